"""Bring the catalogue up to date with the archive: read the heads of new and changed recordings.

No image is read. A recording is not opened if its size and stamp (time of change or ETag) are those of its
row.
"""

from __future__ import annotations

import multiprocessing
import os
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ProcessPoolExecutor, wait
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

from analyze.batch.analysis import failure_kind
from analyze.batch.archive import Source, file_system
from analyze.batch.sparse_copy import sparse_copies
from analyze.catalogue.recording_files import file_exists
from analyze.catalogue.table import Catalogue, Row
from analyze.errors import RecordingCut
from analyze.pipeline.read_evidence import read_open_head
from analyze.progress import Progress, no_progress
from analyze.reading.recording import Recording, open_recording

OK, MISSING = "ok", "missing"
EXACT, LOSSY = "exact", "lossy"
MIN_FOR_PROCESSES = 200
"""number of recordings from which starting processes pays: one takes a second, a head 5 ms"""
_PENDING_PER_PROCESS = 16
SCRUB_COLUMNS = ("scrub", "scrub_reason", "scrubbed_at", "sha256")
"""columns that state what is known of a recording's bytes"""


@dataclass(frozen=True)
class IndexReport:
    """Numbers of recordings that a run of the index found new, changed, unchanged, moved and missing."""

    new: int
    """recordings that had no row"""
    changed: int
    """recordings whose files changed since their row was written"""
    unchanged: int
    """recordings that were not opened"""
    moved: tuple[tuple[str, str], ...]
    """recordings found at another place: earlier and present URL"""
    missing: tuple[str, ...]
    """URLs of recordings that are no longer at their place, nor at another one"""
    forgotten: frozenset[str]
    """those of `missing` whose rows were removed"""
    unreadable: int
    """new or changed recordings that cannot be read; their rows state why"""


def update_index(
    catalogue: Catalogue,
    sources: Sequence[Source],
    places: Sequence[str] = (),
    jobs: int | None = None,
    progress: Progress = no_progress,
    *,
    forget: bool = False,
) -> IndexReport:
    """Add rows of new recordings, renew those of changed ones, and mark those that are missing.

    A recording that was moved keeps what is known of its bytes, if its content and size are the same.

    Args:
        catalogue: rows to change.
        sources: recordings of the archive, from `find_sources`.
        places: folders and buckets that were searched; recordings of a bucket below one of them that were not
            found are missing. Local ones are looked up.
        jobs: number of processes; None for one per core.
        progress: called with (text, recordings read, recordings to read).
        forget: True to remove the rows of recordings missing from a place where others were found; a place
            without any may be a disk that is not there.

    Returns:
        Numbers of rows by what was done.

    Raises:
        OutputError: the catalogue cannot be saved.
    """
    rows = catalogue.rows
    pending = [each for each in sources if not _is_known(catalogue, each)]
    new = {each.url for each in pending if each.url not in rows}
    new_count, changed, unreadable, done = len(new), len(pending) - len(new), 0, 0
    found = {each.url for each in sources}
    gone = [url for url in rows if url not in found and _is_gone(url, places)]
    # What is known of a moved recording's bytes is saved with its new place, in case the index is killed.
    left = {_identity(rows[url]): url for url in gone if rows[url].get("content_id")}
    moved: list[tuple[str, str]] = []
    while pending:
        others: list[Source] = []
        for source, row in _read_rows(pending, jobs):
            done += 1
            progress("reading", done, max(len(pending), done))
            unreadable += row["state"] != OK
            before = left.pop(_identity(row), None) if source.url not in rows and row["state"] == OK else None
            if before is not None:
                row.update(_known_of_bytes(rows.pop(before)))
                moved.append((before, source.url))
            catalogue.set(renewed_row(rows.get(source.url), row))
            # A file of the series' name that belongs to another recording has a row of its own.
            names = row["files"] if row["state"] == OK else ()
            others += [each for each in source.others(names) if each.url not in found]
        found.update(each.url for each in others)
        pending = [each for each in others if not _is_known(catalogue, each)]
        new_count += len(pending)
    _mark_missing(catalogue, [url for url in gone if url in rows])
    missing = tuple(url for url, row in rows.items() if row["state"] == MISSING)
    forgotten = _forget(catalogue, missing, found, places) if forget else frozenset[str]()
    unchanged = len(sources) - len(new) - changed
    return IndexReport(
        new_count - len(moved), changed, unchanged, tuple(moved), missing, forgotten, unreadable
    )


def read_index_row(source: Source) -> Row:
    """Row of one recording, from the head of its files; a failure to read it is stated in the row."""
    row: Row = {
        "url": source.url,
        "files": [each.url.rsplit("/", 1)[-1] for each in source.files],
        "source_id": source.id,
        "state": OK,
    }
    try:
        if source.size == 0:
            raise RecordingCut(f"{source.url}: is empty: nothing of it can be saved: record again")
        with _local_head(source) as path, open_recording(path) as recording:
            row |= _head_columns(recording)
    except Exception as error:  # whatever it is, the other recordings go on
        row |= {"state": failure_kind(error, source), "reason": " ".join(str(error).split())}
        if source.is_local and not Path(source.url).exists():  # removed meanwhile, or a link to nothing
            row |= {"state": MISSING, "reason": f"{source.url}: is no longer there"}
    own = Source(tuple(each for each in source.files if each.url.rsplit("/", 1)[-1] in row["files"]))
    return row | {"files_id": own.id, "size_bytes": own.size}


