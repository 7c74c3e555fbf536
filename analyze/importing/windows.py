"""Which part of which source is which planned strike."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from analyze.errors import ImportRefused
from analyze.importing.onsets import Onset

SKIPPED = "-"
"""given in place of a strike's id: none"""
_BEFORE_NS = 500_000_000
"""of a strike's window, before the motion begins"""
_AFTER_NS = 3_000_000_000
"""of it, after: a large object falls in two seconds"""
_AFTER_FRAMES = 720
"""of it, after, at least: a film that plays slower than it says, or than anybody has said, has that much of the fall"""


@dataclass(frozen=True)
class Film:
    """A source that was looked through."""

    path: Path
    onsets: tuple[Onset, ...] = ()
    """by time"""
    last_ns: int | None = None
    """time of the last image; None where it was not looked through"""
    frame_ns: float = 0.0
    """between two images, by the times that the source states"""
    rested: bool = False
    """a marker lay still in view, at any time"""

    @property
    def why_none(self) -> str:
        """Why no strike is seen, and what helps."""
        if not self.rested:
            return "its tag is seen, but never lies still: put the camera on a stand, and take your hand off the object"
        return (
            "no tag lies still in view and then tips: film all of the tag, sharp, from a second before the strike until the object has "
            "fallen"
        )


def around(onset: Onset, frame_ns: float) -> tuple[int, int]:
    """Start and end of a strike's window, both included, if nothing follows: neither another strike nor the film's end."""
    after_ns = max(_AFTER_NS, round(_AFTER_FRAMES * frame_ns))
    return max(onset.time_ns - _BEFORE_NS, onset.rest_ns), onset.time_ns + after_ns


@dataclass(frozen=True)
class StrikeWindow:
    """The images of one strike."""

    film: int
    """number of the source"""
    plan_strike_id: str
    attempt: int
    start_ns: int | None
    """on the source's clock; None: from its first image"""
    end_ns: int | None
    """on the source's clock, included; None: to its last image"""
    onset: Onset | None
    """None: it was not looked for, or not found"""

    @property
    def strike_id(self) -> str:
        """As the recording calls it."""
        return f"{self.plan_strike_id}.{self.attempt}"


def one_each(films: Sequence[Film], planned: Sequence[str], asked: Sequence[str]) -> tuple[StrikeWindow, ...]:
    """Each film is a strike: of the first motion in it, or all of it where none was found.

    Args:
        films: as they were named.
        planned: ids of the plan's strikes, in its order.
        asked: ids of the films' strikes, in their order; none: the films' names where all are ids, else the plan's order.

    Raises:
        ImportRefused: which film is which strike cannot be told.
    """
    names = [film.path.stem for film in films]
    if not asked and len(films) > len(planned) and not set(names) <= set(planned):
        raise ImportRefused(
            f"{len(films)} sources, but the plan has {len(planned)} strikes: say which each is: --strike ID for each, in order"
        )
    ids = list(asked) or (names if set(names) <= set(planned) else list(planned))
    if asked and len(asked) != len(films):
        raise ImportRefused(
            f"{len(asked)} times --strike for {len(films)} sources: give one for each, in their order, {SKIPPED} to leave one out"
        )
    _refuse_unknown(ids, planned)
    first = [(number, film.onsets[0] if film.onsets else None) for number, film in enumerate(films)]
    return _windows(films, first, ids)


def split(film: Film, planned: Sequence[str], asked: Sequence[str]) -> tuple[StrikeWindow, ...]:
    """Each motion in the film is a strike.

    Args:
        film: that was looked through.
        planned: ids of the plan's strikes, in its order.
        asked: ids of the motions' strikes, in their order; none: the plan's order.

    Raises:
        ImportRefused: which motion is which strike cannot be told.
    """
    found = len(film.onsets)
    at = ", ".join(f"{onset.time_ns * 1e-9:.1f}" for onset in film.onsets)
    if not found:
        raise ImportRefused(f"{film.path}: no strike is seen in it: {film.why_none}")
    if not asked and found != len(planned):
        raise ImportRefused(
            f"{film.path}: shows {found} strikes (at {at} s), the plan has {len(planned)}: say which each is: --strike ID for each, "
            f"in order, {SKIPPED} to leave one out"
        )
    if asked and len(asked) != found:
        raise ImportRefused(f"{film.path}: shows {found} strikes (at {at} s), but --strike is given {len(asked)} times: give one for each")
    ids = list(asked) or list(planned)
    _refuse_unknown(ids, planned)
    return _windows([film], [(0, onset) for onset in film.onsets], ids)


def _refuse_unknown(ids: Iterable[str], planned: Sequence[str]) -> None:
    for each in ids:
        if each not in planned and each != SKIPPED:
            raise ImportRefused(f"--strike {each}: the plan has {', '.join(planned)}")


def _windows(films: Sequence[Film], found: Sequence[tuple[int, Onset | None]], ids: Sequence[str]) -> tuple[StrikeWindow, ...]:
    attempts: Counter[str] = Counter()
    windows: list[StrikeWindow] = []
    for at, ((number, onset), strike) in enumerate(zip(found, ids, strict=False)):
        if strike == SKIPPED:
            continue
        attempts[strike] += 1
        start = end = None
        if onset is not None:
            start, end = around(onset, films[number].frame_ns)
            following = found[at + 1][1] if at + 1 < len(found) and found[at + 1][0] == number else None
            if following is not None:
                end = min(end, following.rest_ns)
            last_ns = films[number].last_ns
            end = end if last_ns is None else min(end, last_ns)
        windows.append(StrikeWindow(number, strike, attempts[strike], start, end, onset))
    return tuple(windows)
