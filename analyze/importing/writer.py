"""Writes an imported recording in the layout that `acquire` writes (schemas/README.md, "A file").

One thread assembles the records, another only hands them to the system: two threads that both run Python
would wait for each other. A file that is being written is called `<name>.part`; the rename is the last step,
and after an error nothing is left, except a finished `.part` file whose final name was taken meanwhile.
"""

from __future__ import annotations

import os
import queue
import threading
import zlib
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Final

import deflate

from analyze.importing.video_chunks import VideoChunk, prepare_chunk
from analyze.reading.followed_recording import PART_SUFFIX
from schemas.document import canonical_json, sha256_text
from schemas.mcap import records as container
from schemas.mcap.chunks import PendingMessages, pack_chunk_of_channel
from schemas.mcap.content_hash import LARGE_MESSAGE_BYTES, ContentHash
from schemas.mcap.record_writer import RecordWriter
from schemas.mcap.records import AttachmentRecord, Buffer
from schemas.output_file import OutputError, why_taken
from schemas.session_manifest import MANIFEST_NAME, SEAL_NAME, SessionManifest, manifest_entries
from schemas.topics import Topic

_QUEUED_WRITES: Final = 3
"""largest number of writes that wait for the writing thread"""
_SMALL_CHUNK_BYTES: Final = 64 << 10
_MAX_BUFFERS: Final = 1024
"""largest number of buffers of one writev on Linux (IOV_MAX)"""


def refuse_taken(path: Path, *, replace: bool = False) -> None:
    """Check that no recording exists at a path, neither finished nor unfinished (its `.part` file).

    It is also called before a long video is read. A folder at this path is not refused.

    Args:
        path: path of the recording to write.
        replace: True if a finished recording there is to be replaced.

    Raises:
        OutputError: a recording, finished or begun, has this path.
    """
    if not path.is_dir() and (reason := why_taken(path, force=replace)) is not None:
        raise OutputError(reason)
    part = _part_path(path)
    if part.exists():
        raise _part_taken(part)


