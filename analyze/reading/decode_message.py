"""Parses a message of a recording as its topic's protobuf class."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import TypeVar

from google.protobuf.descriptor import FieldDescriptor
from google.protobuf.message import DecodeError, Message

from analyze.errors import RecordingError
from analyze.reading.indexed_file import RecordedMessage

M = TypeVar("M", bound=Message)
MAX_COUNT = (1 << 63) - 1
"""largest number of a count that is believed, the largest that arrays hold"""


def decode_message(path: Path, message: RecordedMessage, kind: type[M]) -> M:
    """Parse a message's data; return an object of the message's protobuf class.

    Args:
        path: path of the recording, for the error's text.
        message: the message.
        kind: protobuf class of the content.

    Raises:
        RecordingError: the data cannot be parsed as this class.
    """
    try:
        found = kind.FromString(bytes(message.data))
    except DecodeError:
        raise RecordingError(
            f"{path}: message on {message.topic} at {message.log_time_ns} is not a "
            f"{kind.DESCRIPTOR.full_name}"
        ) from None
    for name in _counters(kind):
        if getattr(found, name) > MAX_COUNT:
            raise RecordingError(
                f"{path}: message on {message.topic} at {message.log_time_ns} is damaged: its {name} is "
                f"{getattr(found, name)}"
            )
    return found


@cache
def _counters(kind: type[Message]) -> tuple[str, ...]:
    """Names of a message's fields that hold unsigned numbers of 64 bits."""
    return tuple(field.name for field in kind.DESCRIPTOR.fields if field.type == FieldDescriptor.TYPE_UINT64)
