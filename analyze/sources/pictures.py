"""Parses image messages of other programs to grey values, with the time stamps of their headers.

Messages of Foxglove (protobuf, JSON) and ROS 2 (CDR) are supported, with raw pixels or image files (such as
JPEG and PNG), and Foxglove's video messages.
"""

from __future__ import annotations

import base64
import json
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any

import cv2
import numpy as np
from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.CompressedVideo_pb2 import CompressedVideo
from foxglove_schemas_protobuf.RawImage_pb2 import RawImage
from google.protobuf.message import DecodeError
from numpy.typing import NDArray
from rosbags.serde import SerdeError
from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.store import Typestore

from analyze.reading.image_message import decode_image_file
from schemas.mcap.records import ContainerError

Image = NDArray[np.uint8]

VIDEO = "foxglove.CompressedVideo"
_ROS_RAW, _ROS_COMPRESSED = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"
_RAW, _COMPRESSED = "foxglove.RawImage", "foxglove.CompressedImage"


@dataclass(frozen=True)
class RawPicture:
    """Raw (uncompressed) image of a message: its pixels as stored, their format, size and time stamp."""

    stamp_ns: int
    """time stamp of the message's header [ns]; 0 if it has none"""
    width: int
    """image width [px]"""
    height: int
    """image height [px]"""
    encoding: str
    """pixel format by its name in ROS, such as mono8 or bgr8"""
    step: int
    """bytes per row"""
    data: Image
    """(n,) bytes of the picture, as stored"""
    big_endian: bool = False
    """True if the first byte of a 16-bit pixel is its high one"""


@dataclass(frozen=True)
class CodedPicture:
    """Content of an image file, or a coded picture of a video, with format and time stamp [ns]."""

    stamp_ns: int
    """time stamp of the message's header [ns]; 0 if it has none"""
    format: str
    """format as the message states it: that of the image file, or the codec h264 or h265"""
    data: bytes
    """image file, or coded picture"""


Picture = RawPicture | CodedPicture


def is_readable(message_encoding: str, schema: str) -> bool:
    """True if messages of this encoding (protobuf, json, cdr) and type are images that can be read."""
    return (message_encoding, schema) in _PARSERS


def parse_picture(message_encoding: str, schema: str, data: bytes) -> Picture:
    """Parse an image message to its picture, without decoding the pixels.

    Args:
        message_encoding: protobuf, json or cdr.
        schema: name of the message type.
        data: the message.

    Returns:
        A `RawPicture` for a message of raw pixels; a `CodedPicture` for an image file or a video's picture.

    Raises:
        ContainerError: the message is damaged, or not of a readable encoding and type.
    """
    try:
        return _PARSERS[message_encoding, schema](data)
    except (
        DecodeError,
        SerdeError,
        ValueError,
        KeyError,
        TypeError,
        AttributeError,
        IndexError,
        RecursionError,
        OverflowError,
    ):
        raise ContainerError(f"a message is not a {schema}") from None


def grey_values(picture: Picture) -> Image:
    """Grey values (height, width) uint8 of raw pixels or an image file; of 16-bit pixels the high byte.

    Raises:
        ContainerError: the encoding is not supported, the pixels or the image file are damaged, or the
            picture is one of a video.
    """
    if isinstance(picture, RawPicture):
        return _raw_grey_values(picture)
    image = decode_image_file(picture.data)
    if image is None:
        raise ContainerError(f"a {picture.format!r:.40} image cannot be decoded")
    return image


# --- raw pixels

