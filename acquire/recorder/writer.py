"""Writer of one recording file: images in MCAP chunks of their own, messages of small topics in others.

Small topics are all topics but the images. While the file is written it is called `<name>.part`; it is
renamed when it is complete. However the process ends, `acquire recover` reads everything that reached the
file. The memory holds at most 0.5 s of small topics, and with a DirectFile 0.2 s of images while the disk
keeps up.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final

from acquire.errors import RecorderError
from acquire.recorder import atomic
from acquire.recorder.channel import Channel
from acquire.recorder.checksum import checksums
from acquire.recorder.direct.block_memory import BlockMemory
from acquire.recorder.direct.borrowed_chunks import pack_borrowed
from acquire.recorder.direct.direct_file import DirectFile
from acquire.recorder.messages import BorrowedImage, DiskBehind, ImageMessage, SmallMessage
from acquire.recorder.paged.page_cache_file import PageCacheFile
from acquire.recorder.recording_file import RecordingFile
from acquire.recorder.seal import Seal
from schemas.document import sha256_text
from schemas.mcap import records as container
from schemas.mcap.chunks import PendingMessages
from schemas.mcap.content_hash import LARGE_MESSAGE_BYTES, ContentHash, HashedMessage
from schemas.mcap.record_writer import RecordWriter
from schemas.mcap.records import AttachmentRecord, Buffer
from schemas.session_manifest import MANIFEST_NAME, SEAL_NAME
from schemas.topics import Topic

PART_SUFFIX: Final = ".part"
SMALL_CHUNK_BYTES: Final = 64 << 10
SMALL_PART_BYTES: Final = 512
"""size below which an image's first part is joined to the message head [bytes]"""
CHUNK_EXTRA: Final = 128
"""upper bound of a chunk's overhead, and of a message's entry in the index [bytes]"""
FLUSH_S: Final = 0.1
"""interval between flushes of small topics [s]

A frame's meta waits up to 0.25 s for a trigger before it is written here, and a DirectFile up to 0.1 s for
more bytes: together below 0.5 s.
"""
SYNC_BYTES: Final = 32 << 20
MOST_SMALL_BYTES: Final = 2 << 20
"""bytes of small topics that may wait in memory on a full disk until the recording is finished"""


