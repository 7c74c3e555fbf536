"""Images out of coded pictures, through FFmpeg's decoders (PyAV): grey values of a frame, and of a recording's foxglove.CompressedVideo.

A video is kept in the order in which it is decoded. Where a later picture was coded first (B-frames) that is not the order of its times:
a decoder gives each picture the time of the message it came in, by then in order.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from fractions import Fraction
from functools import cache
from typing import TYPE_CHECKING

import numpy as np
from foxglove_schemas_protobuf.CompressedVideo_pb2 import CompressedVideo
from google.protobuf.message import DecodeError
from numpy.typing import NDArray

from analyze.reading.annex_b import VideoFormat, is_keyframe
from analyze.types import ImageFrame
from schemas.mcap.records import ContainerError

if TYPE_CHECKING:
    import av

    from analyze.reading.indexed_file import RecordedMessage

SCHEMA = "foxglove.CompressedVideo"
_DECODERS = {VideoFormat.H264: "h264", VideoFormat.H265: "hevc"}
_NANOSECONDS = Fraction(1, 10**9)


def grey_values(frame: av.VideoFrame) -> NDArray[np.uint8]:
    """(height, width) brightness of a decoded frame: its luma as it was coded where that has 8 bits (a view), else converted."""
    if not _has_luma(frame.format.name):
        frame = frame.reformat(format="gray")
    plane = frame.planes[0]
    return np.frombuffer(memoryview(plane), np.uint8).reshape(-1, plane.line_size)[: frame.height, : frame.width]


@cache
def _has_luma(name: str) -> bool:
    import av

    pixels = av.VideoFormat(name)
    first = pixels.components[0]
    return (
        first.plane == 0
        and first.is_luma
        and first.bits == 8
        and (pixels.is_planar or len(pixels.components) == 1)
        and not pixels.has_palette
    )


def parse_video(data: memoryview) -> tuple[VideoFormat, bytes]:
    """Format and bytes of a foxglove.CompressedVideo.

    Raises:
        ContainerError: it is none, or of a format that is not read.
    """
    message = CompressedVideo()
    try:
        message.ParseFromString(bytes(data))
    except DecodeError:
        raise ContainerError("not a CompressedVideo") from None
    return video_format(message.format), message.data


def video_format(name: str) -> VideoFormat:
    """The format that a message names.

    Raises:
        ContainerError: it is not read.
    """
    try:
        return VideoFormat(name)
    except ValueError:
        known = " and ".join(each.value for each in VideoFormat)
        raise ContainerError(f"video of format {name!r} is not read: {known} are") from None


def may_begin(message: RecordedMessage) -> bool:
    """Whether a decoder may begin with this message.

    Raises:
        ContainerError: it is no video.
    """
    return is_keyframe(*parse_video(message.data))


def decoded(messages: Iterable[RecordedMessage]) -> Iterator[ImageFrame]:
    """Images of a video's messages, by time.

    Args:
        messages: in the order in which they were written, from one on with which a decoder may begin.

    Raises:
        ContainerError: one is no video, or cannot be decoded.
    """
    import av
    from av.error import FFmpegError

    decoder: av.VideoCodecContext | None = None
    video: VideoFormat | None = None
    sequences: dict[int, int] = {}
    base_ns = 0
    try:
        for message in messages:
            kind, data = parse_video(message.data)
            if decoder is None or kind is not video:
                if decoder is not None:
                    yield from _images(decoder.decode(None), sequences, base_ns)
                decoder, video, base_ns = _decoder(kind), kind, message.log_time_ns
            packet = av.Packet(data)
            packet.time_base, packet.pts = _NANOSECONDS, message.log_time_ns - base_ns
            sequences[message.log_time_ns] = message.sequence
            yield from _images(decoder.decode(packet), sequences, base_ns)
        if decoder is not None:
            yield from _images(decoder.decode(None), sequences, base_ns)
    except FFmpegError as error:
        raise ContainerError(f"the video cannot be decoded: {error.strerror}") from None
    finally:
        if decoder is not None:
            # One that is let go of while its threads still decode waits for ever for what they want of Python (PyAV 18).
            decoder.flush_buffers()


def _decoder(video: VideoFormat) -> av.VideoCodecContext:
    import av

    decoder = av.CodecContext.create(_DECODERS[video], "r")
    assert isinstance(decoder, av.VideoCodecContext)  # noqa: S101 - of these codecs it is
    decoder.thread_type = "AUTO"
    return decoder


def _images(frames: Iterable[av.VideoFrame], sequences: dict[int, int], base_ns: int) -> Iterator[ImageFrame]:
    for frame in frames:
        if frame.pts is None:
            continue
        time_ns = base_ns + frame.pts
        sequence = sequences.pop(time_ns, None)
        if sequence is not None and not frame.is_corrupt:
            yield ImageFrame(time_ns, sequence, grey_values(frame))
