"""Query the results of a batch in SQL (DuckDB).

Tables: `recordings`, one row per recording, and `strikes`, `moments`, `regions` and `warnings`, one row per
entry of the recordings' lists of that name.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from itertools import count
from pathlib import Path

import duckdb
import pyarrow as pa

from analyze.batch.ledger import read_ledgers
from analyze.batch.stored_results import gather_rows, is_one_select, open_results, read_results
from analyze.errors import ArchiveError

LIST_TABLES = ("strikes", "moments", "regions", "warnings")
"""list columns that are also tables, each row with its recording's key and object"""


@contextmanager
def open_recording_rows(output: Path) -> Iterator[duckdb.DuckDBPyConnection]:
    """Open the results of a batch in SQL: the view `recordings`, and a view for each of `LIST_TABLES`.

    Copies of the same recording share a row; a recording whose row is missing is left out.

    Args:
        output: folder of the results.

    Yields:
        Database in memory that can read these tables and nothing else; the table `row_order` states the rows'
        places in the order of the recordings' URLs, failures last.

    Raises:
        ArchiveError: there are no results, or a row's file is damaged.
    """
    keys, failures = _row_ids(output)
    with open_results(output, keys, failures) as connection:
        for name in LIST_TABLES:
            connection.execute(
                f"create view {name} as select recordings.key, object, url, created, "  # noqa: S608
                f"unnest({name}, recursive := true) from recordings"
            )
        connection.execute("set lock_configuration = true")
        yield connection


def gather_results(output: Path) -> None:
    """Gather the rows of a batch in few files, so that the first query need not open thousands.

    Raises:
        ArchiveError: a row's file is damaged.
    """
    gather_rows(output, [entry.key for entry in read_ledgers(output).values() if entry.key])


def read_recording_rows(output: Path, leave_out: Sequence[str] = ()) -> pa.Table:
    """Read the results of a batch: one row per recording in the order of their URLs, failures last.

    Copies of the same recording share a row; a recording whose row is missing is left out.

    Args:
        output: folder of the results.
        leave_out: columns that are not read, such as `BULKY_COLUMNS`, nearly all of the memory.

    Returns:
        Table with the other columns of `result_rows.SCHEMA`.

    Raises:
        ArchiveError: there are no results, or a row's file is damaged.
    """
    return read_results(output, *_row_ids(output), leave_out)


def read_result_texts(output: Path, keys: Sequence[str]) -> dict[str, str]:
    """Results in JSON by their key, of those of these keys that are stored.

    Raises:
        ArchiveError: a row's file is damaged.
    """
    with open_results(output, keys, []) as connection:
        return dict(connection.sql("select key, result_json from recordings").fetchall())


def _row_ids(output: Path) -> tuple[list[str], list[str]]:
    """Keys of the results and source ids of the failures, each in the order of the recordings' URLs."""
    entries = read_ledgers(output)
    if not entries:
        raise ArchiveError(f"{output}: contains no results: run `analyze batch PATH --out {output}` first")
    ordered = [entry for _, entry in sorted(entries.items())]
    keys = dict.fromkeys(entry.key for entry in ordered if entry.key)
    failures = dict.fromkeys(entry.source_id for entry in ordered if not entry.key)
    return list(keys), list(failures)


def run_query(output: Path, sql: str) -> pa.Table:
    """Run an SQL query, which can read the tables of the results and nothing else.

    Args:
        output: folder of the results.
        sql: the query: one statement that reads.

    Returns:
        Table of the query's rows, with unique column names; empty if the text has no statement.

    Raises:
        ArchiveError: there are no results, a row's file is damaged, or the query is not valid or fails.
    """
    with open_recording_rows(output) as connection:
        try:
            if not is_one_select(connection, sql):
                raise ArchiveError(
                    "query: is not one statement that reads: begin it with SELECT, FROM, WITH, DESCRIBE or "
                    "PIVOT"
                )
            relation = connection.sql(sql)
            # DuckDB runs the query only here.
            return _SCHEMALESS if relation is None else _unique_and_typed(relation.to_arrow_table())
        except duckdb.Error as error:
            raise ArchiveError(f"query: {' '.join(str(error).split())}") from None


_SCHEMALESS = pa.table({})


def _unique_and_typed(answer: pa.Table) -> pa.Table:
    """Query result with unique column names, and decimal columns as integers, or as floats if not whole.

    Two joined tables may share names: later ones get `_1`, `_2`, ... appended. DuckDB returns sums of
    integers as decimals.
    """
    names: list[str] = []
    for name in answer.column_names:
        free = (f"{name}_{again}" if again else name for again in count())
        names.append(next(each for each in free if each not in names))
    columns = [
        _integers_if_whole(column) if pa.types.is_decimal(column.type) else column
        for column in answer.columns
    ]
    return pa.table(columns, names=names)


def _integers_if_whole(column: pa.ChunkedArray) -> pa.ChunkedArray:
    try:
        return column.cast(pa.int64())
    except pa.ArrowInvalid:
        return column.cast(pa.float64())