class McapWriter:
    """Writer of one recording file; every method may be called from any thread.

    When the disk fills up, an image that does not fit is refused with a RecorderError, small messages wait in
    memory up to MOST_SMALL_BYTES, and `finish` still completes the file.

    Raises:
        RecorderError: the path is taken, its folder is missing, the disk refuses, or the recording is
            finished.
    """

    def __init__(
        self,
        path: Path,
        memory: BlockMemory | None = None,
        flush_s: float = FLUSH_S,
        sync_bytes: int = SYNC_BYTES,
    ) -> None:
        """Create `<path>.part`, write the file's head, and start the flushing thread.

        Args:
            path: final path; the file gets that name when it is complete.
            memory: blocks for direct I/O, if the disk allows that (`can_write_directly`); None: write through
                the page cache.
            flush_s: interval at which messages of small topics are handed to the file [s].
            sync_bytes: bytes after which the written data are forced to the disk (fdatasync).
        """
        self.path = path
        self.part_path = path.with_name(path.name + PART_SUFFIX)
        atomic.refuse_taken(path)
        self._file: RecordingFile = (
            PageCacheFile(self.part_path, sync_bytes)
            if memory is None
            else DirectFile(self.part_path, memory, sync_bytes)
        )
        self._flush_s = flush_s
        self._sync_bytes = sync_bytes
        self._pushed = 0
        self._lock = threading.Lock()
        self._records = RecordWriter(self._append_buffers)
        self._hash = ContentHash()
        self._manifest_hash: dict[str, str] = {}
        self._channels: dict[str, Channel] = {}
        self._pending = PendingMessages()
        self._closed = False
        self._full: RecorderError | None = None
        self._wake = threading.Event()
        self._records.begin()
        self._flusher = threading.Thread(target=self._flush_regularly, name="recorder-sync", daemon=True)
        self._flusher.start()

    @property
    def size(self) -> int:
        """Number of bytes appended to the file so far."""
        return self._file.size

    @property
    def never_waits(self) -> bool:
        """True if `write_images` and `write_borrowed` return without waiting for the disk."""
        return self._file.never_waits

    def metadata(self, name: str, entries: dict[str, str]) -> None:
        """Write a metadata record of named strings.

        If `name` is that of the manifest (description of the session), the hash of its entry "json" becomes
        part of the seal (record at the end of the file).

        Raises:
            RecorderError: the recording is finished, or the disk refuses.
        """
        with self._lock:
            self._open()
            self._metadata(name, entries)
            if name == MANIFEST_NAME and "json" in entries:
                self._manifest_hash = {"manifest_sha256": sha256_text(entries["json"])}

    def attachment(self, name: str, media_type: str, data: bytes, log_time_ns: int = 0) -> None:
        """Attach a file's content to the recording.

        Args:
            name: name of the file.
            media_type: for example application/json.
            data: content of the file.
            log_time_ns: log time of the attachment [ns].

        Raises:
            RecorderError: the recording is finished, or the disk refuses.
        """
        with self._lock:
            self._open()
            self._flush_small()
            self._records.write_attachment(AttachmentRecord(name, media_type, log_time_ns, data))

    def add_topic(self, topic: Topic) -> Channel:
        """Declare a topic and return its handle (number and topic), with which messages are written.

        The same topic again gives the same handle.

        Raises:
            RecorderError: the name is taken by a topic of another message type, the recording is finished, or
                the disk refuses.
        """
        with self._lock:
            self._open()
            known = self._channels.get(topic.name)
            if known is not None:
                if known.topic.schema_name != topic.schema_name:
                    held, given = known.topic.schema_name, topic.schema_name
                    raise RecorderError(f"{self.path}: topic {topic.name} holds {held}, not {given}")
                return known
            number = len(self._channels) + 1
            self._flush_small()
            self._records.add_topic(topic, number)
            self._channels[topic.name] = Channel(number, topic)
            return self._channels[topic.name]

    def write_small(self, channel: Channel, messages: Sequence[SmallMessage]) -> None:
        """Write messages of a small topic (any topic but the images).

        The messages gather in memory until they have SMALL_CHUNK_BYTES, or until the next `flush`.

        Raises:
            RecorderError: the disk is full or failing, the recording is finished, or a log time is not
                positive (a clock that was never set).
        """
        for message in messages:
            self._refuse_unset_time(channel, message.log_time_ns)
        if not messages:  # an empty entry in the index has no times for its chunk
            return
        with self._lock:
            self._open()
            if self._full is not None and len(self._pending.data) > MOST_SMALL_BYTES:
                raise self._full
            for time_ns, data, sequence in messages:
                self._pending.add(channel.id, sequence, time_ns, time_ns, data)
            hashed = [(message.log_time_ns, len(message.data), message.data, None) for message in messages]
            self._hash.add_all(channel.topic.name, hashed)
            if len(self._pending.data) >= SMALL_CHUNK_BYTES:
                self._flush_small()

    def write_images(self, channel: Channel, messages: Sequence[ImageMessage]) -> None:
        """Write images as one MCAP chunk, all or none; does nothing for an empty sequence.

        On return the images are in the page cache or, with direct I/O, copied and soon on the disk.

        Raises:
            DiskBehind: there is no memory for the images now; only if `never_waits`.
            RecorderError: the disk is full or failing, the recording is finished, or a log time is not
                positive (a clock that was never set).
        """
        buffers: list[Buffer] = []
        places: list[tuple[int, int]] = []
        hashed: list[HashedMessage] = []
        at = crc = 0
        # The checksums are taken outside the lock: small topics do not wait for those of a whole batch.
        for message in messages:
            time_ns = message.log_time_ns
            self._refuse_unset_time(channel, time_ns)
            size = sum(map(len, message.parts))
            head = container.message_head(channel.id, message.sequence, time_ns, time_ns, size)
            sums = checksums(crc, head, message.parts)
            crc = sums.chunk
            places.append((time_ns, at))
            data = b"" if size >= LARGE_MESSAGE_BYTES else b"".join(message.parts)
            hashed.append((time_ns, size, data, sums.data))
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
            if not self._file.has_room(at + CHUNK_EXTRA * (1 + len(places)), image=True):
                raise self._disk_behind(at)
            self._records.write_chunk(buffers, at, crc, {channel.id: places}, append=self._append_images)
            self._hash.add_all(channel.topic.name, hashed)

    def write_borrowed(self, channel: Channel, images: Sequence[BorrowedImage]) -> None:
        """Write at least one image directly from camera buffers, in an MCAP chunk each, all or none.

        Each buffer is released when its image is on the disk, or when the disk failed.

        Raises:
            DiskBehind: there is no room for the images now; only if `never_waits`.
            RecorderError: the disk is full or failing, the recording is finished, or a log time is not
                positive. In each case no buffer is released.
        """
        for image in images:
            self._refuse_unset_time(channel, image.log_time_ns)
        with self._lock:
            self._open()
            if self._full is not None:
                raise self._full
            chunks = pack_borrowed(self._records.size, channel.id, images)
            run = chunks.run
            if not self._file.has_room(run.own_bytes, image=True, borrowed=run.borrowed_bytes):
                raise self._disk_behind(chunks.size)
            self._append(lambda: self._file.append_borrowed(run))
            self._records.note_chunks(chunks.size, chunks.entries, channel.id, len(images))
            self._hash.add_all(channel.topic.name, chunks.hashed)

    def flush(self) -> None:
        """Hand small messages that wait in memory to the file.

        Small messages are those of all topics but the images. On return other programs can read all that the
        file accepted. Messages for which there is no room now stay in memory. After `finish` or `abort` the
        call does nothing.

        Raises:
            RecorderError: the disk refused some of the messages.
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
        """Complete the file: write the waiting messages, the seal and the summary, fsync, rename.

        The seal is the metadata record with the content id (hash of all messages outside /truth/).

        Returns:
            Final path, content id, number of messages and size [bytes].

        Raises:
            RecorderError: the recording is finished, the disk refuses, or the name was taken meanwhile. In
                the last two cases the `.part` file stays, and `acquire recover` reads it.
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
            self._records.end()
        except BaseException:
            self._file.abort()
            raise
        try:
            self._file.finish()
        except OSError as error:
            raise self._disk_error(error) from None
        atomic.publish(self.part_path, self.path)
        return Seal(self.path, content_id, self._records.summary.message_counts.total(), self._file.size)

    def abort(self) -> None:
        """Stop writing and leave the unfinished `.part` file; does nothing after `finish` or `abort`."""
        with self._lock:
            closed, self._closed = self._closed, True
        if not closed:
            self._join()
            self._file.abort()

    def _refuse_unset_time(self, channel: Channel, log_time_ns: int) -> None:
        if log_time_ns <= 0:
            raise RecorderError(
                f"{self.path}: {channel.topic.name} has log time {log_time_ns}: give wall anchor + host time"
            )

    # --- under the lock ---

    def _open(self) -> None:
        if self._closed:
            raise RecorderError(f"{self.path}: this recording is finished; open a new one")

    def _metadata(self, name: str, entries: dict[str, str]) -> None:
        self._flush_small()
        self._records.write_metadata(name, entries)

    def _flush_small(self) -> None:
        # Without room they stay in memory; a recording that ends has the time to wait for the disk.
        size = len(self._pending.data)
        if size and (self._closed or self._file.has_room(size + SMALL_CHUNK_BYTES, image=False)):
            self._records.write_pending(self._pending)
            self._pending = PendingMessages()

    def _append_images(self, buffers: Sequence[Buffer]) -> None:
        self._append(lambda: self._file.append(buffers, image=True))

    def _append_buffers(self, buffers: Sequence[Buffer]) -> None:
        self._append(lambda: self._file.append(buffers))

    def _append(self, append: Callable[[], int]) -> None:
        """Append to the file; if the disk refuses, take no more images from then on.

        Args:
            append: function that appends to the file and raises OSError if the disk refuses.

        Raises:
            RecorderError: the disk refused.
        """
        try:
            append()
        except OSError as error:
            # From here on no more images: the reserved space is for small topics, the seal and the summary.
            self._full = self._disk_error(error)
            self._file.release_reserve()
            raise self._full from None
        if self._file.size - self._pushed >= self._sync_bytes:
            self._pushed = self._file.size
            self._wake.set()

    def _disk_error(self, error: OSError) -> RecorderError:
        return RecorderError(
            f"{self.part_path}: cannot be written: {error.strerror}: "
            "free space on this disk, finish, and start a new one"
        )

    def _disk_behind(self, size: int) -> DiskBehind:
        return DiskBehind(f"{self.part_path}: the disk is too slow: {size} bytes more have no room in memory")

    # --- helper thread ---

    def _flush_regularly(self) -> None:
        """Every `flush_s` hand messages other than images to the file and make the disk write, to its end."""
        while True:
            self._wake.wait(self._flush_s)
            with self._lock:
                if self._closed:
                    return
                self._wake.clear()
                try:
                    self._flush_small()
                except RecorderError:  # the next call of write or finish raises it again
                    continue
            self._file.sync()

    def _join(self) -> None:
        self._wake.set()
        self._flusher.join()
