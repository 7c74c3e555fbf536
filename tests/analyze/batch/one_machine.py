"""Rows of results as one machine gives them, with which those of a cluster are compared."""

from __future__ import annotations

from pathlib import Path

from analyze.batch.archive import find_sources
from analyze.batch.query import read_recording_rows
from analyze.batch.result_rows import STAMPS
from analyze.batch.run import BatchOptions, plan_work, run_batch
from analyze.batch.settings import BatchSettings


def rows_of_one_machine(archive: Path, output: Path) -> list[dict[str, object]]:
    """Analyse an archive with two processes of this machine; its rows."""
    options = BatchOptions(jobs=2)
    work = plan_work(find_sources([str(archive)]), output, BatchSettings(), options)
    run_batch(work, output, BatchSettings(), options)
    return rows(output)


def rows(output: Path) -> list[dict[str, object]]:
    """Rows in the order of their URLs, without the columns that differ from run to run."""
    found = read_recording_rows(output).drop_columns(list(STAMPS)).to_pylist()
    return sorted(found, key=lambda row: row["url"])
