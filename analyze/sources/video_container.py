"""Reads properties that a video file's container states: stream, capture rate, duration and date."""

from __future__ import annotations

from datetime import datetime
from pathlib import Path

import av
from av.container import InputContainer

from analyze.errors import ImportRefused
from analyze.sources.frame_timing import FrameTiming
from schemas.input_file import open_file

CAPTURE_RATE_KEY = "com.android.capture.fps"
"""metadata of slow motion on Android phones: the capture rate, where the stamps are those of playing"""
MAX_RATE_HZ = 1e6
"""largest capture rate that is believed [Hz]"""
MP4_SUFFIXES = {".mp4", ".mov", ".m4v", ".3gp"}
VIDEO_SUFFIXES = MP4_SUFFIXES | {".mkv", ".webm", ".avi", ".mts", ".m2ts", ".mpg", ".mpeg", ".wmv"}
"""endings of the names of common video files; others are read as well, by their content"""


def begins_like_mp4(path: Path) -> bool:
    """True if the file begins with one of the boxes (units of data) that begin an MP4 or QuickTime file."""
    with open_file(path) as file:
        return file.read(8)[4:] in {b"ftyp", b"moov", b"mdat", b"wide", b"free"}


def video_stream(container: InputContainer, path: Path) -> av.VideoStream:
    """First video stream of a file that FFmpeg has opened.

    Raises:
        ImportRefused: the file has no video stream, or one in an unknown codec.
    """
    if not container.streams.video:
        raise ImportRefused(f"{path}: contains no video: name a file that does")
    stream = container.streams.video[0]
    if stream.codec_context is None:  # FFmpeg has no decoder for it, whatever the type's declaration says
        raise ImportRefused(f"{path}: its video is in no known codec, or its head is damaged: copy it again")
    return stream


def capture_rate_hz(container: InputContainer) -> float | None:
    """Capture rate [Hz] that a video file states under `CAPTURE_RATE_KEY` in its metadata.

    None if it states none, or one outside 1 to 1e6.
    """
    try:
        rate = float(container.metadata.get(CAPTURE_RATE_KEY) or "")
    except ValueError:
        return None
    return rate if 1 <= rate <= MAX_RATE_HZ else None


def stated_end_s(container: InputContainer, timing: FrameTiming) -> float | None:
    """Time [s] that the last frame of a complete video file must reach; else the file is cut short.

    It is a capture time since the first frame: the stated playing duration over `timing.slowed` (playing time
    over capture time), less 2.5 frame intervals, or less 1 s if the file has other streams, which may last
    longer.

    Returns:
        The time; None if the file states no duration. A GIF states none: FFmpeg's is the sum of what the
        file has, with a last image that may be held for long.
    """
    if container.duration is None or container.format.name == "gif":
        return None
    # A sound track may be a moment longer.
    slack_s = 2.5 * timing.interval_s if len(container.streams) == 1 else 1.0
    return container.duration / av.time_base / float(timing.slowed) - slack_s


def wall_start_ns(container: InputContainer) -> int | None:
    """Wall-clock time of the recording that a video file states, to the second [ns since 1970].

    None if it states none, or a time up to 1970, as a camera whose clock is not set does.
    """
    try:
        stated = datetime.fromisoformat(str(container.metadata.get("creation_time", "")))
    except ValueError:
        return None
    wall_ns = round(stated.timestamp()) * 10**9
    return wall_ns if wall_ns > 0 else None  # a camera without a clock writes 1970 or 1904
