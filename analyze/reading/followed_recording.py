"""Follows a recording that is being written: reads whole records as they arrive, images as views."""

from __future__ import annotations

import mmap
import os
import struct
from pathlib import Path

from analyze.errors import RecordingError
from analyze.reading.compressed_video import SCHEMA as VIDEO
from analyze.reading.image_message import decode_image
from analyze.reading.indexed_file import RecordedMessage
from analyze.reading.not_a_recording import not_a_recording
from analyze.reading.recording_head import parse_plan, shape_attachment, whole_manifest
from analyze.types import ImageFrame
from schemas.input_file import open_descriptor
from schemas.mcap import records as container
from schemas.mcap.chunks import chunk_messages
from schemas.mcap.records import ContainerError
from schemas.mcap.walk import walk, whole_records
from schemas.session_manifest import MANIFEST_NAME, PLAN_ATTACHMENT, SessionManifest
from schemas.strike_plan import StrikePlan
from schemas.topics import TRUTH_PREFIX

PART_SUFFIX = ".part"


class FollowedRecording:
    """Reader of a recording (`.part` file) that another process is writing.

    The file need not exist yet, and may be finished and renamed meanwhile. Only whole records are read, since
    on a full disk the writer cuts off an unfinished one. Use it in a `with` statement.

    Args:
        path: the `.part` file, or a finished file.
    """

    def __init__(self, path: Path) -> None:
        self._follow(path)

    def _follow(self, path: Path) -> None:
        """Begin to follow the file at `path`; state of a file followed before is dropped."""
        self.path = path
        """path of the file"""
        self.manifest: SessionManifest | None = None
        """manifest (description of the session); None until `poll` has read it"""
        self.attachments: dict[str, bytes] = {}
        """contents of the attached files that `poll` has read, by name"""
        self.finished = False
        """True once the writer has ended the recording"""
        self._fd: int | None = None
        self._at = 0
        self._topics: dict[int, str] = {}
        self._schemas: dict[int, str] = {}
        self._schema_of: dict[str, str] = {}

    @property
    def plan(self) -> StrikePlan | None:
        """Strike plan attached to the recording; None if it has none, or until `poll` has read it.

        Raises:
            RecordingVersion: the plan is of another major schema version.
            RecordingError: the plan cannot be parsed.
        """
        data = self.attachments.get(PLAN_ATTACHMENT)
        return None if data is None else parse_plan(data.decode(errors="replace"), str(self.path))

    @property
    def shape_bytes(self) -> bytes | None:
        """Content of the object's shape file; None until `poll` has read it.

        It stays None for a primitive (box, cylinder), which has no shape file.
        """
        return shape_attachment(self.attachments)

    def poll(self) -> list[RecordedMessage]:
        """Read what was written since the last call; return the messages in the file's order.

        The call does not wait: the list is empty if nothing was written or the file does not exist yet.
        Ground truth of a simulation (topics under /truth/) is left out. Manifest, attachments and `finished`
        are updated.

        Raises:
            RecordingVersion: the recording is of another major schema version.
            RecordingError: the file is not a recording, cannot be read, or is damaged.
        """
        if self.finished or not self._open():
            return []
        whole = whole_records(self._read, self._at, os.fstat(self._file()).st_size)
        self.finished = whole.data_ended
        if whole.end == self._at:
            return []
        # A new mapping for each call: earlier ones live as long as their messages are in use.
        base = self._at - self._at % mmap.ALLOCATIONGRANULARITY
        data = memoryview(mmap.mmap(self._file(), whole.end - base, access=mmap.ACCESS_READ, offset=base))[
            self._at - base :
        ]
        self._at = whole.end
        found: list[RecordedMessage] = []
        try:
            for opcode, _, body in walk(data):
                self._read_record(opcode, body, found)
        except (ContainerError, struct.error) as error:
            raise RecordingError(f"{self.path}: damaged: {error}") from None
        return found

    def read_manifest(self) -> SessionManifest | None:
        """Read only the manifest (description of the session); `poll` still returns all messages.

        Returns:
            The manifest; None if the file does not exist, has not been written so far, or has no manifest
            before its first chunk.

        Raises:
            RecordingVersion: the recording is of another major schema version.
            RecordingError: the file is not a recording, cannot be read, or is damaged.
        """
        if not self._open():
            return None
        size = os.fstat(self._file()).st_size
        data = memoryview(mmap.mmap(self._file(), size, access=mmap.ACCESS_READ))
        for opcode, _, body in walk(data, self._at):
            if opcode in {container.CHUNK, container.DATA_END}:
                return None
            if opcode == container.METADATA:
                try:
                    metadata = container.parse_metadata(body)
                except (ContainerError, struct.error) as error:
                    raise RecordingError(f"{self.path}: damaged: {error}") from None
                if metadata.name == MANIFEST_NAME:
                    return whole_manifest(metadata.entries, str(self.path), {})
        return None

    def image(self, message: RecordedMessage) -> ImageFrame:
        """Decode the image in a message that `poll` returned.

        Returns:
            Grey values (height, width) uint8 with the message's log time [ns] and sequence number.

        Raises:
            RecordingError: the message holds no image that can be decoded, or is of an imported video.
        """
        if self._schema_of.get(message.topic) == VIDEO:
            raise RecordingError(
                f"{self.path}: is an imported video, which is complete and cannot be followed: use `analyze "
                "estimate` or `analyze replay`"
            )
        try:
            image = decode_image(self._schema_of.get(message.topic, ""), message.data)
        except ContainerError as error:
            raise RecordingError(
                f"{self.path}: image {message.sequence} at {message.log_time_ns}: {error}"
            ) from None
        return ImageFrame(message.log_time_ns, message.sequence, image)

    def refuse_missing(self) -> None:
        """Check that the followed file exists; to be called after `poll`.

        Raises:
            RecordingError: `poll` found no file at the path.
        """
        if self._fd is None and not self.finished:
            raise RecordingError(f"{self.path}: no such recording: check the path")

    def close(self) -> None:
        """Close the file; messages already returned stay valid."""
        if self._fd is not None:
            os.close(self._fd)
            self._fd = None

    def __enter__(self) -> FollowedRecording:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _open(self) -> bool:
        """Open the followed file, unless it is open, and check its first bytes.

        A `.part` file that was finished meanwhile is opened under its final name.

        Returns:
            True if the file is open; False while it does not exist or is shorter than the first bytes (magic)
            of an MCAP file.

        Raises:
            RecordingError: the file cannot be read, or does not begin like an MCAP file.
        """
        if self._fd is None:
            names = [self.path]
            if self.path.suffix == PART_SUFFIX:
                names.append(self.path.with_suffix(""))
            for name in names:
                try:
                    self._fd = open_descriptor(name)
                    break
                except FileNotFoundError:
                    continue
                except OSError as error:
                    unread = f"{name}: cannot be read: {error.strerror}"
                    raise RecordingError(not_a_recording(name) if name.is_dir() else unread) from None
            else:
                return False
        if self._at == 0:
            try:
                magic = os.pread(self._file(), len(container.MAGIC), 0)
            except OSError:
                raise RecordingError(not_a_recording(self.path)) from None
            if len(magic) < len(container.MAGIC):
                return False
            if magic != container.MAGIC:
                raise RecordingError(not_a_recording(self.path))
            self._at = len(magic)
        return True

    def _file(self) -> int:
        if self._fd is None:
            raise RecordingError(f"{self.path}: is not open")
        return self._fd

    def _read(self, size: int, offset: int) -> bytes:
        # Not through a mapping: reading behind an end that the writer has truncated would kill this process
        # (SIGBUS).
        return os.pread(self._file(), size, offset)

    def _read_record(self, opcode: int, body: memoryview, found: list[RecordedMessage]) -> None:
        """Enter the content of one record of the file in this object; append its messages to `found`.

        Ground truth of a simulation (topics under /truth/) is left out.

        Args:
            opcode: kind of the record in MCAP.
            body: content of the record.
            found: list of messages, which is extended.

        Raises:
            ContainerError: the record is damaged.
            RecordingError: the record is a manifest that cannot be parsed.
        """
        if opcode == container.CHUNK:
            chunk = container.parse_chunk(body)
            # The checksum is not verified: that would read every image, and bytes just written come from the
            # page cache anyway.
            messages = chunk_messages(chunk) if chunk.compression else chunk.records
            for kind, _, record in walk(messages):
                self._read_record(kind, record, found)
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
                self.manifest = whole_manifest(metadata.entries, str(self.path), {})
        elif opcode == container.ATTACHMENT:
            attachment = container.parse_attachment(body)
            self.attachments[attachment.name] = attachment.data