def renewed_row(before: Row | None, row: Row) -> Row:
    """Row that replaces an earlier one: it keeps what is known of bytes that did not change.

    A recording of which a file is gone is missing, with its earlier row.
    """
    if before is None:
        return row
    if row["state"] == MISSING:
        return before | {"state": MISSING, "reason": row["reason"]}
    if before["files_id"] == row["files_id"]:
        return row | _known_of_bytes(before)
    here = {name.removesuffix(".part") for name in row["files"]}
    gone = [name for name in before["files"] if name.removesuffix(".part") not in here]
    folder = str(row["url"]).rpartition("/")[0]
    if gone and before["recording_id"] and before["recording_id"] == row.get("recording_id"):
        return before | {"state": MISSING, "reason": f"{folder}/{gone[0]}: is no longer there"}
    return row


def _known_of_bytes(row: Row) -> Row:
    """Columns of a row that state what is known of the recording's bytes, which are at their place again."""
    names = SCRUB_COLUMNS if row["scrub"] != MISSING else ("sha256",)
    return {name: row.get(name) for name in names}


@contextmanager
def _local_head(source: Source) -> Iterator[Path]:
    """Path of the recording's first file; of one in a bucket, a copy without images."""
    if source.is_local:
        yield Path(source.url)
        return
    with (
        tempfile.TemporaryDirectory() as folder,
        sparse_copies(source, Path(folder), images=False) as path,
    ):
        yield path


def _is_known(catalogue: Catalogue, source: Source) -> bool:
    row = catalogue.rows.get(source.url)
    return row is not None and row["source_id"] == source.id and row["state"] != MISSING


def _head_columns(recording: Recording) -> Row:
    head, manifest = read_open_head(recording), recording.manifest
    camera = manifest.cameras[0]
    sources = [each.source_content_id for each in recording.compactions]
    return {
        "files": list(head.files),
        "recording_id": manifest.recording_id,
        "created": manifest.created,
        "object": manifest.object.name,
        "object_sha256": manifest.object_sha256,
        "plan_sha256": manifest.plan_sha256,
        "rig": str(manifest.rig.get("name", "")),
        "camera": f"{camera.vendor} {camera.model}".strip(),
        "camera_serial": camera.serial,
        "time_source": manifest.time_source.value,
        "recorded_by": manifest.software,
        "content_id": head.content_id or None,
        # Of a series only one file may be compact: then no single original is known.
        "source_content_id": sources[0] if len(sources) == len(recording.parts) == 1 else None,
        "compaction": (EXACT if all(each.exact for each in recording.compactions) else LOSSY)
        if sources
        else None,
        "rebases": len(manifest.rebased or []),
        "losses": len(head.recovery_losses),
        "strikes": len(head.strike_ids),
        "tosses": len(head.toss_ids),
    }


def _read_rows(sources: Sequence[Source], jobs: int | None) -> Iterator[tuple[Source, Row]]:
    """Yield each recording with its row, as they are read; many are read by several processes."""
    processes = jobs or len(os.sched_getaffinity(0))
    if len(sources) < MIN_FOR_PROCESSES or processes == 1:
        yield from ((each, read_index_row(each)) for each in sources)
        return
    pool = ProcessPoolExecutor(processes, mp_context=multiprocessing.get_context("spawn"))
    try:
        yield from _in_turn(pool, iter(sources), processes * _PENDING_PER_PROCESS)
    finally:
        pool.shutdown(cancel_futures=True)


def _in_turn(pool: Executor, sources: Iterator[Source], most: int) -> Iterator[tuple[Source, Row]]:
    """Yield each recording with its row; at most `most` wait in the pool at a time, which bounds memory."""
    waiting: dict[Future[Row], Source] = {}
    while True:
        for each in islice(sources, most - len(waiting)):
            waiting[pool.submit(read_index_row, each)] = each
        if not waiting:
            return
        for future in wait(waiting, return_when=FIRST_COMPLETED).done:
            yield waiting.pop(future), future.result()


def _mark_missing(catalogue: Catalogue, gone: Iterable[str]) -> None:
    """Mark rows whose recording is gone; that of a `.part` file that was finished since is removed.

    Args:
        catalogue: rows to change.
        gone: URLs of recordings that are no longer at their place.
    """
    rows = catalogue.rows
    for url in gone:
        finished = url.removesuffix(".part")
        if finished != url and finished in rows:
            del rows[url]
        else:
            rows[url] |= {"state": MISSING, "reason": f"{url}: is no longer there"}


def _forget(
    catalogue: Catalogue, missing: Iterable[str], found: Iterable[str], places: Sequence[str]
) -> frozenset[str]:
    """Remove the rows of missing recordings from places where others are; their URLs."""
    present = [url for url in found if catalogue.rows[url]["state"] != MISSING]
    folders = [place if "://" in place else file_system(place)[1] for place in places]
    searched = [folder for folder in folders if any(_is_below(url, folder) for url in present)]
    forgotten = frozenset(url for url in missing if any(_is_below(url, folder) for folder in searched))
    for url in forgotten:
        del catalogue.rows[url]
    return forgotten


def _identity(row: Row) -> tuple[str, int, str]:
    return row["content_id"], row["size_bytes"], row["object_sha256"]


def _is_below(url: str, folder: str) -> bool:
    """True if a recording is in this folder or bucket, or in one below it."""
    return url.startswith(folder.rstrip("/") + "/")


def _is_gone(url: str, places: Sequence[str]) -> bool:
    if "://" not in url:
        return not os.path.lexists(url)
    if not any("://" in place and _is_below(url, place) for place in places):
        return False
    try:
        return not file_exists(url)
    except Exception:  # no network: nothing is known
        return False
