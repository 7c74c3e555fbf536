"""Writes what was prepared: H.264 and H.265 whole and as they are coded, of everything else the images of the strikes' windows."""

from __future__ import annotations

import hashlib
import uuid
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from itertools import pairwise
from pathlib import Path

import numpy as np
from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
from foxglove_schemas_protobuf.Log_pb2 import Log
from google.protobuf.timestamp_pb2 import Timestamp
from numpy.typing import NDArray

from analyze.importing.run import Import
from analyze.importing.video_chunks import WHOLE_CHUNK, OpenChunk
from analyze.importing.windows import StrikeWindow
from analyze.importing.writer import Message, RecordingWriter
from analyze.sources import image_messages
from analyze.sources.image_messages import VideoMessages
from analyze.sources.kept import numbered
from analyze.sources.pace import Missing
from analyze.sources.source import FrameSource
from analyze.sources.video import VideoSource
from schemas import topics
from schemas.document import sha256_text
from schemas.mcap.records import Buffer
from schemas.proto import percuss_pb2 as pb
from schemas.rig import RigConfig
from schemas.session_manifest import (
    OBJECT_ATTACHMENT,
    PLAN_ATTACHMENT,
    SHAPE_ATTACHMENT_PREFIX,
    LensModel,
    ManifestCamera,
    SessionManifest,
    TimeSource,
)
from schemas.software import software_version

CAMERA = "main"
CAMERA_ATTACHMENT_PREFIX = "camera/"
_NO_DATE_NS = 946_684_800 * 10**9
"""2000-01-01: where no source says when it was filmed; the same source then gives the same content id"""
_BETWEEN_NS = 1_000_000_000
"""between a source's last image and the next one's first"""
_TOLD_EVERY = 100

Progress = Callable[[str, int, int], None]


@dataclass(frozen=True)
class Written:
    """A recording that was imported."""

    path: Path
    content_id: str
    size: int
    """bytes"""
    images: int
    strikes: int
    remarks: tuple[str, ...]
    """of frames that are missing, files that end early"""


@dataclass
class _Seen:
    """Log times of a strike's first and last image."""

    first_ns: int | None = None
    last_ns: int = 0

    def add_range(self, at_ns: int, times_ns: NDArray[np.int64], window: StrikeWindow) -> None:
        """Those of some frames, in order, that lie in a window; the source begins at `at_ns`."""
        first = 0 if window.start_ns is None else int(np.searchsorted(times_ns, window.start_ns, "left"))
        last = len(times_ns) if window.end_ns is None else int(np.searchsorted(times_ns, window.end_ns, "right"))
        if first < last:
            self.add(at_ns + int(times_ns[first]))
            self.add(at_ns + int(times_ns[last - 1]))

    def add(self, log_time_ns: int) -> None:
        """One more."""
        self.first_ns = log_time_ns if self.first_ns is None else min(self.first_ns, log_time_ns)
        self.last_ns = max(self.last_ns, log_time_ns)


