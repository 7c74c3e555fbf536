"""The summary section that ends an MCAP file: gathered while writing, located in a finished file."""

from __future__ import annotations

import struct
import zlib
from collections import Counter
from dataclasses import dataclass, field
from typing import Final, NamedTuple

from schemas.mcap import records as container
from schemas.mcap.records import Buffer, ContainerError

FOOTER_AND_MAGIC: Final = container.FOOTER_SIZE + len(container.MAGIC)
"""Bytes at the end of a finished file."""
DATA_END_SIZE: Final = container.RECORD_HEAD + 4
"""Bytes of the DataEnd record, which stands just before the summary section."""

_CHUNK_TIMES: Final = struct.Struct("<QQ")


class EndsEarly(ContainerError):
    """A file without a usable footer: it was cut short, or is still being written."""


# --- writing


@dataclass
class Summary:
    """Summary section of a file (the index at its end), gathered as the file grows.

    The lists hold whole packed records.
    """

    schemas: list[bytes] = field(default_factory=list)
    """schema records"""
    channels: list[bytes] = field(default_factory=list)
    """channel records"""
    chunks: list[bytes] = field(default_factory=list)
    """chunk index records: as bytes the garbage collector need not visit thousands of objects"""
    attachments: list[bytes] = field(default_factory=list)
    """attachment index records"""
    metadata: list[bytes] = field(default_factory=list)
    """metadata index records"""
    message_counts: Counter[int] = field(default_factory=Counter)
    """number of messages by channel id"""

    def add_attachment(self, offset: int, length: int, attachment: container.AttachmentRecord) -> None:
        """List an attachment record, which was written to the file, in the summary (index at its end).

        Args:
            offset: file offset of the record.
            length: bytes of the record.
            attachment: content of the record.
        """
        time_ns, size = attachment.log_time_ns, len(attachment.data)
        body = struct.pack("<QQQQQ", offset, length, time_ns, time_ns, size)
        body += container.pack_string(attachment.name) + container.pack_string(attachment.media_type)
        self.attachments.append(container.pack_record(container.ATTACHMENT_INDEX, body))

    def add_metadata(self, offset: int, length: int, name: str) -> None:
        """List a metadata record, which was written to the file, in the summary (index at its end).

        Args:
            offset: file offset of the record.
            length: bytes of the record.
            name: name of the metadata.
        """
        body = struct.pack("<QQ", offset, length) + container.pack_string(name)
        self.metadata.append(container.pack_record(container.METADATA_INDEX, body))

    def pack(self, offset: int) -> bytes:
        """Bytes that end the file: DataEnd record, summary, summary offsets, footer and magic bytes.

        Args:
            offset: file offset at which these bytes are to be written.
        """
        data_end = container.pack_record(container.DATA_END, struct.pack("<I", 0))
        start = offset + len(data_end)
        summary = bytearray()
        groups: list[bytes] = []
        for opcode, records in (
            (container.SCHEMA, self.schemas),
            (container.CHANNEL, self.channels),
            (container.STATISTICS, [self._statistics()]),
            (container.CHUNK_INDEX, self.chunks),
            (container.ATTACHMENT_INDEX, self.attachments),
            (container.METADATA_INDEX, self.metadata),
        ):
            if records:
                group = b"".join(records)
                body = struct.pack("<BQQ", opcode, start + len(summary), len(group))
                groups.append(container.pack_record(container.SUMMARY_OFFSET, body))
                summary += group
        offsets_start = start + len(summary)
        summary += b"".join(groups)
        footer = struct.pack("<BQQQ", container.FOOTER, 20, start, offsets_start)
        crc = zlib.crc32(footer, zlib.crc32(summary))
        return data_end + bytes(summary) + footer + struct.pack("<I", crc) + container.MAGIC

    def _statistics(self) -> bytes:
        counts = b"".join(struct.pack("<HQ", *entry) for entry in sorted(self.message_counts.items()))
        times = [_CHUNK_TIMES.unpack_from(chunk, container.RECORD_HEAD) for chunk in self.chunks]
        numbers = struct.pack(
            "<QHIIIIQQ",
            self.message_counts.total(),
            len(self.schemas),
            len(self.channels),
            len(self.attachments),
            len(self.metadata),
            len(self.chunks),
            min((start for start, _ in times), default=0),
            max((end for _, end in times), default=0),
        )
        return container.pack_record(container.STATISTICS, numbers + struct.pack("<I", len(counts)) + counts)


def parse_message_counts(body: memoryview) -> Counter[int]:
    """Number of messages by channel id, from the body of a statistics record.

    Raises:
        ContainerError: the list of counts is damaged.
    """
    try:
        return Counter(dict(struct.iter_unpack("<HQ", body[46:])))
    except struct.error:
        raise ContainerError("a statistics record is damaged") from None


# --- reading


class SummarySection(NamedTuple):
    """Summary section of a finished file: its offset and a view of its records."""

    start: int
    """offset of the section in the file"""
    records: memoryview
    """all records of the section"""


def summary_start(tail: Buffer, size: int) -> tuple[int, int]:
    """Offset of a file's summary section, and the CRC-32 that protects it, from the end of the file.

    Args:
        tail: the file's last FOOTER_AND_MAGIC bytes.
        size: size of the whole file [bytes].

    Returns:
        Offset of the section from the beginning of the file, and the CRC-32 (0 if there is none) of the
        section and of the footer's bytes before that CRC.

    Raises:
        EndsEarly: the file does not end with the magic bytes and a footer that points at a summary.
    """
    magic = container.MAGIC
    if (
        size < len(magic) + FOOTER_AND_MAGIC
        or len(tail) < FOOTER_AND_MAGIC
        or bytes(tail[-len(magic) :]) != magic
    ):
        raise EndsEarly("it ends early")
    opcode, length, start, _, crc = struct.unpack_from("<BQQQI", tail)
    if opcode != container.FOOTER or length != 20 or not 0 < start < size - FOOTER_AND_MAGIC:
        raise EndsEarly("it has no summary")
    return start, crc


def find_summary(data: memoryview) -> SummarySection:
    """Locate the summary section of a mapped file and check the section's CRC, if it has one.

    Args:
        data: the whole file.

    Returns:
        Offset of the section in the file, and a view of its records.

    Raises:
        EndsEarly: the file has no footer that points at a summary.
        ContainerError: the summary is damaged.
    """
    start, crc = summary_start(data[-FOOTER_AND_MAGIC:], len(data))
    footer = len(data) - FOOTER_AND_MAGIC
    if crc and zlib.crc32(data[start : footer + container.FOOTER_SIZE - 4]) != crc:
        raise ContainerError("the summary is damaged (CRC)")
    return SummarySection(start, data[start:footer])
