"""Writes an imported recording as `acquire` writes one (schemas/README.md, "A file").

One thread puts it together, another only gives it to the system: two that both run Python would wait for each other.
While it is written the file is called `<name>.part`; the rename is the last step, and what failed leaves nothing.
"""

from __future__ import annotations

import os
import queue
import struct
import threading
import zlib
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Final, NamedTuple

import deflate

from analyze.errors import OutputError
from analyze.importing.video_chunks import VideoChunk, checked
from schemas.document import canonical_json, sha256_text
from schemas.mcap import records as container
from schemas.mcap.records import Buffer, ContentHash
from schemas.mcap.summary import Summary, pack_chunk, pack_chunk_of_channel, pack_topic
from schemas.session_manifest import MANIFEST_NAME, SEAL_NAME, SessionManifest
from schemas.topics import Topic

_WAITING: Final = 3
"""writes between the two threads"""
_SMALL_CHUNK_BYTES: Final = 64 << 10
_BUFFERS: Final = 1024
"""that writev takes at once on Linux"""
PART_SUFFIX: Final = ".part"


class Message(NamedTuple):
    """One message, its data in parts."""

    log_time_ns: int
    sequence: int
    parts: Sequence[Buffer]


@dataclass
class _Small:
    """Messages of small topics that wait for their chunk."""

    data: bytearray = field(default_factory=bytearray)
    index: dict[int, list[tuple[int, int]]] = field(default_factory=dict[int, list[tuple[int, int]]])


def refuse_taken(path: Path) -> None:
    """Nothing is written over: said before a long film is looked through, too.

    Raises:
        OutputError: a recording, or one that was begun, is there.
    """
    part = path.with_name(path.name + PART_SUFFIX)
    if path.exists() and not path.is_dir():
        raise OutputError(f"{path}: exists already: choose another name or move it away")
    if part.exists():
        raise OutputError(f"{part}: is being written, or was left by what did not finish: choose another name or move it away")