class _Session:
    """One recording while it is written: counts frames over all sources, and lays these one after the other on one clock."""

    def __init__(self, prepared: Import, writer: RecordingWriter, progress: Progress) -> None:
        self._prepared, self._writer, self._progress = prepared, writer, progress
        self.anchor_ns = prepared.sources[0].wall_start_ns or _NO_DATE_NS
        self._at_ns = self.anchor_ns
        """log time of the source's start"""
        self._end_ns = self.anchor_ns
        self._sequence = 0
        self.images = 0
        self.remarks: list[str] = []
        self._seen = [_Seen() for _ in prepared.windows]
        self._image_topic = _image_topic(prepared)
        self._meta_topic = topics.frame_meta(CAMERA)

    def write(self) -> None:
        """All sources, then the strikes."""
        writer, prepared = self._writer, self._prepared
        writer.head(_manifest(prepared, self.anchor_ns), _attachments(prepared))
        calibration = topics.camera_calibration(CAMERA)
        writer.add_topics(calibration, self._image_topic, self._meta_topic, topics.SESSION_STRIKE, topics.LOG)
        writer.small(calibration, self.anchor_ns, _calibration_message(prepared).SerializeToString())
        for number, source in enumerate(prepared.sources):
            windows = [(seen, window) for seen, window in zip(self._seen, prepared.windows, strict=True) if window.film == number]
            if not windows:
                continue
            missing = Missing(1e9 / prepared.rate_hz)
            if prepared.kept is None:
                self._images(source, windows, missing)
            else:
                self._video(prepared.kept[number], windows, missing)
            if (remark := missing.remark(source.name)) is not None:
                self.remarks.append(remark)
            self._at_ns = self._end_ns + _BETWEEN_NS
        for seen, window in zip(self._seen, prepared.windows, strict=True):
            self._strike(seen, window)

    def _images(self, source: FrameSource, windows: list[tuple[_Seen, StrikeWindow]], missing: Missing) -> None:
        for seen, window in windows:
            missing.pause()
            for time_ns, parts in self._messages(source, window):
                log_time_ns = self._at_ns + time_ns
                if self.images % _TOLD_EVERY == 0:
                    self._tell(source)
                self._writer.chunk(self._image_topic, [Message(log_time_ns, self._sequence, parts)])
                self._meta(self._sequence, log_time_ns, missing.before(time_ns))
                self.images += 1
                self._end_ns = max(self._end_ns, log_time_ns)
                seen.add(log_time_ns)
                self._sequence += 1

    def _messages(self, source: FrameSource, window: StrikeWindow) -> Iterator[tuple[int, tuple[Buffer, ...]]]:
        """Time on the source's clock and message of a window's images."""
        if self._prepared.are_files:
            for time_ns, file in source.files(window.start_ns, window.end_ns):
                yield time_ns, image_messages.compressed_image(CAMERA, self._at_ns + time_ns, file)
            return
        for frame in self._prepared.images[window.film].frames(window.start_ns, window.end_ns):
            yield frame.time_ns, image_messages.raw_image(CAMERA, self._at_ns + frame.time_ns, frame.image)

    def _video(self, video: VideoSource, windows: list[tuple[_Seen, StrikeWindow]], missing: Missing) -> None:
        if video.keeps is None:
            return
        channel, chunk = self._writer.channel(self._image_topic), OpenChunk()
        room = image_messages.video_room(CAMERA, video.keeps)
        first = last = self._sequence
        lost: dict[int, tuple[int, int]] = {}
        for pictures, numbers, in_order_ns in numbered(video.coded(room), video.name):
            missed = missing.before_each(in_order_ns)
            for at in np.flatnonzero(missed).tolist():
                lost[last + at] = int(in_order_ns[at]), int(missed[at])
            for seen, window in windows:
                seen.add_range(self._at_ns, in_order_ns, window)
            last += len(in_order_ns)
            self.images += len(in_order_ns)
            self._tell(video)
            sizes = np.fromiter(map(len, pictures.data), np.int64, len(pictures.data)) - room
            messages = VideoMessages(self._at_ns + pictures.times_ns, first + numbers, sizes)
            image_messages.put_video_heads(CAMERA, video.keeps, channel, messages, pictures.data)
            for part, begins in _parts(pictures.keys):
                if chunk.size >= (WHOLE_CHUNK if begins else topics.VIDEO_CHUNK_BYTES):
                    self._video_chunk(chunk, lost)
                    chunk = OpenChunk()
                chunk.add(VideoMessages(*(column[part] for column in messages)), pictures.data[part])
        self._video_chunk(chunk, lost)
        self._sequence = last

    def _video_chunk(self, chunk: OpenChunk, lost: dict[int, tuple[int, int]]) -> None:
        """Write a chunk, and what is to be said of its frames: of its first, and of those before which some are missing."""
        if not chunk.size:
            return
        closed = chunk.closed()
        self._writer.video(self._image_topic, closed)
        first, last = int(closed.messages.sequences.min()), int(closed.messages.sequences.max())
        said = {number: lost.pop(number) for number in sorted(lost) if first <= number <= last}
        if first not in said:
            self._meta(first, int(closed.messages.times_ns.min()), 0)
        for number, (time_ns, missing) in said.items():
            self._meta(number, self._at_ns + time_ns, missing)
        self._end_ns = max(self._end_ns, int(closed.messages.times_ns.max()))

    def _meta(self, sequence: int, log_time_ns: int, lost: int) -> None:
        camera = self._prepared.calibration
        meta = pb.FrameMeta(
            sequence=sequence,
            device_time_ns=log_time_ns - self._at_ns,
            host_time_ns=log_time_ns - self.anchor_ns,
            mid_exposure_host_ns=log_time_ns - self.anchor_ns,
            frames_lost_before=lost,
            image_recorded=True,
            width=camera.width,
            height=camera.height,
        )
        self._writer.small(self._meta_topic, log_time_ns, meta.SerializeToString(), sequence)

    def _tell(self, source: FrameSource) -> None:
        total = sum(each.frame_count or 0 for each in self._prepared.sources) if self._prepared.kept else self.images
        self._progress(f"writing {source.name}", self.images, max(total, self.images))

    def _strike(self, seen: _Seen, window: StrikeWindow) -> None:
        planned = next(strike for strike in self._prepared.plan.strikes if strike.id == window.plan_strike_id)
        if seen.first_ns is None:
            self.remarks.append(f"strike {window.strike_id}: has no images and is left out")
            return
        record = pb.StrikeRecord(
            strike_id=window.strike_id,
            plan_strike_id=window.plan_strike_id,
            attempt=window.attempt,
            window_start_ns=seen.first_ns,
            window_end_ns=seen.last_ns,
            R_world_object=[value for row in planned.R_world_object for value in row],
            p_world_object=planned.p_world_object,
        )
        self._writer.small(topics.SESSION_STRIKE, seen.last_ns, record.SerializeToString())
        self._writer.small(topics.LOG, seen.last_ns, _log(seen.last_ns, self._origin(window)).SerializeToString())

    def _origin(self, window: StrikeWindow) -> str:
        """Where a strike comes from, and when it began, for people."""
        film = self._prepared.films[window.film]
        text = f"strike {window.strike_id}: of {film.path.name}; nothing felt the contact"
        if window.onset is None:
            return text
        # What the eye of the finder misses at first is less than a frame's motion.
        earliest_ns = window.onset.time_ns - round(1e9 / self._prepared.rate_hz)
        middle, half = (window.onset.moved_ns + earliest_ns) / 2, (window.onset.moved_ns - earliest_ns) / 2
        return f"{text}, the tag began to move at {middle * 1e-9:.3f} ± {half * 1e-9:.3f} s of it"


