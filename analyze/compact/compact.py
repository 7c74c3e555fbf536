"""Compacts recordings: half the bytes without loss, or less within the noise; one file after the other.

The copy is written beside the original, forced to the disk, read back, and compared with it message by
message. Only then it takes the original's name, in one step: whenever the program is killed, one of the two
is whole.
"""

from __future__ import annotations

import os
from bisect import bisect_right
from contextlib import ExitStack, closing
from dataclasses import dataclass, field, replace
from itertools import zip_longest
from typing import TYPE_CHECKING

import numpy as np

from analyze.compact.copy_file import Copied, copy_recoded, stored_messages
from analyze.compact.images import COMPRESSED, RAW, Coding, same_image
from analyze.compact.moving_region import BLOCK, moving_regions, noise_sd
from analyze.compact.part_file import locked_part, part_path, publish
from analyze.compact.strikes import changes, side_by_side, struck
from analyze.errors import CompactError
from analyze.reading.file_series import find_series_files
from analyze.reading.image_message import decode_image
from analyze.reading.indexed_file import open_finished
from schemas.compaction import COMPACTED_NAME, Compaction
from schemas.document import canonical_json
from schemas.mcap.content_hash import ContentHash
from schemas.session_manifest import SEAL_NAME
from schemas.software import software_version

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    from analyze.progress import Progress
    from analyze.reading.indexed_file import IndexedFile, TopicIndex
    from schemas.mcap.records import MessageRecord

STEP_SD = 2.0
"""step of the quantisation over the noise: rms 0.58 of the noise at most, which raises it by 15 %"""
_STAYS = "it stays as it is"
_OWN = {COMPACTED_NAME, SEAL_NAME}
"""metadata that a copy has of its own"""
_NOISE_IMAGES = 24
"""number of images by which the noise is measured"""
_GAP, _LONGEST_NS = 10.0, 10_000_000_000
"""time between images, over the usual one, at which a strike's images end, and their longest time [ns]"""
_SHORTEST = 3
"""number of images below which they are no strike, and stay whole"""


@dataclass(frozen=True)
class CompactOptions:
    """What may be lost: nothing, what noise covers, or what does not move."""

    near_lossless: bool = False
    crop: bool = False

    @property
    def exact(self) -> bool:
        """True if nothing may be lost."""
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
    """what was done; None if there was nothing to do"""


@dataclass
class _Codings:
    """Coding of each image of a file, by its topic and time."""

    begin: dict[str, list[int]] = field(default_factory=dict[str, list[int]])
    """by topic the log times [ns] from which on the codings hold"""
    codings: dict[str, list[Coding]] = field(default_factory=dict[str, list[Coding]])
    noise: float | None = None
    """standard deviation of a pixel's noise [grey]; None if not measured"""

    def of(self, topic: str, time_ns: int) -> Coding:
        """Coding of one image."""
        begin = self.begin.get(topic)
        return self.codings[topic][max(bisect_right(begin, time_ns) - 1, 0)] if begin else Coding()


def compact(
    path: Path, options: CompactOptions, progress: Progress, folder: Path | None = None
) -> list[Compacted]:
    """Compact the files of one recording, each replaced by its copy, or written to another folder.

    Args:
        path: any of the recording's files.
        options: what may be lost.
        progress: callback.
        folder: folder for the copies; None to replace the files.

    Raises:
        AnalyzeError: a file is damaged, in use, or would change too much; it stays as it is.
    """
    done: list[Compacted] = []
    with ExitStack() as stack:
        waiting: list[_Written] = []
        for name in find_series_files(path).files:
            identity = _identity(name)
            file = stack.enter_context(closing(open_finished(name)))
            if _is_compact(file, options):
                done.append(Compacted(name, len(file.data), len(file.data), None))
                continue
            target = name if folder is None else folder / name.name
            fd = stack.enter_context(locked_part(target, name.stat().st_mode & 0o777))
            with file.damage_as_error():
                written = replace(_write(file, target, fd, options, progress), identity=identity)
            if options.exact:
                done.append(_publish(written))
            else:
                waiting.append(written)
        if waiting:
            done += _publish_compared(path, waiting, progress)
    return done


@dataclass(frozen=True)
class _Written:
    """Copy of a file that is whole but for its last records, and proved."""

    file: IndexedFile
    """the original"""
    identity: tuple[int, ...]
    """device, number, size and time of change of the original's file"""
    target: Path
    """path that the copy gets"""
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
    """True if a file's images are coded as asked for, or with less."""
    entries = file.metadata.get(COMPACTED_NAME)
    kinds = {file.schemas.get(channel.schema_id) for channel in file.channels.values()}
    if entries is None:
        return RAW not in kinds and (options.exact or COMPRESSED not in kinds)
    had = Compaction.model_validate_json(entries["json"])
    return had.cropped >= options.crop and (had.step > 0) >= options.near_lossless


def _write(file: IndexedFile, target: Path, fd: int, options: CompactOptions, progress: Progress) -> _Written:
    """Write and prove the copy of one file.

    Raises:
        CompactError: the copy is not the original's.
        ContainerError: the original is damaged.
        OSError: the copy cannot be written.
    """
    codings = _Codings() if options.exact else _codings(file, options)
    size, name = len(file.data), file.path.name
    copied = copy_recoded(
        file.data, fd, codings.of, lambda done: progress(f"writing {name}", done >> 20, size >> 20)
    )
    seal = file.metadata.get(SEAL_NAME, {})
    compaction = Compaction(
        source_content_id=seal.get("content_id"),
        source_bytes=size,
        software=software_version(),
        images=copied.images,
        exact=copied.exact,
        step=max((each.step for group in codings.codings.values() for each in group), default=0),
        noise_sd=codings.noise,
        cropped=options.crop,
    )
    earlier = file.metadata.get(COMPACTED_NAME)
    if earlier is not None:
        first = Compaction.model_validate_json(earlier["json"])
        compaction = compaction.model_copy(
            update={"source_content_id": first.source_content_id, "source_bytes": first.source_bytes}
        )
    copied.finish({"json": canonical_json(compaction)})
    os.posix_fadvise(fd, 0, 0, os.POSIX_FADV_DONTNEED)  # read back what the disk has
    _prove(file, part_path(target), copied, progress)
    return _Written(file, (), target, copied, compaction)


