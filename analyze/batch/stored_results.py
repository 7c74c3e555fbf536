"""Read rows of results, and gather them in one file so that a query need not open thousands.

A row's key is a hash of the recording's content, the analysis and its settings: a row never changes except
for its stamps (time and memory used, program version), so gathered rows stay valid. Failures are not
gathered, since a later try may fail for another reason.
"""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

from analyze.batch.result_rows import SCHEMA, read_rows, write_rows
from analyze.batch.worker_messages import FAILURES, ROWS
from schemas.output_file import OutputError

GATHERED = "gathered.parquet"
GATHER_FROM_ROWS = 50
"""number of rows in files of their own from which they are gathered; each takes milliseconds to read"""


def read_results(output: Path, keys: Sequence[str], failures: Sequence[str]) -> pa.Table:
    """Read rows of results and of failures; rows that do not exist are left out.

    If 50 or more of the results are read from files of their own, all results read are also written to
    `gathered.parquet`, from which the next call reads them.

    Args:
        output: folder of the results.
        keys: keys of results, in the order of the rows returned.
        failures: source ids (hashes of URL, size and time of change) of failed recordings.

    Returns:
        Table with a row per result, followed by a row per failure.

    Raises:
        ArchiveError: a row's file is damaged.
    """
    gathered = _read_gathered(output / GATHERED)
    place = {key: i for i, key in enumerate(gathered["key"].to_pylist())}
    alone = [key for key in keys if key not in place and (output / ROWS / f"{key}.parquet").exists()]
    rows = pa.concat_tables([gathered, read_rows([output / ROWS / f"{key}.parquet" for key in alone])])
    place |= {key: len(gathered) + i for i, key in enumerate(alone)}
    found = rows.take(pa.array([place[key] for key in keys if key in place], pa.int64()))
    if len(alone) >= GATHER_FROM_ROWS:
        # Without write permission the rows stay in their own files.
        with contextlib.suppress(OutputError):
            write_rows(found, output / GATHERED)
    paths = [output / FAILURES / f"{name}.parquet" for name in failures]
    return pa.concat_tables([found, read_rows([path for path in paths if path.exists()])])


def _read_gathered(path: Path) -> pa.Table:
    """Read the file of gathered rows; an empty table if it is missing, damaged or has other columns."""
    try:
        table = pq.read_table(path)
        table.validate(full=True)
    except (OSError, pa.ArrowException):
        return SCHEMA.empty_table()
    return table if table.schema.equals(SCHEMA) else SCHEMA.empty_table()
