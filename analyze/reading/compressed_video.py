"""Decodes H.264 and H.265 to grey images with FFmpeg (PyAV).

A video is stored in decoding order. Where a later picture was coded first (B-frames) this is not the order of
times; each picture gets the time of the message that contained it, and the pictures are returned by time.
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


def grey_image(frame: av.VideoFrame) -> NDArray[np.uint8]:
    """Grey values (height, width) uint8 of a decoded video frame.

    The result is a view of the frame's luma plane if it has one of 8 bits, otherwise of a converted copy.
    """
    if not _has_luma(frame.format.name):
        frame = frame.reformat(format="gray")
    plane = frame.planes[0]
    return np.frombuffer(memoryview(plane), np.uint8).reshape(-1, plane.line_size)[
        : frame.height, : frame.width
    ]


@cache
def _has_luma(name: str) -> bool:
    """True if the first plane of FFmpeg's pixel format `name` holds nothing but luma of 8 bits."""
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
    """Parse a foxglove.CompressedVideo message; return its codec and the bytes of its coded picture.

    Raises:
        ContainerError: the message is of another type, or its format is unknown.
    """
    try:
        message = CompressedVideo.FromString(bytes(data))
    except DecodeError:
        raise ContainerError("a message is not a foxglove.CompressedVideo") from None
    return video_format(message.format), message.data


def video_format(name: str) -> VideoFormat:
    """Codec with the given name in foxglove.CompressedVideo, "h264" or "h265".

    Raises:
        ContainerError: `name` is another one.
    """
    try:
        return VideoFormat(name)
    except ValueError:
        known = " and ".join(each.value for each in VideoFormat)
        raise ContainerError(f"video of format {name!r} cannot be read, only {known}") from None


def is_decoding_start(message: RecordedMessage) -> bool:
    """True if a decoder can begin with this video message: its picture is a key picture.

    Raises:
        ContainerError: the message is no video, or of an unknown format.
    """
    return is_keyframe(*parse_video(message.data))


def decode_video(messages: Iterable[RecordedMessage]) -> Iterator[ImageFrame]:
    """Decode a video; yield its grey images in display order, without those marked as corrupt.

    Each image is uint8 (height, width), with the log time [ns] and the sequence number of the message that
    contained it.

    Args:
        messages: the video's messages in file order, beginning with one where a decoder can begin.

    Raises:
        ContainerError: a message is no video or of an unknown format, or the decoder fails.
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
                    yield from _image_frames(decoder.decode(None), sequences, base_ns)
                decoder, video, base_ns = _create_decoder(kind), kind, message.log_time_ns
            packet = av.Packet(data)
            packet.time_base, packet.pts = _NANOSECONDS, message.log_time_ns - base_ns
            sequences[message.log_time_ns] = message.sequence
            yield from _image_frames(decoder.decode(packet), sequences, base_ns)
        if decoder is not None:
            yield from _image_frames(decoder.decode(None), sequences, base_ns)
    except FFmpegError as error:
        raise ContainerError(f"the video cannot be decoded: {error.strerror}") from None
    finally:
        if decoder is not None:
            # A decoder that is destroyed while its threads still decode deadlocks: they wait for Python's
            # lock (PyAV 18).
            decoder.flush_buffers()


def _create_decoder(video: VideoFormat) -> av.VideoCodecContext:
    import av

    decoder = av.CodecContext.create(_DECODERS[video], "r")
    assert isinstance(decoder, av.VideoCodecContext)  # noqa: S101 - true for these codecs
    decoder.thread_type = "AUTO"
    return decoder


def _image_frames(
    frames: Iterable[av.VideoFrame], sequences: dict[int, int], base_ns: int
) -> Iterator[ImageFrame]:
    """Yield decoded frames as grey images with log time and sequence number of their messages.

    Corrupt frames, and those whose message is not known, are left out.

    Args:
        frames: decoded frames, with times since `base_ns` [ns].
        sequences: sequence number of each message by its log time [ns]; those used are removed.
        base_ns: log time of the decoder's first message [ns].
    """
    for frame in frames:
        if frame.pts is None:
            continue
        time_ns = base_ns + frame.pts
        sequence = sequences.pop(time_ns, None)
        if sequence is not None and not frame.is_corrupt:
            yield ImageFrame(time_ns, sequence, grey_image(frame))
