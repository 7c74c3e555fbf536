"""Protobuf wire format of messages that are packed for every frame: varints, fields and time stamps.

Fields may stand in any order, and a message may be concatenated from parts (protobuf.dev, "Encoding"). Time
stamps are those of Foxglove's messages.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from functools import lru_cache

from schemas.mcap.records import ContainerError

_TIMESTAMP_TAG = bytes([1 << 3 | 2])
"""field 1, length-delimited"""
_MAX_VARINT_SHIFT = 63


def varint(value: int) -> bytes:
    """Protobuf encoding of an integer >= 0 as a varint: seven bits to a byte, lowest first."""
    result = bytearray()
    while value > 127:
        result.append(value & 127 | 128)
        value >>= 7
    result.append(value)
    return bytes(result)


def read_varint(data: memoryview, at: int) -> tuple[int, int]:
    """Value of the varint (integer of variable length) at offset `at`, and the offset after it.

    Raises:
        ContainerError: the varint is longer than 64 bits.
        IndexError: the data end within the varint.
    """
    value = shift = 0
    while True:
        byte = data[at]
        at += 1
        value |= (byte & 127) << shift
        if byte < 128:
            return value, at
        shift += 7
        if shift > _MAX_VARINT_SHIFT:
            raise ContainerError("a protobuf integer is longer than 64 bits")


def read_fields(data: memoryview) -> Iterator[tuple[int, int | memoryview]]:
    """Yield number and value of a message's length-delimited and 32-bit fields, in file order.

    The value of a length-delimited field is a view of its bytes, that of a 32-bit field an unsigned integer.
    Varint and 64-bit fields are skipped.

    Raises:
        ContainerError: the bytes are no protobuf message, or end within a field.
    """
    at = 0
    try:
        while at < len(data):
            tag, at = read_varint(data, at)
            wire_type = tag & 7
            if wire_type == 2:
                size, at = read_varint(data, at)
                if size > len(data) - at:
                    raise ContainerError("the message ends early")
                yield tag >> 3, data[at : at + size]
                at += size
            elif wire_type == 5:
                (value,) = struct.unpack_from("<I", data, at)
                yield tag >> 3, value
                at += 4
            elif wire_type == 0:
                _, at = read_varint(data, at)
            elif wire_type == 1:
                struct.unpack_from("<Q", data, at)  # raises if it is cut off
                at += 8
            else:
                raise ContainerError(f"not a protobuf message: it has a field of wire type {wire_type}")
    except (IndexError, struct.error):
        raise ContainerError("the message ends early") from None


def timestamp_field(time_ns: int) -> bytes:
    """Protobuf bytes of field 1 of a message, a google.protobuf.Timestamp, from a time since 1970 [ns].

    Packing takes a tenth of the time of protobuf's own encoder.
    """
    seconds, nanos = divmod(time_ns, 10**9)
    if nanos >= 1 << 28:  # three times in four: five bytes, without the loop
        return _seconds_prefix(seconds, 5) + bytes(
            (
                nanos & 127 | 128,
                nanos >> 7 & 127 | 128,
                nanos >> 14 & 127 | 128,
                nanos >> 21 & 127 | 128,
                nanos >> 28,
            )
        )
    end = varint(nanos)
    return _seconds_prefix(seconds, len(end)) + end


@lru_cache(maxsize=8)
def _seconds_prefix(seconds: int, nanos_size: int) -> bytes:
    """Bytes of a Timestamp field up to its nanoseconds, which the caller appends.

    Args:
        seconds: whole seconds since 1970.
        nanos_size: bytes of the encoded nanoseconds that follow.
    """
    body = b"\x08" + varint(seconds) + b"\x10"
    return _TIMESTAMP_TAG + (len(body) + nanos_size).to_bytes() + body
