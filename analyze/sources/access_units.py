"""Converts packets of a video file to access units with start codes (Annex B), as recordings store them.

The access unit of a key picture contains its parameter sets.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import chain, pairwise, repeat
from typing import cast

import av
import numpy as np
from av.error import FFmpegError

from analyze.reading.annex_b import (
    VideoFormat,
    has_four_byte_lengths,
    holds_parameter_sets,
    is_annex_b,
    write_start_codes,
)
from schemas.mcap.records import Buffer

_FILTER = {VideoFormat.H264: "h264_mp4toannexb", VideoFormat.H265: "hevc_mp4toannexb"}


def has_lengths(stream: av.VideoStream) -> bool:
    """True if the file separates access units by lengths in place of start codes, as MP4 and Matroska do."""
    head = bytes(stream.codec_context.extradata or b"")
    return bool(head) and not is_annex_b(head)


class AccessUnits:
    """Converter of one stream's packets to access units.

    Args:
        video: codec.
        stream: video stream of the file.
        room: number of bytes left free before each access unit, for the message's head in a recording.
    """

    def __init__(self, video: VideoFormat, stream: av.VideoStream, room: int) -> None:
        self._video, self._room = video, bytes(room)
        self._head = bytes(stream.codec_context.extradata or b"")
        self._has_starts = is_annex_b(self._head)
        self._has_long_lengths = has_lengths(stream) and has_four_byte_lengths(video, self._head)
        self._filter = av.BitStreamFilterContext(_FILTER[video], stream)

    def convert(self, packets: Sequence[av.Packet]) -> list[memoryview | None]:
        """Free bytes and access unit of each packet, as one writable buffer; None for a damaged packet.

        The packets may be consumed.
        """
        if not self._has_long_lengths:
            return [self._one(packet) for packet in packets]
        sizes = np.array([packet.size for packet in packets])
        data = bytearray().join(
            chain.from_iterable(zip(repeat(self._room), cast("Sequence[Buffer]", packets)))
        )
        ends = np.cumsum(sizes + len(self._room))
        marked = write_start_codes(self._video, data, ends - sizes, ends).tolist()
        view, places = memoryview(data), pairwise([0, *ends.tolist()])
        return [
            view[start:end] if good else self._filtered(packet)
            for packet, good, (start, end) in zip(packets, marked, places, strict=True)
        ]

    def _one(self, packet: av.Packet) -> memoryview | None:
        data = memoryview(packet)
        if not self._has_starts and (self._head or not is_annex_b(data)):
            return self._filtered(packet)
        head = self._head if packet.is_keyframe and not holds_parameter_sets(self._video, data) else b""
        return memoryview(bytearray().join((self._room, head, data)))

    def _filtered(self, packet: av.Packet) -> memoryview | None:
        self._filter.flush()  # otherwise it omits parameter sets that it has already written
        try:
            filtered = self._filter.filter(packet)
        except FFmpegError:
            return None
        return memoryview(bytearray().join((self._room, cast("Buffer", filtered[0])))) if filtered else None
