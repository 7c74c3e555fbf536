"""Assigns parts of the sources (strike windows) to the planned strikes that they show."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from analyze.errors import ImportRefused
from analyze.importing.onsets import Onset
from schemas.wording import counted

SKIPPED = "-"
"""value of the option --strike, in place of an id, that leaves a strike out"""
BEFORE_ONSET_NS = 500_000_000
"""length of a window before the onset [ns]"""
AFTER_ONSET_NS = 3_000_000_000
"""length of a window after the onset [ns]: a large object falls in two seconds"""
MIN_FRAMES_AFTER_ONSET = 720
"""least number of frames after the onset, so that undeclared slow motion shows enough of the fall"""


@dataclass(frozen=True)
class Clip:
    """A source of images and, if it was searched for strikes, the onsets found in it."""

    path: Path
    """path of the source"""
    onsets: tuple[Onset, ...] = ()
    """onsets of strikes (a marker at rest begins to tip) in the order of their times"""
    last_ns: int | None = None
    """time of the last image on the source's clock [ns]; None if the source was not searched"""
    frame_ns: float = 0.0
    """interval between two images by the source's times [ns]; 0 if the source was not searched"""
    rested: bool = False
    """True if a marker was at rest in view at any time"""

    @property
    def why_no_strike(self) -> str:
        """Part of a sentence: the reason why no strike was found in the searched clip, and a remedy."""
        if not self.rested:
            return (
                "its tag is seen, but is never at rest: put the camera on a stand and take your hand off the "
                "object"
            )
        return (
            "no tag is at rest in view and then tips: record the whole tag, sharp, from a second before the "
            "strike until the object has fallen"
        )


def window_around(onset: Onset, frame_ns: float) -> tuple[int, int]:
    """Start and end [ns] of a strike's window (part of a source) around its onset, both included.

    The times are on the source's clock. The window begins `BEFORE_ONSET_NS` before the onset, but not before
    the marker rested. It is not cut here at the next strike or at the source's end.

    Args:
        onset: onset of the strike (first motion of a marker at rest).
        frame_ns: interval between two images [ns].
    """
    after_ns = max(AFTER_ONSET_NS, round(MIN_FRAMES_AFTER_ONSET * frame_ns))
    return max(onset.time_ns - BEFORE_ONSET_NS, onset.rest_ns), onset.time_ns + after_ns


@dataclass(frozen=True)
class StrikeWindow:
    """Part of a source that shows one strike: the object at rest, struck, and tipping.

    It holds the source's index, the strike's id in the plan, and the times [ns] of the part.
    """

    clip: int
    """index of the source in the list of those imported"""
    plan_strike_id: str
    """id of the strike in the plan"""
    attempt: int
    """number of the attempt at this planned strike, from 1"""
    start_ns: int | None
    """first time on the source's clock [ns], included; None for the source's first image"""
    end_ns: int | None
    """last time on the source's clock [ns], included; None for the source's last image"""
    onset: Onset | None
    """onset of the strike; None if it was not searched for, or not found"""

    @property
    def strike_id(self) -> str:
        """Id of the strike in the recording: its id in the plan and the number of the attempt, as "s2.1"."""
        return f"{self.plan_strike_id}.{self.attempt}"


