"""Writer of the records of one MCAP file in order; it keeps their offsets for the summary at the end.

The caller passes the function that appends bytes to the file.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable, Sequence
from typing import Final

from schemas.mcap import records as container
from schemas.mcap.chunks import MessagePlaces, PackedChunk, PendingMessages, pack_chunk
from schemas.mcap.records import AttachmentRecord, Buffer
from schemas.mcap.summary import Summary
from schemas.topics import Topic

LIBRARY: Final = "percuss"
"""Library name in the header record."""
_JOINED_BYTES: Final = 512
"""Size [bytes] below which a first buffer is copied behind the chunk's head: one buffer less for the system
call."""

Append = Callable[[Sequence[Buffer]], object]
"""Appends all of its buffers to the file, or raises and appends none."""


class RecordWriter:
    """Writer of one file's records: packs them, counts bytes and gathers the summary that ends the file.

    A record that `append` refused (by raising) is in neither `size` nor `summary`.

    Args:
        append: function that appends buffers to the file, all of them or, raising, none.
    """

    def __init__(self, append: Append) -> None:
        self._append = append
        self.size = 0
        """bytes appended: offset of the next record"""
        self.summary = Summary()

    def begin(self) -> None:
        """Append the file's magic bytes and the header record."""
        header = container.pack_record(
            container.HEADER, container.pack_string("") + container.pack_string(LIBRARY)
        )
        self._put([container.MAGIC, header])

    def add_topic(self, topic: Topic, number: int) -> None:
        """Append the schema and channel records of a topic; both get the id `number`."""
        schema, channel = pack_topic(topic, number)
        self._put([schema, channel])
        self.summary.schemas.append(schema)
        self.summary.channels.append(channel)

    def copy_declaration(self, whole: bytes) -> None:
        """Append a schema or channel record of another file, given whole (with opcode and length)."""
        self._put([whole])
        (self.summary.schemas if whole[0] == container.SCHEMA else self.summary.channels).append(whole)

    def write_metadata(self, name: str, entries: dict[str, str]) -> None:
        """Append a metadata record: a map of strings with a name."""
        offset, record = self.size, container.pack_metadata(name, entries)
        self._put([record])
        self.summary.add_metadata(offset, len(record), name)

    def write_attachment(self, attachment: AttachmentRecord) -> None:
        """Append an attachment record, which holds a file, and list it in the summary."""
        time_ns = attachment.log_time_ns
        packed = container.pack_attachment(attachment.name, attachment.media_type, attachment.data, time_ns)
        self.copy_attachment(packed, attachment)

    def copy_attachment(self, whole: Buffer, attachment: AttachmentRecord) -> None:
        """Append a whole packed attachment record and list it in the summary.

        Args:
            whole: the record, with opcode and length.
            attachment: content of the same record.
        """
        offset = self.size
        self._put([whole])
        self.summary.add_attachment(offset, len(whole), attachment)

    def write_pending(self, pending: PendingMessages) -> None:
        """Append the messages gathered in `pending` as an uncompressed chunk.

        The caller must not change `pending` afterwards.
        """
        self.write_chunk([pending.data], len(pending.data), zlib.crc32(pending.data), pending.places)

    def write_chunk(
        self,
        buffers: Sequence[Buffer],
        size: int,
        crc: int,
        places: MessagePlaces,
        append: Append | None = None,
    ) -> None:
        """Append messages as an uncompressed chunk with its message indexes.

        Args:
            buffers: message records, at least one, in one or more pieces of any lengths.
            size: bytes of all buffers.
            crc: CRC-32 of all buffers.
            places: log time [ns] and offset in the chunk of each message, by channel id.
            append: function that appends these buffers to the file; None: the one given at construction.
        """
        packed = pack_chunk(self.size, size, crc, places)
        self._put_chunk(packed, buffers, append)
        for channel_id, entries in places.items():
            self.summary.message_counts[channel_id] += len(entries)

    def write_packed_chunk(
        self, packed: PackedChunk, buffers: Sequence[Buffer], channel_id: int, count: int
    ) -> None:
        """Append a chunk of `count` messages of one channel that was packed for the present end of the file.

        Args:
            packed: bytes around the messages and the chunk's index record, packed for a chunk at the offset
                where the file ends at present (the attribute `size`).
            buffers: messages as stored, possibly compressed, in one or more pieces.
            channel_id: channel of all messages.
            count: number of messages.
        """
        self._put_chunk(packed, buffers, None)
        self.summary.message_counts[channel_id] += count

    def note_chunks(self, size: int, entries: Sequence[bytes], channel_id: int, count: int) -> None:
        """Count chunks that the caller itself has appended to the file, and list them in the summary.

        Args:
            size: bytes that were appended.
            entries: chunk index records of the chunks among them.
            channel_id: channel of all messages in these chunks.
            count: number of messages.
        """
        self.size += size
        self.summary.chunks += entries
        self.summary.message_counts[channel_id] += count

    def end(self) -> None:
        """Append the end of the data section, the summary, the footer and the magic bytes."""
        self._put([self.summary.pack(self.size)])

    def _put_chunk(self, packed: PackedChunk, buffers: Sequence[Buffer], append: Append | None) -> None:
        if len(buffers[0]) < _JOINED_BYTES:
            self._put([packed.head + buffers[0], *buffers[1:], packed.indexes], append)
        else:
            self._put([packed.head, *buffers, packed.indexes], append)
        self.summary.chunks.append(packed.entry)

    def _put(self, buffers: Sequence[Buffer], append: Append | None = None) -> None:
        (append or self._append)(buffers)
        self.size += sum(map(len, buffers))


def pack_topic(topic: Topic, number: int) -> tuple[bytes, bytes]:
    """Bytes of the schema record and of the channel record that declare a topic, both with id `number`."""
    data, string = topic.schema_data(), container.pack_string
    schema = struct.pack("<H", number) + string(topic.schema_name) + string("protobuf")
    channel = struct.pack("<HH", number, number) + string(topic.name) + string("protobuf")
    return (
        container.pack_record(container.SCHEMA, schema + struct.pack("<I", len(data)) + data),
        container.pack_record(container.CHANNEL, channel + container.pack_string_map({})),
    )
