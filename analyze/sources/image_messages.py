"""Encodes images and coded pictures as protobuf messages without copying their data.

Protobuf fields may be in any order, and a message may be assembled from parts (protobuf.dev, "Encoding").
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import NamedTuple

import numpy as np
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.CompressedVideo_pb2 import CompressedVideo
from foxglove_schemas_protobuf.RawImage_pb2 import RawImage
from numpy.typing import NDArray

from analyze.reading.annex_b import VideoFormat
from analyze.sources.image_file import ImageFile
from schemas.mcap import records as container
from schemas.mcap.protobuf_wire import timestamp_field, varint
from schemas.mcap.records import Buffer

_FILE_DATA = bytes([2 << 3 | 2])
_RAW_DATA = bytes([6 << 3 | 2])
_VIDEO_DATA = bytes([3 << 3 | 2])
VARINT_BYTES = 5
"""Length [bytes] to which varints (protobuf's integers) before a video's pictures are padded.

All heads are then equally long. The length is enough for the seconds until the year 3058.
"""
MESSAGE_RECORD_HEAD = np.dtype(
    [
        ("opcode", "u1"),
        ("size", "<u8"),
        ("channel", "<u2"),
        ("sequence", "<u4"),
        ("log", "<u8"),
        ("publish", "<u8"),
    ]
)
"""layout of the head of an MCAP message record (schemas/mcap/records.py)"""


def compressed_image(camera: str, log_time_ns: int, file: ImageFile) -> tuple[Buffer, ...]:
    """Encode an image file as a foxglove.CompressedImage message.

    Args:
        camera: name of the camera, the message's frame_id.
        log_time_ns: time stamp of the message [ns].
        file: PNG or JPEG file.

    Returns:
        Two buffers that together, in this order, are the message. The first has all other fields and the
        key and length of the field `data`, the second the file's bytes.
    """
    return timestamp_field(log_time_ns) + _file_head(camera, file.format) + _FILE_DATA + varint(
        len(file.data)
    ), file.data


@cache
def _file_head(camera: str, kind: str) -> bytes:
    """Encoded fields frame_id and format of a foxglove.CompressedImage.

    Args:
        camera: name of the camera.
        kind: format of the image, jpeg or png.
    """
    return CompressedImage(frame_id=camera, format=kind).SerializeToString(deterministic=True)


class VideoMessages(NamedTuple):
    """Log times [ns], sequence numbers and picture sizes [bytes] of the messages of n coded pictures."""

    times_ns: NDArray[np.int64]
    """(n,) log times [ns]"""
    sequences: NDArray[np.int64]
    """(n,) sequence numbers"""
    sizes: NDArray[np.int64]
    """(n,) size of each picture [bytes]"""


def raw_image(camera: str, log_time_ns: int, image: NDArray[np.uint8]) -> tuple[Buffer, ...]:
    """Encode grey values as a foxglove.RawImage message in mono8 (8 bits per pixel).

    Args:
        camera: name of the camera, the message's frame_id.
        log_time_ns: time stamp of the message [ns].
        image: (height, width) grey values.

    Returns:
        Two buffers that together, in this order, are the message. The first has all other fields and the
        key and length of the field `data`, the second the pixels row by row.
    """
    height, width = image.shape
    pixels = np.ascontiguousarray(image)
    return timestamp_field(log_time_ns) + _raw_head(camera, width, height) + _RAW_DATA + varint(
        pixels.size
    ), pixels.data.cast("B")


@cache
def _raw_head(camera: str, width: int, height: int) -> bytes:
    """Encoded fields of a mono8 foxglove.RawImage except time stamp and pixels; width and height in px."""
    return RawImage(
        width=width, height=height, encoding="mono8", step=width, frame_id=camera
    ).SerializeToString(deterministic=True)


@cache
def _video_head(camera: str, kind: VideoFormat) -> bytes:
    """Encoded fields frame_id (the camera's name) and format (codec) of a foxglove.CompressedVideo."""
    return CompressedVideo(frame_id=camera, format=kind.value).SerializeToString(deterministic=True)


def video_room(camera: str, kind: VideoFormat) -> int:
    """Number of bytes before each coded picture in a recording.

    They hold the head of the MCAP message record, and the message's protobuf fields before the picture.

    Args:
        camera: name of the camera, the message's frame_id.
        kind: codec of the pictures.
    """
    return _video_layout(camera, kind).itemsize


def put_video_heads(
    camera: str, kind: VideoFormat, channel: int, messages: VideoMessages, data: Sequence[memoryview]
) -> None:
    """Write the head of an MCAP message record and foxglove.CompressedVideo's fields before each picture.

    They are written in place into the free bytes of `data`. Those of all pictures are computed at once with
    numpy, since a gigabyte of video has 100 000 pictures.

    Args:
        camera: name of the camera, the messages' frame_id.
        kind: codec of the pictures.
        channel: channel id of the topic in the recording.
        messages: times, sequence numbers and sizes of the n pictures.
        data: n writable buffers: `video_room` free bytes, then the picture.
    """
    heads = np.empty(len(data), _video_layout(camera, kind))
    room = heads.itemsize
    heads["opcode"], heads["size"], heads["channel"] = (
        container.MESSAGE,
        room - container.RECORD_HEAD + messages.sizes,
        channel,
    )
    heads["sequence"] = messages.sequences & 0xFFFFFFFF
    heads["log"] = heads["publish"] = messages.times_ns
    heads["stamp"], heads["seconds"] = (
        bytes([1 << 3 | 2, 2 + 2 * VARINT_BYTES, 1 << 3]),
        _varints(messages.times_ns // 10**9),
    )
    heads["nanos"], heads["nanoseconds"] = bytes([2 << 3]), _varints(messages.times_ns % 10**9)
    heads["fields"], heads["length"] = _video_head(camera, kind) + _VIDEO_DATA, _varints(messages.sizes)
    packed = heads.tobytes()
    for number, each in enumerate(data):
        each[:room] = packed[number * room : (number + 1) * room]


@cache
def _video_layout(camera: str, kind: VideoFormat) -> np.dtype[np.void]:
    """Layout (numpy dtype) of the bytes before each coded picture in a recording.

    These are the head of the MCAP message record, and the message's protobuf fields before the picture.
    """
    fields = len(_video_head(camera, kind) + _VIDEO_DATA)
    seconds, nanoseconds, length = (
        (name, "u1", VARINT_BYTES) for name in ("seconds", "nanoseconds", "length")
    )
    return np.dtype(
        [
            *MESSAGE_RECORD_HEAD.descr,
            ("stamp", "S3"),
            seconds,
            ("nanos", "S1"),
            nanoseconds,
            ("fields", f"S{fields}"),
            length,
        ]
    )


def _varints(values: NDArray[np.int64]) -> NDArray[np.uint8]:
    """Encode n values below 2^35 as protobuf varints (integers of variable length).

    Returns bytes (n, VARINT_BYTES): every varint has this length, with leading zero digits if it needs fewer.
    """
    table = (values[:, None] >> 7 * np.arange(VARINT_BYTES) & 127).astype(np.uint8)
    table[:, :-1] |= 128
    return table
