"""Compacts recordings: half the bytes without loss, or less within the noise; one file after the other.

The copy is written beside the original, forced to the disk, read back, and compared with it message by
message. Only then it takes the original's name, in one step: whenever the program is killed, one of the two
is whole.
"""

from __future__ import annotations

import os
from contextlib import ExitStack, closing
from dataclasses import dataclass, replace
from shutil import disk_usage
from typing import TYPE_CHECKING

from analyze.compact.codings import Codings, lossy_codings
from analyze.compact.copy_file import Copied, copy_recoded
from analyze.compact.images import COMPRESSED, RAW
from analyze.compact.part_file import locked_part, part_path, publish
from analyze.compact.prove import STAYS, prove, refuse_other_head
from analyze.compact.strikes import compare_motions, strike_motions, under_final_names
from analyze.errors import CompactError
from analyze.reading.file_series import find_series_files
from analyze.reading.indexed_file import open_finished
from analyze.reading.recording_head import checked_manifest
from schemas.compaction import COMPACTED_NAME, Compaction, parse_compaction
from schemas.document import canonical_json
from schemas.session_manifest import SEAL_NAME
from schemas.software import software_version

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

    from analyze.progress import Progress
    from analyze.reading.indexed_file import IndexedFile


@dataclass(frozen=True)
class CompactOptions:
    """Permitted loss: none, grey values within the camera's noise, or parts of the image without motion."""

    near_lossless: bool = False
    crop: bool = False

    @property
    def exact(self) -> bool:
        """True if no pixel may change."""
        return not (self.near_lossless or self.crop)


@dataclass(frozen=True)
class Compacted:
    """A recording's file after its compaction."""

    path: Path
    before: int
    """size before [bytes]"""
    after: int
    """size now [bytes]"""
    compaction: Compaction | None
    """recoding of its images; None if the file was left as it is"""


def compact(path: Path, options: CompactOptions, progress: Progress) -> Iterator[Compacted]:
    """Compact the files of one recording, each replaced by its copy; yields each file once it is done.

    Args:
        path: any of the recording's files.
        options: what may be lost.
        progress: callback.

    Raises:
        AnalyzeError: a file is damaged, no recording, in use, or would change too much; it stays as it is.
        OSError: a copy cannot be written; the file stays as it is.
    """
    names = [name.resolve() for name in find_series_files(path).files]
    with ExitStack() as stack:
        waiting: list[_Written] = []
        for name in names:
            identity = _identity(name)
            file = stack.enter_context(closing(open_finished(name)))
            if _is_compact(file, options):
                yield Compacted(name, len(file.data), len(file.data), None)
                continue
            _refuse_replacing(name)
            fd = stack.enter_context(locked_part(name))
            with file.damage_as_error():
                written = _write(file, identity, fd, options, progress)
            if written.copied.images == 0 or written.copied.writer.size >= len(file.data):
                yield Compacted(name, len(file.data), len(file.data), None)
            elif options.exact:
                yield _publish(written)
            else:
                waiting.append(written)
        if waiting:
            yield from _publish_compared(names, waiting, progress)


@dataclass(frozen=True)
class _Written:
    """Copy of a file that is proved, and may be given its last records anew."""

    file: IndexedFile
    """the original"""
    identity: tuple[int, ...]
    """device, number, size and time of change of the original's file"""
    fd: int
    """the copy, open"""
    copied: Copied
    compaction: Compaction


def _identity(path: Path) -> tuple[int, ...]:
    """Device, number, size and time of change of a file; empty if there is none."""
    try:
        found = path.stat()
    except FileNotFoundError:
        return ()
    return found.st_dev, found.st_ino, found.st_size, found.st_mtime_ns


