"""Results of an archive in SQL, read where they lie; rows of thousands of files gathered in few.

A row's key is a hash of the recording's content, the analysis and its settings: a row never changes except
for its stamps (time and memory used, program version), so gathered rows stay valid. Failures are not
gathered, since a later try may fail for another reason. The gathered files are made from those of the single
rows, which stay.
"""

from __future__ import annotations

import contextlib
import fcntl
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from itertools import count
from pathlib import Path

import duckdb
import pyarrow as pa
import pyarrow.parquet as pq

from analyze.batch.result_rows import SCHEMA, read_rows, write_rows
from analyze.batch.worker_messages import FAILURES, ROWS
from schemas.output_file import OutputError

GATHERED = "gathered"
"""folder of the gathered rows"""
GATHER_FROM_ROWS = 50
"""number of rows in files of their own from which they are gathered; each takes milliseconds to read"""
MAX_PART_ROWS = 5000
"""largest number of rows in a gathered file, which is held in memory while it is written"""
_LOCK = "lock"
_GLOB_SIGNS = "*?["
"""signs in a path that the database takes for a glob, without a way to escape them"""


@contextmanager
def open_results(
    output: Path, keys: Sequence[str], failures: Sequence[str]
) -> Iterator[duckdb.DuckDBPyConnection]:
    """Open the view `recordings` of rows of results and failures; rows that do not exist are left out.

    Its columns are those of `SCHEMA`; only those that a query names are read. If 50 or more of the results
    are in files of their own, they are gathered first.

    Args:
        output: folder of the results.
        keys: keys of results.
        failures: source ids (hashes of URL, size and time of change) of failed recordings.

    Yields:
        Database in memory that can read these tables and nothing else; the table `row_order` has the `place`
        of each row in the order given, by its `id`: key, or source id of a failure.

    Raises:
        ArchiveError: a row's file is damaged.
    """
    gather_rows(output, keys)
    with _read_lock(output):
        parts = _parts(output)
        single = _single_rows(output, keys, parts)
        failed = [output / FAILURES / f"{name}.parquet" for name in failures]
        others = read_rows([*single, *(path for path in failed if path.exists())])
        with duckdb.connect(":memory:") as connection:
            _create_view(connection, keys, failures, list(parts), others)
            yield connection


def read_results(
    output: Path, keys: Sequence[str], failures: Sequence[str], leave_out: Sequence[str] = ()
) -> pa.Table:
    """Read rows of results and of failures, in the order given; rows that do not exist are left out.

    Args:
        output: folder of the results.
        keys: keys of results.
        failures: source ids of failed recordings.
        leave_out: columns of `SCHEMA` that are not read.

    Raises:
        ArchiveError: a row's file is damaged.
    """
    fields = [field for field in SCHEMA if field.name not in leave_out]
    names = ", ".join(f"recordings.{field.name}" for field in fields)
    with open_results(output, keys, failures) as connection:
        found = connection.sql(
            f"select {names} from recordings "  # noqa: S608 - names of columns
            "join row_order on row_order.id = coalesce(key, source_id) order by place"
        ).to_arrow_table()
    return found.cast(pa.schema(fields))


def _create_view(
    connection: duckdb.DuckDBPyConnection,
    keys: Sequence[str],
    failures: Sequence[str],
    parts: Sequence[Path],
    others: pa.Table,
) -> None:
    ids = [*keys, *failures]
    order = pa.table({"id": pa.array(ids, pa.string()), "place": pa.array(range(len(ids)), pa.int64())})
    connection.register("order_given", order)
    connection.execute("create table row_order as select * from order_given")
    connection.unregister("order_given")
    connection.register("others_given", others)
    connection.execute("create table others as select * from others_given")
    connection.unregister("others_given")
    view = "select * from others"
    if parts:
        names = ", ".join(_quoted(path) for path in parts)
        connection.execute(f"set allowed_paths = [{names}]")
        # A folder named as "object=cube" would give a column of that name.
        files = f"read_parquet([{names}], union_by_name = true, hive_partitioning = false)"
        wanted = "key in (select id from row_order)"
        view = f"select * from {files} where {wanted} union all by name {view}"  # noqa: S608
    connection.execute(f"create view recordings as {view}")
    connection.execute("set enable_external_access = false")


