"""Protocol between daemon and capture process: length-prefixed packets of a JSON header and bytes.

Nothing is pickled. A batch is a packet's bytes that hold several messages for the recording.
"""

from __future__ import annotations

import json
import socket
import struct
from collections.abc import Iterator
from typing import Any

from schemas import topics

_PREFIX = struct.Struct("<II")
_MESSAGE = struct.Struct("<HQI")
_MOST_PACKET_BYTES = 1 << 30


class WireClosed(ConnectionError):
    """The process at the other end closed the connection, does not read, or sent invalid data."""


def send(connection: socket.socket, header: dict[str, Any], payload: bytes = b"") -> None:
    """Send one packet of a JSON header and bytes.

    Raises:
        WireClosed: the process at the other end is gone, or does not read within the connection's timeout.
    """
    text = json.dumps(header, separators=(",", ":")).encode()
    try:
        connection.sendall(_PREFIX.pack(len(text), len(payload)) + text + payload)
    except OSError as error:
        raise WireClosed(str(error)) from None


def receive(connection: socket.socket) -> tuple[dict[str, Any], bytes]:
    """Wait for one packet and return its content.

    Returns:
        JSON header and bytes of the packet.

    Raises:
        WireClosed: the process at the other end closed the connection, or sent something that is no packet.
        TimeoutError: nothing arrived within the connection's timeout.
    """
    text_size, payload_size = _PREFIX.unpack(_exactly(connection, _PREFIX.size))
    if text_size + payload_size > _MOST_PACKET_BYTES:
        raise WireClosed(f"invalid packet of {text_size + payload_size} bytes")
    text = _exactly(connection, text_size)
    try:
        header = json.loads(text)
    except (ValueError, RecursionError):
        header = None
    if not isinstance(header, dict):
        raise WireClosed("invalid packet: no JSON header")
    return header, _exactly(connection, payload_size)


def small_topics(camera: str) -> dict[str, topics.Topic]:
    """Topics that the daemon may write, by name: all but the images and frame metadata of `camera`."""
    known = (
        topics.camera_calibration(camera),
        topics.STRIKER_SAMPLE,
        topics.STRIKER_EVENT,
        topics.CLOCK_SAMPLE,
        topics.SESSION_STATE,
        topics.SESSION_STRIKE,
        topics.SESSION_TOSS,
        topics.LOG,
    )
    return {topic.name: topic for topic in known}


def pack_message(topic: int, log_time_ns: int, data: bytes) -> bytes:
    """Bytes of one message in a batch (several messages in one packet).

    Args:
        topic: index of the topic's name in the list of names in the packet's header.
        log_time_ns: log time [ns].
        data: serialised message.
    """
    return _MESSAGE.pack(topic, log_time_ns, len(data)) + data


def unpack_messages(batch: bytes) -> Iterator[tuple[int, int, bytes]]:
    """Unpack the messages of a batch (several messages in one packet), in order.

    Yields:
        Index of the topic's name in the list of names in the packet's header, log time [ns], serialised
        message.

    Raises:
        ValueError: the batch ends inside a message.
    """
    at = 0
    while at < len(batch):
        if len(batch) - at < _MESSAGE.size:
            raise ValueError("a batch of messages ends early")
        topic, log_time, size = _MESSAGE.unpack_from(batch, at)
        at += _MESSAGE.size
        if size > len(batch) - at:
            raise ValueError("a batch of messages ends early")
        yield topic, log_time, batch[at : at + size]
        at += size


def _exactly(connection: socket.socket, size: int) -> bytes:
    data = bytearray()
    while len(data) < size:
        try:
            part = connection.recv(min(size - len(data), 1 << 20))
        except TimeoutError:
            raise
        except OSError as error:
            raise WireClosed(str(error)) from None
        if not part:
            raise WireClosed("closed by the other side")
        data += part
    return bytes(data)
