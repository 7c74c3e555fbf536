"""The documented recipes for Slurm, run as they are on a private cluster that loses one of two nodes."""

from __future__ import annotations

import shutil
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tests.analyze.batch.one_machine import rows, rows_of_one_machine
from tests.broken_files import KINDS, break_file
from tests.places import ROOT
from tests.quick_archive import body_of, quick_session
from tests.slurm import Slurm, missing, slurm

pytestmark = [
    pytest.mark.slow,
    pytest.mark.timeout(600),
    pytest.mark.skipif(bool(missing()), reason=f"Slurm cannot be started: {missing()}"),
]

RECIPES = ROOT / "docs" / "examples" / "cluster"
WHOLE, SHORT = 30, 150
"""recordings of three strikes, which give a result, and of one, which give a failure with its reason"""


@pytest.fixture(scope="module")
def archive(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("many")
    for number in range(WHOLE + SHORT):
        strikes = 3 if number < WHOLE else 1
        quick_session(
            folder / f"session-{number:03d}.mcap", body_of(number % 3), number, strikes, packed=True
        )
    for number in range(2):
        for kind in KINDS:
            break_file(folder / f"session-{WHOLE:03d}.mcap", folder, kind, number)
    return folder


@pytest.fixture(scope="module")
def expected(archive, tmp_path_factory):
    """Rows of one machine."""
    found = rows_of_one_machine(archive, tmp_path_factory.mktemp("results") / "out")
    assert len(found) == WHOLE + SHORT + 2 * len(KINDS)
    return found


def environment(cluster: Slurm) -> dict[str, str]:
    """Environment of the recipes: this installation's commands, workers on loopback."""
    path = f"{Path(sys.executable).parent}:{cluster.environment['PATH']}"
    own = {"PATH": path, "PYTHONPATH": str(ROOT), "DASK_JOBQUEUE__SLURM__INTERFACE": "lo"}
    return cluster.environment | own


def wait_for_rows(output: Path, number: int, process: subprocess.Popen[str] | None = None) -> None:
    ends = time.monotonic() + 240
    while len(list(output.glob("[rf]*s/*.parquet"))) < number:
        assert time.monotonic() < ends
        assert process is None or process.poll() is None, process.communicate()
        time.sleep(0.1)


def test_dask_jobqueue_survives_a_lost_node(archive, expected, tmp_path):
    output = tmp_path / "out"
    with slurm(tmp_path / "slurm") as cluster:
        process = subprocess.Popen(
            [sys.executable, str(RECIPES / "slurm_dask.py"), str(archive), str(output), "2"],
            env=environment(cluster),
            cwd=tmp_path,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        try:
            wait_for_rows(output, 40, process)
            hosts = {path.name.split("-")[0] for path in (output / "unfinished").iterdir()}
            cluster.lose("node1")
            printed, errors = process.communicate(timeout=400)
        finally:
            process.kill()
        assert process.returncode == 3, errors
        assert cluster.queue() == []
    assert {"node1", "node2"} <= hosts
    assert printed.startswith(f"{WHOLE} analysed, 0 unchanged, "), errors
    assert rows(output) == expected


def test_array_job_survives_a_lost_node_and_a_killed_task(archive, expected, tmp_path):
    """The lost node's task is requeued by Slurm; the killed one by the user, as the page says."""
    part, output = tmp_path / "part", tmp_path / "out"
    part.mkdir()
    for path in sorted(archive.glob("session-*"))[::3] + sorted(archive.glob("broken-*")):
        shutil.copy2(path, part)
    with slurm(tmp_path / "slurm", cpus=4, memory_mb=20_000) as cluster:
        sbatch = ["sbatch", "--parsable", str(RECIPES / "slurm_array.sh"), str(part), str(output)]

        def submit(*options: str) -> str:
            words = [sbatch[0], *options, *sbatch[1:]]
            done = subprocess.run(
                words, env=environment(cluster), cwd=tmp_path, capture_output=True, text=True, check=True
            )
            return done.stdout.strip()

        def wait_for_end() -> None:
            ends = time.monotonic() + 400
            while cluster.queue():
                assert time.monotonic() < ends, cluster.queue()
                time.sleep(0.2)

        submit()
        wait_for_rows(output, 3)
        (lost,) = [line.split()[0] for line in cluster.queue() if line.endswith("RUNNING node1")]
        cluster.lose("node1")
        killed, _, _ = next(line for line in cluster.queue() if line.endswith("RUNNING node2")).split()
        cluster.command("scancel", "--batch", "--signal=KILL", killed)
        ends = time.monotonic() + 30
        while any(line.startswith(f"{killed} RUNNING") for line in cluster.queue()):
            assert time.monotonic() < ends
            time.sleep(0.1)
        cluster.command("scontrol", "requeue", killed)
        wait_for_end()
        assert "Restarts=1" in cluster.command("scontrol", "show", "job", lost)
        assert "Restarts=1" in cluster.command("scontrol", "show", "job", killed)
        assert len(list((output / "ledger").glob("*-of-20.jsonl"))) == 20
        assert here(output) == there(expected, archive, part)
        again = submit("--array=2,20")
        wait_for_end()
        printed = (tmp_path / f"slurm-{again}_20.out").read_text()
        assert printed.startswith("0 analysed, "), printed


def here(output: Path) -> list[dict[str, object]]:
    """Rows without what depends on the recording's place."""
    return [{**row, "url": Path(str(row["url"])).name, "source_id": "", "reason": ""} for row in rows(output)]


def there(expected: list[dict[str, object]], archive: Path, part: Path) -> list[dict[str, object]]:
    """The expected rows of the recordings in the folder `part`, without what depends on the place."""
    names = {path.name for path in part.iterdir()}
    return [
        {**row, "url": Path(str(row["url"])).name, "source_id": "", "reason": ""}
        for row in expected
        if Path(str(row["url"])).name in names
    ]
