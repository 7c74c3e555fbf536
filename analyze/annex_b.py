"""H.264 and H.265 as a stream of bytes (ISO/IEC 14496-10 and 23008-2, Annex B): what a message of such a video begins with."""

from __future__ import annotations

from collections.abc import Iterator
from enum import Enum

from schemas.container import Buffer

_START = b"\x00\x00\x01"
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


def is_annex_b(data: Buffer) -> bool:
    """Whether the bytes begin with a start code, not with a unit's length."""
    return bytes(data[:4]) == b"\x00" + _START or bytes(data[:3]) == _START


def _unit_types(video: VideoFormat, data: Buffer) -> Iterator[int]:
    head = bytes(data[:_LOOKED_AT])
    at = head.find(_START)
    while 0 <= at < len(head) - 3:
        first = head[at + 3]
        yield first & 31 if video is VideoFormat.H264 else first >> 1 & 63
        at = head.find(_START, at + 3)
