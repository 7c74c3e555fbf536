"""CRC-32 (IEEE) of image messages, each pixel read once (libdeflate).

A chunk's CRC covers the message head as well as the data, the content id's only the data. Both follow from the image's own CRC: a CRC
is linear, so the CRC of A and B together is that of A, taken on over as many zeros as B has bytes, XOR that of B.

libdeflate folds 128 or 256 bytes at a time with carry-less multiplication (Gopal et al., "Fast CRC computation for generic polynomials
using PCLMULQDQ", Intel 2009) as wide as the processor has it. On the one of docs/benchmarks.md a frame of 323 kB takes 13 us from its
level-2 cache, 24 us from memory; isal, which is wide only with AVX-512, takes 26 us, zlib 88 us.
"""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from functools import lru_cache
from typing import Final, NamedTuple

import deflate

from schemas.mcap.records import Buffer

_LARGE_BYTES: Final = 8192
"""below it reading twice is cheaper than combining"""
_Table = list[int]


class Checksums(NamedTuple):
    """CRC-32 of a chunk up to a message's end, and of that message's data alone."""

    chunk: int
    data: int


def checksums(chunk: int, head: Buffer, parts: Sequence[Buffer]) -> Checksums:
    """Continue the CRC `chunk` over a message's `head` and the `parts` of its data."""
    chunk, data = zlib.crc32(head, chunk), 0
    for part in parts:
        if (size := len(part)) < _LARGE_BYTES:
            chunk, data = zlib.crc32(part, chunk), zlib.crc32(part, data)
        else:
            own = deflate.crc32(part)
            zeros = _over_zeros(size)
            chunk, data = _apply(zeros, chunk) ^ own, _apply(zeros, data) ^ own
    return Checksums(chunk, data)


def joined(head: Buffer, prefix: Buffer, pixels: int, size: int) -> Checksums:
    """Of a chunk that holds `head`, `prefix` and `size` bytes of pixels with the CRC `pixels`, and of its data: all but `head`."""
    zeros = _over_zeros(size)
    data = zlib.crc32(prefix)
    return Checksums(_apply(zeros, zlib.crc32(prefix, zlib.crc32(head))) ^ pixels, _apply(zeros, data) ^ pixels)


def crc_of(pixels: Buffer) -> int:
    """CRC-32; other threads run meanwhile."""
    return deflate.crc32(pixels)


@lru_cache(maxsize=8)
def _over_zeros(size: int) -> tuple[_Table, _Table, _Table, _Table]:
    """What `size` zero bytes make of a CRC, without what they make of none: linear in it, so one table for each of its bytes."""
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


def _apply(tables: tuple[_Table, _Table, _Table, _Table], crc: int) -> int:
    low, second, third, high = tables
    return low[crc & 255] ^ second[crc >> 8 & 255] ^ third[crc >> 16 & 255] ^ high[crc >> 24]
