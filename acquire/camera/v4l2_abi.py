"""Structures, numbers and flags of the kernel's video interface (V4L2), for 64-bit Linux.

After the kernel's `include/uapi/linux/videodev2.h` and its documentation, "Video for Linux API", part I. A
test compares offsets and numbers with the installed header. No library is used: linuxpy, the only one that is
kept up, is under the GPL (docs/decisions/0080).
"""

from __future__ import annotations

import ctypes
from ctypes import c_char, c_int32, c_int64, c_uint8, c_uint32, c_uint64
from typing import Final

VIDEO_CAPTURE: Final = 1
"""buffer type of a camera with one plane per image"""
MEMORY_MMAP: Final = 1
FIELD_NONE: Final = 1
MAX_BUFFERS: Final = 32
"""most buffers that a driver grants (VIDEO_MAX_FRAME)"""
CAP_VIDEO_CAPTURE, CAP_VIDEO_CAPTURE_MPLANE, CAP_META_CAPTURE = 0x1, 0x1000, 0x00800000
CAP_STREAMING, CAP_DEVICE_CAPS, CAP_TIMEPERFRAME = 0x04000000, 0x80000000, 0x1000
BUF_MAPPED, BUF_QUEUED, BUF_DONE, BUF_ERROR = 0x1, 0x2, 0x4, 0x40
TIMESTAMP_MASK, TIMESTAMP_MONOTONIC = 0xE000, 0x2000
STAMP_SOURCE_MASK, STAMP_START_OF_EXPOSURE = 0x70000, 0x10000
"""source of a buffer's stamp: start of exposure; without the flag the end of the frame"""

CID_AUTO_WHITE_BALANCE, CID_EXPOSURE, CID_AUTOGAIN, CID_GAIN = 0x0098090C, 0x00980911, 0x00980912, 0x00980913
CID_HFLIP, CID_VFLIP, CID_BACKLIGHT_COMPENSATION = 0x00980914, 0x00980915, 0x0098091C
CID_EXPOSURE_AUTO, CID_EXPOSURE_ABSOLUTE, CID_EXPOSURE_AUTO_PRIORITY = 0x009A0901, 0x009A0902, 0x009A0903
CID_FOCUS_AUTO = 0x009A090C
EXPOSURE_MANUAL: Final = 1
EXPOSURE_UNIT_US: Final = 100.0
"""unit of the control CID_EXPOSURE_ABSOLUTE [us]"""
CONTROL_DISABLED: Final = 0x1


class Capability(ctypes.Structure):
    """Identity and abilities of a device (v4l2_capability)."""

    _fields_ = (
        ("driver", c_char * 16),
        ("card", c_char * 32),
        ("bus_info", c_char * 32),
        ("version", c_uint32),
        ("capabilities", c_uint32),
        ("device_caps", c_uint32),
        ("reserved", c_uint32 * 3),
    )


class FormatDescription(ctypes.Structure):
    """One of a device's pixel formats (v4l2_fmtdesc)."""

    _fields_ = (
        ("index", c_uint32),
        ("type", c_uint32),
        ("flags", c_uint32),
        ("description", c_char * 32),
        ("pixelformat", c_uint32),
        ("mbus_code", c_uint32),
        ("reserved", c_uint32 * 3),
    )


class ImageFormat(ctypes.Structure):
    """Size, pixel format and row length of the images (v4l2_format with v4l2_pix_format)."""

    _fields_ = (
        ("type", c_uint32),
        ("padding", c_uint32),
        ("width", c_uint32),
        ("height", c_uint32),
        ("pixelformat", c_uint32),
        ("field", c_uint32),
        ("bytesperline", c_uint32),
        ("sizeimage", c_uint32),
        ("colorspace", c_uint32),
        ("priv", c_uint32),
        ("unused", c_uint8 * 168),
    )


