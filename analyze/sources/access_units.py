"""A video file's packets as access units with start codes, as a recording holds them; a key one brings its parameter sets."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import chain, pairwise, repeat
from typing import cast

import av
import numpy as np
from av.error import FFmpegError

from analyze.reading.annex_b import VideoFormat, has_long_lengths, holds_parameter_sets, is_annex_b, mark_starts
from schemas.mcap.records import Buffer

_FILTER = {VideoFormat.H264: "h264_mp4toannexb", VideoFormat.H265: "hevc_mp4toannexb"}


def has_lengths(stream: av.VideoStream) -> bool:
    """Whether the file tells its access units apart by itself, as MP4 and Matroska do: lengths are in place of start codes."""
    head = bytes(stream.codec_context.extradata or b"")
    return bool(head) and not is_annex_b(head)


class AccessUnits:
    """Of one stream.

    Args:
        video: how it is coded.
        stream: the stream.
        room: bytes left free before each access unit, for what stands there in a recording.
    """

    def __init__(self, video: VideoFormat, stream: av.VideoStream, room: int) -> None:
        self._video, self._room = video, bytes(room)
        self._head = bytes(stream.codec_context.extradata or b"")
        self._has_starts = is_annex_b(self._head)
        self._has_long_lengths = has_lengths(stream) and has_long_lengths(video, self._head)
        self._filter = av.BitStreamFilterContext(_FILTER[video], stream)

    def of(self, packets: Sequence[av.Packet]) -> list[memoryview | None]:
        """Room and access unit of each packet, writable; None where it is damaged. Packets may be used up."""
        if not self._has_long_lengths:
            return [self._one(packet) for packet in packets]
        sizes = np.array([packet.size for packet in packets])
        data = bytearray().join(chain.from_iterable(zip(repeat(self._room), cast("Sequence[Buffer]", packets))))
        ends = np.cumsum(sizes + len(self._room))
        marked = mark_starts(self._video, data, ends - sizes, ends).tolist()
        view, places = memoryview(data), pairwise([0, *ends.tolist()])
        return [
            view[start:end] if good else self._turned(packet) for packet, good, (start, end) in zip(packets, marked, places, strict=True)
        ]

    def _one(self, packet: av.Packet) -> memoryview | None:
        data = memoryview(packet)
        if not self._has_starts and (self._head or not is_annex_b(data)):
            return self._turned(packet)
        head = self._head if packet.is_keyframe and not holds_parameter_sets(self._video, data) else b""
        return memoryview(bytearray().join((self._room, head, data)))

    def _turned(self, packet: av.Packet) -> memoryview | None:
        self._filter.flush()  # one that has seen parameter sets leaves them out
        try:
            turned = self._filter.filter(packet)
        except FFmpegError:
            return None
        return memoryview(bytearray().join((self._room, cast("Buffer", turned[0])))) if turned else None