def is_one_select(connection: duckdb.DuckDBPyConnection, sql: str) -> bool:
    """True if the text is a single statement that only reads (SELECT, FROM, WITH, DESCRIBE, PIVOT, ...).

    Other statements could write into the gathered files, which the database may open.

    Raises:
        duckdb.Error: the text is not valid SQL.
    """
    connection.extract_statements(sql)
    # A COPY that is part of a WITH clause writes, too.
    data = sql.encode(errors="replace")
    starts = [start for start, kind in duckdb.tokenize(sql) if kind == duckdb.token_type.keyword]
    if any(data[start : start + 4].lower() == b"copy" for start in starts):
        return False
    try:
        # In parentheses only a statement that reads is valid.
        wrapped = f"select * from ({sql.strip().rstrip(';')}\n)"  # noqa: S608 - not run
        return len(connection.extract_statements(wrapped)) == 1
    except duckdb.ParserException:
        return False


def _quoted(path: Path) -> str:
    return "'" + str(path.absolute()).replace("'", "''") + "'"


def _single_rows(output: Path, keys: Sequence[str], parts: dict[Path, set[str]]) -> list[Path]:
    """Files of those rows that are not gathered."""
    gathered = set().union(*parts.values())
    paths = [output / ROWS / f"{key}.parquet" for key in keys if key not in gathered]
    return [path for path in paths if path.exists()]


def _parts(output: Path) -> dict[Path, set[str]]:
    """Gathered files with the keys of their rows; one that is damaged, or has other columns, is left out.

    Columns may be missing, which an older version did not write. A file with a row that another one has, as
    an interrupted gathering leaves it, is left out too. None is used in a folder whose path the database
    would take for a glob.
    """
    if any(sign in str(output.absolute()) for sign in _GLOB_SIGNS):
        return {}
    found: dict[Path, set[str]] = {}
    known = {field.name: field for field in SCHEMA}
    for path in sorted((output / GATHERED).glob("*.parquet")):
        try:
            if not all(known.get(field.name) == field for field in pq.read_schema(path)):
                continue
            keys = set(pq.ParquetFile(path).read(columns=["key"]).column("key").to_pylist())
        except (OSError, pa.ArrowException):
            continue
        if all(keys.isdisjoint(others) for others in found.values()):
            found[path] = keys
    return found


def gather_rows(output: Path, keys: Sequence[str]) -> None:
    """Gather rows from 50 files of their own, or more, into files of many rows, so that queries open few.

    Nothing is done while another process reads or gathers, or if the folder cannot be written.

    Args:
        output: folder of the results.
        keys: keys of results; those that are gathered already are left out.

    Raises:
        ArchiveError: a row's file is damaged.
    """
    if any(sign in str(output.absolute()) for sign in _GLOB_SIGNS):
        return
    if len(_single_rows(output, keys, _parts(output))) < GATHER_FROM_ROWS:
        return
    with contextlib.suppress(OutputError, OSError), _write_lock(output):
        parts = _parts(output)
        for path in (output / GATHERED).glob("*.parquet"):
            if path not in parts:
                path.unlink()
        small = [path for path, own in parts.items() if len(own) < MAX_PART_ROWS]
        _write_parts([*small, *_single_rows(output, keys, parts)], output / GATHERED)
        for path in small:
            path.unlink()


def _write_parts(paths: Sequence[Path], folder: Path) -> None:
    """Write the rows of these files into new ones of about `MAX_PART_ROWS` rows."""
    numbers = (number for number in count() if not (folder / f"{number:06d}.parquet").exists())
    waiting: list[pa.Table] = []
    for done, path in enumerate(paths, 1):
        waiting.append(read_rows([path]))
        if sum(map(len, waiting)) >= MAX_PART_ROWS or done == len(paths):
            write_rows(pa.concat_tables(waiting), folder / f"{next(numbers):06d}.parquet")
            waiting.clear()


@contextmanager
def _read_lock(output: Path) -> Iterator[None]:
    """Keep the gathered files from being removed meanwhile; nothing is locked in a read-only folder."""
    with contextlib.ExitStack() as stack:
        with contextlib.suppress(OSError):
            (output / GATHERED).mkdir(exist_ok=True)
            stack.enter_context(_locked(output, fcntl.LOCK_SH))
        yield


@contextmanager
def _write_lock(output: Path) -> Iterator[None]:
    """Keep others from reading or writing the gathered files.

    Raises:
        OSError: another process does, or the folder cannot be written.
    """
    (output / GATHERED).mkdir(exist_ok=True)
    with _locked(output, fcntl.LOCK_EX | fcntl.LOCK_NB):
        yield


@contextmanager
def _locked(output: Path, operation: int) -> Iterator[None]:
    with (output / GATHERED / _LOCK).open("ab") as file:
        fcntl.flock(file, operation)
        yield
