"""Writes a recording: images as chunks of their own without copying, small topics in chunks of theirs, renamed only when whole.

While it is written the file is called `<name>.part`. Whatever ends the process, what reached the file can be read by
`acquire recover`; what is still in memory is at most 0.5 s of small topics, and with a DirectFile 0.2 s of images while the disk keeps up.
"""

from __future__ import annotations

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
from acquire.recorder.data_file import DataFile, LentRun
from acquire.recorder.direct.block_memory import BlockMemory
from acquire.recorder.direct.borrowed_chunks import pack_lent
from acquire.recorder.direct.direct_file import DirectFile
from acquire.recorder.messages import DiskBehind, ImageMessage, LentImage, SmallMessage
from acquire.recorder.page_cache_file import PageCacheFile
from schemas.document import sha256_text
from schemas.mcap import records as container
from schemas.mcap.records import Buffer, ContentHash
from schemas.mcap.summary import Summary, pack_chunk, pack_topic
from schemas.session_manifest import MANIFEST_NAME, SEAL_NAME
from schemas.topics import Topic

PART_SUFFIX: Final = ".part"
SMALL_CHUNK_BYTES: Final = 64 << 10
SMALL_PART_BYTES: Final = 512
"""joined to what stands before it"""
CHUNK_EXTRA: Final = 128
"""more than what stands around a chunk's messages takes, and more than a message's line in the index"""
FLUSH_S: Final = 0.1
"""a frame's meta waits up to 0.25 s for a trigger before it comes here, and a DirectFile 0.1 s for more: together below 0.5 s"""
SYNC_BYTES: Final = 32 << 20
SMALL_BYTES: Final = 2 << 20
"""of small topics that wait for a full disk to be finished with"""


