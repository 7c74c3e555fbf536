"""The rig of the contract tests with `-m hardware`: PERCUSS_RIG names its file."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import pytest

from acquire.config import read_rig
from acquire.errors import ConfigError
from schemas.rig import RigConfig


@pytest.fixture
def real_rig() -> Callable[[], RigConfig]:
    """Factory of the configuration in PERCUSS_RIG; only tests that need the rig file call it."""

    def read() -> RigConfig:
        path = os.environ.get("PERCUSS_RIG")
        if not path:
            pytest.fail(
                "no rig given: PERCUSS_RIG=rig.toml pytest tests/contracts -m hardware "
                "(docs/how-to/hardware.md)",
                pytrace=False,
            )
        try:
            return read_rig(Path(path))
        except ConfigError as error:
            pytest.fail(f"PERCUSS_RIG={path}: {error}", pytrace=False)

    return read
