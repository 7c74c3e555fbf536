"""Rows of many recordings in one file, so that a question over thousands does not open thousands of files.

A row's key is a hash of the recording's content, the analysis and its settings: under one key nothing ever changes but stamps, so that what
was gathered stays right. Reasons of failures are not gathered: a recording's next try may have another.
"""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

from analyze.batch.request import FAILURES, ROWS
from analyze.batch.table import SCHEMA, read_rows, write_rows
from analyze.errors import OutputError

GATHERED = "gathered.parquet"
_AGAIN = 50
"""rows that lie alone, from which on they are gathered: each takes some milliseconds to read"""


def read_results(output: Path, keys: Sequence[str], failures: Sequence[str]) -> pa.Table:
    """The rows of results with these keys, and those of failures with these ids of their source; of those that are there.

    Args:
        output: folder of the results.
        keys: in the order of the rows.
        failures: these follow.
    """
    gathered = _gathered(output / GATHERED)
    place = {key: i for i, key in enumerate(gathered["key"].to_pylist())}
    alone = [key for key in keys if key not in place and (output / ROWS / f"{key}.parquet").exists()]
    rows = pa.concat_tables([gathered, read_rows([output / ROWS / f"{key}.parquet" for key in alone])])
    place |= {key: len(gathered) + i for i, key in enumerate(alone)}
    found = rows.take(pa.array([place[key] for key in keys if key in place], pa.int64()))
    if len(alone) >= _AGAIN:
        # Whoever may only read these results reads them one by one.
        with contextlib.suppress(OutputError):
            write_rows(found, output / GATHERED)
    paths = [output / FAILURES / f"{name}.parquet" for name in failures]
    return pa.concat_tables([found, read_rows([path for path in paths if path.exists()])])


def _gathered(path: Path) -> pa.Table:
    """What was gathered; nothing where that is of another version, or damaged."""
    try:
        table = pq.read_table(path)
    except (OSError, pa.ArrowException):
        return SCHEMA.empty_table()
    return table if table.schema.equals(SCHEMA) else SCHEMA.empty_table()
