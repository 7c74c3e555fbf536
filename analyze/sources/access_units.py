"""Converts packets of a video file to access units with start codes (Annex B), for recordings.

An access unit is the coded data of one picture. In the access unit of a key picture, where a decoder can
begin, the parameter sets (settings that the decoder needs) are included.
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
    """True if lengths, not start codes, separate the coded units of a video stream.

    Files in MP4 and Matroska have lengths. The stream's codec configuration (FFmpeg's extradata) decides it;
    False if there is none.
    """
    head = bytes(stream.codec_context.extradata or b"")
    return bool(head) and not is_annex_b(head)


class AccessUnits:
    """Converter of one video stream's packets to access units (pictures as coded) with start codes.

    Args:
        video: codec of the stream, H.264 or H.265.
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
        """Convert each packet to one writable buffer: `room` free bytes (zeros), then its access unit.

        The packets must not be used afterwards, since FFmpeg may have taken over their data.

        Returns:
            One buffer per packet, in the same order; None for a packet that FFmpeg cannot convert.
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
        """Convert one packet to a buffer: `room` free bytes, then its access unit with start codes.

        An access unit is a picture as coded; a key picture without parameter sets gets them. Returns None if
        FFmpeg cannot convert the packet.
        """
        data = memoryview(packet)
        if not self._has_starts and (self._head or not is_annex_b(data)):
            return self._filtered(packet)
        head = self._head if packet.is_keyframe and not holds_parameter_sets(self._video, data) else b""
        return memoryview(bytearray().join((self._room, head, data)))

    def _filtered(self, packet: av.Packet) -> memoryview | None:
        """Convert one packet to an access unit (picture as coded) with start codes, by FFmpeg's filter.

        Returns a buffer: `room` free bytes, then the access unit; None if FFmpeg cannot convert the packet.
        """
        self._filter.flush()  # otherwise it omits parameter sets that it has already written
        try:
            filtered = self._filter.filter(packet)
        except FFmpegError:
            return None
        return memoryview(bytearray().join((self._room, cast("Buffer", filtered[0])))) if filtered else None
