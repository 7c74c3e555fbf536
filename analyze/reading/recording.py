"""Reads a recording: manifest, plan, shape, images without copying, messages by topic and time.

A recording may be a series of files (file_series.py): any of them opens all. Ground truth (true values of a
simulation) cannot be read here, only its log times; `analyze.reading.truth` reads it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from analyze.errors import RecordingError
from analyze.reading import compressed_video, indexed_file
from analyze.reading.decode_message import M, decode_message
from analyze.reading.file_series import find_series_files
from analyze.reading.image_message import decode_image
from analyze.reading.indexed_file import IndexedFile, RecordedMessage
from analyze.reading.indexed_series import IndexedSeries, open_series, series_content_id
from analyze.reading.recording_head import checked_manifest, parse_plan, shape_attachment
from analyze.reading.time_range import is_within
from analyze.reading.topic_info import TopicInfo
from analyze.reading.video_frame_meta import expand_frame_meta
from analyze.types import ImageFrame
from schemas import topics
from schemas.compaction import COMPACTED_NAME, parse_compaction
from schemas.mcap.records import ContainerError
from schemas.object_spec import ObjectSpec
from schemas.proto import percuss_pb2 as pb
from schemas.session_manifest import PLAN_ATTACHMENT, RECOVERED_NAME, SEAL_NAME, SessionManifest, TimeSource
from schemas.strike_plan import StrikePlan


@dataclass(frozen=True)
class FilePart:
    """One file of a recording, with its content hash and number of damaged chunks."""

    path: Path
    """path of the file"""
    content_id: str | None
    """hash of the messages, from the file's seal (checksum record at its end); None without a seal, as in a
    file that was cut short"""
    damaged_chunks: int
    """number of damaged chunks and other records that `open_partial` left out; 0 after `open_recording`"""


class Recording:
    """An open recording, one file or a series; made by `open_recording` or `open_partial`.

    Times are log times [ns since 1970]; ranges include both ends. Use it in a `with` statement.

    Args:
        path: the file that was opened.
        series: all files of the recording that were found, in their order.
        missing: numbers of the series' files that were not found.

    Raises:
        RecordingForeign: a file has no manifest (JSON description of the session).
        RecordingVersion: a file was written by another major schema version.
        RecordingError: a file's manifest cannot be parsed, or it or an attachment differs from its stated
            hash.
    """

    def __init__(self, path: Path, series: IndexedSeries, missing: tuple[int, ...] = ()) -> None:
        self._series = series
        self.path = path
        self.manifest: SessionManifest = next(iter([checked_manifest(file) for file in series.files]))
        self.parts = tuple(
            FilePart(f.path, f.metadata.get(SEAL_NAME, {}).get("content_id"), f.damaged_chunks)
            for f in series.files
        )
        self.missing_parts = missing
        self.content_id: str | None = series_content_id([part.content_id for part in self.parts])
        """hash of the messages of all files (`series_content_id`); None if a file has no seal"""
        self.damaged_chunks = sum(part.damaged_chunks for part in self.parts)
        self.recovery_losses: tuple[str, ...] = tuple(
            line
            for file in series.files
            for line in file.metadata.get(RECOVERED_NAME, {}).get("lines", "").splitlines()
        )
        """what `acquire recover` lost, found changed or could not verify in the files; each a line"""
        read = [parse_compaction(file.metadata.get(COMPACTED_NAME, {})) for file in series.files]
        self.compactions = tuple(each for each in read if each is not None)
        """how `analyze compact` recoded the files' images"""

    # --- head

    @property
    def attachments(self) -> dict[str, bytes]:
        """Contents of the files attached to the recording (plan, object, shape, camera), by name.

        They are taken from the recording's first file.
        """
        return {name: attachment.data for name, attachment in self._series.files[0].attachments.items()}

    @property
    def plan(self) -> StrikePlan:
        """Strike plan of the recording: resting poses, pivot edges, impacts and energies of planned strikes.

        Raises:
            RecordingError: the recording holds no plan, or it is damaged.
            RecordingVersion: the plan was written by another major schema version.
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
        """Object specification (mass, shape, markers) as the user wrote it."""
        return self.manifest.object

    @property
    def shape_bytes(self) -> bytes | None:
        """Content of the object's shape file; None for a primitive (box, cylinder)."""
        return shape_attachment(self.attachments)

    @property
    def camera(self) -> str:
        """Name of the first camera."""
        return self.manifest.cameras[0].name

    # --- messages

    def topics(self) -> tuple[TopicInfo, ...]:
        """All topics with count and time span of their messages, in the order of their channels.

        Raises:
            RecordingError: a file is damaged.
        """
        found: list[TopicInfo] = []
        for name in self._series.topic_names():
            times = self._series.index(name).time_ns
            first, last = (int(times[0]), int(times[-1])) if len(times) else (None, None)
            found.append(TopicInfo(name, self._series.schema_of(name), len(times), first, last))
        return tuple(found)

    def times(self, topic: str) -> np.ndarray:
        """Log times of a topic's messages [ns], (n,) int64, sorted; empty for an unknown topic.

        Of a finished file only the message index is read.

        Raises:
            RecordingError: a file is damaged.
        """
        return self._series.index(topic).time_ns

    def first_times(self, topic: str) -> list[int]:
        """Log time [ns] of a topic's earliest message in each file that has one, in the files' order.

        Raises:
            RecordingError: a file is damaged.
        """
        return self._series.first_times(topic)

    def messages(
        self, topic: str, start_ns: int | None = None, end_ns: int | None = None
    ) -> Iterator[RecordedMessage]:
        """Yield a topic's messages, not parsed, by log time; none for an unknown topic.

        Args:
            topic: name of the topic.
            start_ns: earliest log time [ns], included; None for no limit.
            end_ns: latest log time [ns], included; None for no limit.

        Raises:
            RecordingError: a file is damaged, or the topic is ground truth of a simulation (/truth/...).
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
        """Yield a topic's messages by log time, each with its parsed content; none for an unknown topic.

        Args:
            topic: name of the topic.
            kind: protobuf class of the topic's messages.
            start_ns: earliest log time [ns], included; None for no limit.
            end_ns: latest log time [ns], included; None for no limit.

        Raises:
            RecordingError: a file is damaged, the topic is ground truth (/truth/...), or a message cannot be
                parsed as `kind`.
        """
        for message in self.messages(topic, start_ns, end_ns):
            yield message, decode_message(self.path, message, kind)

    @cached_property
    def strikes(self) -> tuple[pb.StrikeRecord, ...]:
        """StrikeRecord messages (id, time window, resting pose) of the strikes carried out, by log time.

        Raises:
            RecordingError: a file is damaged.
        """
        return tuple(record for _, record in self.decoded(topics.SESSION_STRIKE.name, pb.StrikeRecord))

    @cached_property
    def tosses(self) -> tuple[pb.TossRecord, ...]:
        """TossRecord messages (id, time window) of the tosses carried out, by log time.

        Raises:
            RecordingError: a file is damaged.
        """
        return tuple(record for _, record in self.decoded(topics.SESSION_TOSS.name, pb.TossRecord))

    def frame_meta(
        self, camera: str | None = None, start_ns: int | None = None, end_ns: int | None = None
    ) -> Iterator[pb.FrameMeta]:
        """Yield the metadata (FrameMeta) of every frame that reached the host, by time.

        FrameMeta has the frame's number, its times and the number of frames lost before it.

        Args:
            camera: name of the camera; None for the first.
            start_ns: earliest log time [ns], included; None for no limit.
            end_ns: latest log time [ns], included; None for no limit.

        Raises:
            RecordingError: a file is damaged.
        """
        for _, meta in self.timed_frame_meta(camera, start_ns, end_ns):
            yield meta

    def timed_frame_meta(
        self, camera: str | None = None, start_ns: int | None = None, end_ns: int | None = None
    ) -> Iterator[tuple[int, pb.FrameMeta]]:
        """Yield log time [ns] and metadata (FrameMeta) of every frame that reached the host, by time.

        FrameMeta has the frame's number, its times and the number of frames lost before it. An imported video
        stores it for few frames only; the others' is derived from the stored one before them.

        Args:
            camera: name of the camera; None for the first.
            start_ns: earliest log time [ns], included; None for no limit.
            end_ns: latest log time [ns], included; None for no limit.

        Raises:
            RecordingError: a file is damaged.
        """
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
        """Yield a camera's images as grey values (height, width) uint8 with their log times, by time.

        Uncompressed images are read-only views of the file. A range of a video is decoded from the last
        keyframe before it.

        Args:
            camera: name of the camera; None for the first.
            start_ns: earliest log time [ns], included; None for no limit.
            end_ns: latest log time [ns], included; None for no limit.

        Raises:
            RecordingError: a file is damaged, or an image has an unknown format or cannot be decoded.
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
                if is_within(frame.time_ns, start_ns, end_ns):
                    yield frame
        except ContainerError as error:
            raise RecordingError(f"{self.path}: {topic}: {error}") from None

    def release_memory(self) -> None:
        """Return cached pages of the mapped files to the system.

        Views of the files stay valid; the pages are read again when the views are used.
        """
        self._series.release_memory()

    def close(self) -> None:
        """Close the files; images already returned stay valid."""
        self._series.close()

    def __enter__(self) -> Recording:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def refuse_unmapped_times(self) -> None:
        """Check that the camera clocks, from which frame times are mapped, were compared with the host's.

        Each camera with images must have at least one clock sample (such a comparison) in the file. Only
        recordings whose manifest states the time source `device_mapped` are checked.

        Raises:
            RecordingError: a camera's clock has no samples, so that its times cannot be trusted.
        """
        if self.manifest.time_source is not TimeSource.DEVICE_MAPPED:
            return
        for camera in self.manifest.cameras:
            # The images' index, which is long, is read only where it decides.
            clocks = self.decoded(topics.CLOCK_SAMPLE.name, pb.ClockSample)
            if any(sample.clock == f"camera/{camera.name}" for _, sample in clocks):
                continue
            if len(self.times(topics.raw_image(camera.name).name)):
                raise RecordingError(
                    f"{self.path}: frame times are mapped from the clock of camera {camera.name!r}, but the "
                    "file holds no sample of that clock: they cannot be trusted: record again"
                )


