"""Images and coded pictures as messages, their bytes handed on and not copied.

Protobuf fields may stand in any order, and a message may be put together from parts (protobuf.dev, "Encoding").
"""

from __future__ import annotations

import numpy as np
from foxglove_schemas_protobuf.CompressedVideo_pb2 import CompressedVideo
from foxglove_schemas_protobuf.RawImage_pb2 import RawImage
from google.protobuf.timestamp_pb2 import Timestamp
from numpy.typing import NDArray

from analyze.annex_b import VideoFormat
from schemas.container import Buffer

_RAW_DATA = bytes([6 << 3 | 2])
_VIDEO_DATA = bytes([3 << 3 | 2])


def raw_image(camera: str, log_time_ns: int, image: NDArray[np.uint8]) -> tuple[Buffer, ...]:
    """Parts of a foxglove.RawImage, mono8, of `image` (height, width)."""
    height, width = image.shape
    head = RawImage(timestamp=_stamp(log_time_ns), width=width, height=height, encoding="mono8", step=width, frame_id=camera)
    pixels = np.ascontiguousarray(image)
    return head.SerializeToString(deterministic=True) + _RAW_DATA + _varint(pixels.size), pixels.data.cast("B")


def video(camera: str, log_time_ns: int, kind: VideoFormat, data: Buffer) -> tuple[Buffer, ...]:
    """Parts of a foxglove.CompressedVideo."""
    head = CompressedVideo(timestamp=_stamp(log_time_ns), frame_id=camera, format=kind.value)
    return head.SerializeToString(deterministic=True) + _VIDEO_DATA + _varint(len(data)), data


def _stamp(time_ns: int) -> Timestamp:
    return Timestamp(seconds=time_ns // 10**9, nanos=time_ns % 10**9)


def _varint(value: int) -> bytes:
    result = bytearray()
    while value > 127:
        result.append(value & 127 | 128)
        value >>= 7
    result.append(value)
    return bytes(result)
