"""Writes a recording: images as chunks of their own without copying, small topics in chunks of theirs, renamed only when whole.

While it is written the file is called `<name>.part`. Whatever ends the process, what reached the file can be read by
`acquire recover`; what is still in memory is at most 0.5 s of small topics.
"""

from __future__ import annotations

import os
import struct
import threading
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Final

from acquire.errors import RecorderError
from acquire.recorder import atomic
from acquire.recorder.checksum import checksums
from acquire.recorder.summary import Summary, pack_chunk, pack_topic
from schemas import container
from schemas.container import Buffer, ContentHash
from schemas.documents import MANIFEST_NAME, SEAL_NAME, sha256_text
from schemas.topics import Topic

PART_SUFFIX: Final = ".part"
SMALL_CHUNK_BYTES: Final = 64 << 10
FLUSH_S: Final = 0.2
"""a frame's meta waits `pre_trigger_s` (0.25 s) in the delay line before it comes here: together below 0.5 s"""
SYNC_BYTES: Final = 32 << 20
RESERVE_BYTES: Final = 8 << 20
"""kept from other writers on the disk, so that a full disk still lets the summary be written"""


@dataclass(frozen=True)
class Channel:
    """Handle of a topic in one file."""

    id: int
    topic: Topic


@dataclass(frozen=True)
class ImageMessage:
    """One image to be written; `parts` are views of bytes that stay as they are until they are written."""

    log_time_ns: int
    parts: Sequence[Buffer]
    sequence: int = 0
    publish_time_ns: int | None = None
    """log time where None"""


@dataclass(frozen=True)
class Seal:
    """A finished recording."""

    path: Path
    content_id: str
    messages: int
    size: int
    """bytes"""


