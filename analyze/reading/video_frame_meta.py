"""The FrameMeta of every frame of an imported video, which writes few: most of its frames only follow on the one before."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from schemas.proto import percuss_pb2 as pb


def metas_of_video(
    written: Sequence[tuple[int, pb.FrameMeta]], image_times_ns: NDArray[np.int64], start_ns: int | None, end_ns: int | None
) -> Iterator[tuple[int, pb.FrameMeta]]:
    """Log time and FrameMeta of every image in a range, both ends included (schemas/README.md, "A file").

    Args:
        written: those in the file with their log times, in order.
        image_times_ns: log times of its images, in order.
        start_ns: of the range; None for the first.
        end_ns: of the range; None for the last.
    """
    times = np.array([time_ns for time_ns, _ in written], dtype=np.int64)
    places = np.searchsorted(image_times_ns, times)
    first = 0 if start_ns is None else int(np.searchsorted(image_times_ns, start_ns, "left"))
    last = len(image_times_ns) if end_ns is None else int(np.searchsorted(image_times_ns, end_ns, "right"))
    sources = np.searchsorted(times, image_times_ns[first:last], "right") - 1
    for place, (time_ns, source) in enumerate(zip(image_times_ns[first:last].tolist(), sources.tolist(), strict=True), first):
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