class StreamParameters(ctypes.Structure):
    """Time per frame [s], as a fraction (v4l2_streamparm with v4l2_captureparm)."""

    _fields_ = (
        ("type", c_uint32),
        ("capability", c_uint32),
        ("capturemode", c_uint32),
        ("numerator", c_uint32),
        ("denominator", c_uint32),
        ("extendedmode", c_uint32),
        ("readbuffers", c_uint32),
        ("unused", c_uint8 * 176),
    )


class BufferRequest(ctypes.Structure):
    """Number of buffers, asked for and granted (v4l2_requestbuffers)."""

    _fields_ = (
        ("count", c_uint32),
        ("type", c_uint32),
        ("memory", c_uint32),
        ("capabilities", c_uint32),
        ("flags", c_uint8),
        ("reserved", c_uint8 * 3),
    )


class Buffer(ctypes.Structure):
    """State of one buffer: its place in memory, or its image's size, stamp and number (v4l2_buffer)."""

    _fields_ = (
        ("index", c_uint32),
        ("type", c_uint32),
        ("bytesused", c_uint32),
        ("flags", c_uint32),
        ("field", c_uint32),
        ("padding", c_uint32),
        ("seconds", c_int64),
        ("microseconds", c_int64),
        ("timecode", c_uint8 * 16),
        ("sequence", c_uint32),
        ("memory", c_uint32),
        ("offset", c_uint64),
        ("length", c_uint32),
        ("reserved2", c_uint32),
        ("request_fd", c_int32),
        ("end", c_uint32),
    )


class ControlValue(ctypes.Structure):
    """Value of a control (v4l2_control)."""

    _fields_ = (("id", c_uint32), ("value", c_int32))


class ControlRange(ctypes.Structure):
    """Name and range of a control (v4l2_queryctrl)."""

    _fields_ = (
        ("id", c_uint32),
        ("type", c_uint32),
        ("name", c_char * 32),
        ("minimum", c_int32),
        ("maximum", c_int32),
        ("step", c_int32),
        ("default_value", c_int32),
        ("flags", c_uint32),
        ("reserved", c_uint32 * 2),
    )


def _request(direction: int, number: int, size: int) -> int:
    """Request number of an ioctl of V4L2: direction (1 to the kernel, 2 from it, 3 both), number, size."""
    return direction << 30 | size << 16 | ord("V") << 8 | number


QUERYCAP: Final = _request(2, 0, ctypes.sizeof(Capability))
ENUM_FMT: Final = _request(3, 2, ctypes.sizeof(FormatDescription))
G_FMT: Final = _request(3, 4, ctypes.sizeof(ImageFormat))
S_FMT: Final = _request(3, 5, ctypes.sizeof(ImageFormat))
REQBUFS: Final = _request(3, 8, ctypes.sizeof(BufferRequest))
QUERYBUF: Final = _request(3, 9, ctypes.sizeof(Buffer))
QBUF: Final = _request(3, 15, ctypes.sizeof(Buffer))
DQBUF: Final = _request(3, 17, ctypes.sizeof(Buffer))
STREAMON: Final = _request(1, 18, ctypes.sizeof(c_int32))
STREAMOFF: Final = _request(1, 19, ctypes.sizeof(c_int32))
G_PARM: Final = _request(3, 21, ctypes.sizeof(StreamParameters))
S_PARM: Final = _request(3, 22, ctypes.sizeof(StreamParameters))
G_CTRL: Final = _request(3, 27, ctypes.sizeof(ControlValue))
S_CTRL: Final = _request(3, 28, ctypes.sizeof(ControlValue))
QUERYCTRL: Final = _request(3, 36, ctypes.sizeof(ControlRange))


def fourcc(name: str) -> int:
    """Number of the pixel format with the four-letter code `name`, such as GREY."""
    return int.from_bytes(name.encode("ascii"), "little")


def fourcc_name(number: int) -> str:
    """Four-letter code of a pixel format's number; other bytes than letters are shown as they are."""
    return number.to_bytes(4, "little").decode("latin-1").strip()
