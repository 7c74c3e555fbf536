"""Scrub an archive: read every byte of its recordings, and compare content and files with their hashes.

A recording must be whole and its content that of its seal; and its files must have the SHA-256 of the
previous scrub, unless their size or time of change differ. The second finds damage in files without a seal.
"""

from __future__ import annotations

import errno
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from analyze.batch.archive import Source
from analyze.batch.sparse_copy import sparse_copies
from analyze.catalogue.index import MISSING, OK, read_index_row, renewed_row
from analyze.catalogue.recording_files import current_source, file_exists, file_sha256, file_urls
from analyze.catalogue.table import Catalogue, Row
from analyze.errors import RecordingError
from analyze.progress import Progress, no_progress
from analyze.reading.verify import refuse_changed_content

WHOLE, UNSEALED, UNREADABLE = "whole", "unsealed", "unreadable"
DAMAGED, ALTERED = "damaged", "altered"
UNREAD = "unread"
PROBLEMS = (DAMAGED, ALTERED, MISSING, UNREAD)
"""outcomes after which a recording must be restored from a copy, or read again (unread)"""
_MEGA = 1_000_000


@dataclass(frozen=True)
class ScrubReport:
    """Outcomes of a scrub, and what is left to read."""

    rows: tuple[Row, ...]
    """rows of the recordings that were read, with their outcomes"""
    left: int
    """number of recordings that are due and were not read"""
    size_bytes: int
    """bytes read"""
    interrupted: bool = False
    """True if Ctrl-C ended the scrub"""

    @property
    def problems(self) -> tuple[Row, ...]:
        """Rows of the recordings that are damaged, altered, missing or could not be read."""
        return tuple(row for row in self.rows if row["scrub"] in PROBLEMS)


