"""Walks over MCAP records: whole records in file order, and the record that an index points at.

A walk is tolerant: it ends at the first record that is not complete. Whether this is an error is decided by
the caller.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator
from typing import Final, NamedTuple

from schemas.mcap import records as container
from schemas.mcap.chunks import chunk_messages
from schemas.mcap.records import RECORD_HEAD, Buffer, ContainerError, MessageRecord

_HEAD: Final = struct.Struct("<BQ")
"""opcode and length of a record's body"""


def walk(data: memoryview, start: int = 0) -> Iterator[tuple[int, int, memoryview]]:
    """Yield the whole records from offset `start` on as (opcode, record offset, body).

    The walk ends at the first incomplete record, or at opcode 0 (zeros at the end of a file). Offsets are
    counted from the beginning of `data`; bodies are views.
    """
    at, size = start, len(data)
    while at + RECORD_HEAD <= size:
        opcode, length = _HEAD.unpack_from(data, at)
        if opcode == 0 or length > size - at - RECORD_HEAD:
            return
        end = at + RECORD_HEAD + length
        yield opcode, at, data[at + RECORD_HEAD : end]
        at = end


def walk_messages(records: memoryview) -> Iterator[tuple[int, MessageRecord]]:
    """Yield the messages among `records` as (offset of the message record in `records`, message).

    Raises:
        ContainerError: a message record is too short.
    """
    for opcode, at, body in walk(records):
        if opcode == container.MESSAGE:
            yield at, container.parse_message(body)


def walk_chunks(data: memoryview) -> Iterator[memoryview]:
    """Yield the message records of each chunk of a file, decompressed and checked.

    Args:
        data: the file from its beginning, with the magic bytes.

    Raises:
        ContainerError: a chunk is damaged.
    """
    for opcode, _, body in walk(data, len(container.MAGIC)):
        if opcode == container.CHUNK:
            yield chunk_messages(container.parse_chunk(body))


class WholeRecords(NamedTuple):
    """Extent of the whole (completely written) records of a file that may still grow."""

    end: int
    """offset after the last whole record"""
    data_ended: bool
    """True if that record ends the data section: the writer has finished the file"""


def whole_records(read: Callable[[int, int], Buffer], start: int, size: int) -> WholeRecords:
    """Find the end of the last whole (completely written) record; only the records' heads are read.

    The search ends at the first record that is not whole, at opcode 0 (zeros at the end of a file), or after
    the record that ends the data section.

    Args:
        read: function of (count, offset) that returns at most `count` bytes of the file from `offset` on.
        start: file offset of a record.
        size: present size of the file [bytes].

    Returns:
        The file offset after that record (`start` if no record is whole), and whether that record ends the
        data section.
    """
    at = start
    while at + RECORD_HEAD <= size:
        head = read(RECORD_HEAD, at)
        if len(head) < RECORD_HEAD:
            break
        opcode, length = _HEAD.unpack(head)
        if opcode == 0 or length > size - at - RECORD_HEAD:
            break
        at += RECORD_HEAD + length
        if opcode == container.DATA_END:
            return WholeRecords(at, data_ended=True)
    return WholeRecords(at, data_ended=False)


def record_at(data: memoryview, offset: int, opcode: int) -> memoryview:
    """Body (a view) of the record at `offset`, to which an index points.

    Args:
        data: bytes of the file, or of a part to which the index refers.
        offset: offset of the record in `data`.
        opcode: kind of record that the index states.

    Raises:
        ContainerError: there is no whole record of this kind at `offset`.
    """
    if not 0 <= offset <= len(data) - RECORD_HEAD:
        raise ContainerError("an index points outside of what it indexes")
    found, length = _HEAD.unpack_from(data, offset)
    start = offset + RECORD_HEAD
    if found != opcode or length > len(data) - start:
        raise ContainerError("an index points at something else than it states")
    return data[start : start + length]


def index_entries_at(data: memoryview, offset: int, channel_id: int) -> memoryview:
    """Packed entries of the message index record at `offset`, which must be of channel `channel_id`.

    Each entry has 16 bytes: log time [ns] and offset in the chunk of one message (u64).

    Raises:
        ContainerError: there is no whole message index record of this channel at `offset`.
    """
    found_id, entries = container.parse_index_entries(record_at(data, offset, container.MESSAGE_INDEX))
    if found_id != channel_id:
        raise ContainerError("a chunk index points at the message index of another channel")
    return entries
