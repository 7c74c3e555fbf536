"""PNG and JPEG files for recordings: such data are kept, images of other formats become PNG."""

from __future__ import annotations

from typing import NamedTuple

from analyze.reading.image_message import PNG_END, PNG_START, decode_image_file, encode_png
from analyze.sources.jpeg import JPEG_START, jpeg_file
from schemas.mcap.records import Buffer

IMAGE_SUFFIXES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".pgm", ".webp")
"""name endings of image files that are read"""
JPEG, PNG = "jpeg", "png"
"""format names of foxglove.CompressedImage"""
PNG_SIZE_OFFSET = 16
"""offset of the width, before the height, in every PNG file [bytes] (ISO/IEC 15948)"""


class ImageFile(NamedTuple):
    """Content of a PNG or JPEG file as recordings store it, with format and size [px]."""

    format: str
    """`JPEG` or `PNG`"""
    data: Buffer
    """bytes of the file"""
    width: int
    """image width [px]"""
    height: int
    """image height [px]"""


def is_image_file(data: Buffer) -> bool:
    """True if the bytes begin like a PNG or JPEG file."""
    return bytes(data[: len(JPEG_START)]) == JPEG_START or bytes(data[: len(PNG_START)]) == PNG_START


def image_file(data: Buffer) -> ImageFile | None:
    """Convert an image file's bytes to a PNG or JPEG file.

    Bytes of a complete PNG or JPEG file are kept (a JPEG without Huffman tables gets the standard ones);
    another format is decoded and encoded as a grey PNG.

    Returns:
        The PNG or JPEG file with its format and size [px]; None if the bytes are damaged or no image.
    """
    if (jpeg := jpeg_file(data)) is not None:
        return ImageFile(JPEG, *jpeg)
    if bytes(data[: len(PNG_START)]) == PNG_START and bytes(data[-len(PNG_END) :]) == PNG_END:
        width, height = (
            int.from_bytes(data[at : at + 4], "big") for at in (PNG_SIZE_OFFSET, PNG_SIZE_OFFSET + 4)
        )
        return ImageFile(PNG, data, width, height)
    image = decode_image_file(bytes(data))
    return None if image is None else ImageFile(PNG, encode_png(image), image.shape[1], image.shape[0])
