"""Table of an archive's recordings, one row each, as a Parquet file that pandas, Polars and DuckDB read."""

from __future__ import annotations

import fcntl
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from analyze.batch.result_rows import conform, write_rows
from analyze.errors import ArchiveError

CATALOGUE = "catalogue.parquet"
LOCK = "catalogue.lock"
SAVE_INTERVAL_S = 20.0
"""time between two savings [s]: as much work is repeated after a kill"""
MAX_SAVING_SHARE = 0.05
"""largest share of the time that is spent on saving"""

_S, _I, _T = pa.string(), pa.int64(), pa.list_(pa.string())
SCHEMA = pa.schema(
    [
        ("url", _S),
        ("files", _T),
        ("size_bytes", _I),
        ("source_id", _S),
        ("files_id", _S),
        ("state", _S),
        ("reason", _S),
        ("recording_id", _S),
        ("created", _S),
        ("object", _S),
        ("object_sha256", _S),
        ("plan_sha256", _S),
        ("rig", _S),
        ("camera", _S),
        ("camera_serial", _S),
        ("time_source", _S),
        ("recorded_by", _S),
        ("content_id", _S),
        ("source_content_id", _S),
        ("compaction", _S),
        ("rebases", _I),
        ("losses", _I),
        ("strikes", _I),
        ("tosses", _I),
        ("scrub", _S),
        ("scrub_reason", _S),
        ("scrubbed_at", _S),
        ("sha256", _T),
    ]
)
"""columns of the catalogue.

`url`: local path or URL of the recording's first file; `files`: names of its files; `source_id`: hash of
URL, size and stamp (time of change or ETag) of all files of the series' name, `files_id` of those that belong
to the recording; `state`: "ok", "missing", or the kind of failure,
with `reason`; `created`: start of the session (ISO 8601, UTC); `content_id`: hash of the messages, from the
seal; `source_content_id` and `compaction` ("exact", "lossy", or empty): of the original that `analyze
compact` replaced; `rebases`: number of changes of the object file after the strikes; `losses`: lines of what
`acquire recover` lost; `scrub`: outcome of the latest reading of all bytes, with `scrub_reason`,
`scrubbed_at` (ISO 8601, UTC) and the SHA-256 of each file.
"""
Row = dict[str, Any]
"""one row: value by column name; None if unknown"""


class Catalogue:
    """The rows of a catalogue in memory, by URL, and their file; a writer holds its lock.

    Args:
        output: folder of the results, in which the catalogue lies.
        rows: rows by URL.
    """

    def __init__(self, output: Path, rows: Mapping[str, Row]) -> None:
        self.rows: dict[str, Row] = dict(rows)
        """rows by URL"""
        self._path = output / CATALOGUE
        self._clock: Callable[[], float] = time.monotonic
        self._next_save = self._clock() + SAVE_INTERVAL_S

    def set(self, row: Row) -> None:
        """Add or replace a row, and save the catalogue if it is time to."""
        self.rows[row["url"]] = row
        if self._clock() >= self._next_save:
            self.save()

    def save(self) -> None:
        """Write all rows into the file, which is replaced as a whole.

        Raises:
            OutputError: the file cannot be written.
        """
        start = self._clock()
        write_rows(self.table(), self._path)
        end = self._clock()
        self._next_save = end + max(SAVE_INTERVAL_S, (end - start) / MAX_SAVING_SHARE)

    def table(self) -> pa.Table:
        """All rows as a table, in the order of their URLs."""
        return pa.Table.from_pylist([self.rows[url] for url in sorted(self.rows)], schema=SCHEMA)


def read_catalogue(output: Path) -> pa.Table:
    """Read the catalogue in a folder of results.

    Returns:
        Table with the columns of `SCHEMA`; columns that the file lacks are null.

    Raises:
        ArchiveError: there is no catalogue, or its file is damaged.
    """
    path = output / CATALOGUE
    if not path.exists():
        raise ArchiveError(
            f"{output}: contains no catalogue: run `analyze archive index PATH --out {output}` first"
        )
    try:
        stored = pq.ParquetFile(path, page_checksum_verification=True).read()
        table = conform(stored, SCHEMA)
        table.validate(full=True)
    except (OSError, pa.ArrowException):
        raise ArchiveError(
            f"{path}: damaged: remove it, then make it anew by `analyze archive index PATH --out {output}`"
        ) from None
    return table


@contextmanager
def open_catalogue(output: Path, *, create: bool = False) -> Iterator[Catalogue]:
    """Open a catalogue to change it; it is saved at the end, also after an error or Ctrl-C.

    Args:
        output: folder of the results.
        create: True to begin a new catalogue where there is none.

    Yields:
        The catalogue, locked against other writers.

    Raises:
        ArchiveError: there is no catalogue, its file is damaged, another process changes it, or the folder
            cannot be written.
        OutputError: the file cannot be written.
    """
    if not create:
        read_catalogue(output)
    with _locked(output):
        rows = read_catalogue(output).to_pylist() if (output / CATALOGUE).exists() else []
        catalogue = Catalogue(output, {row["url"]: row for row in rows})
        try:
            yield catalogue
        finally:
            catalogue.save()


@contextmanager
def _locked(output: Path) -> Iterator[None]:
    try:
        output.mkdir(parents=True, exist_ok=True)
        file = (output / LOCK).open("ab")
    except OSError as error:
        raise ArchiveError(
            f"{output}: cannot be written ({error.strerror}): choose another folder with --out"
        ) from None
    with file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise ArchiveError(
                f"{output}: another command is changing the catalogue: wait for its end, or use another --out"
            ) from None
        yield
