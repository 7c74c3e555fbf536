"""Read a recording that is still being written: messages and strikes as they arrive, and images."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from pathlib import Path

from analyze.errors import RecordingError
from analyze.reading.followed_series import FollowedSeries
from analyze.reading.indexed_file import RecordedMessage
from analyze.types import ImageFrame
from schemas import topics
from schemas.object_spec import ObjectSpec
from schemas.proto import percuss_pb2 as pb
from schemas.session_manifest import SessionManifest
from schemas.strike_plan import StrikePlan

IMAGE_RETENTION_NS = 120_000_000_000
"""Time [ns] for which images are kept for a strike whose record has not arrived yet."""


class LiveRecording:
    """Recording that is still being written, with its recent images kept in memory.

    `poll` reads the messages added; `forget_until` releases images. A context manager that closes the file. A
    strike's record is the message that holds its ids and times.

    Args:
        path: the file that is being written.
        retention_ns: time [ns] for which images are kept before the newest one; None for all of them.
    """

    def __init__(self, path: Path, retention_ns: int | None = IMAGE_RETENTION_NS) -> None:
        self._retention_ns = retention_ns
        self._series = FollowedSeries(path)
        self._images: deque[RecordedMessage] = deque()
        self._metas: deque[pb.FrameMeta] = deque()
        self._meta_ns: deque[int] = deque()
        self.strikes: list[pb.StrikeRecord] = []
        """Strikes whose records have arrived."""
        self.tosses: list[pb.TossRecord] = []
        """Tosses whose records have arrived."""

    def __enter__(self) -> LiveRecording:
        return self

    def __exit__(self, *_: object) -> None:
        self._series.close()

    @property
    def path(self) -> Path:
        """Path of the file being read; it changes when a recording in several files goes on with the next."""
        return self._series.path

    @property
    def ready(self) -> bool:
        """True if the recording's manifest (its description) and strike plan have been read."""
        return self._series.manifest is not None and self._series.plan is not None

    @property
    def finished(self) -> bool:
        """True if the file being read is complete; in a recording of several files another may follow."""
        return self._series.finished

    @property
    def manifest(self) -> SessionManifest:
        """Manifest (description of session, object and cameras) of the file being read.

        Raises:
            RecordingError: the manifest has not been written yet.
        """
        if self._series.manifest is None:
            raise RecordingError(f"{self.path}: ends before its manifest: wait until the session has begun")
        return self._series.manifest

    @property
    def plan(self) -> StrikePlan:
        """Strike plan of the session.

        Raises:
            RecordingError: the plan has not been written yet.
        """
        plan = self._series.plan
        if plan is None:
            raise RecordingError(f"{self.path}: ends before its plan: wait until the session has begun")
        return plan

    @property
    def object_spec(self) -> ObjectSpec:
        """Object file of the recording: name, mass, shape, markers.

        Raises:
            RecordingError: the manifest has not been written yet.
        """
        return self.manifest.object

    @property
    def shape_bytes(self) -> bytes | None:
        """Contents of the object's shape file; None for a primitive (box, cylinder), or before it is read."""
        return self._series.shape_bytes

    def poll(self) -> tuple[list[RecordedMessage], list[pb.StrikeRecord]]:
        """Read the messages that were written since the last call, without waiting.

        Images and frame metadata of the first camera are kept in this object.

        Returns:
            Two lists, both empty if nothing was written: the new messages that are neither images or frame
            metadata of the first camera nor records of strikes or tosses; and the new strikes' records. The
            records of new tosses are appended to `tosses`.

        Raises:
            RecordingError: the file is damaged, not a recording, or of another major schema version.
        """
        small: list[RecordedMessage] = []
        strikes: list[pb.StrikeRecord] = []
        camera = ""
        for message in self._series.poll():
            camera = camera or self.manifest.cameras[0].name
            if message.topic == topics.raw_image(camera).name:
                self._images.append(message)
            elif message.topic == topics.frame_meta(camera).name:
                self._metas.append(pb.FrameMeta.FromString(bytes(message.data)))
                self._meta_ns.append(message.log_time_ns)
            elif message.topic == topics.SESSION_STRIKE.name:
                strikes.append(pb.StrikeRecord.FromString(bytes(message.data)))
            elif message.topic == topics.SESSION_TOSS.name:
                self.tosses.append(pb.TossRecord.FromString(bytes(message.data)))
            else:
                small.append(message)
        self.strikes += strikes
        while (
            self._retention_ns is not None
            and self._images
            and self._images[-1].log_time_ns - self._images[0].log_time_ns > self._retention_ns
        ):
            self._images.popleft()
        return small, strikes

    def forget_until(self, time_ns: int) -> None:
        """Release images and frame metadata with log times up to and including `time_ns` [ns]."""
        while self._images and self._images[0].log_time_ns <= time_ns:
            self._images.popleft()
        while self._meta_ns and self._meta_ns[0] <= time_ns:
            self._meta_ns.popleft()
            self._metas.popleft()

    def frame_meta(self, *, start_ns: int | None = None, end_ns: int | None = None) -> Iterator[pb.FrameMeta]:
        """Yield the metadata of each kept frame of the first camera in order of arrival.

        Args:
            start_ns: first log time [ns]; None for no limit.
            end_ns: last log time [ns], inclusive; None for no limit.
        """
        for time_ns, meta in zip(list(self._meta_ns), list(self._metas), strict=True):
            if (start_ns is None or time_ns >= start_ns) and (end_ns is None or time_ns <= end_ns):
                yield meta

    def images(self, *, start_ns: int | None = None, end_ns: int | None = None) -> Iterator[ImageFrame]:
        """Yield the images of the first camera that are still kept in memory, in order of time.

        Args:
            start_ns: first log time [ns]; None for no limit.
            end_ns: last log time [ns], inclusive; None for no limit.
        """
        for message in sorted(self._images, key=lambda each: each.log_time_ns):
            if (start_ns is None or message.log_time_ns >= start_ns) and (
                end_ns is None or message.log_time_ns <= end_ns
            ):
                yield self._series.image(message)
