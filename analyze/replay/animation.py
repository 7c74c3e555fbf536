"""Animation of one strike: the tip with its overlay in slow motion, the fitted curve growing beside it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from analyze.reading.recording_file import RecordingFile
from analyze.replay.animated_strike import read_animated_strike
from analyze.replay.animation_file import RATE_HZ, refuse_other_suffix, write_animation
from analyze.replay.source import open_readable_part
from analyze.replay.tip_drawing import TipDrawing
from analyze.replay.viewer import ReplayError

if TYPE_CHECKING:
    from pathlib import Path

    from analyze.progress import Progress
    from analyze.types import IntArray


def animate_strike(
    place: RecordingFile, output: Path, strike_id: str | None, object_path: Path | None, progress: Progress
) -> str:
    """Write an animation of one strike of a recording, and return what it shows in a few words.

    Args:
        place: file of the recording, which must be complete.
        output: the file: .webp, .gif or .mp4.
        strike_id: id of the strike; None for the first good one.
        object_path: object file that replaces the recording's; None for the recording's.
        progress: called with (name of the step, units of work done, units in all).

    Returns:
        Strike, number of pictures, speed and size of the file, for a message.

    Raises:
        ReplayError: the recording is still being written, has no such strike, or the strike has no fitted
            motion; or the file's suffix names no format of animations.
        RecordingError: the recording cannot be read there.
        ShapeError, PlanError: the object file, its shape or the plan cannot be used.
        OutputError: the file cannot be written.
    """
    refuse_other_suffix(output)
    if place.growing:
        raise ReplayError(f"{place.path}: is still being recorded: animate it when the session has ended")
    recording, _ = open_readable_part(place.path)
    with recording:
        strike = read_animated_strike(recording, strike_id, object_path, progress)
    speed = speed_text(strike.time_ns)
    drawing = TipDrawing(strike, speed)
    count = len(strike.images)
    pictures = []
    for i in range(count):
        progress(f"drawing strike {strike.motion.strike_id}", i, count)
        pictures.append(drawing.picture(i))
    size = write_animation(pictures, output, progress)
    return f"strike {strike.motion.strike_id}, {count} pictures, {speed}, {size / 1e6:.1f} MB"


def speed_text(time_ns: IntArray) -> str:
    """Speed at which pictures of these times (n,) [ns] are shown, as text such as "1/5 speed".

    "full speed" from 2/3 of the true speed on; "still picture" for fewer than two pictures.
    """
    if len(time_ns) < 2:
        return "still picture"
    slowing = 1e9 / RATE_HZ / float(np.median(np.diff(time_ns)))
    return f"1/{round(slowing)} speed" if slowing >= 1.5 else "full speed"
