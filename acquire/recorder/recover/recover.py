"""Rebuilds a cut or damaged recording from its whole messages, attachments and metadata.

The new file has a new index and a new seal (metadata record with the hashes of messages and manifest). What
was lost, what differs from the source's own seal or hashes, and what none of them covers is reported, and
stands in a metadata record of the new file.
"""

from __future__ import annotations

import hashlib
import os
import re
import struct
from collections import Counter
from pathlib import Path

from acquire.errors import RecorderError
from acquire.frames.page_memory import PAGE_BYTES
from acquire.recorder import atomic
from acquire.recorder.recover.edit import copy_messages
from acquire.recorder.recover.read_back import verify
from acquire.recorder.recover.recover_report import RecoverReport
from acquire.recorder.recover.rewrite import Rewriter, mapped, refuse_folder
from acquire.recorder.recover.stated import read_listing, stated_hashes
from schemas.document import sha256_text
from schemas.mcap import records as container
from schemas.mcap.chunks import ChunkEntry, chunk_messages
from schemas.mcap.content_hash import ContentHash
from schemas.mcap.records import ContainerError
from schemas.mcap.walk import walk
from schemas.session_manifest import MANIFEST_NAME, RECOVERED_NAME, SEAL_NAME, stated_manifest_hashes
from schemas.wording import counted

_CHUNK_HEAD = re.compile(rb"\x06.{4}\x00{4}.{16}.{4}\x00{4}", re.DOTALL)
"""head of a chunk below 4 GB: opcode, length, two times, size"""


def default_output(path: Path) -> Path:
    """Path beside a recording, with -recovered before .mcap: `a.mcap.part` gives `a-recovered.mcap`.

    Raises:
        RecorderError: `path` is a folder.
    """
    refuse_folder(path)
    return path.with_name(f"{path.name.removesuffix('.part').removesuffix('.mcap')}-recovered.mcap")


def recover(path: Path, out: Path, *, replace: bool = False) -> RecoverReport:
    """Save everything that is whole in the recording `path` to `out`, and read the new file to verify it.

    Args:
        path: recording that was cut short or damaged; it stays unchanged.
        out: path of the new recording.
        replace: True to replace an older file there, once the new one is complete.

    Returns:
        Report: numbers of saved messages and attachments, and extent of the losses.

    Raises:
        RecorderError: `path` is missing, empty or no MCAP file, nothing in it can be saved, or `out` exists,
            cannot be written or cannot be read back; nothing is left behind then.
    """
    atomic.refuse_unwritable(out, path)
    atomic.refuse_taken(out, force=replace)
    report = RecoverReport(path, out)
    with mapped(path) as data:
        writer = Rewriter(out, out.with_name(f".{out.name}.{os.getpid()}.recovering"))
        try:
            writer.records.begin()
            digest = ContentHash()
            _Salvage(data, writer, report, digest).run()
            if not (report.messages or report.attachments or report.has_manifest):
                raise RecorderError(
                    f"{path}: nothing can be saved: it holds no whole message, attachment or manifest"
                )
            writer.finish()
            report.content_id = digest.hexdigest()
            verify(writer.part_path, report)
            atomic.publish(writer.part_path, out, replace=replace)
        finally:
            writer.close()
    return report


