"""The recording that the capture process has open: its files, its recorder, and the memory they write from."""

from __future__ import annotations

import math
from collections import Counter
from pathlib import Path
from typing import Any

from acquire.capture import wire
from acquire.config import RigConfig
from acquire.errors import RecorderError
from acquire.recorder.direct.block_memory import BlockMemory
from acquire.recorder.direct.direct_file import can_write_directly
from acquire.recorder.disk_space import DiskSpace
from acquire.recorder.file_series import FileSeries, Rotation
from acquire.recorder.frame_recorder import FrameRecorder, backlog_bytes, backlog_frames, lent_memory
from acquire.recorder.writer import McapWriter
from schemas.document import canonical_json
from schemas.session_manifest import MANIFEST_NAME, SessionManifest

Attachments = list[tuple[str, str, bytes]]
"""name, media type, content"""


def spare_buffers(rig: RigConfig) -> int:
    """Frames that a continuous recording keeps while the disk stands still."""
    camera, recorder = rig.camera, rig.recorder
    if recorder.mode != "continuous" or recorder.image_format != "raw":
        return 0
    return backlog_frames(camera.width, camera.height, camera.frame_rate_hz)


class OpenRecording:
    """An open recording."""

    def __init__(
        self, path: Path, manifest: SessionManifest, attachments: Attachments, log_time_ns: int, rig: RigConfig, spare: int
    ) -> None:
        """`spare`: of the camera's buffers, to be used where the recording is written past the page cache."""
        config = rig.recorder
        self.rig = rig
        self._lent = spare > 0
        self.anchor = manifest.wall_anchor_ns
        self.camera = rig.camera.name
        self._disk = DiskSpace(path.parent, config.disk_reserve_bytes)

        def write_head(writer: McapWriter, part: int) -> None:
            own = manifest if part == manifest.part else manifest.model_copy(update={"part": part})
            writer.metadata(MANIFEST_NAME, {"json": canonical_json(own)})
            for name, media_type, content in attachments:
                writer.attachment(name, media_type, content, log_time_ns)

        rotation = Rotation()
        self._memory: BlockMemory | None = None
        if config.mode == "continuous":
            rotation = Rotation(config.rotate_bytes, config.keep_files)
            # Windows go through the page cache: `analyze watch` reads them a moment later.
            if config.image_format == "raw" and can_write_directly(path.parent):
                camera = rig.camera
                self._memory = (
                    lent_memory(camera.width, camera.height, spare)
                    if spare
                    else BlockMemory(backlog_bytes(camera.width, camera.height, camera.frame_rate_hz))
                )
        self.files = FileSeries(path, write_head, rotation, self._disk, self._memory, manifest.part)
        self.frames: FrameRecorder | None = None
        self.first_frame_ns: int | None = None
        """log time"""
        self._small = wire.small_topics(self.camera)
        self._sequences: Counter[str] = Counter()

    @property
    def path(self) -> Path:
        """Of the file that is being written, once it is whole."""
        return self.files.path

    @property
    def waiting_bytes(self) -> int:
        """Images in memory before the disk."""
        queued = self.frames.waiting * self.rig.camera.width * self.rig.camera.height if self.frames is not None else 0
        return queued + (self._memory.used_bytes if self._memory is not None else 0)

    def require_space(self) -> None:
        """Refuse a window that the disk has no room for."""
        config, camera = self.rig.recorder, self.rig.camera
        frames = math.ceil((config.max_window_s + config.pre_trigger_s) * camera.frame_rate_hz)
        self._disk.require(frames * camera.width * camera.height, "a window")

    def begin(self) -> None:
        """The head of the file is written: take frames."""
        for topic in self._small.values():
            self.files.add_topic(topic)
        camera = self.rig.camera
        self.frames = FrameRecorder(
            self.files,
            self.camera,
            camera.width,
            camera.height,
            camera.frame_rate_hz,
            self.rig.recorder,
            self.anchor,
            lent=self._lent,
        )

    def write(self, name: str, log_time_ns: int, data: bytes) -> None:
        """Write one message of a small topic."""
        topic = self._small.get(name)
        if topic is None:
            raise RecorderError(f"{self.path}: topic {name!r} is not one of a recording's small topics")
        sequence = self._sequences[name]
        self._sequences[name] = sequence + 1
        self.files.write(self.files.add_topic(topic), log_time_ns, data, sequence=sequence)

    def finish(self) -> dict[str, Any]:
        """Write what waits, finish the last file, and say what the recording holds."""
        frames = self.frames
        try:
            if frames is not None:
                frames.close()
        finally:  # whatever befell the last frames, the file is finished
            seal = self.files.finish()
        return {
            "path": str(seal.path),
            "frames": frames.frames if frames else 0,
            "lost": frames.lost + frames.dropped if frames else 0,
            "content_id": seal.content_id,
        }

    def abandon(self) -> None:
        """The head could not be written: leave nothing behind."""
        if self.frames is not None:
            self.frames.close()
        self.files.abandon()
