"""Reads a recording: manifest, plan, shape, images without copying, messages by topic and time. Truth has a door of its own.

A recording may be a row of files (file_row.py): any of them opens all.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from types import TracebackType
from typing import TypeVar

import numpy as np
from google.protobuf.message import DecodeError, Message

from analyze.errors import RecordingCut, RecordingError, RecordingForeign
from analyze.reading import compressed_video, indexed_file
from analyze.reading.file_series import FileRow, row_of, whole_name
from analyze.reading.followed_recording import FollowedRecording
from analyze.reading.image_message import decode_image
from analyze.reading.indexed_file import IndexedFile, RecordedMessage
from analyze.reading.indexed_series import IndexedRow, row_content_id
from analyze.reading.recording_head import parse_manifest, parse_plan
from analyze.reading.video_frame_meta import metas_of_video
from analyze.types import ImageFrame
from schemas import topics
from schemas.mcap.records import ContainerError
from schemas.object_spec import ObjectSpec
from schemas.proto import percuss_pb2 as pb
from schemas.session_manifest import MANIFEST_NAME, PLAN_ATTACHMENT, SEAL_NAME, SHAPE_ATTACHMENT_PREFIX, SessionManifest, TimeSource
from schemas.strike_plan import StrikePlan

__all__ = ["FollowedRecording", "RecordedMessage", "Recording", "TopicInfo", "Truth", "open_partial", "open_recording", "read_truth"]

M = TypeVar("M", bound=Message)


@dataclass(frozen=True)
class TopicInfo:
    """What a recording holds of a topic."""

    name: str
    schema: str
    count: int
    first_ns: int | None
    last_ns: int | None


@dataclass(frozen=True)
class FilePart:
    """One file of a recording."""

    path: Path
    content_id: str | None
    """None where the file is cut"""
    damaged_chunks: int


class Recording:
    """An open recording, one file or a row of them. Times are log times [ns]; ranges include both ends. Use it in a `with` statement.

    Args:
        path: the file that was asked for.
        row: the files, in their order.
        missing: numbers of the row's files that are not there.
    """

    def __init__(self, path: Path, row: IndexedRow, missing: tuple[int, ...] = ()) -> None:
        self._row = row
        self.path = path
        self.manifest: SessionManifest = next(iter([_checked_manifest(file) for file in row.files]))
        self.parts = tuple(FilePart(f.path, f.metadata.get(SEAL_NAME, {}).get("content_id"), f.damaged_chunks) for f in row.files)
        self.missing_parts = missing
        self.content_id: str | None = row_content_id([part.content_id for part in self.parts])
        """None where the recording is cut"""
        self.damaged_chunks = sum(part.damaged_chunks for part in self.parts)

    # --- head -----------------------------------------------------------------------------------------------------

    @property
    def attachments(self) -> dict[str, bytes]:
        """Attached files by name."""
        return {name: attachment.data for name, attachment in self._row.files[0].attachments.items()}

    @property
    def plan(self) -> StrikePlan:
        """The plan that was carried out.

        Raises:
            RecordingError: there is none.
        """
        return self._plan

    @cached_property
    def _plan(self) -> StrikePlan:
        attachment = self._row.files[0].attachments.get(PLAN_ATTACHMENT)
        if attachment is None:
            raise RecordingError(f"{self.path}: holds no {PLAN_ATTACHMENT}: record again with `acquire session`")
        return parse_plan(attachment.data.decode(errors="replace"), str(self.path))

    @property
    def object_spec(self) -> ObjectSpec:
        """The object as the user described it."""
        return self.manifest.object

    @property
    def shape_bytes(self) -> bytes | None:
        """The object's shape file, None for a primitive."""
        return next((data for name, data in self.attachments.items() if name.startswith(SHAPE_ATTACHMENT_PREFIX)), None)

    @property
    def camera(self) -> str:
        """Name of the first camera."""
        return self.manifest.cameras[0].name

    # --- messages -------------------------------------------------------------------------------------------------

    def topics(self) -> tuple[TopicInfo, ...]:
        """What the recording holds."""
        found: list[TopicInfo] = []
        for name in self._row.topic_names():
            times = self._row.index(name).time_ns
            first, last = (int(times[0]), int(times[-1])) if len(times) else (None, None)
            found.append(TopicInfo(name, self._row.schema_of(name), len(times), first, last))
        return tuple(found)

    def times(self, topic: str) -> np.ndarray:
        """Log times of a topic's messages [ns], (n,) int64, sorted; no message is read."""
        return self._row.index(topic).time_ns

    def first_times(self, topic: str) -> list[int]:
        """Log time of the topic's first message in each file that has one [ns]."""
        return self._row.first_times(topic)

    def messages(self, topic: str, start_ns: int | None = None, end_ns: int | None = None) -> Iterator[RecordedMessage]:
        """A topic's messages by time.

        Raises:
            RecordingError: the file is damaged, or the topic is truth, which only `read_truth` gives out.
        """
        if topic.startswith(topics.TRUTH_PREFIX):
            raise RecordingError(f"{self.path}: {topic} is truth: nothing but `analyze score` may read it")
        yield from self._row.messages(topic, start_ns, end_ns)

    def decoded(
        self, topic: str, kind: type[M], start_ns: int | None = None, end_ns: int | None = None
    ) -> Iterator[tuple[RecordedMessage, M]]:
        """A topic's messages, parsed.

        Raises:
            RecordingError: as `messages`, or a message is of another type.
        """
        for message in self.messages(topic, start_ns, end_ns):
            yield message, _decode(self.path, message, kind)

    @cached_property
    def strikes(self) -> tuple[pb.StrikeRecord, ...]:
        """Every strike that was carried out, in order."""
        return tuple(record for _, record in self.decoded(topics.SESSION_STRIKE.name, pb.StrikeRecord))

    def frame_meta(self, camera: str | None = None, start_ns: int | None = None, end_ns: int | None = None) -> Iterator[pb.FrameMeta]:
        """One per frame that arrived, of the first camera where none is named."""
        for _, meta in self.timed_frame_meta(camera, start_ns, end_ns):
            yield meta

    def timed_frame_meta(
        self, camera: str | None = None, start_ns: int | None = None, end_ns: int | None = None
    ) -> Iterator[tuple[int, pb.FrameMeta]]:
        """The same with their log times."""
        name = camera or self.camera
        image_topic, meta_topic = topics.raw_image(name).name, topics.frame_meta(name).name
        if self._row.schema_of(image_topic) == compressed_video.SCHEMA:
            written = ((message.log_time_ns, meta) for message, meta in self.decoded(meta_topic, pb.FrameMeta))
            yield from metas_of_video(list(written), self.times(image_topic), start_ns, end_ns)
            return
        for message, meta in self.decoded(meta_topic, pb.FrameMeta, start_ns, end_ns):
            yield message.log_time_ns, meta

    def images(self, camera: str | None = None, start_ns: int | None = None, end_ns: int | None = None) -> Iterator[ImageFrame]:
        """Images by time, of the first camera where none is named; uncompressed ones are read-only views into the file.

        Of a video a range is decoded from the last keyframe before it on.

        Raises:
            RecordingError: the file is damaged, or an image is of a kind that is not read.
        """
        topic = topics.raw_image(camera or self.camera).name
        schema = self._row.schema_of(topic)
        if schema == compressed_video.SCHEMA:
            yield from self._video(topic, start_ns, end_ns)
            return
        for message in self.messages(topic, start_ns, end_ns):
            try:
                image = decode_image(schema, message.data)
            except ContainerError as error:
                raise RecordingError(f"{self.path}: image {message.sequence} at {message.log_time_ns}: {error}") from None
            yield ImageFrame(message.log_time_ns, message.sequence, image)

    def _video(self, topic: str, start_ns: int | None, end_ns: int | None) -> Iterator[ImageFrame]:
        """Images of a video: decoded from the last keyframe before the range on."""
        try:
            for frame in compressed_video.decoded(self._row.as_written(topic, start_ns, end_ns, compressed_video.may_begin)):
                if (start_ns is None or frame.time_ns >= start_ns) and (end_ns is None or frame.time_ns <= end_ns):
                    yield frame
        except ContainerError as error:
            raise RecordingError(f"{self.path}: {topic}: {error}") from None

    def release_memory(self) -> None:
        """Let the system take back the memory that holds what was read; views stay valid, and are read again when they are used."""
        self._row.release_memory()

    def close(self) -> None:
        """Let go of the files; images already given out stay valid."""
        self._row.close()

    def __enter__(self) -> Recording:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()

    def refuse_unmapped_times(self) -> None:
        """Raise RecordingError if frame times are said to be mapped from a clock of which the file holds no sample."""
        if self.manifest.time_source is not TimeSource.DEVICE_MAPPED:
            return
        for camera in self.manifest.cameras:
            if len(self.times(topics.raw_image(camera.name).name)) == 0:
                continue
            clocks = self.decoded(topics.CLOCK_SAMPLE.name, pb.ClockSample)
            if not any(sample.clock == f"camera/{camera.name}" for _, sample in clocks):
                raise RecordingError(
                    f"{self.path}: frame times are said to be mapped from camera {camera.name!r}'s clock, but the file holds no sample of "
                    "that clock: they cannot be trusted; record again"
                )


