"""Fixture of a rig on which every check passes."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.acquire.preflight.bench import RIG, Bench


@pytest.fixture
def bench(tmp_path: Path) -> Bench:
    path = tmp_path / "rig.toml"
    path.write_text(RIG.format(folder=tmp_path), encoding="utf-8")
    return Bench(path)
