"""One short session on the virtual rig for all system tests.

It uses the GigE Vision and Dynamixel protocols on loopback and a pseudo-terminal.
"""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

from tests.loopback import loopback
from tests.system.fault_rig import FaultRig, fault_rig

HANG_S = 210.0
"""time after which a demo of three strikes counts as hung [s]: it takes 40 s on two idle cores, and repeats
strikes that a busy machine spoilt"""


@dataclass(frozen=True)
class Session:
    """A finished demo session."""

    path: Path
    report: dict


@pytest.fixture(scope="session")
def session(tmp_path_factory) -> Session:
    """Demo session of three strikes on the virtual object "carton" with seed 7, run once for all tests."""
    path = tmp_path_factory.mktemp("session") / "carton.mcap"
    command = [
        "acquire",
        "demo",
        "--object",
        "carton",
        "--seed",
        "7",
        "--strikes",
        "3",
        "--address",
        loopback(91),
        "-o",
        str(path),
        "--json",
    ]
    with subprocess.Popen(
        [sys.executable, "-m", *command], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as demo:
        try:
            out, errors = demo.communicate(timeout=HANG_S)
        except subprocess.TimeoutExpired:
            demo.terminate()
            pytest.fail(f"no end after {HANG_S} s:\n{demo.communicate()[1]}")
    assert demo.returncode in {0, 3}, errors
    return Session(path, json.loads(out))


@pytest.fixture
def nothing_left(tmp_path: Path) -> Iterator[None]:
    """Check that no file with a temporary name is left behind."""
    yield
    assert [
        path for path in tmp_path.rglob("*") if path.name.endswith(".part") or path.name.startswith(".")
    ] == []


@pytest.fixture
def rig() -> Iterator[FaultRig]:
    with fault_rig() as rig:
        yield rig
