"""Compares a topic's message index with the messages at which it points.

The index has no checksum of its own, and one wrong bit in a time would change a result.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from schemas.mcap import records as container
from schemas.mcap.records import ContainerError

_HEAD: Final = np.dtype(
    [("opcode", "u1"), ("length", "<u8"), ("channel_id", "<u2"), ("sequence", "<u4"), ("log_time_ns", "<u8")]
)
"""beginning of a message record"""


def check_entries(
    data: memoryview,
    extents: NDArray[np.int64],
    offsets: NDArray[np.int64],
    time_ns: NDArray[np.int64],
    channel_ids: set[int],
) -> None:
    """Check that each entry of an index points at a message of its channel and states its log time.

    Args:
        data: bytes of the file.
        extents: (n, 2) start and end in the file of the records of each entry's chunk, which is not
            compressed [bytes].
        offsets: (n,) offsets of the messages among those records, in the index [bytes].
        time_ns: (n,) log times in the index [ns].
        channel_ids: channels of the topic.

    Raises:
        ContainerError: an entry points elsewhere, states another time than the message, or stands twice.
    """
    starts, ends = extents.T
    if np.any(offsets < 0) or np.any(offsets > ends - starts - _HEAD.itemsize):
        raise ContainerError("a message index points outside of its chunk")
    begins = starts + offsets
    if len(np.unique(begins)) != len(begins):
        raise ContainerError("a message index lists a message twice")
    raw = np.frombuffer(data, np.uint8)
    heads = raw[begins[:, None] + np.arange(_HEAD.itemsize)].view(_HEAD)[:, 0]
    if np.any(heads["opcode"] != container.MESSAGE) or not np.isin(heads["channel_id"], [*channel_ids]).all():
        raise ContainerError("a message index points at something else than a message of its channel")
    if np.any(heads["log_time_ns"] != time_ns.astype(np.uint64)):
        raise ContainerError("a message index states another time than its message")
