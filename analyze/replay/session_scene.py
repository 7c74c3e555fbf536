"""Session page of a replay: events of striker, session and log, lost frames, and clock quality.

The session is the time in which all strikes of the recording were made.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import rerun as rr
from google.protobuf.message import DecodeError

from analyze.errors import RecordingError
from analyze.replay.markdown import as_written
from analyze.replay.palette import CYCLE, RED, SESSION, SKY, STRIKER
from analyze.replay.timelines import strike_path
from schemas import topics
from schemas.proto import percuss_pb2 as pb
from schemas.wording import counted

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from analyze.reading.indexed_file import RecordedMessage
    from analyze.reading.recording import Recording
    from analyze.replay.timelines import Timelines
    from analyze.types import Array, IntArray

LOGGED_TOPICS = (topics.STRIKER_EVENT.name, topics.SESSION_STATE.name, topics.LOG.name)
"""Topics of which every message is shown."""
_CLOCK_STEP_NS = 500_000_000
"""Time [ns] between two points of the camera clock's curve."""
_WARNING_KINDS = {pb.StrikerEvent.FAULT, pb.StrikerEvent.MISSED, pb.StrikerEvent.STOPPED}


def send_event(timelines: Timelines, message: RecordedMessage, records: Sequence[pb.StrikeRecord]) -> None:
    """Send a message of striker, session or log to a replay, as a line of text, change of state, or both.

    Args:
        timelines: timelines of the stream.
        message: message of a topic in `LOGGED_TOPICS`.
        records: strikes as recorded; a message within a strike's time window also gets its time since that
            strike's contact.

    Raises:
        RecordingError: the message does not have its topic's type.
    """
    try:
        _send_event(timelines, message, records)
    except (DecodeError, ValueError) as error:
        raise RecordingError(
            f"message on {message.topic} at {message.log_time_ns} is damaged: {error}"
        ) from None


def _send_event(timelines: Timelines, message: RecordedMessage, records: Sequence[pb.StrikeRecord]) -> None:
    time_ns = message.log_time_ns
    holding = (each for each in records if each.window_start_ns <= time_ns <= each.window_end_ns)
    inside = next(holding, None)
    contact = None if inside is None else timelines.contact_of(inside)
    level = rr.TextLogLevel.INFO
    if message.topic == topics.STRIKER_EVENT.name:
        event = pb.StrikerEvent.FromString(bytes(message.data))
        kind = pb.StrikerEvent.Kind.Name(event.kind).lower()
        text = f"{kind} {event.strike_id} {event.text}".strip()
        if event.tip_speed_m_s:
            text += f" at {event.tip_speed_m_s:.3f} m/s"
        if event.kind in _WARNING_KINDS:
            level = rr.TextLogLevel.WARN
        path = "/log/striker"
        timelines.change_state("/session/striker", kind, time_ns, None)
        if inside is not None:
            timelines.change_state(f"{strike_path(inside.strike_id)}/striker", kind, time_ns, contact)
    elif message.topic == topics.SESSION_STATE.name:
        state = pb.SessionState.FromString(bytes(message.data))
        name = pb.SessionState.State.Name(state.state).lower()
        timelines.change_state("/session/state", name, time_ns, None)
        return  # the log has the same event as text
    else:
        line = topics.LOG.message.FromString(bytes(message.data))
        text, path = str(getattr(line, "message", "")), "/log/text"
    timelines.set_time(time_ns, contact)
    timelines.stream.log(path, rr.TextLog(text, level=level))


def send_state_names(timelines: Timelines, strike_ids: Iterable[str] = ()) -> None:
    """Send to the viewer the names and colours of the states of the session and of the striker.

    The striker's are sent for each page (tab of the viewer) that shows it: the session's, and those of the
    given strikes.

    Args:
        timelines: timelines of the stream.
        strike_ids: ids of strikes whose pages show the striker's state.
    """
    timelines.name_states("/session/state", SESSION)
    timelines.name_states("/session/striker", STRIKER)
    for strike_id in strike_ids:
        timelines.name_states(f"{strike_path(strike_id)}/striker", STRIKER)


