"""One short session on the virtual rig for all system tests, over real GigE Vision and real Dynamixel wires."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

from tests.loopback import loopback


@dataclass(frozen=True)
class Session:
    """A finished demo session."""

    path: Path
    report: dict


@pytest.fixture(scope="session")
def session(tmp_path_factory) -> Session:
    """Carton, seed 7, one strike on each of three or more axes."""
    path = tmp_path_factory.mktemp("session") / "carton.mcap"
    command = [
        "acquire",
        "demo",
        "--object",
        "carton",
        "--seed",
        "7",
        "--strikes",
        "4",
        "--address",
        loopback(91),
        "-o",
        str(path),
        "--json",
    ]
    done = subprocess.run([sys.executable, "-m", *command], capture_output=True, text=True, timeout=110, check=False)
    assert done.returncode in {0, 3}, done.stderr
    return Session(path, json.loads(done.stdout))


@pytest.fixture
def nothing_left(tmp_path: Path) -> Iterator[None]:
    """No file with a temporary name outlives a complaint."""
    yield
    assert [path for path in tmp_path.rglob("*") if path.name.endswith(".part") or path.name.startswith(".")] == []