def _prove(file: IndexedFile, part: Path, copied: Copied, progress: Progress) -> None:
    """Compare a copy with its original, message by message, and both with their seals.

    Raises:
        CompactError: they differ.
        ContainerError: one of them is damaged.
    """
    with closing(open_finished(part)) as copy:
        before, after = ContentHash(), ContentHash()
        total = len(file.data) >> 20
        pairs = zip_longest(stored_messages(file.data), stored_messages(copy.data))
        for number, (one, other) in enumerate(pairs):
            if one is None or other is None or not _same(one, other, exact=copied.exact):
                raise CompactError(
                    f"{file.path}: message {number} of its copy differs: {_STAYS}; report this"
                )
            for digest, (topic, message) in ((before, one), (after, other)):
                digest.add(topic, message.log_time_ns, len(message.data), message.data)
            progress(f"comparing {file.path.name}", min(number, total), total)
        sealed = file.metadata.get(SEAL_NAME, {}).get("content_id")
        if sealed not in {None, before.hexdigest()}:
            raise CompactError(
                f"{file.path}: its content is not what was sealed: {_STAYS}; restore it from a copy"
            )
        heads = [
            (each.attachments, {name: v for name, v in each.metadata.items() if name not in _OWN})
            for each in (file, copy)
        ]
        if after.hexdigest() != copied.content_id or heads[0] != heads[1]:
            raise CompactError(f"{file.path}: its copy differs from it: {_STAYS}; report this")


def _same(one: tuple[str, MessageRecord], other: tuple[str, MessageRecord], *, exact: bool) -> bool:
    """True if two messages are the same, or the same image in another coding."""
    (topic, before), (its_topic, after) = one, other
    if topic != its_topic or before[:4] != after[:4]:
        return False
    return before.data == after.data or not exact or same_image(before.data, after.data)


def _publish(written: _Written) -> Compacted:
    """Give a copy the original's name.

    Raises:
        CompactError: the original is another one by now.
        OSError: it cannot be renamed.
    """
    size, source = written.copied.writer.size, written.file.path
    if _identity(source) != written.identity:
        raise CompactError(f"{source}: was changed meanwhile: {_STAYS}; compact it again")
    publish(written.target)
    return Compacted(written.target, len(written.file.data), size, written.compaction)


def _publish_compared(path: Path, waiting: Sequence[_Written], progress: Progress) -> list[Compacted]:
    """State how the strikes change by the recoded images, and give the copies their names.

    Raises:
        AnalyzeError: the strikes cannot be read, or one changes too much.
        OSError: a copy cannot be written or renamed.
    """
    parts = {written.file.path: part_path(written.target) for written in waiting}
    series = {name: parts.get(name, name) for name in find_series_files(path).files}
    before = struck(path, progress)
    with side_by_side(series) as copy:
        found = changes(before, struck(copy, progress), path)
    compared = [
        replace(each, compaction=each.compaction.model_copy(update={"strikes": found})) for each in waiting
    ]
    for written in compared:
        written.copied.finish({"json": canonical_json(written.compaction)})
    return [_publish(written) for written in compared]


def _codings(file: IndexedFile, options: CompactOptions) -> _Codings:
    """Coding of the images of each strike, by what moves in them and by their noise."""
    found = _Codings()
    for topic in file.topic_names():
        schema = file.schema_of(topic)
        index = file.index(topic)
        if schema not in {RAW, COMPRESSED} or not len(index.time_ns):
            continue

        def image(number: int, schema: str = schema, index: TopicIndex = index) -> NDArray[np.uint8]:
            return decode_image(schema, file.message(index, number).data)

        windows = _windows(index.time_ns)
        longest = max(windows, key=len)
        noise = noise_sd([image(number) for number in longest[:_NOISE_IMAGES]])
        found.noise = max(noise, found.noise or 0.0)
        step = max(round(STEP_SD * noise), 1) if options.near_lossless else 0
        found.begin[topic], found.codings[topic] = [], []
        for window in windows:
            regions = None
            if options.crop and len(window) > _SHORTEST:
                regions = moving_regions([image(number) for number in window], noise)
            for first in range(0, len(window), BLOCK):
                kept = None if regions is None else regions[first // BLOCK]
                found.begin[topic].append(int(index.time_ns[window[first]]))
                found.codings[topic].append(Coding(step, kept))
    return found


def _windows(time_ns: NDArray[np.int64]) -> list[range]:
    """Numbers of the images of each strike, by the gaps between their times (n,) [ns]."""
    steps = np.diff(time_ns)
    usual = float(np.median(steps)) if len(steps) else 0.0
    begin = [0]
    for number, step in enumerate(steps.tolist(), 1):
        if step > _GAP * usual or time_ns[number] - time_ns[begin[-1]] > _LONGEST_NS:
            begin.append(number)
    return [range(one, other) for one, other in zip(begin, [*begin[1:], len(time_ns)], strict=True)]