# By pixel format: bytes per pixel and OpenCV's conversion to grey.
COLOUR_CONVERSIONS = {
    "rgb8": (3, cv2.COLOR_RGB2GRAY),
    "8uc3": (3, cv2.COLOR_BGR2GRAY),
    "bgr8": (3, cv2.COLOR_BGR2GRAY),
    "rgba8": (4, cv2.COLOR_RGBA2GRAY),
    "bgra8": (4, cv2.COLOR_BGRA2GRAY),
    "8uc4": (4, cv2.COLOR_BGRA2GRAY),
}
# OpenCV names a mosaic by the second row's second and third pixel: RGGB is its BayerBG.
MOSAIC_CONVERSIONS = {
    "bayer_rggb8": cv2.COLOR_BayerBG2GRAY,
    "bayer_bggr8": cv2.COLOR_BayerRG2GRAY,
    "bayer_gbrg8": cv2.COLOR_BayerGR2GRAY,
    "bayer_grbg8": cv2.COLOR_BayerGB2GRAY,
}
LUMA_OFFSET = {"yuv422": 1, "uyvy": 1, "yuv422_yuy2": 0, "yuyv": 0}
"""offset of the first luma value among the bytes of two pixels"""
READ_ENCODINGS = "mono8, mono16, rgb8, bgr8, rgba8, bgra8, 8UC1, 8UC3, bayer_*8, yuv422, yuyv and nv12 are"


def _raw_grey_values(picture: RawPicture) -> Image:
    """Grey values (height, width) uint8 of raw pixels; of 16-bit pixels the high byte.

    Raises:
        ContainerError: the encoding is not supported, or the number of bytes does not fit the size.
    """
    encoding = picture.encoding.lower()
    channels, code = COLOUR_CONVERSIONS.get(encoding, (1, None))
    channels = 2 if encoding in LUMA_OFFSET or encoding == "mono16" else channels
    if code is None and channels == 1 and encoding not in {"mono8", "8uc1", "nv12", *MOSAIC_CONVERSIONS}:
        raise ContainerError(
            f"encoding {picture.encoding!r:.40} is not supported: {READ_ENCODINGS} supported"
        )
    width, height, step = picture.width, picture.height, picture.step
    data = (
        picture.data[: step * height]
        if encoding == "nv12" and 3 * step * height == 2 * len(picture.data)
        else picture.data
    )
    if width <= 0 or height <= 0 or step < width * channels or step * height != len(data):
        raise ContainerError(
            f"an image of {width} x {height} {encoding} with rows of {step} bytes cannot have "
            f"{len(picture.data)} bytes"
        )
    rows = data.reshape(height, step)[:, : width * channels]
    if encoding in LUMA_OFFSET:
        return rows[:, LUMA_OFFSET[encoding] :: 2]
    if encoding == "mono16":
        return rows[:, 0 if picture.big_endian else 1 :: 2]
    if encoding in MOSAIC_CONVERSIONS:
        if min(width, height) < 4:
            raise ContainerError(f"an image of {width} x {height} is too small for {encoding}")
        return np.asarray(
            cv2.cvtColor(np.ascontiguousarray(rows), MOSAIC_CONVERSIONS[encoding]), dtype=np.uint8
        )
    if code is None:
        return rows
    return np.asarray(cv2.cvtColor(rows.reshape(height, width, channels), code), dtype=np.uint8)


# --- messages


def _bytes(data: Any) -> Image:
    return np.frombuffer(data, np.uint8)


def _foxglove_raw(data: bytes) -> Picture:
    message = RawImage.FromString(data)
    stamp_ns = message.timestamp.seconds * 10**9 + message.timestamp.nanos
    return RawPicture(
        stamp_ns, message.width, message.height, message.encoding, message.step, _bytes(message.data)
    )


def _foxglove_coded(kind: type[CompressedImage] | type[CompressedVideo]) -> Callable[[bytes], Picture]:
    """Function that parses the bytes of a protobuf message of type `kind`, a coded picture.

    It returns the picture's time stamp [ns], format (such as "jpeg" or "h264") and coded bytes, and raises
    DecodeError for a damaged message.
    """

    def parse(data: bytes) -> Picture:
        message = kind.FromString(data)
        return CodedPicture(
            message.timestamp.seconds * 10**9 + message.timestamp.nanos, message.format, message.data
        )

    return parse


def _json(data: bytes) -> tuple[dict[str, Any], int, bytes]:
    """Parse a Foxglove message in JSON.

    Returns:
        All its fields by name, its time stamp [ns], and the bytes of its field `data`, decoded from base64.

    Raises:
        ValueError, KeyError, TypeError, AttributeError, RecursionError: the message is damaged.
    """
    fields = json.loads(data)
    stamp = fields.get("timestamp") or {}
    return (
        fields,
        int(stamp.get("sec", 0)) * 10**9 + int(stamp.get("nsec", 0)),
        base64.b64decode(fields["data"], validate=True),
    )


