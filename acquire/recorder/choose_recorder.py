"""Choice of a recorder for the rig's recording mode, and of the frames' path to the disk."""

from __future__ import annotations

import math

from acquire.recorder.direct.backlog import BACKLOG_S
from acquire.recorder.direct.borrowed_queue import BorrowedQueue
from acquire.recorder.file_series import FileSeries
from acquire.recorder.frame_file import FrameFile
from acquire.recorder.frame_format import FrameFormat
from acquire.recorder.frame_recorder import ContinuousRecorder, FrameRecorder
from acquire.recorder.paged.copied_queue import CopiedQueue
from acquire.recorder.window_recorder import WindowRecorder
from schemas.rig import RecorderConfig


def choose_recorder(
    sink: FileSeries, frames: FrameFormat, config: RecorderConfig, wall_anchor_ns: int
) -> FrameRecorder:
    """Start the recorder of one camera's frames, of the kind that the configuration requires.

    Args:
        sink: series of files to be written. If it never waits for the disk, raw frames of the continuous mode
            are written directly from the camera's buffers; else frames are copied first.
        frames: camera name, size and rate of the frames.
        config: mode, image format, and times of a window (time span of a strike).
        wall_anchor_ns: log time minus host monotonic time [ns].

    Returns:
        ContinuousRecorder (records every frame) if `config.mode` is "continuous", else WindowRecorder
        (records windows); its thread runs.

    Raises:
        RecorderError: the topics of the frames cannot be declared in `sink`.
    """
    raw = config.image_format == "raw"
    file = FrameFile(sink, frames, wall_anchor_ns, raw=raw)
    if config.mode == "continuous" and raw and sink.never_waits:
        return ContinuousRecorder(BorrowedQueue(file), file, frames, config, wall_anchor_ns)
    # PNG takes longer than the time between two frames: the queue's thread encodes it.
    buffers = math.ceil(frames.frame_rate_hz * (config.pre_trigger_s + BACKLOG_S)) + 2
    queue = CopiedQueue(file, frames, buffers)
    mode = ContinuousRecorder if config.mode == "continuous" else WindowRecorder
    return mode(queue, file, frames, config, wall_anchor_ns)
