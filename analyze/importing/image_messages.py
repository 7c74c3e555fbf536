"""Images and coded pictures as messages, their bytes handed on and not copied.

Protobuf fields may stand in any order, and a message may be put together from parts (protobuf.dev, "Encoding").
"""

from __future__ import annotations

from functools import cache
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.CompressedVideo_pb2 import CompressedVideo
from foxglove_schemas_protobuf.RawImage_pb2 import RawImage
from numpy.typing import NDArray

from analyze.annex_b import VideoFormat
from analyze.importing.image_file import ImageFile
from schemas import container
from schemas.container import Buffer
from schemas.packed import timestamp_field, varint

_FILE_DATA = bytes([2 << 3 | 2])
_RAW_DATA = bytes([6 << 3 | 2])
_VIDEO_DATA = bytes([3 << 3 | 2])
_RECORD_HEAD = np.dtype([("opcode", "u1"), ("size", "<u8"), ("channel", "<u2"), ("sequence", "<u4"), ("log", "<u8"), ("publish", "<u8")])
"""of a message (schemas/container.py)"""


def compressed_image(camera: str, log_time_ns: int, file: ImageFile) -> tuple[Buffer, ...]:
    """Parts of a foxglove.CompressedImage."""
    return timestamp_field(log_time_ns) + _file_head(camera, file.format) + _FILE_DATA + varint(len(file.data)), file.data


@cache
def _file_head(camera: str, kind: str) -> bytes:
    return CompressedImage(frame_id=camera, format=kind).SerializeToString(deterministic=True)


class VideoMessages(NamedTuple):
    """Messages of coded pictures, but for the pictures."""

    times_ns: NDArray[np.int64]
    """(n,) log times"""
    sequences: NDArray[np.int64]
    """(n,)"""
    sizes: NDArray[np.int64]
    """(n,) bytes of each picture"""


def raw_image(camera: str, log_time_ns: int, image: NDArray[np.uint8]) -> tuple[Buffer, ...]:
    """Parts of a foxglove.RawImage, mono8, of `image` (height, width)."""
    height, width = image.shape
    pixels = np.ascontiguousarray(image)
    return timestamp_field(log_time_ns) + _raw_head(camera, width, height) + _RAW_DATA + varint(pixels.size), pixels.data.cast("B")


@cache
def _raw_head(camera: str, width: int, height: int) -> bytes:
    return RawImage(width=width, height=height, encoding="mono8", step=width, frame_id=camera).SerializeToString(deterministic=True)


@cache
def _video_head(camera: str, kind: VideoFormat) -> bytes:
    return CompressedVideo(frame_id=camera, format=kind.value).SerializeToString(deterministic=True)


def video_heads(camera: str, kind: VideoFormat, channel: int, messages: VideoMessages) -> list[bytes]:
    """What stands before each picture's bytes: its message record's head, and all other fields of its foxglove.CompressedVideo.

    All are put together at once, as columns of bytes: a gigabyte of video has 100 000 pictures.
    """
    seconds, second_used = _varints(messages.times_ns // 10**9)
    nanoseconds, nanosecond_used = _varints(messages.times_ns % 10**9)
    lengths, length_used = _varints(messages.sizes)
    stamp = 2 + second_used.sum(axis=1) + nanosecond_used.sum(axis=1)
    named = _video_head(camera, kind) + _VIDEO_DATA
    count = len(messages.sizes)
    head = np.empty(count, _RECORD_HEAD)
    sizes = 2 + stamp + len(named) + length_used.sum(axis=1) + messages.sizes
    head["opcode"], head["size"], head["channel"] = container.MESSAGE, container.MESSAGE_HEAD - container.RECORD_HEAD + sizes, channel
    head["sequence"] = messages.sequences & 0xFFFFFFFF
    head["log"] = head["publish"] = messages.times_ns
    columns = (
        head.view(np.uint8).reshape(count, _RECORD_HEAD.itemsize),
        _same(b"\x0a", count),
        stamp[:, None].astype(np.uint8),
        _same(b"\x08", count),
        seconds,
        _same(b"\x10", count),
        nanoseconds,
        _same(named, count),
        lengths,
    )
    used = {4: second_used, 6: nanosecond_used, 8: length_used}
    table = np.hstack(columns)
    there = np.hstack([used.get(number, np.ones(column.shape, np.bool_)) for number, column in enumerate(columns)])
    flat = table[there].tobytes()
    ends = np.cumsum(there.sum(axis=1)).tolist()
    return [flat[start:end] for start, end in pairwise([0, *ends])]


def _same(value: bytes, count: int) -> NDArray[np.uint8]:
    return np.broadcast_to(np.frombuffer(value, np.uint8), (count, len(value)))


def _varints(values: NDArray[np.int64]) -> tuple[NDArray[np.uint8], NDArray[np.bool_]]:
    """(n, k) bytes of each value's varint, and which of these are its."""
    groups = max(1, -(-int(values.max(initial=0)).bit_length() // 7))
    left = values[:, None] >> (7 * np.arange(groups))
    used = left > 0
    used[:, 0] = True
    table = (left & 127).astype(np.uint8)
    table[:, :-1] |= used[:, 1:].astype(np.uint8) << 7
    return table, used
