"""Reads a recording: manifest, plan, shape, images without copying, messages by topic and time.

A recording may be a series of files (file_series.py): any of them opens all. Ground truth is not accessible
here; `analyze.reading.truth` reads it.
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

from analyze.errors import RecordingError, RecordingForeign
from analyze.reading import compressed_video, indexed_file
from analyze.reading.file_series import find_series_files
from analyze.reading.followed_recording import FollowedRecording
from analyze.reading.image_message import decode_image
from analyze.reading.indexed_file import IndexedFile, RecordedMessage
from analyze.reading.indexed_series import IndexedSeries, open_series, series_content_id
from analyze.reading.recording_head import parse_manifest, parse_plan
from analyze.reading.video_frame_meta import expand_frame_meta
from analyze.types import ImageFrame
from schemas import topics
from schemas.mcap.records import ContainerError
from schemas.object_spec import ObjectSpec
from schemas.proto import percuss_pb2 as pb
from schemas.session_manifest import (
    MANIFEST_NAME,
    PLAN_ATTACHMENT,
    SEAL_NAME,
    SHAPE_ATTACHMENT_PREFIX,
    SessionManifest,
    TimeSource,
)
from schemas.strike_plan import StrikePlan

__all__ = [
    "FollowedRecording",
    "RecordedMessage",
    "Recording",
    "TopicInfo",
    "open_partial",
    "open_recording",
]

M = TypeVar("M", bound=Message)


@dataclass(frozen=True)
class TopicInfo:
    """Count and time span of a topic's messages."""

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
    """content_id in the file's seal; None if the file is cut"""
    damaged_chunks: int