@dataclass(frozen=True)
class Channel:
    """Handle of a topic in one file."""

    id: int
    topic: Topic


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

    def __init__(self, path: Path, memory: BlockMemory | None = None, flush_s: float = FLUSH_S, sync_bytes: int = SYNC_BYTES) -> None:
        """Through the page cache, or with `memory` past it (where `can_write_directly`)."""
        self.path = path
        self.part_path = path.with_name(path.name + PART_SUFFIX)
        atomic.refuse_taken(path)
        self._file: DataFile = (
            PageCacheFile(self.part_path, sync_bytes) if memory is None else DirectFile(self.part_path, memory, sync_bytes)
        )
        self._flush_s = flush_s
        self._sync_bytes = sync_bytes
        self._pushed = 0
        self._lock = threading.Lock()
        self._summary = Summary()
        self._hash = ContentHash()
        self._manifest_hash: dict[str, str] = {}
        self._channels: dict[str, Channel] = {}
        self._small = bytearray()
        self._small_index: dict[int, list[tuple[int, int]]] = {}
        self._closed = False
        self._full: RecorderError | None = None
        self._wake = threading.Event()
        self._put([container.MAGIC, container.record(container.HEADER, container.string("") + container.string("percuss"))])
        self._keeper = threading.Thread(target=self._keep, name="recorder-sync", daemon=True)
        self._keeper.start()

    @property
    def size(self) -> int:
        """Bytes written so far."""
        return self._file.size

    @property
    def never_waits(self) -> bool:
        """Whether `write_images` returns without waiting for the disk."""
        return self._file.never_waits

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
            offset = self._file.size
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
        """Write one message, given whole or in parts. Its buffer may be used again; an image is as safe as `write_images` makes it.

        Raises:
            RecorderError: the disk is full or failing, the recording is finished, or the time is 0 (1970: a clock nobody set).
        """
        parts: Sequence[Buffer] = (memoryview(data),) if isinstance(data, bytes | bytearray | memoryview) else data
        if channel.topic.image:
            self.write_images(channel, [ImageMessage(log_time_ns, parts, sequence, publish_time_ns)])
            return
        self.write_small(channel, [SmallMessage(log_time_ns, b"".join(parts), sequence, publish_time_ns)])

    def write_small(self, channel: Channel, messages: Sequence[SmallMessage]) -> None:
        """Write messages of a small topic.

        Raises:
            RecorderError: as from `write`.
        """
        for message in messages:
            self._refuse_unset(channel, message.log_time_ns)
        if not messages:  # an empty entry in the index has no times for its chunk
            return
        with self._lock:
            self._open()
            if self._full is not None and len(self._small) > SMALL_BYTES:
                raise self._full
            small, index, topic = self._small, self._small_index.setdefault(channel.id, []), channel.topic.name
            for time_ns, data, sequence, publish_time_ns in messages:
                publish = time_ns if publish_time_ns is None else publish_time_ns
                index.append((time_ns, len(small)))
                small += container.message_head(channel.id, sequence, time_ns, publish, len(data))
                small += data
            self._hash.add_all(topic, [(message.log_time_ns, len(message.data), message.data, None) for message in messages])
            if len(small) >= SMALL_CHUNK_BYTES:
                self._flush_small()

    def write_images(self, channel: Channel, messages: Sequence[ImageMessage]) -> None:
        """Write images as one chunk, all or none. On return they are in the page cache; or copied, and soon on the disk.

        Raises:
            DiskBehind: there is no memory for them now; only where `never_waits`.
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
            small = 1 if message.parts and len(message.parts[0]) < SMALL_PART_BYTES else 0
            buffers.append(head + message.parts[0] if small else head)
            buffers += message.parts[small:]
            at += len(head) + size
        if not messages:
            return
        with self._lock:
            self._open()
            if self._full is not None:
                raise self._full
            if not self._file.has_room(at + CHUNK_EXTRA * (1 + len(index)), image=True):
                raise DiskBehind(f"{self.part_path}: the disk is too slow: {at} bytes more have no room in memory")
            self._chunk(buffers, at, crc, {channel.id: index}, image=True)
            for time_ns, size, data, data_crc in identity:
                self._hash.add(channel.topic.name, time_ns, size, data, data_crc)

    def write_lent(self, channel: Channel, images: Sequence[LentImage]) -> None:
        """Write images from where they lie, a chunk each, all or none; each is released when it is on the disk, or the disk failed.

        Raises:
            RecorderError: as from `write_images`; none is released then.
        """
        for image in images:
            self._refuse_unset(channel, image.log_time_ns)
        with self._lock:
            self._open()
            if self._full is not None:
                raise self._full
            chunks = pack_lent(self._file.size, channel.id, images)
            run = chunks.run
            if not self._file.has_room(run.own_bytes, image=True, lent=run.lent_bytes):
                raise DiskBehind(f"{self.part_path}: the disk is too slow: {chunks.size} bytes more have no room in memory")
            self._put(run)
            self._summary.chunks += chunks.entries
            self._summary.message_counts[channel.id] += len(images)
            self._hash.add_all(channel.topic.name, chunks.identity)

    def flush(self) -> None:
        """Hand small topics to the file now; on return others can read in it what was written before. `finish` does it too.

        Raises:
            RecorderError: the disk refused some of it.
        """
        with self._lock:
            if self._closed:
                return
            self._flush_small()
            size = self._file.size
        try:
            self._file.wait_until(size)
        except OSError as error:
            raise self._disk_error(error) from None

    def finish(self) -> Seal:
        """Write what is in memory, the seal and the summary; fsync; give the file its name.

        Raises:
            RecorderError: the disk refuses, or the name was taken meanwhile; the `.part` file stays and `acquire recover` reads it.
        """
        with self._lock:
            self._open()
            self._closed = True
        self._join()
        self._file.release_reserve()
        try:
            self._flush_small()
            content_id = self._hash.hexdigest()
            self._metadata(SEAL_NAME, {"content_id": content_id, **self._manifest_hash})
            self._put([self._summary.pack(self._file.size)])
        except BaseException:
            self._file.abort()
            raise
        try:
            self._file.finish()
        except OSError as error:
            raise self._disk_error(error) from None
        atomic.publish(self.part_path, self.path)
        return Seal(self.path, content_id, self._summary.message_counts.total(), self._file.size)

    def abort(self) -> None:
        """Stop writing; the `.part` file stays as it is."""
        with self._lock:
            closed, self._closed = self._closed, True
        if not closed:
            self._join()
            self._file.abort()

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
        offset = self._file.size
        length = self._put([container.record(container.METADATA, container.string(name) + container.string_map(entries))])
        self._summary.add_metadata(offset, length, name)

    def _flush_small(self) -> None:
        # Without room they stay in memory; a recording that ends has the time to wait for the disk.
        if self._small and (self._closed or self._file.has_room(len(self._small) + SMALL_CHUNK_BYTES, image=False)):
            self._chunk([self._small], len(self._small), zlib.crc32(self._small), self._small_index)
            self._small, self._small_index = bytearray(), {}

    def _chunk(self, buffers: list[Buffer], size: int, crc: int, index: dict[int, list[tuple[int, int]]], *, image: bool = False) -> None:
        packed = pack_chunk(self._file.size, size, crc, index)
        self._put([packed.head + buffers[0], *buffers[1:], packed.indexes], image=image)
        self._summary.chunks.append(packed.entry)
        for number, entries in index.items():
            self._summary.message_counts[number] += len(entries)

    def _put(self, buffers: Sequence[Buffer] | LentRun, *, image: bool = False) -> int:
        try:
            length = self._file.append_lent(buffers) if isinstance(buffers, LentRun) else self._file.append(buffers, image=image)
        except OSError as error:
            # From here on no more images; the space held back is for small topics, the seal and the summary.
            self._full = self._disk_error(error)
            self._file.release_reserve()
            raise self._full from None
        if self._file.size - self._pushed >= self._sync_bytes:
            self._pushed = self._file.size
            self._wake.set()
        return length

    def _disk_error(self, error: OSError) -> RecorderError:
        return RecorderError(f"{self.part_path}: cannot be written: {error.strerror}: free space on this disk, finish, and start a new one")

    # --- helper thread ---

    def _keep(self) -> None:
        """Flush small topics ten times a second, and have bytes pushed to the disk."""
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
            self._file.sync()

    def _join(self) -> None:
        self._wake.set()
        self._keeper.join()
