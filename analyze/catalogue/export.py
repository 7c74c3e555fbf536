"""Copy a part of an archive, with answers and checksums, into a folder that is an archive of its own."""

from __future__ import annotations

import hashlib
import os
import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

import pyarrow as pa
from fsspec.core import url_to_fs

from analyze.batch.archive import find_sources
from analyze.batch.result_rows import write_rows
from analyze.batch.worker_messages import ROWS
from analyze.catalogue.index import read_index_row
from analyze.catalogue.recording_files import file_sha256, file_urls
from analyze.catalogue.table import CATALOGUE, SCHEMA, Row
from analyze.errors import ArchiveError
from analyze.progress import Progress, no_progress
from schemas.output_file import write_text

SUMS, RESULTS = "SHA256SUMS", "results"
_BLOCK_BYTES = 1 << 22
_MEGA = 1_000_000


@dataclass(frozen=True)
class ExportReport:
    """Numbers of an export."""

    copied: int
    """files copied"""
    present: int
    """files that were there already, with the same bytes"""
    answers: int
    """rows of results copied"""
    size_bytes: int
    """size of all recordings of the export [bytes]"""


def export_recordings(
    rows: Sequence[Row],
    keys: Sequence[str],
    output: Path,
    folder: Path,
    progress: Progress = no_progress,
) -> ExportReport:
    """Copy recordings and their rows of results into a folder; what is there already is not copied again.

    The folder holds the recordings with their paths below their common folder, `SHA256SUMS` of all of them
    (checked by `sha256sum -c SHA256SUMS`), and `results/` with the catalogue and the rows of results, so that
    `analyze batch FOLDER --out FOLDER/results` analyses nothing anew.

    Args:
        rows: rows of the recordings in the catalogue.
        keys: keys of their rows of results.
        output: folder of the results.
        folder: where to copy to; created if missing.
        progress: called with (text, MB done, MB in all).

    Returns:
        Numbers of files copied, files present, and rows of results.

    Raises:
        ArchiveError: the disk has not enough room, a file of another content is in the way, or a recording
            changed while it was copied or differs from its scrub.
        OSError: a file cannot be read or written.
    """
    urls = [url for row in rows for url in file_urls(row)]
    names = _names_below(urls)
    sizes = {url: _size(url) for url in urls}
    total = sum(sizes.values())
    _refuse_full_disk(folder, [(folder / names[url], sizes[url]) for url in urls])
    known = {url: sha for row in rows for url, sha in zip(file_urls(row), row["sha256"] or [], strict=False)}
    sums: dict[str, str] = {}
    copied = done = 0
    for url in urls:
        progress("copying", done // _MEGA, total // _MEGA)
        target = folder / names[url]
        there = file_sha256(str(target.absolute())) if target.exists() else None
        source_sum = known.get(url) if there is None else file_sha256(url)
        if there is not None and there != source_sum:
            raise ArchiveError(f"{target}: is there with other content: name another folder")
        if there is None:
            there = _copy(url, target, source_sum)
            copied += 1
        sums[names[url]] = there
        done += sizes[url]
    write_text(folder / SUMS, "".join(f"{value}  {name}\n" for name, value in sorted(sums.items())))
    answers = _copy_answers(keys, output, folder / RESULTS)
    places = [str((folder / names[file_urls(row)[0]]).absolute()) for row in rows]
    _write_catalogue(rows, places, folder / RESULTS)
    return ExportReport(copied, len(urls) - copied, answers, total)


def _copy(url: str, target: Path, expected: str | None) -> str:
    """Copy a file, which appears whole or not at all; the SHA-256 of its bytes.

    Raises:
        ArchiveError: the bytes are not those of the scrub.
        OSError: it cannot be read or written.
    """
    target.parent.mkdir(parents=True, exist_ok=True)
    part = target.with_name(target.name + ".copying")
    digest = hashlib.sha256()
    system, path = url_to_fs(url)
    try:
        with system.open(path, "rb") as source, part.open("wb") as copy:
            while block := source.read(_BLOCK_BYTES):
                digest.update(block)
                copy.write(block)
            copy.flush()
            os.fsync(copy.fileno())
        if expected is not None and digest.hexdigest() != expected:
            raise ArchiveError(
                f"{url}: its bytes are not those of its scrub: run `analyze archive index` and `scrub`, or "
                "restore it from a copy"
            )
        if "://" not in url:
            shutil.copystat(path, part)
        part.replace(target)
    finally:
        part.unlink(missing_ok=True)
    return digest.hexdigest()


def _copy_answers(keys: Sequence[str], output: Path, results: Path) -> int:
    """Copy the rows of results that are files of their own; the number of them."""
    (results / ROWS).mkdir(parents=True, exist_ok=True)
    found = [output / ROWS / f"{key}.parquet" for key in dict.fromkeys(keys)]
    present = [path for path in found if path.exists()]
    for path in present:
        shutil.copy2(path, results / ROWS / path.name)
    return len(present)


def _write_catalogue(rows: Sequence[Row], places: Sequence[str], results: Path) -> None:
    """Write the catalogue of the copies, which keeps what the scrubs found."""
    kept = dict(zip(places, rows, strict=True))
    found = []
    for source in find_sources(places):
        row = read_index_row(source)
        old = kept[source.url]
        found.append(
            row | {name: old.get(name) for name in ("scrub", "scrub_reason", "scrubbed_at", "sha256")}
        )
    write_rows(pa.Table.from_pylist(found, schema=SCHEMA), results / CATALOGUE)


def _names_below(urls: Sequence[str]) -> dict[str, str]:
    """Path of each file below the folder that is common to all, by URL.

    Files of several protocols or buckets have no common folder: the protocol is then the first folder.
    """
    parts = {url: PurePosixPath(url.replace("://", "/").lstrip("/")).parts for url in urls}
    shared = os.path.commonpath(["/".join(("", *each[:-1])) for each in parts.values()]) if urls else ""
    depth = len(PurePosixPath(shared).parts) - 1
    return {url: "/".join(each[depth:]) for url, each in parts.items()}


def _refuse_full_disk(folder: Path, files: Sequence[tuple[Path, int]]) -> None:
    needed = sum(size for path, size in files if not path.exists())
    place = next(each for each in (folder, *folder.absolute().parents) if each.exists())
    free = shutil.disk_usage(place).free
    if needed > free:
        raise ArchiveError(
            f"{folder}: {needed / _MEGA:.0f} MB are needed and {free / _MEGA:.0f} MB are free: "
            "select fewer recordings, or name a folder on another disk"
        )


def _size(url: str) -> int:
    system, path = url_to_fs(url)
    return int(system.size(path) or 0)
