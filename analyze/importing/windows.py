"""Assigns parts of the sources (strike windows) to the planned strikes that they show."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from analyze.errors import ImportRefused
from analyze.importing.onsets import Onset
from schemas.wording import counted

SKIPPED = "-"
"""value of the option --strike, in place of an id, that leaves a strike out"""
BY_IMAGES = "auto"
"""value of the option --strike, in place of an id, for a strike that the images shall show"""
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
    turned_back: bool = False
    """True if a marker at rest turned the other way than in the plan's strikes"""

    @property
    def why_no_strike(self) -> str:
        """Part of a sentence: the reason why no strike was found in the searched clip, and a remedy."""
        if not self.rested:
            return (
                "its tag is seen, but is never at rest: put the camera on a stand, take your hand off the "
                "object, and film from a second before the strike"
            )
        if self.turned_back:
            return (
                "its tag turns the other way round than in the plan's strikes: put the object down as its "
                "card shows, and film it from the same end of the edge"
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
    tip: int = 0
    """index of the tip in the list of those found"""

    @property
    def strike_id(self) -> str:
        """Id of the strike in the recording: its id in the plan and the number of the attempt, as "s2.1"."""
        return f"{self.plan_strike_id}.{self.attempt}"


@dataclass(frozen=True)
class FoundTip:
    """Tip found in a clip, or a whole clip in which none was found, that becomes one strike."""

    clip: int
    """index of the clip in the list of those imported"""
    onset: Onset | None
    """onset of the tip; None if none was searched for, or found"""
    name: str
    """name of the clip's file and, if the clip shows several strikes, the time in it: "a.mp4 at 2.3 s\""""


def found_tips(clips: Sequence[Clip], split: bool) -> tuple[FoundTip, ...]:
    """Tips that become strikes, in the order of the clips and of their times.

    Args:
        clips: clips in the order in which they were given.
        split: True to take every tip of the only clip, False for the first tip of each clip.

    Raises:
        ImportRefused: `split`, and the clip shows no tip.
    """
    if not split:
        return tuple(
            FoundTip(number, clip.onsets[0] if clip.onsets else None, clip.path.name)
            for number, clip in enumerate(clips)
        )
    clip = clips[0]
    if not clip.onsets:
        raise ImportRefused(f"{clip.path}: no strike is found in it: {clip.why_no_strike}")
    times = [f" at {onset.time_ns * 1e-9:.1f} s" if len(clip.onsets) > 1 else "" for onset in clip.onsets]
    return tuple(
        FoundTip(0, onset, clip.path.name + at) for onset, at in zip(clip.onsets, times, strict=True)
    )


def stated_ids(
    clips: Sequence[Clip], tips: Sequence[FoundTip], planned: Sequence[str], strike_ids: Sequence[str]
) -> list[str | None]:
    """Planned ids of the tips as the option --strike or the names of the clips' files state them.

    Args:
        clips: clips in the order in which they were given.
        tips: tips that become strikes.
        planned: ids of the plan's strikes.
        strike_ids: values of --strike, `SKIPPED` to leave one out, `BY_IMAGES` to state nothing; if empty,
            names of files without suffix count that are ids of the plan, if no clip shows several strikes.

    Returns:
        One id per tip; None for a tip of which nothing is stated.

    Raises:
        ImportRefused: --strike is not given once per tip, or names no strike of the plan.
    """
    if not strike_ids:
        names = [clips[tip.clip].path.stem for tip in tips]
        is_split = len(tips) > len(clips)
        return [name if name in planned and not is_split else None for name in names]
    if len(strike_ids) != len(tips):
        if len(clips) == 1:
            raise ImportRefused(
                f"{clips[0].path}: {_shows(clips[0], tips)}, but --strike is given {len(strike_ids)} times: "
                "give one for each"
            )
        raise ImportRefused(
            f"{len(strike_ids)} times --strike for {counted(len(clips), 'source')}: give one for each, in "
            f"their order, {SKIPPED} to leave one out"
        )
    for each in strike_ids:
        if each not in planned and each not in (SKIPPED, BY_IMAGES):
            raise ImportRefused(f"--strike {each}: the plan has {', '.join(planned)}")
    return [None if each == BY_IMAGES else each for each in strike_ids]


def ids_in_order(
    clips: Sequence[Clip], tips: Sequence[FoundTip], planned: Sequence[str], split: bool
) -> list[str]:
    """Ids of the plan's strikes in its order, for tips of which nothing else is known.

    Args:
        clips: clips in the order in which they were given.
        tips: tips that become strikes.
        planned: ids of the plan's strikes, in its order.
        split: True if the only clip shows several strikes: there must then be as many as in the plan.

    Raises:
        ImportRefused: the numbers of tips and planned strikes do not fit.
    """
    if split and len(tips) != len(planned):
        raise ImportRefused(
            f"{clips[0].path}: {_shows(clips[0], tips)}, the plan has {len(planned)}: "
            f"name each with --strike ID, in order, {SKIPPED} to leave one out"
        )
    if len(tips) > len(planned):
        raise ImportRefused(
            f"{counted(len(clips), 'source')}, but the plan has {counted(len(planned), 'strike')}: name "
            "each with --strike ID, in order"
        )
    return list(planned[: len(tips)])


def _shows(clip: Clip, tips: Sequence[FoundTip]) -> str:
    """Words for the tips of a clip, with their times [s]: "shows 2 strikes (at 1.2, 5.3 s)"."""
    at = ", ".join(f"{onset.time_ns * 1e-9:.1f}" for onset in clip.onsets)
    return f"shows {counted(len(tips), 'strike')} (at {at} s)"


def strike_windows(
    clips: Sequence[Clip], tips: Sequence[FoundTip], ids: Sequence[str]
) -> tuple[StrikeWindow, ...]:
    """Windows of strikes (parts of sources), in the order of the tips.

    A window ends at the latest where the object rests before the next strike in the same clip (source), or at
    the clip's end.

    Args:
        clips: the sources.
        tips: tips that become strikes; where the onset is None, the window is the whole source.
        ids: planned id of each strike; those with `SKIPPED` get no window.
    """
    attempts: Counter[str] = Counter()
    windows: list[StrikeWindow] = []
    for at, (tip, strike) in enumerate(zip(tips, ids, strict=True)):
        if strike == SKIPPED:
            continue
        attempts[strike] += 1
        start = end = None
        number, onset = tip.clip, tip.onset
        if onset is not None:
            start, end = window_around(onset, clips[number].frame_ns)
            following = tips[at + 1].onset if at + 1 < len(tips) and tips[at + 1].clip == number else None
            if following is not None:
                end = min(end, following.rest_ns)
            last_ns = clips[number].last_ns
            end = end if last_ns is None else min(end, last_ns)
        windows.append(StrikeWindow(number, strike, attempts[strike], start, end, onset, at))
    return tuple(windows)