def one_window_per_clip(
    clips: Sequence[Clip], planned: Sequence[str], strike_ids: Sequence[str]
) -> tuple[StrikeWindow, ...]:
    """Windows (parts of sources) of clips that show one strike each, in the order of the clips.

    A window lies around the clip's first onset (begin of a motion), or is the whole clip if none was found.

    Args:
        clips: clips in the order in which they were given.
        planned: ids of the plan's strikes, in its order.
        strike_ids: planned ids of the clips' strikes, in the clips' order; `SKIPPED` leaves a clip out. If
            empty, the clips' file names without suffix are the ids if all of them are ids of the plan;
            otherwise the plan's order applies.

    Raises:
        ImportRefused: numbers of clips and ids do not fit, or an id is not in the plan.
    """
    names = [clip.path.stem for clip in clips]
    if not strike_ids and len(clips) > len(planned) and not set(names) <= set(planned):
        raise ImportRefused(
            f"{counted(len(clips), 'source')}, but the plan has {counted(len(planned), 'strike')}: name "
            "each with --strike ID, in order"
        )
    ids = list(strike_ids) or (names if set(names) <= set(planned) else list(planned))
    if strike_ids and len(strike_ids) != len(clips):
        raise ImportRefused(
            f"{len(strike_ids)} times --strike for {counted(len(clips), 'source')}: give one for each, in "
            f"their order, {SKIPPED} to leave one out"
        )
    _refuse_unknown(ids, planned)
    first = [(number, clip.onsets[0] if clip.onsets else None) for number, clip in enumerate(clips)]
    return _windows(clips, first, ids)


def split_clip(clip: Clip, planned: Sequence[str], strike_ids: Sequence[str]) -> tuple[StrikeWindow, ...]:
    """Windows (parts of a source) of a clip that shows several strikes, one around each onset.

    They are in the order of their times and do not overlap.

    Args:
        clip: clip that was searched for onsets.
        planned: ids of the plan's strikes, in its order.
        strike_ids: planned ids of the onsets' strikes, in the onsets' order, `SKIPPED` to leave one out; if
            empty the plan's order.

    Raises:
        ImportRefused: there is no onset, the numbers of onsets and ids differ, or an id is not in the plan.
    """
    found = len(clip.onsets)
    at = ", ".join(f"{onset.time_ns * 1e-9:.1f}" for onset in clip.onsets)
    if not found:
        raise ImportRefused(f"{clip.path}: no strike is found in it: {clip.why_no_strike}")
    if not strike_ids and found != len(planned):
        raise ImportRefused(
            f"{clip.path}: shows {counted(found, 'strike')} (at {at} s), the plan has {len(planned)}: "
            f"name each with --strike ID, in order, {SKIPPED} to leave one out"
        )
    if strike_ids and len(strike_ids) != found:
        raise ImportRefused(
            f"{clip.path}: shows {counted(found, 'strike')} (at {at} s), but --strike is given "
            f"{len(strike_ids)} times: give one for each"
        )
    ids = list(strike_ids) or list(planned)
    _refuse_unknown(ids, planned)
    return _windows([clip], [(0, onset) for onset in clip.onsets], ids)


def _refuse_unknown(ids: Iterable[str], planned: Sequence[str]) -> None:
    for each in ids:
        if each not in planned and each != SKIPPED:
            raise ImportRefused(f"--strike {each}: the plan has {', '.join(planned)}")


def _windows(
    clips: Sequence[Clip], found: Sequence[tuple[int, Onset | None]], ids: Sequence[str]
) -> tuple[StrikeWindow, ...]:
    """Windows of strikes (parts of sources), in the order of `found`.

    A window ends at the latest where the object rests before the next strike in the same clip (source), or at
    the clip's end.

    Args:
        clips: the sources.
        found: index of the source and onset of each strike; where the onset is None, the window is the
            whole source.
        ids: planned id of each strike; those with `SKIPPED` get no window.
    """
    attempts: Counter[str] = Counter()
    windows: list[StrikeWindow] = []
    for at, ((number, onset), strike) in enumerate(zip(found, ids, strict=False)):
        if strike == SKIPPED:
            continue
        attempts[strike] += 1
        start = end = None
        if onset is not None:
            start, end = window_around(onset, clips[number].frame_ns)
            following = found[at + 1][1] if at + 1 < len(found) and found[at + 1][0] == number else None
            if following is not None:
                end = min(end, following.rest_ns)
            last_ns = clips[number].last_ns
            end = end if last_ns is None else min(end, last_ns)
        windows.append(StrikeWindow(number, strike, attempts[strike], start, end, onset))
    return tuple(windows)
