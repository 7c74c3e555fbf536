"""What a recording states of its own contents: hashes of its attachments, and what its summary lists."""

from __future__ import annotations

import json
import struct
import zlib
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

from schemas.mcap import records as container
from schemas.mcap.records import ContainerError
from schemas.mcap.summary import FOOTER_AND_MAGIC, find_summary, parse_message_counts
from schemas.mcap.walk import walk
from schemas.wording import counted

MAX_NAMES = 5
"""Largest number of missing records or topics that a line names."""
_NAME_OFFSETS = {container.ATTACHMENT_INDEX: 40, container.METADATA_INDEX: 16}
"""offset of the name in an index record, by opcode"""
_KINDS = {container.ATTACHMENT: "attachment", container.METADATA: "metadata record"}
_INDEXED = {
    container.ATTACHMENT_INDEX: container.ATTACHMENT,
    container.METADATA_INDEX: container.METADATA,
}
_STATISTICS_HEAD = struct.Struct("<QHIII")
"""numbers of messages, schemas, channels, attachments and metadata records"""


@dataclass
class Listing:
    """Contents of a file by its summary; empty without a whole summary."""

    declarations: dict[tuple[int, int], bytes] = field(default_factory=dict)
    """whole schema and channel records, by opcode and id"""
    names: Counter[tuple[int, str]] = field(default_factory=Counter)
    """number of indexed attachments and metadata records, by opcode and name"""
    totals: dict[int, int] = field(default_factory=dict)
    """number of messages, attachments and metadata records, by opcode, from the statistics"""
    messages: Counter[int] = field(default_factory=Counter)
    """number of messages by channel id, from the statistics"""

    def missing(
        self,
        found: Counter[tuple[int, str]],
        messages: Counter[int],
        topics: Mapping[int, str],
    ) -> list[str]:
        """Lines on messages, attachments and metadata records that the summary lists and that are missing.

        Args:
            found: number of attachments and metadata records in the file, by opcode and name.
            messages: number of messages in the file, by channel id.
            topics: topic name of each channel, by id.
        """
        lines = []
        for opcode, kind in _KINDS.items():
            names = sorted(name for (each, name), _ in (self.names - found).items() if each == opcode)
            present = sum(count for (each, _), count in found.items() if each == opcode)
            lacking = max(len(names), self.totals.get(opcode, 0) - present)
            if lacking:
                named = f": {_enumerated([repr(name) for name in names])}" if names else ""
                lines.append(f"{counted(lacking, kind)} that the summary lists{named}")
        lacking_by_id = self.messages - messages
        lacking = max(lacking_by_id.total(), self.totals.get(container.MESSAGE, 0) - messages.total())
        if lacking:
            by_topic = [
                f"{count} on {topics.get(number, f'channel {number}')}"
                for number, count in sorted(lacking_by_id.items())
            ]
            named = f": {_enumerated(by_topic)}" if by_topic else ""
            lines.append(f"{counted(lacking, 'message')} that the summary counts{named}")
        return lines


def _enumerated(texts: list[str]) -> str:
    more = len(texts) - MAX_NAMES
    return ", ".join([*texts[:MAX_NAMES], *([f"and {more} more"] if more > 0 else [])])


def read_listing(data: memoryview) -> Listing:
    """Contents of the mapped file `data` by its summary."""
    listing = Listing()
    try:
        for opcode, whole, body in _summary_records(data):
            if opcode in {container.SCHEMA, container.CHANNEL}:
                listing.declarations[opcode, *struct.unpack_from("<H", body)] = bytes(whole)
            elif opcode in _INDEXED:
                listing.names[_INDEXED[opcode], _name_at(body, _NAME_OFFSETS[opcode])] += 1
            elif opcode == container.STATISTICS:
                total, _, _, attachments, metadata = _STATISTICS_HEAD.unpack_from(body)
                listing.totals = {
                    container.MESSAGE: total,
                    container.ATTACHMENT: attachments,
                    container.METADATA: metadata,
                }
                listing.messages = parse_message_counts(body)
    except (ContainerError, struct.error):
        return Listing()
    return listing


def _summary_records(data: memoryview) -> Iterator[tuple[int, memoryview, memoryview]]:
    """Yield the records of the summary as (opcode, whole record, body).

    A record that was taken out of the file or put in displaces its summary, which then follows the data's end
    all the same.

    Raises:
        ContainerError: there is no whole summary.
    """
    try:
        records = find_summary(data).records
    except ContainerError:
        records = _displaced_summary(data)
    for opcode, at, body in walk(records):
        yield opcode, records[at : at + container.RECORD_HEAD + len(body)], body


def _displaced_summary(data: memoryview) -> memoryview:
    """Records between the end of the data and the footer, if their CRC says that they are the summary.

    Raises:
        ContainerError: they are not, or the walk from the file's beginning does not reach the data's end.
    """
    footer = len(data) - FOOTER_AND_MAGIC
    for opcode, at, body in walk(data, len(container.MAGIC)):
        if opcode == container.DATA_END:
            start = at + container.RECORD_HEAD + len(body)
            covered = data[start : footer + container.FOOTER_SIZE - 4]
            (crc,) = struct.unpack_from("<I", data, footer + container.FOOTER_SIZE - 4)
            if crc and start <= footer and zlib.crc32(covered) == crc:
                return data[start:footer]
            break
    raise ContainerError("no whole summary")


def _name_at(body: memoryview, offset: int) -> str:
    (size,) = struct.unpack_from("<I", body, offset)
    return bytes(body[offset + 4 : offset + 4 + size]).decode(errors="replace")


def stated_hashes(manifest_json: str) -> dict[str, str]:
    """Hash of each attachment that a manifest states; none, if it cannot be read."""
    try:
        stated = json.loads(manifest_json)["hashes"]
    except (ValueError, KeyError, TypeError, RecursionError):
        return {}
    return {str(name): str(digest) for name, digest in stated.items()} if isinstance(stated, dict) else {}