@dataclass(frozen=True)
class Truth:
    """What the virtual world knows. Only `analyze score` may look at it."""

    pose_time_ns: np.ndarray
    """(n,) int64 log times"""
    poses: tuple[pb.TruthPose, ...]
    contacts: tuple[pb.TruthContact, ...]
    contact_time_ns: np.ndarray
    """(m,) int64 log times"""
    body: pb.TruthBody


def open_recording(path: Path) -> Recording:
    """Open a finished recording, with all files of its row.

    Raises:
        RecordingCut: it, or a file of its row, ends early; `open_partial` reads what is there.
        RecordingVersion: it is of another major schema version.
        RecordingError: it is missing, not a recording, damaged, or its times cannot be trusted.
    """
    recording = _open(path, indexed_file.open_finished)
    try:
        recording.refuse_unmapped_times()
    except RecordingError:
        recording.close()
        raise
    return recording


def open_partial(path: Path) -> Recording:
    """Open a recording that was cut short or is damaged: what stands in whole chunks can be read, of every file of its row.

    Raises:
        RecordingVersion: it is of another major schema version.
        RecordingError: it is missing, not a recording, or not even its manifest is left.
    """
    return _open(path, indexed_file.open_cut)


def read_truth(path: Path) -> Truth:
    """Truth of a virtual recording.

    Raises:
        RecordingError: it holds none, or is damaged.
    """
    row = _open_row(path, row_of(path), indexed_file.open_finished)
    try:
        bodies = [_decode(path, message, pb.TruthBody) for message in row.messages(topics.TRUTH_BODY.name)]
        if not bodies:
            raise RecordingError(f"{path}: holds no truth: only recordings of the virtual rig (`acquire demo`) can be scored")
        return Truth(
            pose_time_ns=row.index(topics.TRUTH_POSE.name).time_ns,
            poses=tuple(_decode(path, message, pb.TruthPose) for message in row.messages(topics.TRUTH_POSE.name)),
            contacts=tuple(_decode(path, message, pb.TruthContact) for message in row.messages(topics.TRUTH_CONTACT.name)),
            contact_time_ns=row.index(topics.TRUTH_CONTACT.name).time_ns,
            body=bodies[0],
        )
    finally:
        row.close()