def _image_topic(prepared: Import) -> topics.Topic:
    if prepared.kept is not None:
        return topics.compressed_video(CAMERA)
    return topics.compressed_image(CAMERA) if prepared.are_files else topics.raw_image(CAMERA)


def _parts(keys: NDArray[np.bool_]) -> Iterator[tuple[slice, bool]]:
    """Stretches of pictures that begin with a key picture, and whether they do: the first may go on with what came before."""
    begins = np.flatnonzero(keys).tolist()
    for start, stop in pairwise(sorted({0, len(keys), *begins})):
        yield slice(start, stop), bool(keys[start])


def write(prepared: Import, output: Path, progress: Progress = lambda _text, _done, _total: None) -> Written:
    """Write the recording; on failure nothing is left.

    Raises:
        OutputError: it exists already, or cannot be written.
        ImportRefused: a source cannot be read to its end.
    """
    with RecordingWriter(output) as writer:
        session = _Session(prepared, writer, progress)
        session.write()
        content_id = writer.finish()
        remarks = tuple(dict.fromkeys([*prepared.remarks(), *session.remarks]))
        return Written(output, content_id, writer.size, session.images, len(prepared.windows), remarks)


def _manifest(prepared: Import, anchor_ns: int) -> SessionManifest:
    known = prepared.sources[0].wall_start_ns is not None
    created = datetime.fromtimestamp(anchor_ns * 1e-9, UTC) if known else datetime.now(UTC)
    kinds = {source.time_source for source in prepared.sources}
    rig, usual = prepared.camera.rig, RigConfig.model_fields
    files = prepared.object
    return SessionManifest(
        recording_id=str(uuid.uuid4()),
        created=created.isoformat(timespec="seconds"),
        software=software_version(),
        wall_anchor_ns=anchor_ns,
        time_source=kinds.pop() if len(kinds) == 1 else TimeSource.CONTAINER_PTS,
        time_source_sd_ns=max(source.time_sd_ns for source in prepared.sources),
        g_m_s2=usual["g_m_s2"].default if rig is None else rig.g_m_s2,
        g_sd_m_s2=usual["g_sd_m_s2"].default if rig is None else rig.g_sd_m_s2,
        gravity_tilt_sd_rad=usual["gravity_tilt_sd_rad"].default if rig is None else rig.gravity_tilt_sd_rad,
        level=None if rig is None else rig.level,
        cameras=[_camera(prepared)],
        object=files.spec,
        object_sha256=files.sha256,
        plan_sha256=sha256_text(prepared.plan_text),
        hashes={name: hashlib.sha256(data).hexdigest() for name, _, data in _attachments(prepared)},
    )


def _camera(prepared: Import) -> ManifestCamera:
    sd = prepared.options.rate_sd_hz
    return ManifestCamera(name=CAMERA, frame_rate_hz=prepared.rate_hz, frame_rate_sd_hz=sd, calibration=prepared.calibration)


def _attachments(prepared: Import) -> list[tuple[str, str, bytes]]:
    files = prepared.object
    found = [
        (OBJECT_ATTACHMENT, "application/toml", prepared.object_text.encode()),
        (PLAN_ATTACHMENT, "application/json", prepared.plan_text.encode()),
        (CAMERA_ATTACHMENT_PREFIX + prepared.camera.file_name, "text/plain", prepared.camera.content()),
    ]
    if files.shape_bytes is not None:
        found.append((SHAPE_ATTACHMENT_PREFIX + Path(files.shape_name).name, "application/octet-stream", files.shape_bytes))
    return found


def _log(time_ns: int, text: str) -> Log:
    stamp = Timestamp(seconds=time_ns // 10**9, nanos=time_ns % 10**9)
    return Log(timestamp=stamp, level=Log.Level.INFO, message=text, name="import")


def _calibration_message(prepared: Import) -> CameraCalibration:
    spec = prepared.calibration
    message = CameraCalibration(frame_id=CAMERA, width=spec.width, height=spec.height)
    message.distortion_model = "kannala_brandt" if spec.model is LensModel.FISHEYE else "plumb_bob"
    message.D.extend(spec.distortion)
    message.K.extend(value for row in spec.K for value in row)
    message.P.extend(value for row in spec.K for value in (*row, 0.0))
    message.R.extend([1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0])
    return message
