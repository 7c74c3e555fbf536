"""Compacts recordings: half the bytes without loss, or less within the noise; one file after the other.

The copy is written beside the original, forced to the disk, read back, and compared with it message by
message. Only then it takes the original's name, in one step: whenever the program is killed, one of the two
is whole.
"""

from __future__ import annotations

import os
from contextlib import ExitStack, closing, suppress
from dataclasses import dataclass, replace
from shutil import disk_usage
from typing import TYPE_CHECKING

from analyze.compact.codings import Codings, lossy_codings
from analyze.compact.copy_file import Copied, copy_recoded
from analyze.compact.images import COMPRESSED, RAW
from analyze.compact.part_file import locked_part, part_path, publish
from analyze.compact.prove import ORIGINAL_STAYS, prove, refuse_other_head
from analyze.compact.strikes import (
    compare_motions,
    is_as_aimed,
    judged_motions,
    strike_motions,
    under_final_names,
)
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
    from analyze.types import TipMotion


INFORMATION_SHARES = 0.9, 1.0
"""shares of the information on motion in exact pixels, tried one after the other: tags hold nearly all of it
in their edges, faint print beside strong outlines needs every pixel that shows structure"""


@dataclass(frozen=True)
class CompactOptions:
    """Permitted loss: none, grey values within the camera's noise, or parts of the image without motion."""

    near_lossless: bool = False
    crop: bool = False
    disk_reserve_bytes: int = 0
    """disk space that a copy leaves free [bytes]"""

    @property
    def exact(self) -> bool:
        """True if no pixel may change."""
        return not (self.near_lossless or self.crop)


@dataclass(frozen=True)
class Compacted:
    """A recording's file after its compaction."""

    path: Path
    bytes_original: int
    """size of the file before [bytes]"""
    bytes_compact: int
    """size of the file now [bytes]"""
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
        waiting: list[_Source] = []
        for name in names:
            identity = _file_identity(name)
            file = stack.enter_context(closing(open_finished(name)))
            if _is_compact(file, options):
                yield Compacted(name, len(file.data), len(file.data), None)
                continue
            _refuse_replacing(name, options.disk_reserve_bytes)
            source = _Source(file, identity, stack.enter_context(locked_part(name)))
            if options.exact:
                yield _publish(_write(source, options, None, progress))
            else:
                waiting.append(source)
        if waiting:
            yield from _compact_compared(names, waiting, options, progress)


@dataclass(frozen=True)
class _Source:
    """File that is to be compacted."""

    file: IndexedFile
    identity: tuple[int, ...]
    """device, number, size and time of change of the file"""
    fd: int
    """its copy, open"""


@dataclass(frozen=True)
class _Written:
    """Copy of a file that is proved, and may be given its last records anew."""

    source: _Source
    copied: Copied
    compaction: Compaction

    @property
    def is_smaller(self) -> bool:
        """True if the copy holds recoded images and is smaller than its original."""
        return self.copied.recoded_images > 0 and self.copied.writer.size < len(self.source.file.data)


def _file_identity(path: Path) -> tuple[int, ...]:
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
        raise CompactError(f"{file.path}: its entry {COMPACTED_NAME} cannot be read: {ORIGINAL_STAYS}")
    if options.exact or (done.cropped >= options.crop and done.within_noise >= options.near_lossless):
        return True
    if not done.exact:
        raise CompactError(
            f"{file.path}: was compacted with loss before: {ORIGINAL_STAYS}; give both options at once"
        )
    return False


def _refuse_replacing(path: Path, reserve_bytes: int) -> None:
    """Check that a file may be replaced, and that there is room for a copy of its size.

    Args:
        path: the file.
        reserve_bytes: disk space that must stay free [bytes].

    Raises:
        CompactError: it is write-protected, has several names, or the disk is too full.
    """
    found = path.stat()
    if not os.access(path, os.W_OK):
        raise CompactError(f"{path}: is write-protected: {ORIGINAL_STAYS}; `chmod u+w` allows to replace it")
    if found.st_nlink > 1:
        raise CompactError(
            f"{path}: has {found.st_nlink} names (hard links): {ORIGINAL_STAYS}; compact a copy of it"
        )
    free = disk_usage(path.parent).free
    if free < found.st_size + reserve_bytes:
        kept_back = f", and {reserve_bytes >> 20} MB are to stay free" if reserve_bytes else ""
        raise CompactError(
            f"{path}: {free >> 20} MB are free on its disk, a copy may need {found.st_size >> 20}{kept_back}:"
            f" {ORIGINAL_STAYS}; make room"
        )


