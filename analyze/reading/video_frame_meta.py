"""Expands the few FrameMeta (frame metadata) stored with an imported video to one per frame.

A frame without a FrameMeta gets a copy of the last stored one before it. The copy's number is advanced by the
frames between the two, its times by the difference of their log times.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from analyze.reading.time_range import index_range
from schemas.proto import percuss_pb2 as pb


def expand_frame_meta(
    written: Sequence[tuple[int, pb.FrameMeta]],
    image_times_ns: NDArray[np.int64],
    start_ns: int | None,
    end_ns: int | None,
) -> Iterator[tuple[int, pb.FrameMeta]]:
    """Yield log time [ns] and FrameMeta (frame metadata) of every image of a video in a range of times.

    A FrameMeta that is not stored is derived from the last one before it, and reports no lost frames. Images
    before the first stored FrameMeta are left out. The rule is in schemas/README.md, "A file".

    Args:
        written: FrameMeta in the file with their log times [ns], by time.
        image_times_ns: (n,) log times of the video's images [ns], sorted.
        start_ns: earliest log time of the range [ns], included; None for the first image.
        end_ns: latest log time of the range [ns], included; None for the last image.
    """
    times = np.array([time_ns for time_ns, _ in written], dtype=np.int64)
    places = np.searchsorted(image_times_ns, times)
    first, last = index_range(image_times_ns, start_ns, end_ns)
    sources = np.searchsorted(times, image_times_ns[first:last], "right") - 1
    for place, (time_ns, source) in enumerate(
        zip(image_times_ns[first:last].tolist(), sources.tolist(), strict=True), first
    ):
        if source < 0:
            continue
        at_ns, meta = written[source]
        later_ns = time_ns - at_ns
        if later_ns:
            own = pb.FrameMeta()
            own.CopyFrom(meta)
            own.sequence += place - int(places[source])
            own.device_time_ns += later_ns
            own.host_time_ns += later_ns
            own.mid_exposure_host_ns += later_ns
            own.frames_lost_before = 0
            meta = own
        yield time_ns, meta
