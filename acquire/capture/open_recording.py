"""Open recording of the capture process: its files, its recorder, and its memory for direct I/O."""

from __future__ import annotations

import math
from collections import Counter
from pathlib import Path
from typing import Any

from acquire.capture import wire
from acquire.errors import RecorderError
from acquire.recorder.choose_recorder import choose_recorder
from acquire.recorder.direct.backlog import backlog_frames, backlog_memory
from acquire.recorder.direct.block_memory import BlockMemory
from acquire.recorder.direct.direct_io import can_write_directly
from acquire.recorder.disk_space import DiskSpace
from acquire.recorder.file_series import FileSeries, Rotation
from acquire.recorder.frame_format import FrameFormat
from acquire.recorder.messages import SmallMessage
from acquire.recorder.writer import McapWriter
from schemas.document import canonical_json
from schemas.rig import RigConfig
from schemas.session_manifest import MANIFEST_NAME, SessionManifest, manifest_entries

Attachments = list[tuple[str, str, bytes]]
"""files to attach to a recording: (name, media type, content) of each"""


def frame_format(rig: RigConfig) -> FrameFormat:
    """Name, image size [px] and frame rate [Hz] of the camera that a rig file describes."""
    camera = rig.camera
    return FrameFormat(camera.name, camera.width, camera.height, camera.frame_rate_hz)


def borrowable_frames(rig: RigConfig) -> int:
    """Number of camera buffers that a recording may borrow (keep until they are on the disk) at a time.

    0 unless the recorder's mode is "continuous", with raw images of at least a page (4096 bytes).
    """
    recorder = rig.recorder
    if recorder.mode != "continuous" or recorder.image_format != "raw":
        return 0
    return backlog_frames(frame_format(rig))


class OpenRecording:
    """An open recording: its files, the recorder of its frames, and the writer of its small messages.

    Small messages are those of all topics but the camera's images and frame metadata.
    """

    def __init__(
        self,
        path: Path,
        manifest: SessionManifest,
        attachments: Attachments,
        log_time_ns: int,
        rig: RigConfig,
        borrowable: int,
    ) -> None:
        """Open the first file, write its head, declare the small topics, and start to record frames.

        Args:
            path: final path of the recording's first file.
            manifest: description of the session, written to every file with the file's number.
            attachments: (name, media type, content) of files attached to every file of the recording.
            log_time_ns: log time of the attachments [ns].
            rig: camera and recorder configuration.
            borrowable: number of camera buffers that may be borrowed, for direct I/O; 0: frames are copied.

        Raises:
            RecorderError: the path is taken, or the disk refuses or has no room; no file is left then.
        """
        config = rig.recorder
        self.rig = rig
        self.anchor = manifest.wall_anchor_ns
        self.camera = rig.camera.name
        self._format = frame_format(rig)
        self._disk = DiskSpace(path.parent, config.disk_reserve_bytes)

        def write_head(writer: McapWriter, part: int) -> None:
            own = manifest if part == manifest.part else manifest.model_copy(update={"part": part})
            writer.metadata(MANIFEST_NAME, manifest_entries(canonical_json(own)))
            for name, media_type, content in attachments:
                writer.attachment(name, media_type, content, log_time_ns)

        rotation = Rotation()
        self._memory: BlockMemory | None = None
        if config.mode == "continuous":
            rotation = Rotation(config.rotate_bytes, config.keep_files)
            # Windows go through the page cache: `analyze watch` reads them a moment later.
            if config.image_format == "raw" and borrowable and can_write_directly(path.parent):
                self._memory = backlog_memory(self._format, borrowable)
        self.files = FileSeries(path, write_head, rotation, self._disk, self._memory, manifest.part)
        self.first_frame_ns: int | None = None
        """log time of the first frame; None before it"""
        self._small = wire.small_topics(self.camera)
        self._sequences: Counter[str] = Counter()
        try:
            for topic in self._small.values():
                self.files.add_topic(topic)
            self.frames = choose_recorder(self.files, self._format, config, self.anchor)
        except BaseException:
            self.files.abandon()
            raise

    @property
    def path(self) -> Path:
        """Final path of the file being written; the file gets that name when it is complete."""
        return self.files.path

    @property
    def waiting_bytes(self) -> int:
        """Bytes of images that wait in memory for the disk: in the queue, in copies, in camera buffers."""
        queued = self.frames.waiting * self._format.image_bytes
        return queued + (self._memory.used_bytes if self._memory is not None else 0)

    def require_space(self) -> None:
        """Raise RecorderError if the disk has no room for a window of the greatest length.

        A window is the time span of a strike, with the pre-trigger time before it.
        """
        config = self.rig.recorder
        frames = math.ceil((config.max_window_s + config.pre_trigger_s) * self._format.frame_rate_hz)
        self._disk.require(frames * self._format.image_bytes, "a window")

    def write(self, name: str, log_time_ns: int, data: bytes) -> None:
        """Write one message of a small topic (any topic but the camera's images and frame metadata).

        Args:
            name: name of the topic.
            log_time_ns: log time [ns].
            data: serialised message.

        Raises:
            RecorderError: there is no such topic, the log time is not positive, or the disk refuses.
        """
        topic = self._small.get(name)
        if topic is None:
            raise RecorderError(f"{self.path}: topic {name!r} is not one of a recording's small topics")
        sequence = self._sequences[name]
        self._sequences[name] = sequence + 1
        self.files.write_small(self.files.add_topic(topic), [SmallMessage(log_time_ns, data, sequence)])

    def finish(self) -> dict[str, Any]:
        """Write the waiting frames and finish the last file.

        Returns:
            Of the last file: `path` and `content_id` (hash of its messages). Over all files: `frames`, number
            of frames that arrived, and `lost`, number lost on the way or dropped because of a slow disk.

        Raises:
            RecorderError: a file could not be finished.
        """
        frames = self.frames
        try:
            frames.close()
        finally:  # the file is finished even if writing the last frames failed
            seal = self.files.finish()
        return {
            "path": str(seal.path),
            "frames": frames.frames,
            "lost": frames.lost + frames.dropped,
            "content_id": seal.content_id,
        }