class McapWriter:
    """One recording being written. Every method may be called from any thread.

    A disk that fills up raises RecorderError and takes back the message that did not fit; `finish` still gives a whole file.

    Raises:
        RecorderError: the path is taken, its folder is missing, or the disk refuses.
    """

    def __init__(self, path: Path, flush_s: float = FLUSH_S, sync_bytes: int = SYNC_BYTES) -> None:
        self.path = path
        self.part_path = path.with_name(path.name + PART_SUFFIX)
        atomic.refuse_taken(path)
        self._fd = atomic.create_part(self.part_path)
        self._reserve = atomic.reserve(path.parent, RESERVE_BYTES)
        self._flush_s = flush_s
        self._sync_bytes = sync_bytes
        self._lock = threading.Lock()
        self._summary = Summary()
        self._hash = ContentHash()
        self._manifest_hash: dict[str, str] = {}
        self._channels: dict[str, Channel] = {}
        self._small = bytearray()
        self._small_index: dict[int, list[tuple[int, int]]] = {}
        self._size = 0
        self._synced = 0
        self._closed = False
        self._full: RecorderError | None = None
        self._wake = threading.Event()
        self._put([container.MAGIC, container.record(container.HEADER, container.string("") + container.string("percuss"))])
        self._keeper = threading.Thread(target=self._keep, name="recorder-sync", daemon=True)
        self._keeper.start()

    @property
    def size(self) -> int:
        """Bytes written so far."""
        return self._size

    def metadata(self, name: str, entries: dict[str, str]) -> None:
        """Write named strings."""
        with self._lock:
            self._open()
            self._metadata(name, entries)
            if name == MANIFEST_NAME and "json" in entries:
                self._manifest_hash = {"manifest_sha256": sha256_text(entries["json"])}

    def attachment(self, name: str, media_type: str, data: bytes, log_time_ns: int = 0) -> None:
        """Attach a file."""
        with self._lock:
            self._open()
            self._flush_small()
            head = container.string(name) + container.string(media_type)
            body = struct.pack("<QQ", log_time_ns, log_time_ns) + head + struct.pack("<Q", len(data)) + data
            offset = self._size
            length = self._put([container.record(container.ATTACHMENT, body + struct.pack("<I", zlib.crc32(body)))])
            self._summary.add_attachment(offset, length, container.AttachmentRecord(name, media_type, log_time_ns, b""), len(data))

    def add_topic(self, topic: Topic) -> Channel:
        """Make a channel; the same topic again gives the same channel."""
        with self._lock:
            self._open()
            known = self._channels.get(topic.name)
            if known is not None:
                if known.topic.schema_name != topic.schema_name:
                    raise RecorderError(f"{self.path}: topic {topic.name} holds {known.topic.schema_name}, not {topic.schema_name}")
                return known
            number = len(self._channels) + 1
            schema, channel = pack_topic(topic, number)
            self._flush_small()
            self._put([schema, channel])
            self._summary.schemas.append(schema)
            self._summary.channels.append(channel)
            self._channels[topic.name] = Channel(number, topic)
            return self._channels[topic.name]

    def write(
        self,
        channel: Channel,
        log_time_ns: int,
        data: Buffer | Sequence[Buffer],
        sequence: int = 0,
        publish_time_ns: int | None = None,
    ) -> None:
        """Write one message, given whole or in parts. An image is in the file (page cache) on return; its buffer may be used again.

        Raises:
            RecorderError: the disk is full or failing, the recording is finished, or the time is 0 (1970: a clock nobody set).
        """
        given = data if isinstance(data, Sequence) and not isinstance(data, bytes | bytearray | memoryview) else [data]
        parts: list[Buffer] = [memoryview(part) for part in given]
        if channel.topic.image:
            self.write_images(channel, [ImageMessage(log_time_ns, parts, sequence, publish_time_ns)])
            return
        self._refuse_unset(channel, log_time_ns)
        body = b"".join(parts)
        publish = log_time_ns if publish_time_ns is None else publish_time_ns
        head = container.message_head(channel.id, sequence, log_time_ns, publish, len(body))
        with self._lock:
            self._open()
            if self._full is not None and len(self._small) > RESERVE_BYTES // 4:
                raise self._full
            self._small_index.setdefault(channel.id, []).append((log_time_ns, len(self._small)))
            self._small += head
            self._small += body
            self._hash.add(channel.topic.name, log_time_ns, len(body), body)
            if len(self._small) >= SMALL_CHUNK_BYTES:
                self._flush_small()

    def write_images(self, channel: Channel, messages: Sequence[ImageMessage]) -> None:
        """Write images as one chunk with one system call, without copying them. On return they are in the file (page cache), or none is.

        Raises:
            RecorderError: as from `write`.
        """
        buffers: list[Buffer] = []
        index: list[tuple[int, int]] = []
        identity: list[tuple[int, int, Buffer, int]] = []
        at = crc = 0
        # The checksums release the GIL and are taken outside the lock, so that small topics never wait for them.
        for message in messages:
            time_ns, publish = message.log_time_ns, message.publish_time_ns
            self._refuse_unset(channel, time_ns)
            size = sum(map(len, message.parts))
            head = container.message_head(channel.id, message.sequence, time_ns, time_ns if publish is None else publish, size)
            sums = checksums(crc, head, message.parts)
            crc = sums.chunk
            index.append((time_ns, at))
            identity.append((time_ns, size, b"" if size >= container.LARGE_MESSAGE else b"".join(message.parts), sums.data))
            buffers += (head, *message.parts)
            at += len(head) + size
        if not messages:
            return
        with self._lock:
            self._open()
            if self._full is not None:
                raise self._full
            self._chunk(buffers, at, crc, {channel.id: index})
            for time_ns, size, data, data_crc in identity:
                self._hash.add(channel.topic.name, time_ns, size, data, data_crc)

    def flush(self) -> None:
        """Hand small topics to the file now."""
        with self._lock:
            self._open()
            self._flush_small()

    def finish(self) -> Seal:
        """Write what is in memory, the seal and the summary; fsync; give the file its name.

        Raises:
            RecorderError: the disk refuses, or the name was taken meanwhile; the `.part` file stays and `acquire recover` reads it.
        """
        with self._lock:
            self._open()
            self._closed = True
            self._release_reserve()
            try:
                self._flush_small()
                content_id = self._hash.hexdigest()
                self._metadata(SEAL_NAME, {"content_id": content_id, **self._manifest_hash})
                self._put([self._summary.pack(self._size)])
                os.fsync(self._fd)
            except OSError as error:
                raise self._disk_error(error) from None
            finally:
                os.close(self._fd)
                self._wake.set()
        self._join()
        atomic.publish(self.part_path, self.path)
        return Seal(self.path, content_id, self._summary.message_counts.total(), self._size)

    def abort(self) -> None:
        """Stop writing; the `.part` file stays as it is."""
        with self._lock:
            if not self._closed:
                self._closed = True
                self._release_reserve()
                os.close(self._fd)
        self._join()

    def __enter__(self) -> McapWriter:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        """Finish, or after an error leave the `.part` file."""
        if kind is not None:
            self.abort()
        elif not self._closed:
            self.finish()

    def _refuse_unset(self, channel: Channel, log_time_ns: int) -> None:
        if log_time_ns <= 0:
            raise RecorderError(f"{self.path}: {channel.topic.name} has log time {log_time_ns}: give wall anchor + host time")

    # --- under the lock ---

    def _open(self) -> None:
        if self._closed:
            raise RecorderError(f"{self.path}: this recording is finished; open a new one")

    def _metadata(self, name: str, entries: dict[str, str]) -> None:
        self._flush_small()
        offset = self._size
        length = self._put([container.record(container.METADATA, container.string(name) + container.string_map(entries))])
        self._summary.add_metadata(offset, length, name)

    def _flush_small(self) -> None:
        if self._small:
            self._chunk([self._small], len(self._small), zlib.crc32(self._small), self._small_index)
            self._small, self._small_index = bytearray(), {}

    def _chunk(self, buffers: list[Buffer], size: int, crc: int, index: dict[int, list[tuple[int, int]]]) -> None:
        packed = pack_chunk(self._size, size, crc, index)
        self._put([packed.head, *buffers, packed.indexes])
        self._summary.chunks.append(packed.entry)
        for number, entries in index.items():
            self._summary.message_counts[number] += len(entries)

    def _put(self, buffers: list[Buffer]) -> int:
        try:
            length = atomic.write_all(self._fd, buffers)
        except OSError as error:
            # Take back the half-written record: the file stays a sequence of whole records.
            os.ftruncate(self._fd, self._size)
            os.lseek(self._fd, self._size, os.SEEK_SET)
            # From here on no more images; the space held back is for small topics, the seal and the summary.
            self._full = self._disk_error(error)
            self._release_reserve()
            raise self._full from None
        self._size += length
        if self._size - self._synced >= self._sync_bytes:
            self._wake.set()
        return length

    def _disk_error(self, error: OSError) -> RecorderError:
        return RecorderError(f"{self.part_path}: cannot be written: {error.strerror}: free space on this disk, finish, and start a new one")

    def _release_reserve(self) -> None:
        if self._reserve is not None:
            os.close(self._reserve)
            self._reserve = None

    # --- helper thread ---

    def _keep(self) -> None:
        """Flush small topics twice a second, and push bytes to the disk so that the kernel never has seconds of them to write."""
        while True:
            self._wake.wait(self._flush_s)
            with self._lock:
                if self._closed:
                    return
                self._wake.clear()
                try:
                    self._flush_small()
                except RecorderError:  # the next caller of write or finish meets the full disk itself
                    continue
                due = self._size - self._synced >= self._sync_bytes
                if due:
                    self._synced = self._size
                fd = os.dup(self._fd) if due else None
            if fd is not None:
                try:
                    os.fdatasync(fd)
                except OSError:  # reported again by the fsync in finish
                    pass
                finally:
                    os.close(fd)

    def _join(self) -> None:
        self._wake.set()
        self._keeper.join()
