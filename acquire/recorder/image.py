"""Image messages: RawImage without copying the pixels, PNG where the disk is small."""

from __future__ import annotations

import numpy as np
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.RawImage_pb2 import RawImage
from google.protobuf.timestamp_pb2 import Timestamp
from numpy.typing import NDArray

from acquire.errors import RecorderError
from schemas.mcap.packed import timestamp_field, varint
from schemas.mcap.records import Buffer

_DATA_FIELD = bytes([6 << 3 | 2])


class RawImageEncoder:
    """foxglove.RawImage, mono8, of one size: everything but time and pixels is serialised once; pixels are handed on, not copied.

    Protobuf fields may stand in any order and a message may be put together from parts (protobuf.dev, "Encoding").
    """

    def __init__(self, camera: str, width: int, height: int) -> None:
        image = RawImage(width=width, height=height, encoding="mono8", step=width, frame_id=camera)
        self._shape = (height, width)
        self._size = width * height
        self._after_time = image.SerializeToString(deterministic=True) + _DATA_FIELD + varint(width * height)

    def prefix(self, log_time_ns: int, size: int) -> bytes:
        """The message before its pixels, of which there are `size` bytes."""
        if size != self._size:
            raise RecorderError(f"an image has {size} bytes, the recording's are {self._shape[1]} x {self._shape[0]}")
        return timestamp_field(log_time_ns) + self._after_time

    def encode(self, log_time_ns: int, image: NDArray[np.uint8]) -> list[Buffer]:
        """Parts of the message; the last one is a view of `image` (height, width)."""
        if image.shape != self._shape:
            raise RecorderError(f"image is {image.shape[1]} x {image.shape[0]}, the recording's are {self._shape[1]} x {self._shape[0]}")
        if not image.flags.c_contiguous:
            image = np.ascontiguousarray(image)
        return [timestamp_field(log_time_ns) + self._after_time, image.data.cast("B")]


def png_message(camera: str, log_time_ns: int, image: NDArray[np.uint8]) -> bytes:
    """foxglove.CompressedImage, format png, of `image` (height, width).

    Huffman coding only, on horizontal differences: on noisy images as small as any other lossless setting, at 160 MB/s.
    """
    import cv2

    settings = (cv2.IMWRITE_PNG_COMPRESSION, 1, cv2.IMWRITE_PNG_STRATEGY, cv2.IMWRITE_PNG_STRATEGY_HUFFMAN_ONLY, cv2.IMWRITE_PNG_FILTER, 16)
    done, data = cv2.imencode(".png", image, settings)
    if not done:
        raise RecorderError("image could not be encoded as PNG")
    stamp = Timestamp(seconds=log_time_ns // 10**9, nanos=log_time_ns % 10**9)
    return CompressedImage(timestamp=stamp, frame_id=camera, data=data.tobytes(), format="png").SerializeToString()
