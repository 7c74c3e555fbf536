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


@dataclass(frozen=True)
class Coding:
    """How an image is stored."""

    step: int = 0
    """step of the quantisation [grey]; 0 for none: PNG, without loss"""
    kept: NDArray[np.bool_] | None = None
    """(h, w) True where the image is kept; None for all of it"""


@dataclass(frozen=True)
class RecodedImage:
    """Message of an image in its new coding."""

    data: bytes
    """serialised CompressedImage"""
    exact: bool
    """True if no pixel differs from the raw image's"""


def recode(schema: str, data: memoryview, coding: Coding) -> RecodedImage | None:
    """An image in another coding, which has been decoded again and compared; None if it stays as it is.

    What is coded already stays, but for PNG that is to be quantised or cut.

    Args:
        schema: type of the message.
        data: serialised RawImage or CompressedImage.
        coding: how the image is to be stored.

    Raises:
        ContainerError: the message is damaged, no image of 8-bit grey values, or the coding lost more than it
            states.
    """
    exact = coding.step == 0 and coding.kept is None
    head = _head(schema, data)
    if isinstance(head, CompressedImage) and (exact or head.format != "png"):
        return None
    pixels = decode_image(schema, data)
    wanted = pixels if coding.kept is None else np.where(coding.kept, pixels, np.uint8(GREY))
    message = CompressedImage(
        timestamp=head.timestamp,
        frame_id=head.frame_id,
        data=_jpeg(wanted, coding.step) if coding.step else _png(wanted),
        format="jpeg" if coding.step else "png",
    ).SerializeToString(deterministic=True)
    back = decode_image(COMPRESSED, memoryview(message))
    off = float(np.sqrt(np.mean((back.astype(np.float32) - wanted) ** 2)))
    if back.shape != wanted.shape or off > 0.5 * coding.step:
        raise ContainerError(f"an image came back {off:.2g} grey levels off")
    return RecodedImage(message, exact)


def same_image(raw: memoryview, recoded: memoryview) -> bool:
    """True if a recoded image has the time, the frame and every pixel of the raw one.

    Raises:
        ContainerError: one of them is damaged.
    """
    before, after = _head(RAW, raw), _head(COMPRESSED, recoded)
    return (
        before.timestamp == after.timestamp
        and before.frame_id == after.frame_id
        and np.array_equal(decode_image(RAW, raw), decode_image(COMPRESSED, recoded))
    )


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
