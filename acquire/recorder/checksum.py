"""CRC-32 (IEEE) of image messages, each pixel read once (libdeflate).

A chunk's CRC covers the message head and the data; the content id (hash of a recording's messages) uses a CRC
of the data alone. Both follow from the image's own CRC: a CRC is linear, so the CRC of A followed by B is the
CRC of A, continued over as many zeros as B has bytes, XOR the CRC of B.

libdeflate folds 128 or 256 bytes at a time with carry-less multiplication (Gopal et al., "Fast CRC
computation for generic polynomials using PCLMULQDQ", Intel 2009), as wide as the processor supports. On the
processor of docs/reference/benchmarks.md a frame of 323 kB takes 13 us from the level-2 cache, 24 us from
memory; isal, which is wide only with AVX-512, takes 26 us, zlib 88 us.
"""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from functools import lru_cache
from typing import Final, NamedTuple

import deflate

from schemas.mcap.records import Buffer

_LARGE_BYTES: Final = 8192
"""size [bytes] below which reading twice is cheaper than combining two CRCs"""
_Table = list[int]
_ByteTables = tuple[_Table, _Table, _Table, _Table]


class Checksums(NamedTuple):
    """CRC-32 of an MCAP chunk (group of messages) up to the end of a message, and of that message's data."""

    chunk: int
    """CRC-32 of the chunk from its beginning to the message's end"""
    data: int
    """CRC-32 of the message's data"""


def checksums(chunk: int, head: Buffer, parts: Sequence[Buffer]) -> Checksums:
    """CRC-32 of an MCAP chunk (group of messages) after one more message, and of that message's data.

    Args:
        chunk: CRC of the chunk before this message; 0 at the chunk's beginning.
        head: bytes of the message record before its data.
        parts: data of the message, in consecutive pieces.

    Returns:
        `chunk` continued over head and data, and the CRC of the data alone.
    """
    chunk, data = zlib.crc32(head, chunk), 0
    for part in parts:
        if (size := len(part)) < _LARGE_BYTES:
            chunk, data = zlib.crc32(part, chunk), zlib.crc32(part, data)
        else:
            own = deflate.crc32(part)
            zeros = _over_zeros(size)
            chunk, data = _apply(zeros, chunk) ^ own, _apply(zeros, data) ^ own
    return Checksums(chunk, data)


def image_checksums(head: Buffer, prefix: Buffer, pixels: int, size: int) -> Checksums:
    """CRC-32 of an MCAP chunk of one image, and of the message's data, from the CRC-32 of the pixels.

    The pixels are not read again.

    Args:
        head: bytes of the message record before its data.
        prefix: data of the message before the pixels.
        pixels: CRC-32 of the pixels.
        size: number of bytes of pixels.

    Returns:
        CRC of head, prefix and pixels (`chunk`), and CRC of prefix and pixels (`data`).
    """
    zeros = _over_zeros(size)
    data = zlib.crc32(prefix)
    return Checksums(
        _apply(zeros, zlib.crc32(prefix, zlib.crc32(head))) ^ pixels, _apply(zeros, data) ^ pixels
    )


def crc_of(pixels: Buffer) -> int:
    """CRC-32 of the bytes `pixels`; it holds the interpreter lock, 13 to 24 us for a frame of 323 kB."""
    return deflate.crc32(pixels)


@lru_cache(maxsize=8)
def _over_zeros(size: int) -> _ByteTables:
    """Tables of the linear map that `size` zero bytes cause in the register of a CRC-32.

    The inversions before and after a CRC-32 are no part of the map.

    Returns:
        One table for each of the CRC's four bytes, lowest byte first, with 256 entries, one for each value
        of that byte. `_apply` combines one entry of each table by XOR.
    """
    zeros = bytes(size)
    none = deflate.crc32(zeros, 0)
    bits = [deflate.crc32(zeros, 1 << bit) ^ none for bit in range(32)]
    tables: list[_Table] = []
    for first in range(0, 32, 8):
        table = [0]
        for bit in bits[first : first + 8]:
            table += [bit ^ value for value in table]
        tables.append(table)
    return tables[0], tables[1], tables[2], tables[3]


def _apply(tables: _ByteTables, crc: int) -> int:
    """CRC-32 that `crc` becomes under the linear map in `tables`.

    Args:
        tables: one table of 256 entries for each of the four bytes of `crc`, lowest byte first; the result is
            the XOR of one entry of each.
        crc: CRC-32 to be mapped.
    """
    low, second, third, high = tables
    return low[crc & 255] ^ second[crc >> 8 & 255] ^ third[crc >> 16 & 255] ^ high[crc >> 24]