class Recording:
    """An open recording, one file or a series.

    Times are log times [ns]; ranges include both ends. Use it in a `with` statement.

    Args:
        path: the file that was opened.
        series: all files of the recording, in their order.
        missing: numbers of the series' files that do not exist.
    """

    def __init__(self, path: Path, series: IndexedSeries, missing: tuple[int, ...] = ()) -> None:
        self._series = series
        self.path = path
        self.manifest: SessionManifest = next(iter([_checked_manifest(file) for file in series.files]))
        self.parts = tuple(
            FilePart(f.path, f.metadata.get(SEAL_NAME, {}).get("content_id"), f.damaged_chunks)
            for f in series.files
        )
        self.missing_parts = missing
        self.content_id: str | None = series_content_id([part.content_id for part in self.parts])
        """None if a file of the recording is cut"""
        self.damaged_chunks = sum(part.damaged_chunks for part in self.parts)

    # --- head

    @property
    def attachments(self) -> dict[str, bytes]:
        """Attached files by name."""
        return {name: attachment.data for name, attachment in self._series.files[0].attachments.items()}

    @property
    def plan(self) -> StrikePlan:
        """Strike plan that was carried out.

        Raises:
            RecordingError: the recording holds none.
        """
        return self._plan

    @cached_property
    def _plan(self) -> StrikePlan:
        attachment = self._series.files[0].attachments.get(PLAN_ATTACHMENT)
        if attachment is None:
            raise RecordingError(
                f"{self.path}: holds no {PLAN_ATTACHMENT}: record again with `acquire session`"
            )
        return parse_plan(attachment.data.decode(errors="replace"), str(self.path))

    @property
    def object_spec(self) -> ObjectSpec:
        """Object specification as the user wrote it."""
        return self.manifest.object

    @property
    def shape_bytes(self) -> bytes | None:
        """The object's shape file, None for a primitive."""
        return next(
            (data for name, data in self.attachments.items() if name.startswith(SHAPE_ATTACHMENT_PREFIX)),
            None,
        )

    @property
    def camera(self) -> str:
        """Name of the first camera."""
        return self.manifest.cameras[0].name

    # --- messages

    def topics(self) -> tuple[TopicInfo, ...]:
        """Topics with count and time span of their messages."""
        found: list[TopicInfo] = []
        for name in self._series.topic_names():
            times = self._series.index(name).time_ns
            first, last = (int(times[0]), int(times[-1])) if len(times) else (None, None)
            found.append(TopicInfo(name, self._series.schema_of(name), len(times), first, last))
        return tuple(found)

    def times(self, topic: str) -> np.ndarray:
        """Log times of a topic's messages [ns], (n,) int64, sorted; no message is read."""
        return self._series.index(topic).time_ns

    def first_times(self, topic: str) -> list[int]:
        """Log time of the topic's first message in each file that has one [ns]."""
        return self._series.first_times(topic)

    def messages(
        self, topic: str, start_ns: int | None = None, end_ns: int | None = None
    ) -> Iterator[RecordedMessage]:
        """A topic's messages by time.

        Raises:
            RecordingError: the file is damaged, or the topic is ground truth.
        """
        if topic.startswith(topics.TRUTH_PREFIX):
            raise RecordingError(
                f"{self.path}: {topic} is ground truth, which only `analyze score` may read: choose another "
                "topic"
            )
        yield from self._series.messages(topic, start_ns, end_ns)

    def decoded(
        self, topic: str, kind: type[M], start_ns: int | None = None, end_ns: int | None = None
    ) -> Iterator[tuple[RecordedMessage, M]]:
        """A topic's messages by time, each with its parsed content.

        Raises:
            RecordingError: as from `messages`, or a message is of another type.
        """
        for message in self.messages(topic, start_ns, end_ns):
            yield message, decode_message(self.path, message, kind)

    @cached_property
    def strikes(self) -> tuple[pb.StrikeRecord, ...]:
        """Records of the strikes that were carried out, in order."""
        return tuple(record for _, record in self.decoded(topics.SESSION_STRIKE.name, pb.StrikeRecord))

    def frame_meta(
        self, camera: str | None = None, start_ns: int | None = None, end_ns: int | None = None
    ) -> Iterator[pb.FrameMeta]:
        """FrameMeta of every frame that arrived, of `camera` or the first camera."""
        for _, meta in self.timed_frame_meta(camera, start_ns, end_ns):
            yield meta

    def timed_frame_meta(
        self, camera: str | None = None, start_ns: int | None = None, end_ns: int | None = None
    ) -> Iterator[tuple[int, pb.FrameMeta]]:
        """Log time and FrameMeta of every frame that arrived, of `camera` or the first camera."""
        name = camera or self.camera
        image_topic, meta_topic = topics.raw_image(name).name, topics.frame_meta(name).name
        if self._series.schema_of(image_topic) == compressed_video.SCHEMA:
            written = [
                (message.log_time_ns, meta) for message, meta in self.decoded(meta_topic, pb.FrameMeta)
            ]
            yield from expand_frame_meta(written, self.times(image_topic), start_ns, end_ns)
            return
        for message, meta in self.decoded(meta_topic, pb.FrameMeta, start_ns, end_ns):
            yield message.log_time_ns, meta

    def images(
        self, camera: str | None = None, start_ns: int | None = None, end_ns: int | None = None
    ) -> Iterator[ImageFrame]:
        """Images by time, of `camera` or the first camera.

        Uncompressed images are read-only views of the file. A range of a video is decoded from the last
        keyframe before it.

        Raises:
            RecordingError: the file is damaged, or an image has an unknown format.
        """
        topic = topics.raw_image(camera or self.camera).name
        schema = self._series.schema_of(topic)
        if schema == compressed_video.SCHEMA:
            yield from self._video_images(topic, start_ns, end_ns)
            return
        for message in self.messages(topic, start_ns, end_ns):
            try:
                image = decode_image(schema, message.data)
            except ContainerError as error:
                raise RecordingError(
                    f"{self.path}: image {message.sequence} at {message.log_time_ns}: {error}"
                ) from None
            yield ImageFrame(message.log_time_ns, message.sequence, image)

    def _video_images(self, topic: str, start_ns: int | None, end_ns: int | None) -> Iterator[ImageFrame]:
        is_start = compressed_video.is_decoding_start
        try:
            for frame in compressed_video.decode_video(
                self._series.messages_to_decode(topic, start_ns, end_ns, is_start)
            ):
                if (start_ns is None or frame.time_ns >= start_ns) and (
                    end_ns is None or frame.time_ns <= end_ns
                ):
                    yield frame
        except ContainerError as error:
            raise RecordingError(f"{self.path}: {topic}: {error}") from None

    def release_memory(self) -> None:
        """Return cached pages of the files to the system.

        Views stay valid and read them again when they are used.
        """
        self._series.release_memory()

    def close(self) -> None:
        """Close the files; images already returned stay valid."""
        self._series.close()

    def __enter__(self) -> Recording:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def refuse_unmapped_times(self) -> None:
        """Raise RecordingError if frame times are mapped from a clock without samples."""
        if self.manifest.time_source is not TimeSource.DEVICE_MAPPED:
            return
        for camera in self.manifest.cameras:
            if len(self.times(topics.raw_image(camera.name).name)) == 0:
                continue
            clocks = self.decoded(topics.CLOCK_SAMPLE.name, pb.ClockSample)
            if not any(sample.clock == f"camera/{camera.name}" for _, sample in clocks):
                raise RecordingError(
                    f"{self.path}: frame times are mapped from the clock of camera {camera.name!r}, but the "
                    "file holds no sample of that clock: they cannot be trusted: record again"
                )


