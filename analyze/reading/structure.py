"""Checks the records of a finished file around its messages, which no hash covers.

Heads of chunks, message indexes and declarations stand in the file twice in some way: in themselves, and in
the messages or the summary, which has a checksum.
"""

from __future__ import annotations

from collections import Counter, defaultdict

from analyze.reading.indexed_file import IndexedFile
from schemas.mcap import records as container
from schemas.mcap.chunks import ChunkEntry, MessagePlaces
from schemas.mcap.records import ContainerError
from schemas.mcap.summary import DATA_END_SIZE, find_summary
from schemas.mcap.walk import record_at, walk, walk_messages

_INDEX_OF = {container.ATTACHMENT: container.ATTACHMENT_INDEX, container.METADATA: container.METADATA_INDEX}
"""kind of index record in the summary by kind of record"""


class Structure:
    """Records of a finished file as its summary lists them.

    Args:
        file: the file, opened by `open_finished`.

    Raises:
        ContainerError: the summary is damaged.
    """

    def __init__(self, file: IndexedFile) -> None:
        self._data = file.data
        summary = find_summary(file.data)
        self._data_end = summary.start - DATA_END_SIZE
        self._chunks: dict[int, ChunkEntry] = {}
        self._listed: Counter[int | bytes] = Counter()  # chunks by offset, others whole or by their kind
        for opcode, at, body in walk(summary.records):
            if opcode == container.CHUNK_INDEX:
                entry = ChunkEntry.parse(body)
                self._chunks[entry.offset] = entry
                self._listed[entry.offset] += 1
            elif opcode in {container.SCHEMA, container.CHANNEL}:
                self._listed[bytes(summary.records[at : at + container.RECORD_HEAD + len(body)])] += 1
            elif opcode in _INDEX_OF.values():
                self._listed[opcode] += 1

    def check_records(self) -> None:
        """Check that the data section holds the records that the summary lists, up to its end.

        Raises:
            ContainerError: a record is damaged, is not listed, or is missing.
        """
        found: Counter[int | bytes] = Counter()
        end = len(container.MAGIC)
        for opcode, at, body in walk(self._data[: self._data_end], end):
            end = at + container.RECORD_HEAD + len(body)
            if opcode == container.CHUNK:
                found[at] += 1
            elif opcode in {container.SCHEMA, container.CHANNEL}:
                found[bytes(self._data[at:end])] += 1
            elif opcode in _INDEX_OF:
                found[_INDEX_OF[opcode]] += 1
            elif opcode == container.PADDING and any(body):
                raise ContainerError("bytes that fill a gap are not zero")
        if end != self._data_end or found != self._listed:
            raise ContainerError("its records are not those that its summary lists")
        record_at(self._data, self._data_end, container.DATA_END)

    def check_chunk(self, offset: int, messages: memoryview) -> None:
        """Check that a chunk's head and message indexes are of its messages.

        Args:
            offset: offset of the chunk in the file [bytes].
            messages: its records, decompressed.

        Raises:
            ContainerError: they are not, or differ from the summary.
        """
        places: MessagePlaces = defaultdict(list)
        for at, message in walk_messages(messages):
            places[message.channel_id].append((message.log_time_ns, at))
        times_ns = [time_ns for each in places.values() for time_ns, _ in each] or [0]
        entry, chunk = self._chunks[offset], container.parse_chunk(self._body(offset, container.CHUNK))
        stored, compression = len(chunk.records), chunk.compression
        head = (chunk.start_ns, chunk.end_ns, stored, chunk.uncompressed_size, compression)
        listed = (entry.start_ns, entry.end_ns, entry.stored_size, entry.uncompressed_size, entry.compression)
        if head != listed or head[:2] != (min(times_ns), max(times_ns)):
            raise ContainerError("a chunk's head is not that of its messages")
        indexes = [
            container.parse_message_index(self._body(at, container.MESSAGE_INDEX))
            for at in entry.index_offsets.values()
        ]
        if {number: sorted(each) for number, each in indexes} != {
            number: sorted(each) for number, each in places.items()
        }:
            raise ContainerError("a message index does not list its chunk's messages")

    def _body(self, offset: int, opcode: int) -> memoryview:
        return record_at(self._data, offset, opcode)
