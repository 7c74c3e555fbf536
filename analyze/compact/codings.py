"""Coding of each image of a file: by the noise of its images, and by what moves in each strike."""

# numpy is only partly typed.
# pyright: reportUnknownMemberType=false

from __future__ import annotations

from bisect import bisect_right
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from google.protobuf.message import DecodeError

from analyze.compact.images import COMPRESSED, RAW, Coding
from analyze.compact.moving_region import moving_region, noise_sd
from analyze.reading.image_message import decode_image
from schemas.mcap.records import ContainerError
from schemas.proto import percuss_pb2 as pb
from schemas.topics import SESSION_STRIKE

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from numpy.typing import NDArray

    from analyze.reading.indexed_file import IndexedFile, TopicIndex

    Image = NDArray[np.uint8]

_NOISE_IMAGES = 24
"""number of images by which the noise is measured"""
_GAP_RATIO, _LONGEST_NS = 10.0, 5_000_000_000
"""time between images, over the usual one, at which a strike's images end, and their longest time outside of
the strikes' own [ns]"""
_SHORTEST = 3
"""number of images up to which they are no strike, and stay whole"""


@dataclass
class Codings:
    """Coding of each image of a file, by its topic and time; without loss where none is stated."""

    start_ns: dict[str, list[int]] = field(default_factory=dict[str, list[int]])
    """by topic the log times from which on the codings hold [ns]"""
    codings: dict[str, list[Coding]] = field(default_factory=dict[str, list[Coding]])
    noise_sd: float | None = None
    """largest standard deviation of a pixel's noise in a topic [grey]; None if not measured"""

    def coding_at(self, topic: str, time_ns: int) -> Coding:
        """Coding of an image with this log time [ns]."""
        start = self.start_ns.get(topic)
        return self.codings[topic][max(bisect_right(start, time_ns) - 1, 0)] if start else Coding()


def lossy_codings(file: IndexedFile, information_share: float | None, *, crop: bool) -> Codings:
    """Codings of a file's images, changed within their noise, cut to what moves, or both.

    Args:
        file: the file.
        information_share: share of the information on motion that exact pixels hold; None to change none.
        crop: True to keep only the region in which something moves.

    Raises:
        RecordingError: the file is damaged.
        ContainerError: an image cannot be decoded.
    """
    found, strikes = Codings(), _strike_times(file)
    for topic in file.topic_names():
        schema, index = file.schema_of(topic), file.index(topic)
        if schema not in {RAW, COMPRESSED} or not len(index.time_ns):
            continue

        def images(numbers: range, schema: str = schema, index: TopicIndex = index) -> Iterator[Image]:
            return (decode_image(schema, file.message(index, number).data) for number in numbers)

        windows = _windows(index.time_ns, strikes)
        noise = noise_sd(images(max(windows, key=len)[:_NOISE_IMAGES]))
        found.noise_sd = max(noise, found.noise_sd or 0.0)
        found.start_ns[topic], found.codings[topic] = [], []
        for window in windows:
            region = moving_region(images(window), noise) if crop and len(window) > _SHORTEST else None
            found.start_ns[topic].append(int(index.time_ns[window.start]))
            found.codings[topic].append(
                Coding(0.0, squares=region)
                if information_share is None
                else Coding(noise, information_share, region)
            )
    return found


def _strike_times(file: IndexedFile) -> list[tuple[int, int]]:
    """First and last log time [ns] of each strike's images, of the strikes whose record is in the file.

    Raises:
        RecordingError: the file is damaged.
        ContainerError: a record cannot be parsed.
    """
    index = file.index(SESSION_STRIKE.name)
    try:
        records = [
            pb.StrikeRecord.FromString(bytes(file.message(index, number).data))
            for number in range(len(index.time_ns))
        ]
    except DecodeError:
        raise ContainerError("a message is not a percuss.v1.StrikeRecord") from None
    return [(each.window_start_ns, each.window_end_ns) for each in records]


def _windows(time_ns: NDArray[np.int64], strikes: Sequence[tuple[int, int]]) -> list[range]:
    """Numbers of the images of each strike; those of a continuous recording are cut between its strikes.

    Args:
        time_ns: (n,) log times of the images [ns].
        strikes: first and last log time of each strike's images [ns].
    """
    steps = np.diff(time_ns)
    usual = float(np.median(steps)) if len(steps) else 0.0
    begin = [0]
    for number, step in enumerate(steps.tolist(), 1):
        if step <= _GAP_RATIO * usual:
            at = int(time_ns[number])
            if at - int(time_ns[begin[-1]]) <= _LONGEST_NS or any(one < at <= end for one, end in strikes):
                continue
        begin.append(number)
    return [range(one, other) for one, other in zip(begin, [*begin[1:], len(time_ns)], strict=True)]
