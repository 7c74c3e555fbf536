"""Decodes image messages to arrays: RawImage as a view, PNG and JPEG through OpenCV."""

from __future__ import annotations

import warnings
from io import BytesIO

import numpy as np
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from google.protobuf.message import DecodeError
from numpy.typing import NDArray

from schemas.mcap.protobuf_wire import read_fields
from schemas.mcap.records import ContainerError

_WIDTH, _HEIGHT, _ENCODING, _STEP, _DATA = 2, 3, 4, 5, 6
"""field numbers of foxglove.RawImage"""
PNG_START = b"\x89PNG\r\n\x1a\n"
PNG_END = b"\0\0\0\0IEND\xae\x42\x60\x82"
"""last chunk of every PNG file: length, name and checksum (ISO/IEC 15948)"""
_KNOWN_TO_PILLOW = (
    b"\x89PNG",
    b"\xff\xd8",
    b"BM",
    b"II",
    b"MM",
    b"RIFF",
    b"P1",
    b"P2",
    b"P3",
    b"P4",
    b"P5",
    b"P6",
)
"""first bytes of files that Pillow reads too"""


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


def decode_image_file(data: bytes, *, verified: bool = False) -> NDArray[np.uint8] | None:
    """Decode an image file's bytes; return (height, width) uint8 grey values, None if they are no image.

    Any format that OpenCV reads is accepted. An orientation tag (EXIF) is ignored. A file that is damaged,
    cut short, or larger than some 180 megapixels is no image.

    Args:
        data: content of the file.
        verified: True if a checksum has shown that the bytes are those that were written.
    """
    import cv2

    if not data or not _is_sound(data, verified=verified):
        return None
    try:
        image = cv2.imdecode(
            np.frombuffer(data, np.uint8), cv2.IMREAD_GRAYSCALE | cv2.IMREAD_IGNORE_ORIENTATION
        )
    except cv2.error:
        return None
    return None if image is None else np.asarray(image, dtype=np.uint8)


def _is_sound(data: bytes, *, verified: bool) -> bool:
    """True if an image file's stated size is plausible and, unless `verified`, its content is whole.

    OpenCV would accept half a JPEG, and its libraries write to standard error. True for formats that only
    OpenCV knows.
    """
    from PIL import Image, UnidentifiedImageError

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            image = Image.open(BytesIO(data))
            if image.format == "PNG":
                image.verify()  # its checksums, but for the last one
                return _ends_like_png(data)
            if not verified:
                image.load()
    except UnidentifiedImageError:
        return not data.startswith(_KNOWN_TO_PILLOW)
    except Exception:  # Pillow's readers raise whatever the damaged byte leads to
        return False
    return True


def _ends_like_png(data: bytes) -> bool:
    """True if the last chunk of a PNG file, whose other chunks are sound, is what it must be."""
    at, size = len(PNG_START), len(data)
    while at + 12 <= size:
        if data[at + 4 : at + 8] == b"IEND":
            return data[at : at + 12] == PNG_END
        at += 12 + int.from_bytes(data[at : at + 4], "big")
    return False


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
    image = decode_image_file(message.data, verified=True)
    if image is None:
        raise ContainerError(f"a {message.format!r} image cannot be decoded")
    return image