class RecordingWriter:
    """Writer of a recording in the MCAP format.

    Call `write_head`, `add_topics`, the other `write_` methods, and `finish`, in this order. Use it in a
    `with` statement: leaving it without `finish` deletes the file.

    Args:
        path: path of the finished recording.
        replace: True if an existing recording there is to be replaced, once this one is finished.

    Raises:
        OutputError: the file exists already, or cannot be written.
    """

    def __init__(self, path: Path, *, replace: bool = False) -> None:
        self.path, self._replace = path, replace
        self._part = _part_path(path)
        refuse_taken(path, replace=replace)
        try:
            self._fd = os.open(self._part, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o644)
        except FileExistsError:
            raise _part_taken(self._part) from None
        except OSError as error:
            raise self._disk_error(error) from None
        self._records = RecordWriter(self._append)
        self._hash = ContentHash()
        self._channels: dict[str, int] = {}
        self._pending = PendingMessages()
        self._manifest_sha256 = ""
        self._queue: queue.Queue[Sequence[Buffer] | None] = queue.Queue(_QUEUED_WRITES)
        self._failure: OSError | None = None
        self._thread = threading.Thread(target=self._write_queued, name="import-writer", daemon=True)
        self._thread.start()
        self._records.begin()

    @property
    def size(self) -> int:
        """Size of the recording so far [bytes], written or queued.

        Messages of `write_small` that are still being gathered are missing.
        """
        return self._records.size

    def write_head(self, manifest: SessionManifest, attachments: Sequence[tuple[str, str, bytes]]) -> None:
        """Write the manifest and the attached files; call it before anything else.

        Args:
            manifest: description of the session.
            attachments: name, media type and content of each file.

        Raises:
            OutputError: the file cannot be written.
        """
        text = canonical_json(manifest)
        self._manifest_sha256 = sha256_text(text)
        self._records.write_metadata(MANIFEST_NAME, manifest_entries(text))
        for name, media_type, data in attachments:
            self._records.write_attachment(AttachmentRecord(name, media_type, 0, data))

    def add_topics(self, *topics: Topic) -> None:
        """Declare the recording's topics, after the head and before messages.

        Raises:
            OutputError: the file cannot be written.
        """
        for topic in topics:
            number = len(self._channels) + 1
            self._records.add_topic(topic, number)
            self._channels[topic.name] = number

    def channel_id(self, topic: Topic) -> int:
        """Number of a declared topic's channel in the file.

        Raises:
            KeyError: the topic was not declared.
        """
        return self._channels[topic.name]

    def write_image(self, topic: Topic, log_time_ns: int, sequence: int, parts: Sequence[Buffer]) -> None:
        """Write a message of an image topic as one chunk.

        Args:
            topic: the image topic.
            log_time_ns: log time [ns].
            sequence: sequence number.
            parts: message in parts, which are written later, by another thread, and must stay unchanged.

        Raises:
            OutputError: an earlier chunk could not be written.
        """
        channel_id, size = self._channels[topic.name], sum(map(len, parts))
        head = container.message_head(channel_id, sequence, log_time_ns, log_time_ns, size)
        crc, data_crc = zlib.crc32(head), 0
        for part in parts:
            crc, data_crc = deflate.crc32(part, crc), deflate.crc32(part, data_crc)
        data = b"" if size >= LARGE_MESSAGE_BYTES else b"".join(parts)
        self._hash.add_all(topic.name, [(log_time_ns, size, data, data_crc)])
        self._records.write_chunk([head, *parts], len(head) + size, crc, {channel_id: [(log_time_ns, 0)]})

    def write_video(self, topic: Topic, chunk: VideoChunk) -> None:
        """Write coded pictures as one chunk.

        Args:
            topic: the image topic.
            chunk: the pictures; their records are written later, by another thread, and must stay unchanged.

        Raises:
            OutputError: an earlier chunk could not be written.
        """
        channel_id, times, ready = self._channels[topic.name], chunk.messages.times_ns, prepare_chunk(chunk)
        self._hash.add_all(topic.name, ready.hashed)
        span = int(times.min()), int(times.max())
        packed = pack_chunk_of_channel(self.size, span, ready.size, channel_id, ready.index_entries)
        self._records.write_packed_chunk(packed, ready.buffers, channel_id, len(times))

    def write_small(self, topic: Topic, log_time_ns: int, data: bytes, sequence: int = 0) -> None:
        """Add one small message; it is gathered with others to a chunk of 64 KiB.

        Args:
            topic: topic of the message.
            log_time_ns: log time [ns].
            data: the encoded message.
            sequence: sequence number.

        Raises:
            OutputError: an earlier chunk could not be written.
        """
        self._hash.add(topic.name, log_time_ns, len(data), data)
        self._pending.add(self._channels[topic.name], sequence, log_time_ns, log_time_ns, data)
        if len(self._pending.data) >= _SMALL_CHUNK_BYTES:
            self._flush_small()

    def finish(self) -> str:
        """Write what is left of the recording, and give the file its final name.

        Written are pending messages, the seal (record with the checksums) and the summary.

        Returns:
            Content id, which is the hash of the messages, in hexadecimal digits.

        Raises:
            OutputError: the file cannot be written, or the name was taken meanwhile.
        """
        self._flush_small()
        content_id = self._hash.hexdigest()
        seal = {"content_id": content_id, "manifest_sha256": self._manifest_sha256}
        self._records.write_metadata(SEAL_NAME, seal)
        self._records.end()
        self._join()
        self._raise_failure()
        try:
            # No fsync, which may take a minute for a gigabyte: after a power cut the video can be imported
            # again.
            os.close(self._fd)
            self._fd = -1
            if self.path.exists() and not self._replace:
                raise OutputError(
                    f"{self.path}: was created meanwhile: the finished recording is {self._part}"
                )
            self._part.replace(self.path)
        except OSError as error:
            raise self._disk_error(error) from None
        return content_id

    def __enter__(self) -> RecordingWriter:
        return self

    def __exit__(self, *_: object) -> None:
        """End the writing thread, and remove the `.part` file unless the recording was finished."""
        self._join()
        if self._fd >= 0:
            os.close(self._fd)
            with suppress(OSError):
                self._part.unlink()

    # --- the file

    def _flush_small(self) -> None:
        if self._pending.data:
            self._records.write_pending(self._pending)
            self._pending = PendingMessages()

    def _append(self, buffers: Sequence[Buffer]) -> None:
        """Queue buffers for the writing thread; wait as long as `_QUEUED_WRITES` writes are queued already.

        Raises:
            OutputError: an earlier write failed.
        """
        self._raise_failure()
        self._queue.put(buffers)

    def _write_queued(self) -> None:
        """Write queued buffers to the file until None is queued (body of the writing thread).

        The first error is kept in `_failure`; nothing is written after it.
        """
        while (buffers := self._queue.get()) is not None:
            try:
                if self._failure is None:
                    self._write(buffers)
            except OSError as error:
                self._failure = error

    def _write(self, buffers: Sequence[Buffer]) -> None:
        for first in range(0, len(buffers), _MAX_BUFFERS):
            left = [memoryview(buffer) for buffer in buffers[first : first + _MAX_BUFFERS]]
            while left:
                written = os.writev(self._fd, left)
                while left and written >= len(left[0]):
                    written -= len(left.pop(0))
                if written:
                    left[0] = left[0][written:]

    def _join(self) -> None:
        """End the writing thread once it has written all queued buffers."""
        if self._thread.is_alive():
            self._queue.put(None)
            self._thread.join()

    def _raise_failure(self) -> None:
        if self._failure is not None:
            raise self._disk_error(self._failure)

    def _disk_error(self, error: OSError) -> OutputError:
        return OutputError(f"{self.path}: cannot be written: {error.strerror}: choose another place")


def _part_path(path: Path) -> Path:
    return path.with_name(path.name + PART_SUFFIX)


def _part_taken(part: Path) -> OutputError:
    return OutputError(
        f"{part}: is being written, or remains of an import that failed: choose another name or move it away"
    )
