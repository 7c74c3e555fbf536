"""Recoding of a recording's raw images: PNG without loss, or JPEG quantised by the camera's own noise.

JPEG's table of 64 divisors is one number here, the same for all frequencies, so that what is lost is white,
as the camera's noise is: of a step q rms q / sqrt(12) or less.
"""

# cv2 is only partly typed.
# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false, reportUnknownArgumentType=false

from __future__ import annotations

import io
from dataclasses import dataclass
from typing import TYPE_CHECKING

import cv2
import numpy as np
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.RawImage_pb2 import RawImage
from google.protobuf.message import DecodeError
from PIL import Image

from analyze.reading.image_message import decode_image
from schemas.mcap.records import ContainerError

if TYPE_CHECKING:
    from numpy.typing import NDArray

RAW, COMPRESSED = RawImage.DESCRIPTOR.full_name, CompressedImage.DESCRIPTOR.full_name
"""types of messages: an image as it was taken, and a coded one"""
_PNG = [
    cv2.IMWRITE_PNG_COMPRESSION,
    1,
    cv2.IMWRITE_PNG_STRATEGY,
    cv2.IMWRITE_PNG_STRATEGY_HUFFMAN_ONLY,
    cv2.IMWRITE_PNG_FILTER,
    cv2.IMWRITE_PNG_FILTER_AVG,
]
"""noise has no repetitions to look for; the mean of two neighbours predicts best"""
GREY = 128
"""value of the pixels outside of a region that is kept"""
_FREQUENCIES = 64
_ROUNDING = 0.5
"""largest rms by which decoders round grey values [grey]"""


@dataclass(frozen=True)
class Coding:
    """Coding of one image: step of its quantisation, and the part that is kept."""

    step: int = 0
    """step of the quantisation [grey]; 0 for none: PNG, without loss"""
    kept: NDArray[np.bool_] | None = None
    """(h, w) True where the image is kept; None for all of it"""

    @property
    def exact(self) -> bool:
        """True if no pixel changes."""
        return self.step == 0 and self.kept is None


def recode(schema: str, data: memoryview, coding: Coding) -> bytes | None:
    """An image's message in another coding; None if it stays as it is.

    What is coded already stays, but for PNG of 8-bit grey values that is to be quantised or cut.

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
    return CompressedImage(
        timestamp=head.timestamp,
        frame_id=head.frame_id,
        data=_jpeg(wanted, coding.step) if coding.step else _png(wanted),
        format="jpeg" if coding.step else "png",
    ).SerializeToString(deterministic=True)


def is_recoded(schema: str, before: memoryview, after: memoryview, coding: Coding) -> bool:
    """True if a message is the given image in the coding: its time and frame, and the pixels that it keeps.

    Without quantisation every pixel must be the same; else their rms difference at most what rounding to the
    step makes.

    Args:
        schema: type of the message before.
        before: serialised RawImage or CompressedImage.
        after: serialised CompressedImage.
        coding: how the image is stored.

    Raises:
        ContainerError: one of them is damaged.
    """
    one, other = _head(schema, before), _head(COMPRESSED, after)
    wanted = _wanted(decode_image(schema, before), coding)
    found = decode_image(COMPRESSED, after)
    if one.timestamp != other.timestamp or one.frame_id != other.frame_id or wanted.shape != found.shape:
        return False
    if not coding.step:
        return np.array_equal(wanted, found)
    off = float(np.sqrt(np.mean((wanted.astype(np.float32) - found) ** 2)))
    return off <= coding.step / np.sqrt(12.0) + _ROUNDING


def _wanted(image: NDArray[np.uint8], coding: Coding) -> NDArray[np.uint8]:
    """Image (h, w) with what is not kept in one grey."""
    return image if coding.kept is None else np.where(coding.kept, image, np.uint8(GREY))


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


def _png(image: NDArray[np.uint8]) -> bytes:
    return cv2.imencode(".png", image, _PNG)[1].tobytes()


def _jpeg(image: NDArray[np.uint8], step: int) -> bytes:
    file = io.BytesIO()
    Image.fromarray(image).save(file, "JPEG", qtables=[[step] * _FREQUENCIES], optimize=True)
    return file.getvalue()
