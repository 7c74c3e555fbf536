"""A video file's packets as access units with start codes, as a recording holds them; a key one brings its parameter sets."""

from __future__ import annotations

import av
from av.error import FFmpegError

from analyze.annex_b import StartMarker, VideoFormat, has_long_lengths, holds_parameter_sets, is_annex_b
from schemas.container import Buffer

_FILTER = {VideoFormat.H264: "h264_mp4toannexb", VideoFormat.H265: "hevc_mp4toannexb"}


class AccessUnits:
    """Of one stream.

    Args:
        video: how it is coded.
        stream: the stream.
    """

    def __init__(self, video: VideoFormat, stream: av.VideoStream) -> None:
        self._video, self._stream = video, stream
        self._head = bytes(stream.codec_context.extradata or b"")
        self._has_starts = is_annex_b(self._head)
        self._marker = StartMarker(video) if has_long_lengths(video, self._head) else None

    def of(self, packet: av.Packet) -> Buffer | None:
        """A packet's access unit, in its own memory where it can be; None where it is damaged."""
        data = memoryview(packet)
        if self._has_starts or (not self._head and is_annex_b(data)):
            if packet.is_keyframe and not holds_parameter_sets(self._video, data):
                return self._head + bytes(data)
            return data
        if self._marker is not None and self._marker.mark(data):
            return data
        # A filter of its own: one that has seen parameter sets leaves them out.
        turn = av.BitStreamFilterContext(_FILTER[self._video], self._stream)
        try:
            turned = turn.filter(packet)
        except FFmpegError:
            return None
        return memoryview(turned[0]) if turned else None