def _open(path: Path, open_file: Callable[[Path], IndexedFile]) -> Recording:
    row = row_of(path)
    opened = _open_row(path, row, open_file)
    try:
        return Recording(path, opened, row.missing)
    except RecordingError:
        opened.close()
        raise


def _open_row(path: Path, row: FileRow, open_file: Callable[[Path], IndexedFile]) -> IndexedRow:
    """Every file of the row that `path` is of.

    Raises:
        RecordingError: of `path` as `open_file` says it; of another file, with what it has to do with `path`.
    """
    files: list[IndexedFile] = []
    try:
        for file in row.files:
            try:
                files.append(open_file(file))
            except RecordingCut as error:
                if file == path:
                    raise
                whole = whole_name(file)
                remedy = f"-o {whole}`" if whole != file else "-o NEW.mcap`, and put that in its place"
                raise RecordingCut(
                    f"{path}: {file.name} of the same recording was cut short or is still being written: `acquire recover {file} {remedy}"
                ) from error
    except RecordingError:
        IndexedRow(files).close()
        raise
    return IndexedRow(files)


def _checked_manifest(file: IndexedFile) -> SessionManifest:
    """The file's manifest, if it and the attachments are those that were sealed."""
    entries = file.metadata.get(MANIFEST_NAME)
    if entries is None or "json" not in entries:
        raise RecordingForeign(f"{file.path}: holds no Percuss manifest: it was not recorded by `acquire`, or ends before its manifest")
    manifest = parse_manifest(entries["json"], str(file.path))
    seal = file.metadata.get(SEAL_NAME, {})
    if seal.get("manifest_sha256", digest := hashlib.sha256(entries["json"].encode()).hexdigest()) != digest:
        raise RecordingError(f"{file.path}: damaged: the manifest is not the one that was sealed")
    for name, expected in manifest.hashes.items():
        attachment = file.attachments.get(name)
        if attachment is not None and hashlib.sha256(attachment.data).hexdigest() != expected:
            raise RecordingError(f"{file.path}: damaged: attachment {name!r} is not the one that was recorded")
    return manifest


def _decode(path: Path, message: RecordedMessage, kind: type[M]) -> M:
    decoded = kind()
    try:
        decoded.ParseFromString(bytes(message.data))
    except DecodeError:
        raise RecordingError(f"{path}: message on {message.topic} at {message.log_time_ns} is no {kind.DESCRIPTOR.full_name}") from None
    return decoded
