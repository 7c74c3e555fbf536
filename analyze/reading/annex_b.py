"""H.264 and H.265 as a stream of bytes (ISO/IEC 14496-10 and 23008-2, Annex B): what a message of such a video begins with.

In MP4 and Matroska files each part of a picture has its length before it in place of a start code (ISO/IEC 14496-15).
"""

from __future__ import annotations

from collections.abc import Iterator
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from schemas.mcap.records import Buffer

_START = b"\x00\x00\x01"
_LONG_START = 1
"""a start code of four bytes, as a number"""
_LOOKED_AT = 1 << 16
"""bytes of an access unit in which its first picture begins: parameter sets and an encoder's greeting come before it"""


class VideoFormat(Enum):
    """How the pictures are coded, as foxglove.CompressedVideo calls it."""

    H264 = "h264"
    H265 = "h265"


def is_keyframe(video: VideoFormat, data: Buffer) -> bool:
    """Whether a decoder may begin with this access unit."""
    for kind in _unit_types(video, data):
        if video is VideoFormat.H264 and kind in {1, 5}:  # a slice; of an IDR picture
            return kind == 5
        if video is VideoFormat.H265 and kind < 32:  # a slice; of a picture without references from 16 to 23
            return 16 <= kind <= 23
    return False


def holds_parameter_sets(video: VideoFormat, data: Buffer) -> bool:
    """Whether the access unit brings what a decoder must know first (its sequence parameter set)."""
    return (7 if video is VideoFormat.H264 else 33) in _unit_types(video, data)


def slices(video: VideoFormat, data: Buffer) -> list[bool]:
    """Of each slice in the bytes, whether a picture begins with it."""
    whole = bytes(data)
    found: list[bool] = []
    at = whole.find(_START)
    while 0 <= at < len(whole) - 5:
        # The first bit after a unit's head: first_mb_in_slice is 0, or first_slice_segment_in_pic_flag is set.
        if video is VideoFormat.H264 and whole[at + 3] & 31 in {1, 5}:
            found.append(whole[at + 4] >= 128)
        elif video is VideoFormat.H265 and whole[at + 3] >> 1 & 63 < 32:
            found.append(whole[at + 5] >= 128)
        at = whole.find(_START, at + 3)
    return found


def is_annex_b(data: Buffer) -> bool:
    """Whether the bytes begin with a start code, not with a unit's length."""
    return bytes(data[:4]) == b"\x00" + _START or bytes(data[:3]) == _START


def has_long_lengths(video: VideoFormat, head: Buffer) -> bool:
    """Whether a file with this head of the stream writes lengths of four bytes, as nearly all do."""
    at = 4 if video is VideoFormat.H264 else 21
    return len(head) > at and head[at] & 3 == 3


def mark_starts(video: VideoFormat, data: bytearray, starts: NDArray[np.int64], ends: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Put start codes over four-byte lengths, where they lie: of some access units at once, for a film may have 100 000.

    Args:
        video: how the pictures are coded.
        data: holds access units as they stand in such a file; those that come out False are spoilt.
        starts: (n,) where each begins.
        ends: (n,) where each ends.

    Returns:
        (n,) False where the lengths do not add up, or where a decoder may begin with the unit and wants parameter sets.
    """
    lengths = np.ndarray(max(0, len(data) - 3), ">u4", data, strides=(1,))  # of four bytes from each byte on
    at = starts.copy()
    going = np.flatnonzero(at < ends - 4)
    while len(going):
        places = at[going]
        sizes, first = lengths[places].astype(np.int64), np.frombuffer(data, np.uint8)[places + 4]
        begins = first & 31 == 5 if video is VideoFormat.H264 else (first >> 1 & 63) - np.uint8(16) < 8
        lengths[places] = _LONG_START
        at[going] = places = np.where(begins | (sizes == 0), len(data) + 1, places + 4 + sizes)
        going = going[places < ends[going] - 4]
    return at == ends


def _unit_types(video: VideoFormat, data: Buffer) -> Iterator[int]:
    head = bytes(data[:_LOOKED_AT])
    at = head.find(_START)
    while 0 <= at < len(head) - 3:
        first = head[at + 3]
        yield first & 31 if video is VideoFormat.H264 else first >> 1 & 63
        at = head.find(_START, at + 3)
