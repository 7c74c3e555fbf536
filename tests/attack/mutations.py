"""Seeded damage to files: wrong bits, cuts, moved blocks, extreme numbers, and text that lies.

A damage that repairs the checksums afterwards is a forgery: what it changes, no reader can know.
"""

from __future__ import annotations

import re
import struct
import zlib
from dataclasses import dataclass

import numpy as np

from schemas.mcap import records as container
from schemas.mcap.walk import walk

EXTREMES = (0, 1, 0x7F, 0x80, 0xFF, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF, (1 << 63) - 1, 1 << 63, (1 << 64) - 1)
NUMBERS = (
    *("nan", "inf", "-inf", "1e308", "-1e308", "1e-320", "0", "-0.0", "-1", "9" * 400, "0x7f"),
    *("1_0", "true", "null", '""', "[]", "{}"),
)
TEXTS = (
    "\x00",
    "\x1b]0;x\x07",
    "\x1b[2J",
    "=1+1",
    "../../x",
    "\u202e",
    "\ud83d\ude00",
    "a" * 5000,
    "",
    "\r\n",
)
NUMBER = re.compile(rb"-?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?")
STRING = re.compile(rb'"[^"\n]{0,80}"')


@dataclass(frozen=True)
class Damage:
    """Damaged bytes, the name of the damage, and whether it repaired the checksums behind it."""

    data: bytes
    name: str
    forged: bool = False


def damage(data: bytes, rng: np.random.Generator, *, text: bool) -> Damage:
    """Damage a file's bytes in one random way.

    Args:
        data: the whole file.
        rng: source of chance.
        text: True for a file of text.
    """
    if not data:
        return Damage(b"", "empty")
    ways = [*_OF_BYTES]
    if text:
        ways += _OF_TEXT * 2
    if data.startswith(container.MAGIC):
        ways += _OF_MCAP
    way = ways[int(rng.integers(len(ways)))]
    return way(data, rng)


def _place(data: bytes, rng: np.random.Generator) -> int:
    """Offset in the data; every third near the beginning or the end, where heads and indexes are."""
    where = rng.integers(6)
    near = min(len(data), 2000)
    if where == 0:
        return int(rng.integers(near))
    if where == 1:
        return len(data) - 1 - int(rng.integers(near))
    return int(rng.integers(len(data)))


def _bit(data: bytes, rng: np.random.Generator) -> Damage:
    found = bytearray(data)
    found[_place(data, rng)] ^= 1 << int(rng.integers(8))
    return Damage(bytes(found), "one wrong bit")


def _bytes(data: bytes, rng: np.random.Generator) -> Damage:
    found, at = bytearray(data), _place(data, rng)
    length = min(int(rng.integers(1, 64)), len(data) - at)
    found[at : at + length] = rng.bytes(length)
    return Damage(bytes(found), "wrong bytes")


def _cut(data: bytes, rng: np.random.Generator) -> Damage:
    return Damage(data[: _place(data, rng)], "cut")


def _zeros(data: bytes, rng: np.random.Generator) -> Damage:
    at = _place(data, rng)
    length = min(int(rng.integers(1, 8192)), len(data) - at)
    return Damage(data[:at] + bytes(length) + data[at + length :], "zeros")


def _extreme(data: bytes, rng: np.random.Generator) -> Damage:
    size = int(rng.choice([1, 2, 4, 8]))
    value = int(EXTREMES[rng.integers(len(EXTREMES))]) & ((1 << 8 * size) - 1)
    found, at = bytearray(data), _place(data, rng)
    found[at : at + size] = value.to_bytes(size, "little" if rng.integers(2) else "big")
    return Damage(bytes(found), "an extreme number")


def _moved(data: bytes, rng: np.random.Generator) -> Damage:
    a, b = sorted((_place(data, rng), _place(data, rng)))
    length = int(rng.integers(1, 4096))
    block = data[a : a + length]
    if rng.integers(2):
        return Damage(data[:b] + block + data[b:], "a doubled block")
    rest = data[:a] + data[a + length :]
    return Damage(rest[:b] + block + rest[b:], "a moved block")