def _write(
    source: _Source, options: CompactOptions, information_share: float | None, progress: Progress
) -> _Written:
    """Write and prove the copy of one file.

    Args:
        source: the file.
        options: what may be lost.
        information_share: share of the information on motion that exact pixels hold; None to change none.
        progress: callback.

    Raises:
        CompactError: the copy is not the original's.
        RecordingError: the original is damaged.
        OSError: the copy cannot be written.
    """
    file, fd = source.file, source.fd
    size, name = len(file.data), file.path.name
    os.ftruncate(fd, 0)
    os.lseek(fd, 0, os.SEEK_SET)
    with file.damage_as_error():
        codings = Codings() if options.exact else lossy_codings(file, information_share, crop=options.crop)
        copied = copy_recoded(
            file.data, fd, codings.coding_at, lambda done: progress(f"writing {name}", done >> 20, size >> 20)
        )
        earlier = parse_compaction(file.metadata.get(COMPACTED_NAME, {}))
        sealed = file.metadata.get(SEAL_NAME, {}).get("content_id")
        compaction = Compaction(
            source_content_id=sealed if earlier is None else earlier.source_content_id,
            source_bytes=size if earlier is None else earlier.source_bytes,
            software=software_version(),
            images=copied.recoded_images,
            exact=options.exact,
            near_lossless=options.near_lossless,
            information_share=information_share,
            noise_sd=codings.noise_sd,
            cropped=options.crop,
        )
        copied.finish({"json": canonical_json(compaction)})
        os.posix_fadvise(fd, 0, 0, os.POSIX_FADV_DONTNEED)  # read back what the disk has
        prove(file, part_path(file.path), codings, progress)
    return _Written(source, copied, compaction)


def _publish(written: _Written) -> Compacted:
    """Give a copy the original's name, if it is smaller.

    Raises:
        CompactError: the original is another one by now.
        OSError: it cannot be renamed.
    """
    path, bytes_original = written.source.file.path, len(written.source.file.data)
    if not written.is_smaller:
        return Compacted(path, bytes_original, bytes_original, None)
    if _file_identity(path) != written.source.identity:
        raise CompactError(f"{path}: was changed meanwhile: {ORIGINAL_STAYS}; compact it again")
    publish(path, written.source.fd)
    return Compacted(path, bytes_original, written.copied.writer.size, written.compaction)


def _compact_compared(
    names: Sequence[Path], sources: Sequence[_Source], options: CompactOptions, progress: Progress
) -> Iterator[Compacted]:
    """Compact files with loss: with fewer exact pixels first, with all that show structure if strikes change.

    Raises:
        AnalyzeError: the strikes cannot be read, or one changes too much.
        OSError: a copy cannot be written or renamed.
    """
    original = judged_motions(names[0], progress)
    *preferred, last = INFORMATION_SHARES if options.near_lossless else (None,)
    for share in preferred:
        copies = [_write(source, options, share, progress) for source in sources]
        recoded = _recoded_motions(names, copies, progress)
        with suppress(CompactError):
            changes = compare_motions(original, recoded, names[0])
            if all(is_as_aimed(each) for each in changes):
                break
    else:
        copies = [_write(source, options, last, progress) for source in sources]
        changes = compare_motions(original, _recoded_motions(names, copies, progress), names[0])
    for written in copies:
        compaction = written.compaction.model_copy(update={"strikes": changes})
        written.copied.finish({"json": canonical_json(compaction)})
        with closing(open_finished(part_path(written.source.file.path))) as finished:
            refuse_other_head(written.source.file, finished)
        yield _publish(replace(written, compaction=compaction))


def _recoded_motions(
    names: Sequence[Path], copies: Sequence[_Written], progress: Progress
) -> dict[str, TipMotion]:
    """Motion of each strike of a recording by the copies of its files, by its id."""
    parts = {each.source.file.path: part_path(each.source.file.path) for each in copies if each.is_smaller}
    with under_final_names({name: parts.get(name, name) for name in names}) as copy:
        return strike_motions(copy, progress)