def _is_compact(file: IndexedFile, options: CompactOptions) -> bool:
    """True if there is nothing to do for a file.

    Raises:
        RecordingError: it is no recording.
        CompactError: more is to be lost of a file that has lost something already.
    """
    checked_manifest(file)
    kinds = {file.schemas.get(channel.schema_id) for channel in file.channels.values()}
    entries = file.metadata.get(COMPACTED_NAME)
    if entries is None:
        return RAW not in kinds and (options.exact or COMPRESSED not in kinds)
    done = parse_compaction(entries)
    if done is None:
        raise CompactError(f"{file.path}: its entry {COMPACTED_NAME} cannot be read: {STAYS}")
    if options.exact or (done.cropped >= options.crop and done.within_noise >= options.near_lossless):
        return True
    if not done.exact:
        raise CompactError(f"{file.path}: was compacted with loss before: {STAYS}; give both options at once")
    return False


def _refuse_replacing(path: Path) -> None:
    """Check that a file may be replaced, and that there is room for its copy.

    Raises:
        CompactError: it is write-protected, has several names, or the disk is too full.
    """
    found = path.stat()
    if not os.access(path, os.W_OK):
        raise CompactError(f"{path}: is write-protected: {STAYS}; `chmod u+w` allows to replace it")
    if found.st_nlink > 1:
        raise CompactError(f"{path}: has {found.st_nlink} names (hard links): {STAYS}; compact a copy of it")
    free = disk_usage(path.parent).free
    if free < found.st_size:
        raise CompactError(
            f"{path}: {free >> 20} MB are free for a copy of {found.st_size >> 20} MB: {STAYS}; make room"
        )


def _write(
    file: IndexedFile, identity: tuple[int, ...], fd: int, options: CompactOptions, progress: Progress
) -> _Written:
    """Write and prove the copy of one file.

    Raises:
        CompactError: the copy is not the original's.
        RecordingError: the original is damaged.
        ContainerError: the original is damaged.
        OSError: the copy cannot be written.
    """
    codings = (
        Codings()
        if options.exact
        else lossy_codings(file, near_lossless=options.near_lossless, crop=options.crop)
    )
    size, name = len(file.data), file.path.name
    copied = copy_recoded(
        file.data, fd, codings.coding_at, lambda done: progress(f"writing {name}", done >> 20, size >> 20)
    )
    earlier = parse_compaction(file.metadata.get(COMPACTED_NAME, {}))
    sealed = file.metadata.get(SEAL_NAME, {}).get("content_id")
    compaction = Compaction(
        source_content_id=sealed if earlier is None else earlier.source_content_id,
        source_bytes=size if earlier is None else earlier.source_bytes,
        software=software_version(),
        images=copied.images,
        exact=options.exact,
        near_lossless=options.near_lossless,
        noise_sd=codings.noise_sd,
        cropped=options.crop,
    )
    copied.finish({"json": canonical_json(compaction)})
    os.posix_fadvise(fd, 0, 0, os.POSIX_FADV_DONTNEED)  # read back what the disk has
    prove(file, part_path(file.path), codings, progress)
    return _Written(file, identity, fd, copied, compaction)


def _publish(written: _Written) -> Compacted:
    """Give a copy the original's name.

    Raises:
        CompactError: the original is another one by now.
        OSError: it cannot be renamed.
    """
    size, source = written.copied.writer.size, written.file.path
    if _identity(source) != written.identity:
        raise CompactError(f"{source}: was changed meanwhile: {STAYS}; compact it again")
    publish(source, written.fd)
    return Compacted(source, len(written.file.data), size, written.compaction)


def _publish_compared(
    names: Sequence[Path], waiting: Sequence[_Written], progress: Progress
) -> Iterator[Compacted]:
    """State how the strikes change by the recoded images, and give the copies their names.

    Raises:
        AnalyzeError: the strikes cannot be read, or one changes too much.
        OSError: a copy cannot be written or renamed.
    """
    parts = {written.file.path: part_path(written.file.path) for written in waiting}
    before = strike_motions(names[0], progress)
    with under_final_names({name: parts.get(name, name) for name in names}) as copy:
        found = compare_motions(before, strike_motions(copy, progress), names[0])
    for written in waiting:
        compaction = written.compaction.model_copy(update={"strikes": found})
        written.copied.finish({"json": canonical_json(compaction)})
        with closing(open_finished(part_path(written.file.path))) as finished:
            refuse_other_head(written.file, finished)
        yield _publish(replace(written, compaction=compaction))