def _removed(data: bytes, rng: np.random.Generator) -> Damage:
    at = _place(data, rng)
    return Damage(data[:at] + data[at + int(rng.integers(1, 4096)) :], "a missing block")


def _appended(data: bytes, rng: np.random.Generator) -> Damage:
    return Damage(data + rng.bytes(int(rng.integers(1, 8192))), "rubbish at the end")


def _number(data: bytes, rng: np.random.Generator) -> Damage:
    found = list(NUMBER.finditer(data[:200_000]))
    if not found:
        return _bit(data, rng)
    match = found[int(rng.integers(len(found)))]
    value = str(rng.choice(np.array(NUMBERS, dtype=object))).encode()
    return Damage(data[: match.start()] + value + data[match.end() :], "a number that is none")


def _string(data: bytes, rng: np.random.Generator) -> Damage:
    found = list(STRING.finditer(data[:200_000]))
    if not found:
        return _bit(data, rng)
    match = found[int(rng.integers(len(found)))]
    value = TEXTS[int(rng.integers(len(TEXTS)))].encode("utf-8", "surrogatepass")
    at = match.start() + 1
    return Damage(data[:at] + value + data[at if rng.integers(2) else match.end() - 1 :], "a hostile text")


def _line(data: bytes, rng: np.random.Generator) -> Damage:
    lines = data.split(b"\n")
    a, b = int(rng.integers(len(lines))), int(rng.integers(len(lines)))
    way = int(rng.integers(3))
    if way == 0:
        del lines[a]
    elif way == 1:
        lines.insert(b, lines[a])
    else:
        lines[a], lines[b] = lines[b], lines[a]
    return Damage(b"\n".join(lines), "lines in disorder")


def _nested(data: bytes, rng: np.random.Generator) -> Damage:
    at = _place(data, rng)
    mark = (b"[", b"{", b"(", b'"', b"<a>")[int(rng.integers(5))]
    return Damage(data[:at] + mark * int(rng.integers(1, 20_000)) + data[at:], "deep nesting")


def _records(data: bytes, rng: np.random.Generator) -> Damage:
    """Double, drop or exchange whole records of an MCAP file."""
    places = [
        (at, at + container.RECORD_HEAD + len(body))
        for _, at, body in walk(memoryview(data), len(container.MAGIC))
    ]
    if len(places) < 3:
        return _bit(data, rng)
    (a, a_end), (b, b_end) = sorted(places[int(i)] for i in rng.choice(len(places), 2, replace=False))
    way = int(rng.integers(3))
    if way == 0:
        return Damage(data[:a_end] + data[a:a_end] + data[a_end:], "a doubled record")
    if way == 1:
        return Damage(data[:a] + data[a_end:], "a missing record")
    found = data[:a] + data[b:b_end] + data[a_end:b] + data[a:a_end] + data[b_end:]
    return Damage(found, "exchanged records")


def _forged_chunk(data: bytes, rng: np.random.Generator) -> Damage:
    """Change bytes in a chunk of an MCAP file and repair its checksum: the parsers behind it are reached."""
    chunks = [
        (at, len(body))
        for opcode, at, body in walk(memoryview(data), len(container.MAGIC))
        if opcode == container.CHUNK and len(body) > 80
    ]
    if not chunks:
        return _bit(data, rng)
    small = [each for each in chunks if each[1] < 4000] or chunks
    at, length = small[int(rng.integers(len(small)))]
    found = bytearray(data)
    start, end = at + container.CHUNK_HEAD, at + container.RECORD_HEAD + length
    for _ in range(int(rng.integers(1, 4))):
        place = int(rng.integers(start, end))
        size = int(rng.choice([1, 4, 8]))
        value = rng.bytes(size) if rng.integers(2) else b"\xff" * size
        found[place : place + size] = value[: end - place]
    struct.pack_into("<I", found, at + container.RECORD_HEAD + 24, zlib.crc32(found[start:end]))
    return Damage(bytes(found), "a forged chunk", forged=True)


_OF_BYTES = (_bit, _bit, _bytes, _cut, _zeros, _extreme, _moved, _removed, _appended)
_OF_TEXT = (_number, _string, _line, _nested)
_OF_MCAP = (_records, _records, _forged_chunk, _forged_chunk, _forged_chunk)
