"""Writes the records of one MCAP file in order.

The caller appends the bytes to the file; the offsets and the summary are tracked here.
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
"""A first buffer below this size is copied behind the chunk's head: one buffer less for the system call."""

Append = Callable[[Sequence[Buffer]], object]
"""Appends all of its buffers to the file, or raises and appends none."""


class RecordWriter:
    """Packs the records of one file, counts its bytes and gathers the summary that ends it.

    A record that `append` refused is in neither `size` nor `summary`.
    """

    def __init__(self, append: Append) -> None:
        self._append = append
        self.size = 0
        """bytes appended: offset of the next record"""
        self.summary = Summary()

    def begin(self) -> None:
        """Write the magic and the header."""
        header = container.pack_record(
            container.HEADER, container.pack_string("") + container.pack_string(LIBRARY)
        )
        self._put([container.MAGIC, header])

    def add_topic(self, topic: Topic, number: int) -> None:
        """Declare a topic as schema and channel `number`."""
        schema, channel = pack_topic(topic, number)
        self._put([schema, channel])
        self.summary.schemas.append(schema)
        self.summary.channels.append(channel)

    def copy_declaration(self, whole: bytes) -> None:
        """Write a whole schema or channel record of another file."""
        self._put([whole])
        (self.summary.schemas if whole[0] == container.SCHEMA else self.summary.channels).append(whole)

    def write_metadata(self, name: str, entries: dict[str, str]) -> None:
        """Write a named map of strings."""
        offset, record = self.size, container.pack_metadata(name, entries)
        self._put([record])
        self.summary.add_metadata(offset, len(record), name)

    def write_attachment(self, attachment: AttachmentRecord) -> None:
        """Attach a file."""
        time_ns = attachment.log_time_ns
        packed = container.pack_attachment(attachment.name, attachment.media_type, attachment.data, time_ns)
        self.copy_attachment(packed, attachment)

    def copy_attachment(self, whole: Buffer, attachment: AttachmentRecord) -> None:
        """Write a whole attachment record, which holds `attachment`."""
        offset = self.size
        self._put([whole])
        self.summary.add_attachment(offset, len(whole), attachment)

    def write_pending(self, pending: PendingMessages) -> None:
        """Write gathered messages as a chunk; they must not be changed afterwards."""
        self.write_chunk([pending.data], len(pending.data), zlib.crc32(pending.data), pending.places)

    def write_chunk(
        self,
        buffers: Sequence[Buffer],
        size: int,
        crc: int,
        places: MessagePlaces,
        append: Append | None = None,
    ) -> None:
        """Write messages as an uncompressed chunk.

        Args:
            buffers: message records, in as many pieces as they come in.
            size: bytes of all buffers.
            crc: CRC-32 of all buffers.
            places: log time and offset of each message, by channel.
            append: appends these buffers, in place of the function given at construction.
        """
        packed = pack_chunk(self.size, size, crc, places)
        self._put_chunk(packed, buffers, append)
        for channel_id, entries in places.items():
            self.summary.message_counts[channel_id] += len(entries)

    def write_packed_chunk(
        self, packed: PackedChunk, buffers: Sequence[Buffer], channel_id: int, count: int
    ) -> None:
        """Write a chunk of `count` messages of one channel that was packed for offset `size`."""
        self._put_chunk(packed, buffers, None)
        self.summary.message_counts[channel_id] += count

    def note_chunks(self, size: int, entries: Sequence[bytes], channel_id: int, count: int) -> None:
        """Add chunks to the summary that the caller has appended to the file itself.

        Args:
            size: bytes that were appended.
            entries: chunk index records of the chunks among them.
            channel_id: channel of all their messages.
            count: number of messages.
        """
        self.size += size
        self.summary.chunks += entries
        self.summary.message_counts[channel_id] += count

    def end(self) -> None:
        """Write the summary, the footer and the magic."""
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
    """Schema and channel record of a topic; both carry the same number."""
    data, string = topic.schema_data(), container.pack_string
    schema = struct.pack("<H", number) + string(topic.schema_name) + string("protobuf")
    channel = struct.pack("<HH", number, number) + string(topic.name) + string("protobuf")
    return (
        container.pack_record(container.SCHEMA, schema + struct.pack("<I", len(data)) + data),
        container.pack_record(container.CHANNEL, channel + container.pack_string_map({})),
    )
