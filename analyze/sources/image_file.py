"""Pictures that are image files already, PNG or JPEG: they are handed on as they are, not decoded and coded again."""

from __future__ import annotations

from typing import NamedTuple

from analyze.reading.image_message import image_of_file, png_of
from analyze.sources.jpeg import JPEG_START, jpeg_file
from schemas.mcap.records import Buffer

JPEG, PNG = "jpeg", "png"
"""as foxglove.CompressedImage calls them"""
_PNG_START, _PNG_END = b"\x89PNG\r\n\x1a\n", b"IEND\xae\x42\x60\x82"
_PNG_SIZE = 16
"""place of width and height in the head of every PNG file (ISO/IEC 15948)"""


class ImageFile(NamedTuple):
    """One picture's file, as a reader of recordings understands it."""

    format: str
    data: Buffer
    width: int
    height: int


def is_image_file(data: Buffer) -> bool:
    """Whether the bytes begin as a PNG or JPEG file."""
    return bytes(data[: len(JPEG_START)]) == JPEG_START or bytes(data[: len(_PNG_START)]) == _PNG_START


def image_file(data: Buffer) -> ImageFile | None:
    """The picture as a file: the bytes themselves where they are one, else what can be decoded of them as PNG; None where nothing can."""
    if (jpeg := jpeg_file(data)) is not None:
        return ImageFile(JPEG, *jpeg)
    if bytes(data[: len(_PNG_START)]) == _PNG_START and bytes(data[-len(_PNG_END) :]) == _PNG_END:
        width, height = (int.from_bytes(data[at : at + 4], "big") for at in (_PNG_SIZE, _PNG_SIZE + 4))
        return ImageFile(PNG, data, width, height)
    return _coded(bytes(data))


def _coded(data: bytes) -> ImageFile | None:
    image = image_of_file(data)
    if image is None:
        return None
    return ImageFile(PNG, png_of(image), image.shape[1], image.shape[0])
