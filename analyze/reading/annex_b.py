"""Inspects H.264 and H.265 byte streams (ISO/IEC 14496-10, 23008-2, Annex B): unit types, start codes.

A NAL unit is a coded unit: a slice of a picture, or a parameter set. In Annex B it follows a start code; in
MP4 and Matroska files its length stands in place of the start code (ISO/IEC 14496-15).
"""

from __future__ import annotations

from collections.abc import Iterator
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from schemas.mcap.records import Buffer

_START_CODE = b"\x00\x00\x01"
_FOUR_BYTE_START_CODE = 1
"""start code of four bytes, as a big-endian number"""
_MAX_HEAD_BYTES = 1 << 16
"""bytes of an access unit (one coded picture) that are searched for its parameter sets and first slice"""


class VideoFormat(Enum):
    """Video codec, by its name in foxglove.CompressedVideo."""

    H264 = "h264"
    H265 = "h265"


def is_keyframe(video: VideoFormat, data: Buffer) -> bool:
    """True if a decoder can begin with an access unit (one coded picture), by its first slice's type.

    A slice is a part of a picture. H.264: a slice of an IDR picture, which needs no other pictures; H.265: a
    slice of NAL unit type 16 to 23. False if no slice begins in the first 64 KiB.
    """
    for kind in _unit_types(video, data):
        if video is VideoFormat.H264 and kind in {1, 5}:  # a slice; of an IDR picture
            return kind == 5
        if video is VideoFormat.H265 and kind < 32:  # a slice; of a picture without references from 16 to 23
            return 16 <= kind <= 23
    return False


def holds_parameter_sets(video: VideoFormat, data: Buffer) -> bool:
    """True if an access unit's first 64 KiB hold a sequence parameter set, which a decoder needs first.

    An access unit is one coded picture, here with start codes.
    """
    return (7 if video is VideoFormat.H264 else 33) in _unit_types(video, data)


def slice_starts(video: VideoFormat, data: Buffer) -> list[bool]:
    """List with one bool per slice (part of a picture) in the data: True if the slice begins a picture.

    Args:
        video: codec.
        data: coded data with start codes (Annex B); all of it is searched.
    """
    whole = bytes(data)
    found: list[bool] = []
    at = whole.find(_START_CODE)
    while 0 <= at < len(whole) - 5:
        # The first bit after a unit's head: first_mb_in_slice is 0, or first_slice_segment_in_pic_flag is
        # set.
        if video is VideoFormat.H264 and whole[at + 3] & 31 in {1, 5}:
            found.append(whole[at + 4] >= 128)
        elif video is VideoFormat.H265 and whole[at + 3] >> 1 & 63 < 32:
            found.append(whole[at + 5] >= 128)
        at = whole.find(_START_CODE, at + 3)
    return found


def is_annex_b(data: Buffer) -> bool:
    """True if the data begin with a start code of three or four bytes (Annex B)."""
    return bytes(data[:4]) == b"\x00" + _START_CODE or bytes(data[:3]) == _START_CODE


def has_four_byte_lengths(video: VideoFormat, head: Buffer) -> bool:
    """True if a codec configuration states that NAL units (coded units) have lengths of four bytes.

    Most configurations (avcC of H.264, hvcC of H.265) do.

    Args:
        video: codec.
        head: codec configuration, the stream's extradata; the result is False if it is too short.
    """
    at = 4 if video is VideoFormat.H264 else 21
    return len(head) > at and head[at] & 3 == 3


def write_start_codes(
    video: VideoFormat, data: bytearray, starts: NDArray[np.int64], ends: NDArray[np.int64]
) -> NDArray[np.bool_]:
    """Replace the four-byte lengths of NAL units by start codes in place, in many access units at once.

    An access unit is one coded picture, made of NAL units (coded units); a video may have 100 000 pictures.

    Args:
        video: codec.
        data: bytes that contain the access units as in an MP4 or Matroska file; an access unit whose result
            is False is left unusable.
        starts: (n,) offset of each access unit in `data` [bytes].
        ends: (n,) offset after each access unit in `data` [bytes].

    Returns:
        (n,) True if the access unit was converted; False if its lengths do not add up to its size, or if it
        is a key picture, which also needs parameter sets before it.
    """
    lengths = np.ndarray(max(0, len(data) - 3), ">u4", data, strides=(1,))  # the four bytes from each byte on
    at = starts.copy()
    going = np.flatnonzero(at < ends - 4)
    while len(going):
        places = at[going]
        sizes, first = lengths[places].astype(np.int64), np.frombuffer(data, np.uint8)[places + 4]
        begins = first & 31 == 5 if video is VideoFormat.H264 else (first >> 1 & 63) - np.uint8(16) < 8
        lengths[places] = _FOUR_BYTE_START_CODE
        at[going] = places = np.where(begins | (sizes == 0), len(data) + 1, places + 4 + sizes)
        going = going[places < ends[going] - 4]
    return at == ends


def _unit_types(video: VideoFormat, data: Buffer) -> Iterator[int]:
    """Yield the types (numbers) of the NAL units (coded units) that begin in a stream's first 64 KiB.

    They come in the stream's order.
    """
    head = bytes(data[:_MAX_HEAD_BYTES])
    at = head.find(_START_CODE)
    while 0 <= at < len(head) - 3:
        first = head[at + 3]
        yield first & 31 if video is VideoFormat.H264 else first >> 1 & 63
        at = head.find(_START_CODE, at + 3)