def send_health(timelines: Timelines, recording: Recording) -> None:
    """Send curves and a text on lost frames and clock quality over the time of the session.

    Raises:
        RecordingError: the file is damaged; the curves sent before the damage was met stay, the text is not
            sent.
    """
    name = recording.camera
    found = [
        (time_ns, meta.frames_lost_before, meta.mapping_sd_ns)
        for time_ns, meta in recording.timed_frame_meta(name)
    ]
    words = [
        (
            "**Choose the timeline `session` at the bottom**: its zero is the start of the first strike's "
            "window. The strikes' pages use `since_contact`."
        ),
        "",
    ]
    if found:
        time_ns, lost, mapping = (np.array(column, dtype=np.int64) for column in zip(*found, strict=True))
        lost[0] = 0  # before the first frame
        total = np.cumsum(lost)
        _send_lost_frames(timelines, time_ns, total)
        kept = np.flatnonzero(np.diff(time_ns // _CLOCK_STEP_NS, prepend=-1))
        style = rr.SeriesLines(colors=[SKY], names=["camera to host, sd"], widths=[1.5])
        timelines.send_curve("/session/clock/mapping", time_ns[kept], None, 1e-3 * mapping[kept], style)
        words.append(
            f"- camera {as_written(name)}: {counted(len(found), 'frame')}, **{int(total[-1])} lost**; "
            f"time accurate to {1e-3 * np.median(mapping):.0f} µs (1 sd)"
        )
    clocks: dict[str, list[tuple[int, int, int]]] = {}
    for message, sample in recording.decoded(topics.CLOCK_SAMPLE.name, pb.ClockSample):
        middle = (sample.host_before_ns + sample.host_after_ns) // 2
        clocks.setdefault(sample.clock, []).append((message.log_time_ns, middle, sample.device_time_ns))
    for number, (clock, samples) in enumerate(sorted(clocks.items())):
        time_ns, host, device = (np.array(column, dtype=np.int64) for column in zip(*samples, strict=True))
        drift, deviation = _clock_drift(host, device)
        path = f"/session/clock{rr.new_entity_path([clock])}"
        style = rr.SeriesPoints(
            colors=[CYCLE[1 + number % 5]], names=[f"{clock}, deviation from a line"], marker_sizes=[2.5]
        )
        timelines.send_curve(path, time_ns, None, 1e-3 * deviation, style)
        words.append(
            f"- clock {as_written(clock)}: {counted(len(samples), 'sample')}, drift {drift:+.1f} ppm, "
            f"{1e-3 * np.std(deviation):.0f} µs rms deviation from a straight line"
        )
    timelines.log_static("/session/text", rr.TextDocument("\n".join(words), media_type="text/markdown"))


def _send_lost_frames(timelines: Timelines, time_ns: IntArray, total: IntArray) -> None:
    """Send the curve of frames lost since the start, reduced to its two ends and the points at its steps.

    Args:
        timelines: timelines of the stream.
        time_ns: (n,) log times of the frames [ns].
        total: (n,) number of frames lost up to each frame.
    """
    rises = np.flatnonzero(np.diff(total))
    shown = np.unique(np.concatenate([[0, len(total) - 1], rises, rises + 1]))
    style = rr.SeriesLines(colors=[RED], names=["frames lost"], widths=[2.0])
    timelines.send_curve("/session/lost/frames", time_ns[shown], None, total[shown], style)


def _clock_drift(host_ns: IntArray, device_ns: IntArray) -> tuple[float, Array]:
    """Drift of a device's clock against the host's, by a straight line through the samples.

    Args:
        host_ns: (n,) times of the samples on the host's clock [ns].
        device_ns: (n,) times of the samples on the device's clock [ns].

    Returns:
        Drift [ppm], positive if the device's clock runs faster, and deviation (n,) [ns] of the device's
        readings from the line; both 0 for fewer than three samples or an end that is not after the start.
    """
    at = (host_ns - host_ns[0]).astype(np.float64)
    ahead = (device_ns - device_ns[0]).astype(np.float64) - at
    if len(at) < 3 or at[-1] <= 0:
        return 0.0, np.zeros_like(at)
    slope, start = np.polyfit(at * 1e-9, ahead, 1)
    return float(slope) * 1e-3, ahead - (slope * at * 1e-9 + start)
