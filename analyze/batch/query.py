"""Results queried in SQL (DuckDB): tables `recordings`, `strikes`, `moments`, `regions`, `warnings`."""

from __future__ import annotations

from itertools import count
from pathlib import Path

import duckdb
import pyarrow as pa

from analyze.batch.ledger import read_ledgers
from analyze.batch.stored_results import read_results
from analyze.errors import ArchiveError

LIST_TABLES = ("strikes", "moments", "regions", "warnings")
"""list columns that are also tables, each row with its recording's key and object"""


def read_recording_rows(output: Path) -> pa.Table:
    """Table with one row per recording, in the order of their URLs, failures last.

    Copies of the same recording share a row.

    Raises:
        ArchiveError: there are no results.
    """
    entries = read_ledgers(output)
    if not entries:
        raise ArchiveError(f"{output}: contains no results: run `analyze batch PATH --out {output}` first")
    ordered = [entry for _, entry in sorted(entries.items())]
    return read_results(
        output,
        list(dict.fromkeys(entry.key for entry in ordered if entry.key)),
        list(dict.fromkeys(entry.source_id for entry in ordered if not entry.key)),
    )


def run_query(output: Path, sql: str) -> pa.Table:
    """Answer to an SQL query, which can read the result tables and nothing else.

    Raises:
        ArchiveError: there are no results, or the query is not valid.
    """
    with connect(read_recording_rows(output)) as connection:
        try:
            relation = connection.sql(sql)
            # DuckDB runs the query only here.
            return _SCHEMALESS if relation is None else _unique_and_typed(relation.to_arrow_table())
        except duckdb.Error as error:
            raise ArchiveError(f"query: {' '.join(str(error).split())}") from None


_SCHEMALESS = pa.table({})


def _unique_and_typed(answer: pa.Table) -> pa.Table:
    """The answer with unique column names, and with integer sums as integers.

    Two joined tables may share names; DuckDB returns sums of integers as decimals.
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


def connect(recordings: pa.Table) -> duckdb.DuckDBPyConnection:
    """Connection to a database in memory with the tables, and without access to the disk or the network."""
    connection = duckdb.connect(":memory:")
    connection.register("recordings_given", recordings)
    connection.execute("create table recordings as select * from recordings_given")
    for name in LIST_TABLES:
        connection.execute(
            f"create view {name} as select recordings.key, object, url, created, "  # noqa: S608
            f"unnest({name}, recursive := true) from recordings"
        )
    connection.unregister("recordings_given")
    connection.execute("set enable_external_access = false")
    connection.execute("set lock_configuration = true")
    return connection
