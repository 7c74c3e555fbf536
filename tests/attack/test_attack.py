"""Short form of `make attack`: some damaged files through the commands."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np

from tests.attack.mutations import damage
from tests.places import ROOT

TRIES = 50
IN_A_PROCESS = f"""
import sys
from pathlib import Path
from tests.attack.files import attack_files
from tests.attack.forked import import_everything
import_everything()
from tests.attack.hostile import attack_by_hostile_files
def show(tally):
    for each in tally.findings:
        print(each)
if __name__ == "__main__":
    attack_files(Path(sys.argv[1]), 4, float("inf"), show, {TRIES})
    attack_by_hostile_files(Path(sys.argv[1]), float("inf"), show, short=True)
"""


def test_damage_depends_on_its_seed_alone() -> None:
    def names(seed: int) -> list[bytes]:
        rng = np.random.default_rng(seed)
        return [damage(b'{"a": 1.5, "b": "c"}' * 20, rng, text=True).data for _ in range(50)]

    assert names(1) == names(1) != names(2)


def test_bad_files_are_refused_in_one_line_or_read_as_they_were(tmp_path: Path) -> None:
    """In a process that has started no threads: its forks would wait for them."""
    script = tmp_path / "attack.py"
    script.write_text(IN_A_PROCESS, encoding="utf-8")
    command = [sys.executable, str(script), str(tmp_path)]
    environment = {
        "PYTHONPATH": str(ROOT),
        "OPENBLAS_NUM_THREADS": "1",
        "XDG_CACHE_HOME": str(tmp_path / "cache"),
    }
    done = subprocess.run(command, capture_output=True, text=True, check=True, env=environment)
    assert done.stdout == "", done.stdout
