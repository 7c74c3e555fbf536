"""Copy a part of an archive, with answers and checksums, into a folder that is an archive of its own."""

from __future__ import annotations

import hashlib
import os
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from analyze.batch.archive import file_system, find_sources
from analyze.batch.worker_messages import ROWS
from analyze.catalogue.index import SCRUB_COLUMNS, update_index
from analyze.catalogue.recording_files import current_source, file_exists, file_sha256, file_urls, read_blocks
from analyze.catalogue.scrub import ALTERED, DAMAGED
from analyze.catalogue.table import CATALOGUE, Catalogue, Row, open_catalogue
from analyze.errors import ArchiveError
from analyze.progress import Progress, no_progress
from schemas.output_file import write_bytes, write_text
from schemas.wording import counted

SUMS, RESULTS = "SHA256SUMS", "results"
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
        ArchiveError: the disk has not enough room, a file of another content is in the way, or a recording is
            damaged, gone, changed since its row was written or while it was copied, or not that of its scrub.
        OSError: a file cannot be read or written.
    """
    _refuse_damaged(rows)
    _refuse_changed(rows)
    urls = [url for row in rows for url in file_urls(row)]
    names = _names_below(urls)
    sizes = {url: _size(url) for url in urls}
    total = sum(sizes.values())
    _refuse_other_folder(folder, output)
    _refuse_full_disk(folder, [(folder / names[url], sizes[url]) for url in urls])
    known = {url: sha for row in rows for url, sha in zip(file_urls(row), row["sha256"] or [], strict=False)}
    sums: dict[str, str] = {}
    copied = done = 0
    with open_catalogue(folder / RESULTS, create=True) as catalogue:
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
        answers = _copy_answers(keys, output, folder / RESULTS)
        _catalogue_copies(catalogue, rows, {url: str(folder / name) for url, name in names.items()})
        _write_sums(folder / SUMS, sums)
    return ExportReport(copied, len(urls) - copied, answers, total)


def _copy(url: str, target: Path, expected: str | None) -> str:
    """Copy a file, which appears whole or not at all; the SHA-256 of its bytes.

    Raises:
        ArchiveError: the bytes are not those of the scrub, or changed meanwhile.
        OSError: it cannot be read or written.
    """
    target.parent.mkdir(parents=True, exist_ok=True)
    part = target.with_name(target.name + ".copying")
    digest = hashlib.sha256()
    before = current_source([url]).id
    try:
        with part.open("wb") as copy:
            for block in read_blocks(url):
                digest.update(block)
                copy.write(block)
            copy.flush()
            os.fsync(copy.fileno())
        if expected is not None and digest.hexdigest() != expected:
            raise ArchiveError(
                f"{url}: its bytes are not those of its scrub: run `analyze archive index` and `scrub`, or "
                "restore it from a copy"
            )
        if current_source([url]).id != before:
            raise ArchiveError(
                f"{url}: changed while it was copied: run it again when the recording is complete, or leave "
                "it out with --where \"state <> 'unfinished'\""
            )
        if "://" not in url:
            shutil.copystat(url, part)
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
        write_bytes(results / ROWS / path.name, path.read_bytes())
    return len(present)


def _catalogue_copies(catalogue: Catalogue, rows: Sequence[Row], targets: Mapping[str, str]) -> None:
    """Add the copies to the catalogue of the export, with what the scrubs of their originals found.

    Args:
        catalogue: catalogue of the export.
        rows: rows of the originals.
        targets: path of each file's copy by its URL.
    """
    sources = find_sources(list(targets.values()))
    update_index(catalogue, sources)
    for row in rows:
        (source,) = find_sources([targets[file_urls(row)[0]]])
        if source.url in catalogue.rows:  # a `.part` beside its finished file has no row
            catalogue.rows[source.url] |= {name: row.get(name) for name in SCRUB_COLUMNS}


def _write_sums(path: Path, sums: Mapping[str, str]) -> None:
    """Write the file for `sha256sum -c`; lines of an earlier export into the same folder stay."""
    lines = {_sum_line(name, value) for name, value in sums.items()}
    own = {line.partition("  ")[2] for line in lines}
    earlier = path.read_text(encoding="utf-8").splitlines() if path.exists() else []
    lines |= {line for line in earlier if line.partition("  ")[2] not in own}
    write_text(path, "".join(f"{line}\n" for line in sorted(lines, key=lambda each: each.partition("  ")[2])))


def _sum_line(name: str, value: str) -> str:
    """Line of `sha256sum`, which marks a name with escapes by a backslash at its begin."""
    escaped = name.replace("\\", "\\\\").replace("\n", "\\n").replace("\r", "\\r")
    return f"{'' if escaped == name else chr(92)}{value}  {escaped}"


def _refuse_damaged(rows: Sequence[Row]) -> None:
    damaged = [row for row in rows if row["scrub"] in {DAMAGED, ALTERED}]
    if damaged:
        raise ArchiveError(
            f"{damaged[0]['url']}: {damaged[0]['scrub']} at its scrub ({counted(len(damaged), 'recording')} "
            "in all): restore it and run `analyze archive scrub`, or leave it out with "
            "--where \"coalesce(scrub, '') not in ('damaged', 'altered')\""
        )


def _refuse_changed(rows: Sequence[Row]) -> None:
    for row in rows:
        gone = next((url for url in file_urls(row) if not file_exists(url)), None)
        if gone is not None or current_source(file_urls(row)).id != row["files_id"]:
            raise ArchiveError(
                f"{gone or row['url']}: is gone or changed since it was read into the catalogue: run "
                "`analyze archive index` on its folder first"
            )


def _refuse_other_folder(folder: Path, output: Path) -> None:
    """Refuse a folder in which an export would replace files that no export has written."""
    if (folder / RESULTS).resolve() == output.resolve():
        raise ArchiveError(f"{folder}: its results are those of the archive itself: name another folder")
    if (folder / SUMS).exists() and not (folder / RESULTS / CATALOGUE).exists():
        raise ArchiveError(f"{folder / SUMS}: is there already, and of no export: name another folder")


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
    system, path = file_system(url)
    return int(system.size(path) or 0)