def open_recording(path: Path) -> Recording:
    """Open a finished recording with all its files.

    Raises:
        RecordingCut: one of its files ends early; `open_partial` reads what is there.
        RecordingVersion: it has another major schema version.
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
    """Open a recording that was cut short or is damaged: whole chunks of all its files can be read.

    Raises:
        RecordingVersion: it has another major schema version.
        RecordingError: it is missing, not a recording, or its manifest is lost.
    """
    return _open(path, indexed_file.open_cut)


def _open(path: Path, open_file: Callable[[Path], IndexedFile]) -> Recording:
    files = find_series_files(path)
    series = open_series(path, files, open_file)
    try:
        return Recording(path, series, files.missing)
    except RecordingError:
        series.close()
        raise


def _checked_manifest(file: IndexedFile) -> SessionManifest:
    """Manifest of a file.

    Raises:
        RecordingForeign: the file has none.
        RecordingError: the manifest or an attachment differs from what was sealed.
    """
    entries = file.metadata.get(MANIFEST_NAME)
    if entries is None or "json" not in entries:
        raise RecordingForeign(
            f"{file.path}: holds no Percuss manifest: it was not recorded by `acquire`, or ends before its "
            "manifest"
        )
    manifest = parse_manifest(entries["json"], str(file.path))
    seal = file.metadata.get(SEAL_NAME, {})
    if seal.get("manifest_sha256", digest := hashlib.sha256(entries["json"].encode()).hexdigest()) != digest:
        raise RecordingError(
            f"{file.path}: damaged: the manifest is not the one that was sealed: restore it from a copy"
        )
    for name, expected in manifest.hashes.items():
        attachment = file.attachments.get(name)
        if attachment is not None and hashlib.sha256(attachment.data).hexdigest() != expected:
            raise RecordingError(
                f"{file.path}: damaged: attachment {name!r} is not the one that was recorded: restore the "
                "file from a copy"
            )
    return manifest


def decode_message(path: Path, message: RecordedMessage, kind: type[M]) -> M:
    """Parse a message of the recording `path`.

    Raises:
        RecordingError: it is of another type.
    """
    decoded = kind()
    try:
        decoded.ParseFromString(bytes(message.data))
    except DecodeError:
        raise RecordingError(
            f"{path}: message on {message.topic} at {message.log_time_ns} is not a "
            f"{kind.DESCRIPTOR.full_name}"
        ) from None
    return decoded
