"""Results as tables, asked in SQL (DuckDB): `recordings`, `strikes`, `moments`, `regions`, `warnings`."""

from __future__ import annotations

from itertools import count
from pathlib import Path

import duckdb
import pyarrow as pa

from analyze.batch.gathered import read_results
from analyze.batch.ledger import read_ledgers
from analyze.errors import ArchiveError

LISTS = ("strikes", "moments", "regions", "warnings")
"""columns of lists that are tables as well, each row with its recording's key and object"""


def rows_of(output: Path) -> pa.Table:
    """Every recording's row, in the order of their places, those that failed last; of one that lies in several places once.

    Raises:
        ArchiveError: there are no results.
    """
    entries = read_ledgers(output)
    if not entries:
        raise ArchiveError(f"{output}: holds no results: run `analyze batch PATH --out {output}` first")
    ordered = [entry for _, entry in sorted(entries.items())]
    return read_results(
        output,
        list(dict.fromkeys(entry.key for entry in ordered if entry.key)),
        list(dict.fromkeys(entry.source_id for entry in ordered if not entry.key)),
    )


def ask(output: Path, sql: str) -> pa.Table:
    """The answer to an SQL question; it reaches nothing but these tables.

    Raises:
        ArchiveError: there are no results, or the question is none.
    """
    with connected(rows_of(output)) as connection:
        try:
            relation = connection.sql(sql)
            # What the question asks for is only computed here.
            return _SCHEMALESS if relation is None else _plain(relation.to_arrow_table())
        except duckdb.Error as error:
            raise ArchiveError(f"query: {' '.join(str(error).split())}") from None


_SCHEMALESS = pa.table({})


def _plain(answer: pa.Table) -> pa.Table:
    """With names that differ (two tables joined may share some), and sums of integers as integers, which DuckDB gives as decimals."""
    names: list[str] = []
    for name in answer.column_names:
        free = (f"{name}_{again}" if again else name for again in count())
        names.append(next(each for each in free if each not in names))
    columns = [_of_decimals(column) if pa.types.is_decimal(column.type) else column for column in answer.columns]
    return pa.table(columns, names=names)


def _of_decimals(column: pa.ChunkedArray) -> pa.ChunkedArray:
    try:
        return column.cast(pa.int64())
    except pa.ArrowInvalid:
        return column.cast(pa.float64())


def connected(recordings: pa.Table) -> duckdb.DuckDBPyConnection:
    """A connection with the tables in it, and no way to the disk or the network."""
    connection = duckdb.connect(":memory:")
    connection.register("recordings_given", recordings)
    connection.execute("create table recordings as select * from recordings_given")
    for name in LISTS:
        connection.execute(
            f"create view {name} as select recordings.key, object, url, created, unnest({name}, recursive := true) from recordings"  # noqa: S608 - of LISTS
        )
    connection.unregister("recordings_given")
    connection.execute("set enable_external_access = false")
    connection.execute("set lock_configuration = true")
    return connection
