"""The files for the system, in docs/: systemd's unit and udev's rules."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
from pathlib import Path

import pytest

from tests.places import ROOT

UNIT, RULES = ROOT / "docs/percuss.service", ROOT / "docs/99-percuss.rules"
MATCHES = {"ACTION", "SUBSYSTEM", "DRIVER", "ATTRS", "ENV"}
ASSIGNMENTS = {"ATTR", "GROUP", "MODE", "SYMLINK", "ENV"}


@pytest.mark.skipif(not shutil.which("systemd-analyze"), reason="systemd-analyze is missing")
def test_the_unit_is_valid(tmp_path: Path) -> None:
    """Only its paths must exist, as for a person who has installed it."""
    program = tmp_path / "percuss/.venv/bin/acquire"
    program.parent.mkdir(parents=True)
    program.write_text("#!/bin/sh\n", encoding="utf-8")
    program.chmod(0o755)
    environment = {**os.environ, "HOME": str(tmp_path), "XDG_RUNTIME_DIR": str(tmp_path)}
    done = subprocess.run(
        ["systemd-analyze", "--user", "verify", str(UNIT)],
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, done.stderr) == (0, "")


def test_every_rule_matches_devices_and_assigns_something() -> None:
    rules = [line for line in RULES.read_text(encoding="utf-8").splitlines() if line and line[0] != "#"]
    assert len(rules) >= 8
    for rule in rules:
        found = [re.fullmatch(r'([A-Z]+)(?:\{\w+\})?(==|=|\+=)"([^"]+)"', part) for part in rule.split(", ")]
        assert all(found), rule
        pairs = [(each[1], each[2]) for each in found if each is not None]
        assert all(key in MATCHES for key, operator in pairs if operator == "=="), rule
        assigned = [key for key, operator in pairs if operator != "=="]
        assert assigned, rule
        assert set(assigned) <= ASSIGNMENTS, rule


def test_the_ports_of_the_rules_are_those_of_the_guide() -> None:
    guide = (ROOT / "docs/how-to/hardware.md").read_text(encoding="utf-8")
    for name in set(re.findall(r'SYMLINK\+="([^"]+)"', RULES.read_text(encoding="utf-8"))):
        assert f"/dev/{name}" in guide
    assert "docs/99-percuss.rules" in guide
