"""Copies a recording's file with another manifest and other attached files; its messages stay as they are.

Every record but these is copied byte for byte, and the summary at the end of the file, which lists where
the records are, is rewritten.
"""

from __future__ import annotations

import os
import struct
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from analyze.errors import RecordingError
from schemas.document import sha256_text
from schemas.mcap import records as container
from schemas.mcap.chunks import ChunkEntry
from schemas.mcap.record_writer import RecordWriter
from schemas.mcap.records import AttachmentRecord, Buffer, ContainerError
from schemas.mcap.summary import DATA_END_SIZE, Summary, find_summary, parse_message_counts
from schemas.mcap.walk import record_at, walk
from schemas.session_manifest import MANIFEST_NAME, SEAL_NAME, manifest_entries

PAGE: Final = 4096
"""size of a page [bytes]: the pixels of a rig's images begin on pages, and stay on them"""


@dataclass(frozen=True)
class Head:
    """Manifest (JSON) and attached files that a copy has in place of the recording's own."""

    manifest_json: str
    """manifest (description of the session) as JSON"""
    attachments: Sequence[AttachmentRecord]
    """all files attached to the copy"""


@dataclass(frozen=True)
class _Kept:
    """Range of bytes of the source that is copied, and its place in the copy."""

    start: int
    """first byte in the source"""
    stop: int
    """byte after the last one in the source"""
    offset: int
    """place in the copy of the first byte"""


@dataclass(frozen=True)
class _Contents:
    """Parts of a source file that a copy keeps: ranges of bytes, metadata records, and the seal."""

    ranges: list[tuple[int, int]]
    """first byte, and byte after the last one, of each range that is copied"""
    metadata: list[tuple[int, int, str]]
    """offset, length and name of each metadata record in these ranges"""
    seal: dict[str, str] | None
    """entries of the seal; None if the file has none"""
    summary: memoryview
    """records of the summary at the end of the file"""


def copy_with_head(data: memoryview, path: Path, head: Head, fd: int) -> int:
    """Write a copy of a finished recording's file with another manifest and other attached files.

    Args:
        data: bytes of the source.
        path: path of the source, for messages.
        head: manifest and attachments of the copy.
        fd: file to write to, empty.

    Returns:
        Size of the copy [bytes].

    Raises:
        RecordingError: the source is damaged.
        OSError: the copy cannot be written.
    """
    writer = RecordWriter(lambda buffers: _write_all(fd, buffers))
    try:
        contents = _read_contents(data)
        writer.begin()
        writer.write_metadata(MANIFEST_NAME, manifest_entries(head.manifest_json))
        for attachment in head.attachments:
            writer.write_attachment(attachment)
        kept = _copy_ranges(writer, fd, data, contents.ranges)
        if contents.seal is not None:
            sealed = contents.seal | {"manifest_sha256": sha256_text(head.manifest_json)}
            writer.write_metadata(SEAL_NAME, sealed)
        for offset, length, name in contents.metadata:
            writer.summary.add_metadata(_moved(kept, offset), length, name)
        _add_summary(writer.summary, contents.summary, kept)
        writer.end()
    except (ContainerError, struct.error) as error:
        raise RecordingError(f"{path}: damaged: {error}: `acquire recover` saves what can be read") from None
    return writer.size


def _read_contents(data: memoryview) -> _Contents:
    """Find what a copy keeps of a finished file: all but the header, manifest, seal and attached files.

    Raises:
        ContainerError: the file is damaged.
    """
    section = find_summary(data)
    data_end = section.start - DATA_END_SIZE
    record_at(data, data_end, container.DATA_END)
    contents = _Contents([], [], None, section.records)
    start: int | None = None
    for opcode, at, body in walk(data[:data_end], len(container.MAGIC)):
        dropped = opcode in {container.HEADER, container.ATTACHMENT}
        if opcode == container.METADATA:
            metadata = container.parse_metadata(body)
            dropped = metadata.name in {MANIFEST_NAME, SEAL_NAME}
            if metadata.name == SEAL_NAME:
                contents = replace(contents, seal=metadata.entries)
            elif not dropped:
                contents.metadata.append((at, container.RECORD_HEAD + len(body), metadata.name))
        if dropped and start is not None:
            contents.ranges.append((start, at))
            start = None
        elif not dropped and start is None:
            start = at
    if start is not None:
        contents.ranges.append((start, data_end))
    return contents


def _copy_ranges(
    writer: RecordWriter, fd: int, data: memoryview, ranges: Sequence[tuple[int, int]]
) -> list[_Kept]:
    """Copy ranges of the source, each shifted by whole pages, behind a record of padding where needed."""
    kept: list[_Kept] = []
    for start, stop in ranges:
        if padding := (start - writer.size) % PAGE:
            padding += PAGE if padding < container.RECORD_HEAD else 0
            record = container.pack_record(container.PADDING, bytes(padding - container.RECORD_HEAD))
            writer.size += _write_all(fd, [record])
        kept.append(_Kept(start, stop, writer.size))
        writer.size += _write_all(fd, [data[start:stop]])
    return kept


def _add_summary(summary: Summary, records: memoryview, kept: Sequence[_Kept]) -> None:
    """Add the source's topics, counts and chunks to a summary, at their new places.

    Raises:
        ContainerError: an index points at something that was not copied.
    """
    for opcode, at, body in walk(records):
        whole = bytes(records[at : at + container.RECORD_HEAD + len(body)])
        if opcode == container.SCHEMA:
            summary.schemas.append(whole)
        elif opcode == container.CHANNEL:
            summary.channels.append(whole)
        elif opcode == container.STATISTICS:
            summary.message_counts = parse_message_counts(body)
        elif opcode == container.CHUNK_INDEX:
            entry = ChunkEntry.parse(body)
            places = {channel: _moved(kept, place) for channel, place in entry.index_offsets.items()}
            moved = entry._replace(offset=_moved(kept, entry.offset), index_offsets=places)
            summary.chunks.append(moved.pack())


def _moved(kept: Sequence[_Kept], at: int) -> int:
    """Place in the copy of the byte at `at` in the source.

    Raises:
        ContainerError: it was not copied.
    """
    for each in kept:
        if each.start <= at < each.stop:
            return at - each.start + each.offset
    raise ContainerError("an index points at something else than it states")


def _write_all(fd: int, buffers: Sequence[Buffer]) -> int:
    """Write all bytes of the buffers to a file; return their number."""
    total = 0
    for buffer in buffers:
        view = memoryview(buffer)
        while view:
            view = view[os.write(fd, view) :]
        total += len(buffer)
    return total
