"""Fixtures: an archive with two folders, a copy, and damaged files, and its catalogue."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from tests.analyze.catalogue.steps import NUMBERS, index
from tests.broken_files import break_file
from tests.quick_archive import body_of, quick_session


@pytest.fixture(scope="module")
def recordings(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("recordings")
    for number in NUMBERS:
        quick_session(folder / f"session-{number}.mcap", body_of(number), number, 3, packed=True)
    return folder


@pytest.fixture
def archive(recordings, tmp_path) -> Path:
    """An archive of its own with two folders, a copy of one session, and damaged files."""
    folder = tmp_path / "archive"
    (folder / "lab").mkdir(parents=True)
    for number in NUMBERS:
        name = f"session-{number}.mcap"
        shutil.copy(recordings / name, folder / ("lab" if number % 2 else "") / name)
    shutil.copy(recordings / "session-0.mcap", folder / "lab" / "copy.mcap")
    for kind in ("cut", "text", "empty", "part", "wrong_byte"):
        break_file(recordings / "session-0.mcap", folder, kind)
    return folder


@pytest.fixture
def output(archive, tmp_path) -> Path:
    """Folder of results with the catalogue of the archive."""
    index(archive, tmp_path / "results")
    return tmp_path / "results"
