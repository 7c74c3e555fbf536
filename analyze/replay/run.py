"""Replay a recording: send its parts in order, from a whole, damaged or growing file.

The first strike's images are sent before any numerical module is imported.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from itertools import islice
from typing import TYPE_CHECKING

import rerun as rr

from analyze.errors import RecordingError
from analyze.reading.followed_recording import PART_SUFFIX
from analyze.reading.live_recording import LiveRecording
from analyze.reading.recording import Recording
from analyze.reading.recording_file import STILL_S, RecordingFile, is_fresh
from analyze.replay.layout import ANSWER, SESSION_PAGE
from analyze.replay.pictures import limit_frame_rate, send_pictures
from analyze.replay.sender import ReplayOptions, Sender
from analyze.replay.session_scene import LOGGED_TOPICS, send_event, send_health
from analyze.replay.source import open_readable_part
from analyze.replay.timelines import Timelines
from analyze.replay.viewer import ReplayError
from schemas.wording import counted

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

    from analyze.pipeline.evidence import StrikeSource
    from analyze.progress import Progress
    from analyze.reading.indexed_file import RecordedMessage
    from analyze.replay.target import Target
    from schemas.proto import percuss_pb2 as pb
    from schemas.session_manifest import SessionManifest


@dataclass(frozen=True)
class ReplayResult:
    """Outcome of a replay: its problems, and the time [s since contact] to show first."""

    problems: list[str]
    """Problems, one line each: damage of the recording, else the reason why there is no answer; empty if
    there is neither."""
    moment_s: float
    """Time on `timeline` [s] at which the front page shows a tipping object."""
    timeline: str
    """Name of the timeline of the front page."""


APPLICATION = "percuss"
_POLL_S = 0.1
_NEXT_FILE_S = 2.0
"""Time [s] within which the next file of a recording in several files appears."""
_NO_STRIKE_RATE_HZ, _MAX_NO_STRIKE_IMAGES = 5.0, 600
"""Rate [Hz] and greatest number of images sent if the recording holds no strike."""


def replay_recording(
    place: RecordingFile, target: Target, options: ReplayOptions, progress: Progress
) -> ReplayResult:
    """Send a recording to a target; if it is still being written, follow it strike by strike.

    Args:
        place: file of the recording, and whether it is still growing.
        target: destination.
        options: options given by the user.
        progress: called with (name of the step, units of work done, units in all).

    Returns:
        Problems, and the time [s since contact] to show first.

    Raises:
        RecordingError: nothing of the recording can be read.
        ReplayError: the target does not accept data, or the options name a strike or page that a complete
            recording does not have.
        ViewerClosed: the user closed the viewer before everything was sent.
    """
    if place.growing:
        return _follow(place.path, target, options, progress)
    recording, damage = open_readable_part(place.path)
    with recording:
        return _replay_complete(recording, damage, target, options, progress)


def _begin(
    manifest: SessionManifest, path: Path, origin_ns: int, target: Target, options: ReplayOptions
) -> Sender:
    stream = rr.RecordingStream(APPLICATION, recording_id=manifest.recording_id)
    target.connect(stream)
    name = path.name.removesuffix(PART_SUFFIX).removesuffix(".mcap")
    stream.send_recording_name(name)
    return Sender(Timelines(stream, origin_ns), name, options)


def _replay_complete(
    recording: Recording, damage: str | None, target: Target, options: ReplayOptions, progress: Progress
) -> ReplayResult:
    records = recording.strikes
    _refuse_unknown(recording, options)
    origin_ns = min((record.window_start_ns for record in records), default=0) or _first_time(recording)
    sender = _begin(recording.manifest, recording.path, origin_ns, target, options)
    if damage is not None:
        sender.damage.append(damage)
    sender.add_pages(records, more=False)
    measured = all(record.contact_time_ns for record in records)
    for done, record in enumerate(records):
        progress(f"strike {record.strike_id}", done, len(records) + 1)
        for _ in _images_then_motion(recording, record, sender, more=False):
            if done == 0:
                target.first_strike_sent(sender.timelines.stream)
            target.check()
        if done == 0 and measured:
            _send_events(recording, sender)
        recording.release_memory()
    if not records and not recording.tosses:
        _send_images_without_strikes(recording, sender, options)
    if not measured or not records:
        _send_events(recording, sender)
    target.check()
    return _finish(recording, sender, target, progress)


def _follow(path: Path, target: Target, options: ReplayOptions, progress: Progress) -> ReplayResult:
    sender: Sender | None = None
    damage: str | None = None
    grown = time.monotonic()
    with LiveRecording(path) as live:
        while damage is None:
            small, strikes = live.poll()
            if sender is None and live.ready and (small or strikes):
                origin_ns = min([message.log_time_ns for message in small] or [strikes[0].window_start_ns])
                sender = _begin(live.manifest, live.path, origin_ns, target, options)
                sender.add_pages([], more=True)
            if sender is not None:
                _send_live(live, small, strikes, sender, target, progress)
            if small or strikes:
                grown = time.monotonic()
                continue
            target.check()
            count = len(live.strikes)
            progress("waiting for the next strike", count, count + 1)
            if live.finished and time.monotonic() - grown > _NEXT_FILE_S:
                break
            if not live.finished and not is_fresh(live.path):
                damage = (
                    f"{live.path}: ends early: it has not grown for {STILL_S:.0f} s: "
                    f"run `acquire recover {live.path} -o NEW.mcap`"
                )
            time.sleep(_POLL_S)
        last = live.path
    whole = last.with_suffix("") if last.suffix == PART_SUFFIX else last
    recording, wrong = open_readable_part(whole if whole.exists() else last)
    with recording:
        if sender is None:
            return _replay_complete(recording, damage or wrong, target, options, progress)
        if (problem := damage or wrong) is not None:
            sender.damage.append(problem)
        return _finish(recording, sender, target, progress)


def _send_live(
    live: LiveRecording,
    small: Sequence[RecordedMessage],
    strikes: Sequence[pb.StrikeRecord],
    sender: Sender,
    target: Target,
    progress: Progress,
) -> None:
    for message in small:
        if message.topic in LOGGED_TOPICS:
            try:
                send_event(sender.timelines, message, live.strikes)
            except RecordingError as error:
                sender.damage.append(f"{live.path}: {error}")
    for record in strikes:
        count = len(live.strikes)
        progress(f"strike {record.strike_id}", count - 1, count)
        sender.add_pages([record], more=True)
        for _ in _images_then_motion(live, record, sender, more=True):
            target.first_strike_sent(sender.timelines.stream)
        live.forget_until(record.window_end_ns)


def _images_then_motion(
    source: StrikeSource, record: pb.StrikeRecord, sender: Sender, *, more: bool
) -> Iterator[None]:
    """Send a strike's images and its motion, and yield after each of the two.

    Images come first, so that a viewer shows something at once. Where no striker measured the contact, they
    come after the motion, which shows when it was: their times count from it.

    Args:
        source: recording.
        record: the strike as recorded; its page must have been added.
        sender: where to.
        more: True if further strikes may follow.
    """
    if record.contact_time_ns:
        sender.send_images(source, record)
        yield
    sender.analyse_strike(source, record, more=more)
    if not record.contact_time_ns:
        sender.send_images(source, record)
    yield


def _finish(recording: Recording, sender: Sender, target: Target, progress: Progress) -> ReplayResult:
    count = len(recording.strikes)
    if recording.tosses:
        progress("tosses", count, count + 1)
        sender.send_tosses(recording)
    progress("estimating", count, count + 1)
    try:
        send_health(sender.timelines, recording)
    except RecordingError as error:
        sender.damage.append(str(error))
    sender.send_answer(recording)
    target.sent(sender.timelines.stream)
    problems = sender.no_answer
    if sender.damage:
        problems = [f"{sender.damage[0]} (replayed as far as it can be read: {counted(count, 'strike')})"]
    return ReplayResult(problems, sender.shown_moment_s(), sender.shown_timeline())


def _refuse_unknown(recording: Recording, options: ReplayOptions) -> None:
    strikes = [record.strike_id for record in recording.strikes]
    known = [*strikes, *(record.toss_id for record in recording.tosses)]
    tossed = len(known) > len(strikes)
    for name in sorted(options.exclude - set(known)):
        raise ReplayError(
            f"{recording.path}: no strike {name!r} to exclude: its strikes{' and tosses' * tossed} are "
            f"{', '.join(known) or 'none'}"
        )
    pages = [ANSWER, *known, SESSION_PAGE]
    if options.page is not None and options.page not in pages:
        raise ReplayError(f"{recording.path}: has no page {options.page!r}: choose one of {', '.join(pages)}")


def _first_time(recording: Recording) -> int:
    return min((topic.first_ns for topic in recording.topics() if topic.first_ns), default=0)


def _send_events(recording: Recording, sender: Sender) -> None:
    try:
        for topic in LOGGED_TOPICS:
            for message in recording.messages(topic):
                send_event(sender.timelines, message, recording.strikes)
    except RecordingError as error:
        sender.damage.append(str(error))


def _send_images_without_strikes(recording: Recording, sender: Sender, options: ReplayOptions) -> None:
    """Send images of a recording without a strike, such as one cut before the record of its first strike.

    At most 600 images at 5 Hz are sent; damage of the recording is added to the sender's list.
    """
    try:
        frames = islice(limit_frame_rate(recording.images(), _NO_STRIKE_RATE_HZ), _MAX_NO_STRIKE_IMAGES)
        send_pictures(sender.timelines, "/session/camera", frames, None, options.images)
    except RecordingError as error:
        sender.damage.append(str(error))
