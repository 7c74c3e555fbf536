"""Fixtures: an archive of two recordings of one object and a broken file of each kind, and a run over it."""

from __future__ import annotations

from pathlib import Path

import pytest

from analyze.batch.archive import find_sources
from analyze.batch.run import BatchOptions, plan_work, run_batch
from analyze.batch.settings import BatchSettings
from tests.broken_files import KINDS, break_file
from tests.quick_archive import body_of, quick_session


@pytest.fixture(scope="session")
def archive(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("archive")
    (folder / "a").mkdir()
    for number in range(2):
        quick_session(folder / "a" / f"session-{number}.mcap", body_of(0), number, 3, packed=True)
    other = tmp_path_factory.mktemp("whole") / "other.mcap"
    quick_session(other, body_of(0), 9, 1, packed=True)
    for kind in KINDS:
        break_file(other, folder, kind)
    return folder


@pytest.fixture(scope="session")
def finished(archive, tmp_path_factory):
    """Folder of the results, and report of the run, as a pair."""
    output = tmp_path_factory.mktemp("results") / "out"
    output.mkdir()
    settings, options = BatchSettings(), BatchOptions(jobs=2)
    work = plan_work(find_sources([str(archive)]), output, settings, options)
    return output, run_batch(work, output, settings, options)
