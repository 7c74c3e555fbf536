"""Decodes image messages to arrays: RawImage as a view, PNG and JPEG through OpenCV."""

from __future__ import annotations

import numpy as np
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from google.protobuf.message import DecodeError
from numpy.typing import NDArray

from schemas.mcap.protobuf_wire import read_fields
from schemas.mcap.records import ContainerError

_WIDTH, _HEIGHT, _ENCODING, _STEP, _DATA = 2, 3, 4, 5, 6
"""field numbers of foxglove.RawImage"""


def decode_image(schema: str, data: memoryview) -> NDArray[np.uint8]:
    """Decode a foxglove.RawImage or CompressedImage to (height, width) uint8 grey values.

    A raw image is returned as a view of `data`. Compressed colour is converted to grey.

    Args:
        schema: full name of the message type.
        data: the message.

    Raises:
        ContainerError: the message is of another type or damaged, a raw image has a pixel format other than
            mono8 (8UC1), or a compressed image cannot be decoded.
    """
    if schema == "foxglove.RawImage":
        return _raw_image(data)
    if schema == "foxglove.CompressedImage":
        return _compressed_image(data)
    raise ContainerError(f"images of type {schema!r} cannot be read, only RawImage and CompressedImage")


def decode_image_file(data: bytes) -> NDArray[np.uint8] | None:
    """Decode an image file's bytes; return (height, width) uint8 grey values, None if they are no image.

    Any format that OpenCV reads is accepted. An orientation tag (EXIF) is ignored.
    """
    import cv2

    if not data:
        return None
    try:
        image = cv2.imdecode(
            np.frombuffer(data, np.uint8), cv2.IMREAD_GRAYSCALE | cv2.IMREAD_IGNORE_ORIENTATION
        )
    except cv2.error:
        return None
    return None if image is None else np.asarray(image, dtype=np.uint8)


def encode_png(image: NDArray[np.uint8]) -> bytes:
    """Bytes of a PNG file with the given (height, width) uint8 image."""
    import cv2

    return cv2.imencode(".png", image)[1].tobytes()


def _raw_image(data: memoryview) -> NDArray[np.uint8]:
    numbers = {_WIDTH: 0, _HEIGHT: 0, _STEP: 0}
    parts = {_ENCODING: memoryview(b""), _DATA: memoryview(b"")}
    for number, value in read_fields(data):
        if isinstance(value, int):
            numbers[number] = value
        else:
            parts[number] = value
    encoding, pixels = str(parts[_ENCODING], "ascii", "replace"), parts[_DATA]
    width, height, step = numbers[_WIDTH], numbers[_HEIGHT], numbers[_STEP]
    if encoding not in {"mono8", "8UC1"}:
        raise ContainerError(f"encoding {encoding!r} cannot be read, only mono8")
    if not 0 < width <= step or height <= 0 or step * height != len(pixels):
        raise ContainerError(f"an image of {width} x {height} cannot have {len(pixels)} bytes")
    return np.frombuffer(pixels, np.uint8).reshape(height, step)[:, :width]


def _compressed_image(data: memoryview) -> NDArray[np.uint8]:
    try:
        message = CompressedImage.FromString(bytes(data))
    except DecodeError:
        raise ContainerError("a message is not a foxglove.CompressedImage") from None
    image = decode_image_file(message.data)
    if image is None:
        raise ContainerError(f"a {message.format!r} image cannot be decoded")
    return image
