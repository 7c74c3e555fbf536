"""Follows a recording while it grows: whole records as they arrive, images as views that cost nothing until they are looked at."""

from __future__ import annotations

import mmap
import os
import struct
from pathlib import Path
from types import TracebackType

from analyze.errors import RecordingError
from analyze.reading.compressed_video import SCHEMA as VIDEO
from analyze.reading.image_message import decode_image
from analyze.reading.indexed_file import RecordedMessage
from analyze.reading.recording_head import parse_manifest, parse_plan
from analyze.types import ImageFrame
from schemas.mcap import records as container
from schemas.mcap.records import ContainerError
from schemas.session_manifest import MANIFEST_NAME, PLAN_ATTACHMENT, SHAPE_ATTACHMENT_PREFIX, SessionManifest
from schemas.strike_plan import StrikePlan
from schemas.topics import TRUTH_PREFIX

PART_SUFFIX = ".part"
_HEAD_BYTES = 1 << 24
"""a manifest is far smaller"""


class FollowedRecording:
    """A `.part` file that somebody is writing. It need not exist yet, and may be finished and renamed meanwhile.

    Only whole records are looked at; a writer takes back nothing but its last, unfinished one.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.manifest: SessionManifest | None = None
        """None until it was written"""
        self.attachments: dict[str, bytes] = {}
        self.finished = False
        """the writer ended the recording"""
        self._fd: int | None = None
        self._at = 0
        self._topics: dict[int, str] = {}
        self._schemas: dict[int, str] = {}
        self._schema_of: dict[str, str] = {}

    @property
    def plan(self) -> StrikePlan | None:
        """None until it was written.

        Raises:
            RecordingError: it cannot be read.
        """
        data = self.attachments.get(PLAN_ATTACHMENT)
        return None if data is None else parse_plan(data.decode(errors="replace"), str(self.path))

    @property
    def shape_bytes(self) -> bytes | None:
        """The object's shape file, None for a primitive and before it was written."""
        return next((data for name, data in self.attachments.items() if name.startswith(SHAPE_ATTACHMENT_PREFIX)), None)

    def poll(self) -> list[RecordedMessage]:
        """Messages that were written since the last call, in the file's order; never truth. Does not wait.

        Raises:
            RecordingVersion: the recording is of another major schema version.
            RecordingError: what is there is not a recording, or damaged.
        """
        if self.finished or not self._open():
            return []
        end = self._whole_until(os.fstat(self._file()).st_size)
        if end == self._at:
            return []
        # A new mapping for each call: older ones live as long as somebody looks at their messages.
        base = self._at - self._at % mmap.ALLOCATIONGRANULARITY
        data = memoryview(mmap.mmap(self._file(), end - base, access=mmap.ACCESS_READ, offset=base))[self._at - base :]
        self._at = end
        found: list[RecordedMessage] = []
        try:
            for opcode, _, body in container.walk(data):
                self._take(opcode, body, found)
        except (ContainerError, struct.error) as error:
            raise RecordingError(f"{self.path}: damaged: {error}") from None
        return found

    def peek(self) -> SessionManifest | None:
        """The manifest, None where it is not there yet; nothing else is read, and nothing is remembered.

        Raises:
            RecordingError: what is there is not a recording, or damaged.
        """
        if not self._open():
            return None
        size = os.fstat(self._file()).st_size
        with mmap.mmap(self._file(), size, access=mmap.ACCESS_READ) as data:
            at = self._at
            while at + container.RECORD_HEAD <= size:
                opcode, length = struct.unpack_from("<BQ", data, at)
                body = data[at + container.RECORD_HEAD : at + container.RECORD_HEAD + min(length, _HEAD_BYTES)]
                if len(body) < length or opcode in {0, container.CHUNK, container.DATA_END}:
                    return None
                if opcode == container.METADATA:
                    try:
                        metadata = container.parse_metadata(memoryview(body))
                    except (ContainerError, struct.error) as error:
                        raise RecordingError(f"{self.path}: damaged: {error}") from None
                    if metadata.name == MANIFEST_NAME:
                        return parse_manifest(metadata.entries.get("json", ""), str(self.path))
                at += container.RECORD_HEAD + length
        return None

    def image(self, message: RecordedMessage) -> ImageFrame:
        """The image in a message of an image topic.

        Raises:
            RecordingError: it holds none.
        """
        if self._schema_of.get(message.topic) == VIDEO:
            raise RecordingError(
                f"{self.path}: holds a film as it was coded (`analyze import`), which nobody writes any more: use `analyze estimate` or "
                "`analyze replay`"
            )
        try:
            image = decode_image(self._schema_of.get(message.topic, ""), message.data)
        except ContainerError as error:
            raise RecordingError(f"{self.path}: image {message.sequence} at {message.log_time_ns}: {error}") from None
        return ImageFrame(message.log_time_ns, message.sequence, image)

    def refuse_missing(self) -> None:
        """Raise RecordingError if the file has not appeared."""
        if self._fd is None and not self.finished:
            raise RecordingError(f"{self.path}: no such recording: check the path")

    def close(self) -> None:
        """Let go of the file; messages already given out stay valid."""
        if self._fd is not None:
            os.close(self._fd)
            self._fd = None

    def __enter__(self) -> FollowedRecording:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()

    def _open(self) -> bool:
        """Open the file once it is there and has its magic, under its present or its final name."""
        if self._fd is None:
            names = [self.path]
            if self.path.suffix == PART_SUFFIX:
                names.append(self.path.with_suffix(""))
            for name in names:
                try:
                    self._fd = os.open(name, os.O_RDONLY | os.O_CLOEXEC)
                    break
                except FileNotFoundError:
                    continue
                except OSError as error:
                    raise RecordingError(f"{name}: cannot be read: {error.strerror}") from None
            else:
                return False
        if self._at == 0:
            try:
                magic = os.pread(self._file(), len(container.MAGIC), 0)
            except OSError as error:
                raise RecordingError(f"{self.path}: cannot be read: {error.strerror}") from None
            if len(magic) < len(container.MAGIC):
                return False
            if magic != container.MAGIC:
                raise RecordingError(f"{self.path}: is not a recording: it does not begin like an MCAP file")
            self._at = len(magic)
        return True

    def _file(self) -> int:
        if self._fd is None:
            raise RecordingError(f"{self.path}: is not open")
        return self._fd

    def _whole_until(self, size: int) -> int:
        """Where the last whole record ends."""
        at = self._at
        while at + container.RECORD_HEAD <= size:
            head = os.pread(self._file(), container.RECORD_HEAD, at)
            if len(head) < container.RECORD_HEAD:
                break
            opcode, length = struct.unpack("<BQ", head)
            if opcode == 0 or length > size - at - container.RECORD_HEAD:
                break
            at += container.RECORD_HEAD + length
            if opcode == container.DATA_END:
                self.finished = True
                break
        return at

    def _take(self, opcode: int, body: memoryview, found: list[RecordedMessage]) -> None:
        if opcode == container.CHUNK:
            chunk = container.parse_chunk(body)
            # The checksum would read every image; what was written a moment ago comes from memory anyway.
            messages = container.chunk_messages(chunk) if chunk.compression else chunk.records
            for kind, _, record in container.walk(messages):
                self._take(kind, record, found)
        elif opcode == container.MESSAGE:
            message = container.parse_message(body)
            topic = self._topics.get(message.channel_id)
            if topic is not None and not topic.startswith(TRUTH_PREFIX):
                found.append(RecordedMessage(topic, message.log_time_ns, message.sequence, message.data))
        elif opcode == container.SCHEMA:
            schema = container.parse_schema(body)
            self._schemas[schema.id] = schema.name
        elif opcode == container.CHANNEL:
            channel = container.parse_channel(body)
            self._topics[channel.id] = channel.topic
            self._schema_of[channel.topic] = self._schemas.get(channel.schema_id, "")
        elif opcode == container.METADATA:
            metadata = container.parse_metadata(body)
            if metadata.name == MANIFEST_NAME:
                self.manifest = parse_manifest(metadata.entries.get("json", ""), str(self.path))
        elif opcode == container.ATTACHMENT:
            attachment = container.parse_attachment(body)
            self.attachments[attachment.name] = attachment.data