def open_recording(path: Path) -> Recording:
    """Open a finished recording with all its files that are in the folder of `path`; return it.

    A recording may be split into several files. Missing ones are no error; their numbers are in
    `Recording.missing_parts`.

    Args:
        path: any of the recording's files.

    Raises:
        RecordingCut: a file ends early or is empty; `open_partial` reads what is there.
        RecordingForeign: a file is not MCAP, or has no manifest (JSON description of the session).
        RecordingVersion: a file has another major schema version.
        RecordingError: `path` does not exist, a file cannot be read or is damaged, its manifest or an
            attachment differs from its stated hash, or a camera's clock was never compared with the host's.
    """
    recording = _open(path, indexed_file.open_finished)
    try:
        recording.refuse_unmapped_times()
    except RecordingError:
        recording.close()
        raise
    return recording


def open_partial(path: Path) -> Recording:
    """Open a recording that was cut short or is damaged; return it with its whole, undamaged chunks.

    All its files in the folder of `path` are opened. Missing files of the series are no error; their numbers
    are in `Recording.missing_parts`, the number of damaged chunks in `Recording.damaged_chunks`.

    Args:
        path: any of the recording's files.

    Raises:
        RecordingCut: a file is empty.
        RecordingForeign: a file is not MCAP, or has lost its manifest (JSON description of the session).
        RecordingVersion: a file has another major schema version.
        RecordingError: `path` does not exist, a file cannot be read, its manifest cannot be parsed, or an
            attachment differs from its stated hash.
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
