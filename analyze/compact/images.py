"""Recoding of a recording's images as PNG: without loss, within the camera's noise, or cut to what moves."""

# cv2 is only partly typed.
# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false, reportUnknownArgumentType=false

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import cv2
import numpy as np
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.RawImage_pb2 import RawImage
from google.protobuf.message import DecodeError

from analyze.compact.moving_region import whole_squares
from analyze.compact.near_lossless import MAX_CHANGE_SD, within_noise
from analyze.reading.image_message import decode_image
from schemas.mcap.records import ContainerError

if TYPE_CHECKING:
    from numpy.typing import NDArray

RAW, COMPRESSED = RawImage.DESCRIPTOR.full_name, CompressedImage.DESCRIPTOR.full_name
"""types of messages: an image as it was taken, and a coded one"""
_NOISY = [
    cv2.IMWRITE_PNG_COMPRESSION,
    1,
    cv2.IMWRITE_PNG_STRATEGY,
    cv2.IMWRITE_PNG_STRATEGY_HUFFMAN_ONLY,
    cv2.IMWRITE_PNG_FILTER,
    cv2.IMWRITE_PNG_FILTER_AVG,
]
"""noise has no repetitions to look for; the mean of two neighbours predicts best"""
_FLAT = [
    cv2.IMWRITE_PNG_COMPRESSION,
    1,
    cv2.IMWRITE_PNG_STRATEGY,
    cv2.IMWRITE_PNG_STRATEGY_RLE,
    cv2.IMWRITE_PNG_FILTER,
    cv2.IMWRITE_PNG_FILTER_PAETH,
]
"""where one value fills a square, differences are runs of zeros"""
GREY = 128
"""value of the pixels outside of a region that is kept"""


@dataclass(frozen=True)
class Coding:
    """Coding of one image: the noise within which it may change, and the part that is kept."""

    noise_sd: float = 0.0
    """standard deviation of a pixel's noise [grey], within which pixels may change; 0 for no change"""
    information_share: float = 1.0
    """share of the information on motion that exact pixels hold"""
    squares: NDArray[np.bool_] | None = None
    """True for each square (`moving_region.SQUARE_PX`) of the image that is kept; None for all of it"""

    @property
    def exact(self) -> bool:
        """True if no pixel changes."""
        return self.noise_sd == 0.0 and self.squares is None


def recode(schema: str, data: memoryview, coding: Coding) -> bytes | None:
    """An image's message in another coding; None if it stays as it is.

    What is coded already stays, but for PNG of 8-bit grey values that may change or is to be cut.

    Args:
        schema: type of the message.
        data: serialised RawImage or CompressedImage.
        coding: how the image is to be stored.

    Raises:
        ContainerError: the message is damaged, or no image of 8-bit grey values.
    """
    head = _head(schema, data)
    if isinstance(head, CompressedImage) and (coding.exact or not _is_grey_png(data)):
        return None
    wanted = _wanted(decode_image(schema, data), coding)
    png = cv2.imencode(".png", wanted, _NOISY if coding.exact else _FLAT)[1].tobytes()
    return CompressedImage(
        timestamp=head.timestamp, frame_id=head.frame_id, data=png, format="png"
    ).SerializeToString(deterministic=True)


def is_recoded(schema: str, original: memoryview, recoded: memoryview, coding: Coding) -> bool:
    """True if a message is the given image in the coding: its time and frame, and every pixel as wanted.

    Args:
        schema: type of the original message.
        original: serialised RawImage or CompressedImage.
        recoded: serialised CompressedImage.
        coding: how the image is stored.

    Raises:
        ContainerError: one of them is damaged.
    """
    one, other = _head(schema, original), _head(COMPRESSED, recoded)
    image, found = decode_image(schema, original), decode_image(COMPRESSED, recoded)
    if one.timestamp != other.timestamp or one.frame_id != other.frame_id or image.shape != found.shape:
        return False
    kept = _kept(image, coding)
    off = cv2.absdiff(image, found)
    if float(np.max(off if kept is None else off * kept, initial=0)) > MAX_CHANGE_SD * coding.noise_sd:
        return False
    return np.array_equal(_wanted(image, coding), found)


def _kept(image: NDArray[np.uint8], coding: Coding) -> NDArray[np.bool_] | None:
    """True (h, w) where an image is kept; None for all of it."""
    return None if coding.squares is None else whole_squares(coding.squares, image.shape)


def _wanted(image: NDArray[np.uint8], coding: Coding) -> NDArray[np.uint8]:
    """Image (h, w) as it is to be stored."""
    kept = _kept(image, coding)
    share = coding.information_share
    changed = within_noise(image, coding.noise_sd, kept, share) if coding.noise_sd else image
    return changed if kept is None else np.where(kept, changed, np.uint8(GREY))


def _is_grey_png(data: memoryview) -> bool:
    """True for a CompressedImage that is a PNG of 8-bit grey values."""
    message = CompressedImage.FromString(bytes(data))
    if message.format != "png":
        return False
    image = cv2.imdecode(np.frombuffer(message.data, np.uint8), cv2.IMREAD_UNCHANGED)
    return image is not None and image.ndim == 2 and image.dtype == np.uint8


def _head(schema: str, data: memoryview) -> RawImage | CompressedImage:
    """An image's message without its pixels.

    Raises:
        ContainerError: it is of another type.
    """
    try:
        message = (RawImage if schema == RAW else CompressedImage).FromString(bytes(data))
    except DecodeError:
        raise ContainerError(f"a message is not a {schema}") from None
    message.ClearField("data")
    return message
