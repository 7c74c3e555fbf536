"""Parses a message of a recording as its topic's protobuf class."""

from __future__ import annotations

from pathlib import Path
from typing import TypeVar

from google.protobuf.message import DecodeError, Message

from analyze.errors import RecordingError
from analyze.reading.indexed_file import RecordedMessage

M = TypeVar("M", bound=Message)


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
        return kind.FromString(bytes(message.data))
    except DecodeError:
        raise RecordingError(
            f"{path}: message on {message.topic} at {message.log_time_ns} is not a "
            f"{kind.DESCRIPTOR.full_name}"
        ) from None
