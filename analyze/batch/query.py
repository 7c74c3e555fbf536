"""Results as tables, asked in SQL (DuckDB): `recordings`, `strikes`, `moments`, `regions`, `warnings`."""

from __future__ import annotations

from pathlib import Path

import duckdb
import pyarrow as pa

from analyze.batch.ledger import read_ledgers
from analyze.batch.request import FAILURES, ROWS
from analyze.batch.table import read_rows
from analyze.errors import ArchiveError

LISTS = ("strikes", "moments", "regions", "warnings")
"""columns of lists that are tables as well, each row with its recording's key and object"""


def rows_of(output: Path) -> pa.Table:
    """Every recording's row, in the order of their places; of one that lies in several places once.

    Raises:
        ArchiveError: there are no results.
    """
    entries = read_ledgers(output)
    if not entries:
        raise ArchiveError(f"{output}: holds no results: run `analyze batch PATH --out {output}` first")
    names = dict.fromkeys(f"{ROWS}/{entry.key}" if entry.key else f"{FAILURES}/{entry.source_id}" for _, entry in sorted(entries.items()))
    paths = [output / f"{name}.parquet" for name in names]
    return read_rows([path for path in paths if path.exists()])


def ask(output: Path, sql: str) -> pa.Table:
    """The answer to an SQL question; it reaches nothing but these tables.

    Raises:
        ArchiveError: there are no results, or the question is none.
    """
    with connected(rows_of(output)) as connection:
        try:
            relation = connection.sql(sql)
        except duckdb.Error as error:
            raise ArchiveError(f"query: {' '.join(str(error).split())}") from None
        return SCHEMALESS if relation is None else relation.to_arrow_table()


SCHEMALESS = pa.table({})


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
