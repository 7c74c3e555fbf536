"""Messages in the form in which they are handed to the writer of a recording."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

from acquire.errors import RecorderError
from schemas.mcap.records import Buffer


class DiskBehind(RecorderError):
    """Images were refused because memory is full of bytes that wait for the disk; they may fit later."""


class ImageMessage(NamedTuple):
    """One image to be written; the bytes of `parts` must not change until they are written."""

    log_time_ns: int
    parts: Sequence[Buffer]
    """serialised message, in consecutive pieces"""
    sequence: int = 0
    """number of the image in its stream"""


class BorrowedImage(NamedTuple):
    """One image to be written directly from a borrowed camera buffer, without a copy."""

    log_time_ns: int
    sequence: int
    """number of the image in its stream"""
    prefix: bytes
    """the message before its pixels"""
    pixels: memoryview
    """the image's bytes: at least a page, and beginning on a page of the memory"""
    crc: int
    """CRC-32 of the pixels"""
    release: Callable[[], None]
    """called once, by any thread, when the pixels are in the file or will never be"""


class SmallMessage(NamedTuple):
    """One message of a small topic (any topic but the images)."""

    log_time_ns: int
    data: Buffer
    """serialised message"""
    sequence: int = 0
    """number of the message in its topic"""
