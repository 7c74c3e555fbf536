"""Choice of a recording's mode and of its path to the disk, made once when it opens."""

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
    """Start the recorder of one camera.

    Args:
        sink: file, or series of files. If it never waits for the disk, continuous raw frames are written
            directly from the camera's borrowed buffers; else they are copied.
        frames: camera name, size and rate of the frames.
        config: mode, image format, and times of a window (time span of a strike).
        wall_anchor_ns: log time minus host monotonic time [ns].

    Returns:
        ContinuousRecorder if `config.mode` is "continuous", else WindowRecorder; its thread runs.

    Raises:
        RecorderError: the topics cannot be written to `sink`.
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
