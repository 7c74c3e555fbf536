"""Messages that are handed to the writer of a recording."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

from acquire.errors import RecorderError
from schemas.mcap.records import Buffer


class DiskBehind(RecorderError):
    """What waits for the disk fills the memory there is: this image was not taken, a later one may be."""


class ImageMessage(NamedTuple):
    """One image to be written; `parts` are views of bytes that stay as they are until they are written."""

    log_time_ns: int
    parts: Sequence[Buffer]
    sequence: int = 0
    publish_time_ns: int | None = None
    """log time where None"""


class LentImage(NamedTuple):
    """One image to be written from where it lies."""

    log_time_ns: int
    sequence: int
    prefix: bytes
    """the message before its pixels"""
    pixels: memoryview
    """at least a page, and begin on one of the memory"""
    crc: int
    """CRC-32 of the pixels"""
    release: Callable[[], None]
    """called once, by any thread, when the pixels are in the file or will never be"""


class SmallMessage(NamedTuple):
    """One message of a small topic."""

    log_time_ns: int
    data: Buffer
    sequence: int = 0
    publish_time_ns: int | None = None
    """log time where None"""