def _json_raw(data: bytes) -> Picture:
    fields, stamp_ns, content = _json(data)
    return RawPicture(
        stamp_ns,
        int(fields["width"]),
        int(fields["height"]),
        str(fields["encoding"]),
        int(fields["step"]),
        _bytes(content),
    )


def _json_coded(data: bytes) -> Picture:
    fields, stamp_ns, content = _json(data)
    return CodedPicture(stamp_ns, str(fields.get("format", "")), content)


@cache
def ros_types() -> Typestore:
    """Store of ROS 2 message types: those of Humble, as image messages are the same in all distributions."""
    return get_typestore(Stores.ROS2_HUMBLE)


def ros_message(data: bytes, kind: str) -> Any:
    """Deserialise a ROS 2 message from CDR; return an object with the message's fields.

    Args:
        data: the message.
        kind: name of the message type, such as sensor_msgs/msg/Image.

    Raises:
        SerdeError, ValueError: the data are not a message of this type.
    """
    if len(data) < 4:
        raise ValueError("no CDR")
    try:
        return ros_types().deserialize_cdr(data, kind)
    except (
        AssertionError,
        ArithmeticError,
        MemoryError,
        LookupError,
        UnicodeError,
    ):  # errors of its generated code on malformed input
        raise ValueError("no CDR") from None


def _ros_stamp(message: Any) -> int:
    return message.header.stamp.sec * 10**9 + message.header.stamp.nanosec


def _ros_raw(data: bytes) -> Picture:
    found = ros_message(data, _ROS_RAW)
    return RawPicture(
        _ros_stamp(found),
        found.width,
        found.height,
        found.encoding,
        found.step,
        found.data,
        bool(found.is_bigendian),
    )


def _ros_coded(data: bytes) -> Picture:
    found = ros_message(data, _ROS_COMPRESSED)
    return CodedPicture(_ros_stamp(found), found.format, found.data.tobytes())


def camera_info(message_encoding: str, schema: str, data: bytes) -> dict[str, Any]:
    """Parse a camera calibration message to its entries by name.

    Args:
        message_encoding: protobuf, json or cdr.
        schema: name of the message type.
        data: the message.

    Returns:
        All entries of a JSON message; of other messages width and height [px], distortion_model, K (the 9
        entries of the camera matrix, row by row [px]) and D (distortion coefficients).

    Raises:
        ContainerError: the message is damaged.
    """
    try:
        if message_encoding == "json":
            return dict(json.loads(data))
        found = (
            CameraCalibration.FromString(data)
            if message_encoding == "protobuf"
            else ros_message(data, schema)
        )
    except (DecodeError, SerdeError, ValueError, TypeError, RecursionError):
        raise ContainerError(f"a message is not a {schema}") from None
    names = ("K", "D") if message_encoding == "protobuf" else ("k", "d")
    K, D = ([float(each) for each in getattr(found, name)] for name in names)
    return {
        "width": found.width,
        "height": found.height,
        "distortion_model": found.distortion_model,
        "K": K,
        "D": D,
    }


def as_video(picture: CodedPicture) -> bytes:
    """Bytes of a foxglove.CompressedVideo message with a coded picture, without time stamp and frame_id."""
    return CompressedVideo(format=picture.format, data=picture.data).SerializeToString()


_PARSERS: dict[tuple[str, str], Callable[[bytes], Picture]] = {
    ("protobuf", _RAW): _foxglove_raw,
    ("protobuf", _COMPRESSED): _foxglove_coded(CompressedImage),
    ("protobuf", VIDEO): _foxglove_coded(CompressedVideo),
    ("json", _RAW): _json_raw,
    ("json", _COMPRESSED): _json_coded,
    ("json", VIDEO): _json_coded,
    ("cdr", _ROS_RAW): _ros_raw,
    ("cdr", _ROS_COMPRESSED): _ros_coded,
}