class _Salvage:
    """One pass over the bytes of a cut or damaged recording, which copies what is whole to a new file.

    Args:
        data: bytes of the recording.
        writer: writer of the new file.
        report: report of the recovery, filled during the pass.
        digest: content hash, to which every saved message is added.
    """

    def __init__(
        self, data: memoryview, writer: Rewriter, report: RecoverReport, digest: ContentHash
    ) -> None:
        self._data = data
        self._writer = writer
        self._report = report
        self._digest = digest
        self._topics: dict[int, str] = {}
        self._schema_ids: set[int] = set()
        self._declared: set[bytes] = set()
        self._listing = read_listing(data)
        self._manifest: dict[str, str] | None = None
        """entries of the source's manifest"""
        self._attachment_hashes: dict[str, str] = {}
        self._names: Counter[tuple[int, str]] = Counter()
        """number of whole attachments and metadata records, by opcode and name"""
        self._sealed: dict[str, str] = {}
        """entries of the source's seal"""
        self._earlier: list[str] = []
        """lines on what an earlier recovery lost"""
        self._places: dict[int, tuple[int, int]] = {}
        """sequence number and log time [ns] of each channel's latest message"""
        self._out_of_order: Counter[str] = Counter()
        """number of messages that are not later than the one before, by topic"""
        self._unchecked_messages = 0
        """number of messages saved without a checksum"""

    def run(self) -> None:
        """Copy what is whole in the damaged recording to the new file, then write the seal; fill the report.

        The seal is the metadata record with the content hash. A cut chunk is searched for whole messages, and
        after damage the next undamaged chunk is searched for.

        Raises:
            RecorderError: the new file cannot be written.
        """
        at = len(container.MAGIC)
        end = self._data_end()
        while at < end and not self._report.ended_properly:
            at = self._copy_records(at)
            if not self._report.ended_properly:
                saved = self._salvage_cut_chunk(at)
                following = min(end, self._next_chunk(at + 1))
                self._report.skipped_bytes += max(0, following - at - saved)
                at = following
        self._writer.flush()
        counts = self._writer.summary.message_counts
        for number, topic in self._topics.items():
            if counts[number]:
                self._report.topics[topic] = self._report.topics.get(topic, 0) + counts[number]
        chunks = [
            ChunkEntry.parse(memoryview(entry)[container.RECORD_HEAD :])
            for entry in self._writer.summary.chunks
        ]
        if chunks:
            self._report.lasts_s = (
                max(each.end_ns for each in chunks) - min(each.start_ns for each in chunks)
            ) * 1e-9
        self._verify_contents()
        self._write_marks()

    def _write_marks(self) -> None:
        """Write the record of what is lost, if anything is, and the seal.

        The hash of the manifest that was recorded stays: a rebuilt file does not vouch for a changed one.

        Raises:
            RecorderError: the new file cannot be written.
        """
        lines = list(dict.fromkeys([*self._earlier, *self._report.losses()]))
        if lines:
            entries = {"source": self._report.source.name, "lines": "\n".join(lines)}
            self._writer.write_metadata(RECOVERED_NAME, entries)
        seal = {"content_id": self._digest.hexdigest()}
        if self._manifest is not None:
            own = {"manifest_sha256": sha256_text(self._manifest.get("json", ""))}
            seal |= own | {key: self._sealed[key] for key in own if key in self._sealed}
        self._writer.write_metadata(SEAL_NAME, seal)

    def _verify_contents(self) -> None:
        """Compare what was saved with the source's seal, summary and manifest; extend the report."""
        report = self._report
        report.differences += self._manifest_differences()
        counts = self._writer.summary.message_counts
        report.missing += self._listing.missing(self._names, counts, self._topics)
        if self._manifest is None and "manifest_sha256" in self._sealed and not report.missing:
            report.missing.append("the manifest, whose hash the seal states")
        whole = not report.damaged_records and not report.skipped_bytes
        content = self._sealed.get("content_id")
        if content is not None and content == self._digest.hexdigest():
            return
        if whole and content is not None:
            report.differences.append(
                "the messages are not those that were sealed, though each is whole: some were changed, "
                "moved, doubled or taken out: restore the file from a copy"
            )
        if self._out_of_order:
            topics = ", ".join(f"{count} on {topic}" for topic, count in sorted(self._out_of_order.items()))
            report.differences.append(f"messages stand twice or out of their order: {topics}")
        if self._unchecked_messages:
            text = f"{counted(self._unchecked_messages, 'message')} without a checksum in the source"
            report.unverified.append(text)

    def _manifest_differences(self) -> list[str]:
        """Lines on a manifest or attachments other than those that were recorded, by the stated hashes.

        A manifest without any stated hash is reported as unverified.
        """
        if self._manifest is None:
            return []
        found, text = [], self._manifest.get("json", "")
        stated = stated_manifest_hashes(self._manifest, self._sealed)
        if not stated:
            self._report.unverified.append("the manifest: the source states no hash of it")
        if stated - {sha256_text(text)}:
            found.append(
                "the manifest is not the one that was recorded: `analyze` refuses the new file like this "
                "source: restore it from a copy"
            )
        for name, expected in stated_hashes(text).items():
            if name not in self._attachment_hashes:
                found.append(f"attachment {name!r}, which the manifest states, is missing")
            elif self._attachment_hashes[name] != expected:
                found.append(
                    f"attachment {name!r} is not the one that the manifest states: restore it from a copy"
                )
        return found

    def _data_end(self) -> int:
        """Offset in the damaged file where its data end, without trailing zeros of its last 4096 bytes.

        A recording written past the page cache fills its last page with zeros.
        """
        padding = bytes(self._data[-PAGE_BYTES:])
        return len(self._data) - (len(padding) - len(padding.rstrip(b"\0")))

    def _copy_records(self, start: int) -> int:
        """Copy whole records to the rebuilt file, from offset `start` of the damaged file on.

        It ends at a record that is cut, unknown, or ends the data section. A damaged record is left out and
        counted in the report.

        Returns:
            Offset in the damaged file where the whole records end.
        """
        at = start
        for opcode, found, body in walk(self._data, start):
            # Padding has a bounded length and holds zeros only; anything else is damage, and the next chunk
            # is searched for.
            padding = opcode == container.PADDING and len(body) < 2 * PAGE_BYTES and not any(body)
            if not padding and not container.HEADER <= opcode <= container.DATA_END:
                break
            at = found + container.RECORD_HEAD + len(body)
            if opcode == container.DATA_END:
                self._report.ended_properly = True
                break
            try:
                self._copy_record(opcode, body, self._data[found:at])
            except ContainerError:
                self._report.damaged_records += 1
        return at

    def _copy_record(self, opcode: int, body: memoryview, whole: memoryview) -> None:
        if opcode == container.CHUNK:
            chunk = container.parse_chunk(body)
            self._copy_chunk(chunk_messages(chunk), checked=chunk.crc != 0)
        elif opcode in {container.SCHEMA, container.CHANNEL}:
            self._declare(opcode, body, bytes(whole))
        elif opcode == container.MESSAGE:
            self._copy_chunk(whole, checked=False)
        elif opcode == container.ATTACHMENT:
            attachment = container.parse_attachment(body)
            self._attachment_hashes[attachment.name] = hashlib.sha256(attachment.data).hexdigest()
            self._names[opcode, attachment.name] += 1
            self._writer.copy_attachment(whole)
            self._report.attachments += 1
        elif opcode == container.METADATA:
            metadata = container.parse_metadata(body)
            self._names[opcode, metadata.name] += 1
            if metadata.name == MANIFEST_NAME:
                self._report.has_manifest = True
                self._manifest = metadata.entries
            if metadata.name == SEAL_NAME:
                self._sealed = metadata.entries
            elif metadata.name == RECOVERED_NAME:
                self._earlier += metadata.entries.get("lines", "").splitlines()
            else:
                self._writer.write_metadata(metadata.name, metadata.entries)

    def _declare(self, opcode: int, body: memoryview, whole: bytes) -> None:
        """Copy a schema or channel record once; in its place the summary's, which has a checksum, if any.

        Raises:
            ContainerError: the record is damaged, and the source has no summary.
        """
        if self._listing.declarations and len(body) >= 2:
            listed = self._listing.declarations.get((opcode, *struct.unpack_from("<H", body)))
            if listed != whole:
                self._report.damaged_records += 1
            if listed is None:
                return
            whole = listed
        if whole in self._declared:
            return
        body = memoryview(whole)[container.RECORD_HEAD :]
        if opcode == container.SCHEMA:
            self._schema_ids.add(container.parse_schema(body).id)
        else:
            channel = container.parse_channel(body)
            self._topics.setdefault(channel.id, channel.topic)
            self._declare_schema_of(channel.schema_id)
        self._declared.add(whole)
        self._writer.copy_declaration(whole)

    def _declare_schema_of(self, schema_id: int) -> None:
        """Copy a channel's schema from the summary, or count it as damage, if it did not come before."""
        if schema_id == 0 or schema_id in self._schema_ids:
            return
        self._schema_ids.add(schema_id)
        self._report.damaged_records += 1
        if (listed := self._listing.declarations.get((container.SCHEMA, schema_id))) is not None:
            self._declared.add(listed)
            self._writer.copy_declaration(listed)

    def _copy_chunk(self, messages: memoryview, *, checked: bool) -> None:
        # Other programs declare topics inside their chunks.
        for opcode, at, body in walk(messages):
            if opcode in {container.SCHEMA, container.CHANNEL}:
                self._declare(opcode, body, bytes(messages[at : at + container.RECORD_HEAD + len(body)]))
        copied = copy_messages(messages, self._topics, self._writer, self._digest)
        self._report.messages += len(copied)
        if not checked:
            self._unchecked_messages += len(copied)
        for message in copied:
            # Other programs leave all numbers at 0: their times tell.
            place = (message.sequence, message.log_time_ns)
            if place <= self._places.get(message.channel_id, (-1, 0)):
                self._out_of_order[self._topics[message.channel_id]] += 1
            self._places[message.channel_id] = place

    def _salvage_cut_chunk(self, at: int) -> int:
        """Copy the whole messages of an uncompressed MCAP chunk at offset `at` whose end is missing.

        The messages cannot be checked by the chunk's CRC, only by their form.

        Returns:
            Number of bytes of the chunk that were used; 0 if no such chunk begins there or no message is
            whole.
        """
        head = container.CHUNK_HEAD
        if len(self._data) - at <= head or self._data[at] != container.CHUNK:
            return 0
        size, _, name_size = struct.unpack_from("<QII", self._data, at + container.RECORD_HEAD + 16)
        if name_size != 0 or size <= len(self._data) - at - head:
            return 0
        saved = 0
        for opcode, found, body in walk(self._data[at + head :]):
            start, length = at + head + found, container.RECORD_HEAD + len(body)
            try:
                if (
                    opcode != container.MESSAGE
                    or container.parse_message(body).channel_id not in self._topics
                ):
                    break
            except ContainerError:
                break
            self._copy_chunk(self._data[start : start + length], checked=False)
            saved = head + found + length
        return saved

    def _next_chunk(self, start: int) -> int:
        """Offset of the first undamaged MCAP chunk at or after `start`; the file's size if there is none.

        The bytes are searched for a chunk's head (opcode, length, times, size), because a wrong record length
        must not cost everything after it. Chunks that compression made smaller are not found.
        """
        data = self._data
        for match in _CHUNK_HEAD.finditer(data, start):
            at = match.start()
            length, _, _, size = struct.unpack_from("<QQQQ", data, at + 1)
            if size <= length <= len(data) - at - container.RECORD_HEAD:
                body = data[at + container.RECORD_HEAD : at + container.RECORD_HEAD + length]
                try:
                    chunk_messages(container.parse_chunk(body))
                    return at
                except ContainerError:
                    continue
        return len(data)