class RecordingWriter:
    """A recording being written. Use it in a `with` statement: after an error nothing is left.

    Raises:
        OutputError: the file is there already, or cannot be written.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._part = path.with_name(path.name + PART_SUFFIX)
        refuse_taken(path)
        try:
            self._fd = os.open(self._part, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o644)
        except FileExistsError:
            raise OutputError(
                f"{self._part}: is being written, or was left by what did not finish: choose another name or move it away"
            ) from None
        except OSError as error:
            raise OutputError(f"{path}: cannot be written: {error.strerror}: choose another place") from None
        self._summary, self._hash = Summary(), ContentHash()
        self._channels: dict[str, int] = {}
        self._small = _Small()
        self._size = 0
        self._manifest_sha256 = ""
        self.messages = 0
        self._queue: queue.Queue[Sequence[Buffer] | None] = queue.Queue(_WAITING)
        self._failed: OSError | None = None
        self._thread = threading.Thread(target=self._put_down, name="import-writer", daemon=True)
        self._thread.start()
        self._append([container.MAGIC, container.record(container.HEADER, container.string("") + container.string("percuss"))])

    @property
    def size(self) -> int:
        """Bytes written so far."""
        return self._size

    def head(self, manifest: SessionManifest, attachments: Sequence[tuple[str, str, bytes]]) -> None:
        """Manifest, and attachments as (name, media type, content). Before anything else."""
        text = canonical_json(manifest)
        self._manifest_sha256 = sha256_text(text)
        self._metadata(MANIFEST_NAME, {"json": text})
        for name, media_type, data in attachments:
            body = struct.pack("<QQ", 0, 0) + container.string(name) + container.string(media_type)
            body += struct.pack("<Q", len(data)) + data
            offset = self._size
            length = self._append([container.record(container.ATTACHMENT, body + struct.pack("<I", zlib.crc32(body)))])
            self._summary.add_attachment(offset, length, container.AttachmentRecord(name, media_type, 0, b""), len(data))

    def add_topics(self, *topics: Topic) -> None:
        """Make channels; after the head, before messages."""
        for topic in topics:
            number = len(self._channels) + 1
            schema, channel = pack_topic(topic, number)
            self._append([schema, channel])
            self._summary.schemas.append(schema)
            self._summary.channels.append(channel)
            self._channels[topic.name] = number

    def chunk(self, topic: Topic, messages: Sequence[Message]) -> None:
        """Messages of an image topic as one chunk. They are written soon; until then their parts must stay as they are.

        Raises:
            OutputError: the disk refused something that was given before.
        """
        if not messages:
            return
        channel = self._channels[topic.name]
        buffers: list[Buffer] = []
        index: list[tuple[int, int]] = []
        identity: list[tuple[int, int, Buffer, int]] = []
        at = crc = 0
        for time_ns, sequence, parts in messages:
            size = sum(map(len, parts))
            head = container.message_head(channel, sequence, time_ns, time_ns, size)
            crc = zlib.crc32(head, crc)
            own = 0
            for part in parts:
                crc, own = deflate.crc32(part, crc), deflate.crc32(part, own)
            identity.append((time_ns, size, b"" if size >= container.LARGE_MESSAGE else b"".join(parts), own))
            index.append((time_ns, at))
            buffers += (head, *parts)
            at += len(head) + size
        self._hash.add_all(topic.name, identity)
        self._frame_chunk(buffers, at, crc, {channel: index})

    def video(self, topic: Topic, chunk: VideoChunk) -> None:
        """Coded pictures as one chunk; as `chunk`."""
        channel, times, ready = self._channels[topic.name], chunk.messages.times_ns, checked(chunk)
        self._hash.add_all(topic.name, ready.identity)
        packed = pack_chunk_of_channel(self._size, (int(times.min()), int(times.max())), ready.size, channel, ready.entries)
        self._append([packed.head, *ready.buffers, packed.indexes])
        self._summary.chunks.append(packed.entry)
        self._summary.message_counts[channel] += len(times)
        self.messages += len(times)

    def channel(self, topic: Topic) -> int:
        """Its number in the file."""
        return self._channels[topic.name]

    def small(self, topic: Topic, log_time_ns: int, data: bytes, sequence: int = 0) -> None:
        """One message of a small topic.

        Raises:
            OutputError: as from `chunk`.
        """
        channel = self._channels[topic.name]
        self._hash.add(topic.name, log_time_ns, len(data), data)
        self._small.index.setdefault(channel, []).append((log_time_ns, len(self._small.data)))
        self._small.data += container.message_head(channel, sequence, log_time_ns, log_time_ns, len(data)) + data
        if len(self._small.data) >= _SMALL_CHUNK_BYTES:
            self._flush_small()

    def finish(self) -> str:
        """Write what waits, the seal and the summary; give the file its name. Its content id.

        Raises:
            OutputError: the disk refuses, or the name was taken meanwhile.
        """
        self._flush_small()
        content_id = self._hash.hexdigest()
        self._metadata(SEAL_NAME, {"content_id": content_id, "manifest_sha256": self._manifest_sha256})
        self._append([self._summary.pack(self._size)])
        self._join()
        self._refuse_failed()
        try:
            os.close(
                self._fd
            )  # no fsync, which may take a minute for a gigabyte: a power cut loses nothing that the film does not still hold
            self._fd = -1
            if self.path.exists():
                raise OutputError(f"{self.path}: was created by somebody else meanwhile: the recording is whole in {self._part}")
            self._part.rename(self.path)
        except OSError as error:
            raise self._refused(error) from None
        return content_id

    def __enter__(self) -> RecordingWriter:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        """Remove the file unless it was finished."""
        self._join()
        if self._fd >= 0:
            os.close(self._fd)
            with suppress(OSError):
                self._part.unlink()

    # --- the file -------------------------------------------------------------------------------------------------

    def _flush_small(self) -> None:
        if self._small.data:
            data = bytes(self._small.data)
            self._frame_chunk([data], len(data), zlib.crc32(data), self._small.index)
            self._small = _Small()

    def _frame_chunk(self, buffers: list[Buffer], size: int, crc: int, index: dict[int, list[tuple[int, int]]]) -> None:
        packed = pack_chunk(self._size, size, crc, index)
        self._append([packed.head, *buffers, packed.indexes])
        self._summary.chunks.append(packed.entry)
        for number, entries in index.items():
            self._summary.message_counts[number] += len(entries)
            self.messages += len(entries)

    def _metadata(self, name: str, entries: dict[str, str]) -> None:
        offset = self._size
        length = self._append([container.record(container.METADATA, container.string(name) + container.string_map(entries))])
        self._summary.add_metadata(offset, length, name)

    def _append(self, buffers: Sequence[Buffer]) -> int:
        self._refuse_failed()
        self._queue.put(buffers)
        total = sum(map(len, buffers))
        self._size += total
        return total

    def _put_down(self) -> None:
        """The other thread."""
        while (buffers := self._queue.get()) is not None:
            try:
                if self._failed is None:
                    self._write(buffers)
            except OSError as error:
                self._failed = error

    def _write(self, buffers: Sequence[Buffer]) -> None:
        for first in range(0, len(buffers), _BUFFERS):
            left = [memoryview(buffer) for buffer in buffers[first : first + _BUFFERS]]
            while left:
                taken = os.writev(self._fd, left)
                while left and taken >= len(left[0]):
                    taken -= len(left.pop(0))
                if taken:
                    left[0] = left[0][taken:]

    def _join(self) -> None:
        if self._thread.is_alive():
            self._queue.put(None)
            self._thread.join()

    def _refuse_failed(self) -> None:
        if self._failed is not None:
            raise self._refused(self._failed)

    def _refused(self, error: OSError) -> OutputError:
        return OutputError(f"{self.path}: cannot be written: {error.strerror}: choose another place")
