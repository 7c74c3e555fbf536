"""Encoding of images as messages: foxglove.RawImage without copying pixels, or PNG to save disk space."""

from __future__ import annotations

import numpy as np
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.RawImage_pb2 import RawImage
from google.protobuf.timestamp_pb2 import Timestamp
from numpy.typing import NDArray

from acquire.errors import RecorderError
from schemas.mcap.protobuf_wire import timestamp_field, varint
from schemas.mcap.records import Buffer

_DATA_FIELD = bytes([6 << 3 | 2])


class RawImageEncoder:
    """Encoder of mono8 images of one size as foxglove.RawImage messages, without copying the pixels.

    Only the time is serialised for each image. Protobuf fields may stand in any order and a message may be
    concatenated from parts (protobuf.dev, "Encoding").

    Args:
        camera: name of the camera's coordinate frame, the message's `frame_id`.
        width: width of the images [px].
        height: height of the images [px].
    """

    def __init__(self, camera: str, width: int, height: int) -> None:
        image = RawImage(width=width, height=height, encoding="mono8", step=width, frame_id=camera)
        self._shape = (height, width)
        self._size = width * height
        self._after_time = image.SerializeToString(deterministic=True) + _DATA_FIELD + varint(width * height)

    def prefix(self, log_time_ns: int, size: int) -> bytes:
        """Bytes of the serialised RawImage message before its pixels.

        Args:
            log_time_ns: time stamp of the image, since the Unix epoch [ns].
            size: number of bytes of pixels that follow.

        Raises:
            RecorderError: `size` is not width * height.
        """
        if size != self._size:
            raise RecorderError(
                f"an image has {size} bytes, the recording's are {self._shape[1]} x {self._shape[0]}"
            )
        return timestamp_field(log_time_ns) + self._after_time

    def encode(self, log_time_ns: int, image: NDArray[np.uint8]) -> list[Buffer]:
        """Serialised RawImage message, in two parts: the bytes before the pixels, and the pixels.

        Args:
            log_time_ns: time stamp of the image, since the Unix epoch [ns].
            image: (height, width) mono8.

        Returns:
            The parts; the second is a view of `image`, or of a copy if `image` is not contiguous.

        Raises:
            RecorderError: the image differs in size from the encoder's.
        """
        if image.shape != self._shape:
            size, expected = f"{image.shape[1]} x {image.shape[0]}", f"{self._shape[1]} x {self._shape[0]}"
            raise RecorderError(f"image is {size}, the recording's are {expected}")
        if not image.flags.c_contiguous:
            image = np.ascontiguousarray(image)
        return [timestamp_field(log_time_ns) + self._after_time, image.data.cast("B")]


def png_message(camera: str, log_time_ns: int, image: NDArray[np.uint8]) -> bytes:
    """Serialised foxglove.CompressedImage message with the image as PNG, without loss.

    Huffman coding only, on horizontal differences: as small as any other lossless setting on noisy images, at
    160 MB/s.

    Args:
        camera: name of the camera's coordinate frame, the message's `frame_id`.
        log_time_ns: time stamp of the image, since the Unix epoch [ns].
        image: (height, width) mono8.

    Raises:
        RecorderError: OpenCV cannot encode the image.
    """
    import cv2

    strategy = (cv2.IMWRITE_PNG_STRATEGY, cv2.IMWRITE_PNG_STRATEGY_HUFFMAN_ONLY)
    settings = (cv2.IMWRITE_PNG_COMPRESSION, 1, *strategy, cv2.IMWRITE_PNG_FILTER, 16)
    done, data = cv2.imencode(".png", image, settings)
    if not done:
        raise RecorderError("image could not be encoded as PNG")
    stamp = Timestamp(seconds=log_time_ns // 10**9, nanos=log_time_ns % 10**9)
    return CompressedImage(
        timestamp=stamp, frame_id=camera, data=data.tobytes(), format="png"
    ).SerializeToString()
