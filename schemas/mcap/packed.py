"""Protobuf by hand where a message is written for every frame: a varint, and the time stamp that all of Foxglove's messages begin with.

Fields may stand in any order and a message may be put together from parts (protobuf.dev, "Encoding").
"""

from __future__ import annotations

from functools import lru_cache

_TIMESTAMP_FIELD = bytes([1 << 3 | 2])


def varint(value: int) -> bytes:
    """A number that is not negative, seven bits to a byte."""
    result = bytearray()
    while value > 127:
        result.append(value & 127 | 128)
        value >>= 7
    result.append(value)
    return bytes(result)


def timestamp_field(time_ns: int) -> bytes:
    """Field 1, a google.protobuf.Timestamp, of a time since 1970; a tenth of protobuf's own time."""
    seconds, nanos = divmod(time_ns, 10**9)
    if nanos >= 1 << 28:  # three of four times: without the loop
        return _seconds(seconds, 5) + bytes(
            (nanos & 127 | 128, nanos >> 7 & 127 | 128, nanos >> 14 & 127 | 128, nanos >> 21 & 127 | 128, nanos >> 28)
        )
    end = varint(nanos)
    return _seconds(seconds, len(end)) + end


@lru_cache(maxsize=8)
def _seconds(seconds: int, behind: int) -> bytes:
    """Of the field, what stands before its `behind` bytes of nanoseconds."""
    body = b"\x08" + varint(seconds) + b"\x10"
    return _TIMESTAMP_FIELD + (len(body) + behind).to_bytes() + body
