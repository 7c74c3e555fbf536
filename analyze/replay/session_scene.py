"""The session in a replay: what striker, session and log said, frames that were lost, how well the clocks were known."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import rerun as rr
from google.protobuf.message import DecodeError

from analyze.errors import RecordingError
from analyze.replay.palette import CYCLE, RED, SESSION, SKY, STRIKER
from analyze.replay.timelines import contact_of, strike_path
from schemas import topics
from schemas.proto import percuss_pb2 as pb

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from analyze.reading.recording import RecordedMessage, Recording
    from analyze.replay.timelines import Timelines
    from analyze.types import Array, IntArray

NOTED = (topics.STRIKER_EVENT.name, topics.SESSION_STATE.name, topics.LOG.name)
"""topics of which every message is shown"""
_STEP_NS = 500_000_000
"""between points of the camera's clock"""
_TROUBLE = {pb.StrikerEvent.FAULT, pb.StrikerEvent.MISSED, pb.StrikerEvent.STOPPED}


def send_note(timelines: Timelines, message: RecordedMessage, records: Sequence[pb.StrikeRecord]) -> None:
    """One message of a topic in `NOTED`: its text, or the band that it begins.

    Raises:
        RecordingError: it is not what its topic says.
    """
    try:
        _note(timelines, message, records)
    except (DecodeError, ValueError) as error:
        raise RecordingError(f"message on {message.topic} at {message.log_time_ns} is damaged: {error}") from None


def _note(timelines: Timelines, message: RecordedMessage, records: Sequence[pb.StrikeRecord]) -> None:
    inside = next((record for record in records if record.window_start_ns <= message.log_time_ns <= record.window_end_ns), None)
    contact = None if inside is None else contact_of(inside)
    level = rr.TextLogLevel.INFO
    if message.topic == topics.STRIKER_EVENT.name:
        event = pb.StrikerEvent.FromString(bytes(message.data))
        kind = pb.StrikerEvent.Kind.Name(event.kind).lower()
        text = f"{kind} {event.strike_id} {event.text}".strip()
        if event.tip_speed_m_s:
            text += f" at {event.tip_speed_m_s:.3f} m/s"
        if event.kind in _TROUBLE:
            level = rr.TextLogLevel.WARN
        path = "/log/striker"
        timelines.band("/session/striker", kind, message.log_time_ns, None)
        if inside is not None:
            timelines.band(f"{strike_path(inside.strike_id)}/striker", kind, message.log_time_ns, contact)
    elif message.topic == topics.SESSION_STATE.name:
        state = pb.SessionState.FromString(bytes(message.data))
        timelines.band("/session/state", pb.SessionState.State.Name(state.state).lower(), message.log_time_ns, None)
        return  # the log says it in words
    else:
        line = topics.LOG.message.FromString(bytes(message.data))
        text, path = str(getattr(line, "message", "")), "/log/text"
    timelines.at(message.log_time_ns, contact)
    timelines.stream.log(path, rr.TextLog(text, level=level))


def send_lanes(timelines: Timelines, strike_ids: Iterable[str] = ()) -> None:
    """Colours of the bands."""
    timelines.lane("/session/state", SESSION)
    timelines.lane("/session/striker", STRIKER)
    for strike_id in strike_ids:
        timelines.lane(f"{strike_path(strike_id)}/striker", STRIKER)


def send_health(timelines: Timelines, recording: Recording) -> None:
    """Frames lost and the clocks' state over the session.

    Raises:
        RecordingError: the file is damaged there; what came before it is sent.
    """
    name = recording.camera
    found = [(time_ns, meta.frames_lost_before, meta.mapping_sd_ns) for time_ns, meta in recording.timed_frame_meta(name)]
    words = [
        "**Choose the timeline `session` at the bottom**: it counts from the first window. Strikes have their own, `since_contact`.",
        "",
    ]
    if found:
        time_ns, lost, mapping = (np.array(column, dtype=np.int64) for column in zip(*found, strict=True))
        lost[0] = 0  # before the first frame
        total = np.cumsum(lost)
        _step(timelines, "/session/lost/frames", time_ns, total)
        timelines.stream.log("/session/lost/frames", rr.SeriesLines(colors=[RED], names=["frames lost"], widths=[2.0]), static=True)
        kept = np.flatnonzero(np.diff(time_ns // _STEP_NS, prepend=-1))
        timelines.series("/session/clock/mapping", time_ns[kept], None, 1e-3 * mapping[kept].astype(np.float64))
        style = rr.SeriesLines(colors=[SKY], names=["camera to host, sd"], widths=[1.5])
        timelines.stream.log("/session/clock/mapping", style, static=True)
        words.append(f"- camera {name}: {len(found)} frames, **{int(total[-1])} lost**; time known to {1e-3 * np.median(mapping):.0f} µs")
    clocks: dict[str, list[tuple[int, int, int]]] = {}
    for message, sample in recording.decoded(topics.CLOCK_SAMPLE.name, pb.ClockSample):
        middle = (sample.host_before_ns + sample.host_after_ns) // 2
        clocks.setdefault(sample.clock, []).append((message.log_time_ns, middle, sample.device_time_ns))
    for number, (clock, samples) in enumerate(sorted(clocks.items())):
        time_ns, host, device = (np.array(column, dtype=np.int64) for column in zip(*samples, strict=True))
        drift, off = _off_line(host, device)
        path = f"/session/clock{rr.new_entity_path([clock])}"
        timelines.series(path, time_ns, None, 1e-3 * off)
        style = rr.SeriesPoints(colors=[CYCLE[1 + number % 5]], names=[f"{clock}, off its line"], marker_sizes=[2.5])
        timelines.stream.log(path, style, static=True)
        words.append(
            f"- clock {clock}: {len(samples)} samples, drift {drift:+.1f} ppm, {1e-3 * np.std(off):.0f} µs rms off a straight line"
        )
    timelines.stream.log("/session/text", rr.TextDocument("\n".join(words), media_type="text/markdown"), static=True)


def _step(timelines: Timelines, path: str, time_ns: IntArray, total: IntArray) -> None:
    """A staircase: only where it rises, and its ends."""
    rises = np.flatnonzero(np.diff(total))
    shown = np.unique(np.concatenate([[0, len(total) - 1], rises, rises + 1]))
    timelines.series(path, time_ns[shown], None, total[shown].astype(np.float64))


def _off_line(host_ns: IntArray, device_ns: IntArray) -> tuple[float, Array]:
    """Drift [ppm] of a device's clock, and how far each reading lies off the straight line (n,) [ns]."""
    at = (host_ns - host_ns[0]).astype(np.float64)
    ahead = (device_ns - device_ns[0]).astype(np.float64) - at
    if len(at) < 3 or at[-1] <= 0:
        return 0.0, np.zeros_like(at)
    slope, start = np.polyfit(at * 1e-9, ahead, 1)
    return float(slope) * 1e-3, ahead - (slope * at * 1e-9 + start)