def scrub(
    catalogue: Catalogue,
    urls: Sequence[str],
    output: Path,
    *,
    seconds: float | None = None,
    older_than_days: float = 0.0,
    progress: Progress = no_progress,
    clock: Callable[[], float] = time.monotonic,
) -> ScrubReport:
    """Read recordings of a catalogue, those first that were not read for the longest time.

    Each outcome is kept in the catalogue, so that a scrub that ended early goes on with the others.

    Args:
        catalogue: rows to change.
        urls: recordings to read.
        output: folder of the results, for copies of recordings in a bucket.
        seconds: time after which no further recording is begun [s]; None for no limit.
        older_than_days: leave out recordings that were read in this many days.
        progress: called with (text, MB read, MB to read).
        clock: seconds since any moment.

    Returns:
        Rows of the recordings read, and the number of those left.

    Raises:
        OutputError: the catalogue cannot be saved.
    """
    due = _due([catalogue.rows[url] for url in urls], older_than_days)
    total, done, start = sum(row["size_bytes"] for row in due), 0, clock()
    read: list[Row] = []
    interrupted = False
    try:
        for row in due:
            if seconds is not None and clock() - start >= seconds:
                break
            progress("scrubbing", done // _MEGA, total // _MEGA)
            found = scrub_recording(row, output)
            if found["scrub"] != UNREAD:  # what is known of it stays, and it is due again
                catalogue.set(found)
            read.append(found)
            done += found["size_bytes"]
    except KeyboardInterrupt:
        interrupted = True
    return ScrubReport(tuple(read), len(due) - len(read), done, interrupted)


def scrub_recording(row: Row, output: Path) -> Row:
    """Read all bytes of one recording; its row with the outcome.

    Args:
        row: row of the catalogue.
        output: folder for the copy of a recording in a bucket.

    Returns:
        The row, read anew if the files changed; `scrub` is "whole", "unsealed" (no content hash to compare
        with: only later changes are found), "unreadable" (not a complete recording; its bytes are compared
        with the previous scrub), "damaged", "altered" (the bytes changed, their size and time did not),
        "missing", or "unread" (its bytes could not be had, or changed meanwhile: nothing is known of them).
    """
    now = datetime.now(UTC).isoformat(timespec="seconds")
    try:
        gone = [url for url in file_urls(row) if not file_exists(url)]
        if gone:
            text = f"{gone[0]}: is no longer there: restore it from a copy"
            return row | {"state": MISSING, "scrub": MISSING, "scrub_reason": text, "scrubbed_at": now}
        source = current_source(file_urls(row))
        same = source.id == row["files_id"] and row["state"] != MISSING
        current = row if same else renewed_row(row, read_index_row(source))
        outcome, reason, hashes = _read(source, current, output)
        if current_source(file_urls(row)).id != source.id:  # it was written to meanwhile
            if current["state"] == OK:
                return _unread(row, f"{row['url']}: changed while it was read: scrub it again")
            outcome, reason, hashes = UNREADABLE, current["reason"], None
    except Exception as error:  # whatever it is, the other recordings go on
        text = f"{row['url']}: {' '.join(str(error).split())}"
        if isinstance(error, OSError) and error.errno == errno.EIO:
            return row | {"scrub": DAMAGED, "scrub_reason": text, "scrubbed_at": now}
        return _unread(row, text)
    # The hash of the bytes as they should be stays: a file that is restored is whole again.
    kept = hashes if outcome not in PROBLEMS else current.get("sha256")
    return current | {"scrub": outcome, "scrub_reason": reason, "scrubbed_at": now, "sha256": kept}


def _unread(row: Row, reason: str) -> Row:
    return row | {"scrub": UNREAD, "scrub_reason": reason}


def _read(source: Source, row: Row, output: Path) -> tuple[str, str | None, list[str] | None]:
    """Read all files: outcome, reason (None if there is nothing to state), and SHA-256 of each file.

    Raises:
        OSError: a file cannot be read.
    """
    try:
        with _local_copy(source, output) as path:
            hashes = [file_sha256(str(path.with_name(name))) for name in row["files"]]
            return *_outcome(row, hashes, path), hashes
    except RecordingError as error:
        return DAMAGED, f"{row['url']}: {' '.join(str(error).split())}", None


def _outcome(row: Row, hashes: Sequence[str], path: Path) -> tuple[str, str | None]:
    """Outcome of a scrub with its reason, None if there is nothing to state."""
    before = row.get("sha256")
    if before and before != list(hashes):
        text = (
            f"{row['url']}: altered: its bytes changed, their size and time did not: restore it from a copy"
        )
        return ALTERED, text
    if row["state"] == "damaged":
        return DAMAGED, row["reason"]
    if row["state"] != OK:
        return UNREADABLE, row["reason"]
    if row["content_id"] is None:
        return UNSEALED, f"{row['url']}: has no seal: only changes after this scrub are found"
    try:
        refuse_changed_content(path)
    except RecordingError as error:
        return DAMAGED, " ".join(str(error).split()).replace(f"{path.parent}/", f"{_folder(row)}/")
    return WHOLE, None


def _due(rows: Sequence[Row], older_than_days: float) -> list[Row]:
    """Rows that were not scrubbed in that many days, the longest not scrubbed first."""
    earliest = max(0.0, time.time() - 86400 * older_than_days)
    latest = datetime.fromtimestamp(earliest, UTC).isoformat(timespec="seconds")
    due = [row for row in rows if row["scrubbed_at"] is None or row["scrubbed_at"] <= latest]
    return sorted(due, key=lambda row: (row["scrubbed_at"] or "", row["url"]))


def _folder(row: Row) -> str:
    return str(row["url"]).rpartition("/")[0]


@contextmanager
def _local_copy(source: Source, output: Path) -> Iterator[Path]:
    if source.is_local:
        yield Path(source.url)
        return
    with (
        tempfile.TemporaryDirectory(dir=output) as folder,
        sparse_copies(source, Path(folder), whole=True) as path,
    ):
        yield path
