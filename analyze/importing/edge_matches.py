"""Recognises the edge over which an object tips, among all edges of all faces on which it may rest.

The line about which the object turned is compared with each edge, and the vertical with each resting face.
The camera file states the vertical, or the strikes determine it together: they were made on one table before
one camera.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from analyze.errors import ImportRefused
from analyze.importing.matching import MAX_OFFSET_M, MAX_OFFSET_SHARE, MIN_LEAD, TipInView
from analyze.importing.stated_edges import StatedEdge
from analyze.importing.tip_view import TipView, TurningLine
from analyze.importing.windows import SKIPPED
from analyze.planning.pivots import PivotAxis
from analyze.planning.possible_tips import PossibleTip, PossibleTips
from analyze.tags.side_names import side_name
from analyze.types import Array
from schemas.object_spec import ObjectSpec

MAX_TURN = math.radians(12.0)
"""largest angle between the line about which an object turned and an edge [rad]: tags placed by ruler are off
by some degrees; an object that tips over something beneath it turns about a line that is no edge"""
MAX_LEAN = math.radians(15.0)
"""largest angle between the vertical and the normal of the face on which an object rests [rad]"""


@dataclass(frozen=True)
class EdgeFit:
    """Possible tip compared with one that is seen: edge with turning line, resting face with vertical."""

    tip: PossibleTip
    """the possible tip"""
    angle: float
    """angle between turning line and edge [rad]"""
    offset: float
    """distance of the turning line from the edge at the tag [m]"""
    allowed: float
    """largest such distance that is allowed [m]"""
    lean: float = 0.0
    """angle between the vertical and the resting face's normal [rad]; 0 if the vertical is unknown"""

    @property
    def mismatch(self) -> float:
        """Mismatch relative to the largest one allowed: 0 for a perfect match, above 1 if it is excluded."""
        return math.hypot(self.angle / MAX_TURN, self.offset / self.allowed, self.lean / MAX_LEAN)

    @property
    def words(self) -> str:
        """How far the tip is off, in words, by the larger of both angles: "0.3 deg, 1.2 mm off"."""
        return f"{math.degrees(max(self.angle, self.lean)):.1f} deg, {1000 * self.offset:.1f} mm off"


@dataclass(frozen=True)
class EdgeMatch:
    """Edge over which an object tips in one clip, with the next one that comes into question."""

    best: EdgeFit
    """the tip that the images show"""
    following: EdgeFit | None
    """the tip that fits best after it; None if there is none"""


def match_edges(
    tips: Sequence[TipInView],
    stated: Sequence[StatedEdge | None],
    possible: PossibleTips,
    spec: ObjectSpec,
    up_in_camera: Array | None,
) -> list[EdgeMatch]:
    """Edge over which the object tips, and face on which it rested, in each clip.

    Args:
        tips: tips found in the videos.
        stated: edge that the user states for each tip; None where nothing is stated.
        possible: all tips that the object can make.
        spec: object file, for the names of sides in messages.
        up_in_camera: (3,) unit vector upwards in the camera's frame; None if the camera's pose is unknown.

    Raises:
        ImportRefused: a tip is not seen well enough, is over no edge of the shape, contradicts the vertical
            or what is stated, or may be over several edges.
    """
    seen: list[list[EdgeFit]] = []
    for tip in tips:
        line = _seen_line(tip)
        shown = [each for each in possible.tips if not each.axis.rolls] + list(
            possible.over_rims(line.direction)
        )
        fits = sorted((_compared(each, line) for each in shown), key=lambda fit: fit.mismatch)
        if fits[0].mismatch > 1:
            raise ImportRefused(
                f"{tip.name}: the object tips over an edge that its shape does not have, or of a face on "
                f"which it cannot stand; nearest is {tip_words(fits[0].tip, spec)}, {fits[0].words}: correct "
                "the tags' places or the shape in the object file, or leave this strike out "
                f"(--strike {SKIPPED})"
            )
        seen.append(fits)
    up = (
        up_in_camera
        if up_in_camera is not None
        else _common_up(tips, _plausible(tips, seen, stated, spec), spec)
    )
    return [
        _chosen(tip, [replace(fit, lean=_lean(fit.tip, tip.view, up)) for fit in fits], statement, spec)
        for tip, fits, statement in zip(tips, seen, stated, strict=True)
    ]


def tip_words(tip: PossibleTip, spec: ObjectSpec) -> str:
    """Tip in words: name of the edge, side on the table, and side that it tips towards."""
    under, ahead = side_name(spec, -tip.axis.plane.up), side_name(spec, tip.axis.tip)
    return f"{tip.axis.id} ({under} underneath, tips towards {ahead})"


def up_in_camera(tip: PossibleTip, view: TipView) -> Array:
    """Unit vector (3,) upwards in the camera's frame, if a view shows the object resting as for this tip."""
    return view.T_camera_object[:3, :3] @ tip.axis.plane.up


def _seen_line(tip: TipInView) -> TurningLine:
    """Line about which the object turns in a tip.

    Raises:
        ImportRefused: no tip is found in the clip, or it is not seen well enough.
    """
    why = tip.why_no_tip
    if not why and tip.view is None:
        why = "no tag with T_object_marker in the object file is seen at rest"
    if tip.view is not None and tip.view.line is not None and not why:
        return tip.view.line
    why = why or "its tag is seen in too little of the tip"
    raise ImportRefused(
        f"{tip.name}: which edge the object tips over is unknown: {why}; leave it out "
        f"(--strike {SKIPPED}), or import it with a plan (--plan)"
    )


def _compared(tip: PossibleTip, line: TurningLine) -> EdgeFit:
    """Possible tip compared with the line about which an object turned.

    Where another line takes over from the edge before balance, the nearer one of both counts.
    """
    axes = [tip.axis] if tip.axis.placed is None else [tip.axis, tip.axis.placed]
    allowed = MAX_OFFSET_M + MAX_OFFSET_SHARE * line.distance
    fits = [EdgeFit(tip, *_differences(axis, line), allowed) for axis in axes]
    return min(fits, key=lambda fit: fit.mismatch)


def _differences(axis: PivotAxis, line: TurningLine) -> tuple[float, float]:
    """Angle [rad] and distance [m], at the tag, between a turning line and an edge."""
    apart = line.point - axis.point
    angle = math.acos(float(np.clip(axis.direction @ line.direction, -1.0, 1.0)))
    return angle, float(np.linalg.norm(apart - axis.direction * (axis.direction @ apart)))


def _plausible(
    tips: Sequence[TipInView],
    seen: Sequence[Sequence[EdgeFit]],
    stated: Sequence[StatedEdge | None],
    spec: ObjectSpec,
) -> list[list[EdgeFit]]:
    """Fits of each tip by its turning line alone, without those clearly worse or not as stated.

    Raises:
        ImportRefused: the images contradict what is stated.
    """
    found: list[list[EdgeFit]] = []
    for tip, fits, statement in zip(tips, seen, stated, strict=True):
        allowed = [fit for fit in fits if fit.mismatch <= 1]
        if statement is not None:
            named = [fit for fit in allowed if statement.names(fit.tip)]
            if not named:
                raise _contradiction(tip, statement, allowed[0], spec)
            allowed = named
        found.append([fit for fit in allowed if fit.mismatch <= allowed[0].mismatch + MIN_LEAD])
    return found


def _common_up(tips: Sequence[TipInView], plausible: Sequence[Sequence[EdgeFit]], spec: ObjectSpec) -> Array:
    """Unit vector (3,) upwards in the camera's frame on which the plausible edges of all tips agree.

    Raises:
        ImportRefused: the tips contradict each other, or agree on several directions.
    """
    ups = [
        [up_in_camera(fit.tip, tip.view) for fit in fits if tip.view is not None]
        for tip, fits in zip(tips, plausible, strict=True)
    ]
    apart = math.cos(MAX_LEAN)
    tried = [up for each in ups for up in each]
    agreeing = [[max(float(up @ one) for one in each) > apart for each in ups] for up in tried]
    most = max(map(sum, agreeing))
    best = [number for number, each in enumerate(agreeing) if sum(each) == most]
    up = tried[best[0]]
    if most < len(tips):
        odd = agreeing[best[0]].index(False)
        raise ImportRefused(
            f"{tips[odd].name}: shows {tip_words(plausible[odd][0].tip, spec)}, but the table is then tilted "
            f"by {math.degrees(_angle(ups[odd][0], up)):.0f} deg against that of the other strikes: was the "
            f"camera moved? Import these by themselves, or leave this one out (--strike {SKIPPED})"
        )
    if any(float(tried[number] @ up) < apart for number in best):
        number = next(i for i, each in enumerate(plausible) if len(each) > 1)
        words = " or ".join(tip_words(fit.tip, spec) for fit in plausible[number])
        raise ImportRefused(
            f"{tips[number].name}: may show {words}: state which (--edge), or give the camera's pose "
            "(`analyze calibrate --table`)"
        )
    total: Array = np.sum([max(each, key=lambda one: float(one @ up)) for each in ups], axis=0)
    return np.asarray(total / np.linalg.norm(total), dtype=np.float64)


def _lean(tip: PossibleTip, view: TipView | None, up: Array) -> float:
    """Angle [rad] between the vertical `up` (3,) in the camera's frame and a resting face's normal."""
    return 0.0 if view is None else _angle(up_in_camera(tip, view), up)


def _angle(one: Array, other: Array) -> float:
    """Angle [rad] between two unit vectors (3,)."""
    return math.acos(float(np.clip(one @ other, -1.0, 1.0)))


def _chosen(
    tip: TipInView, fits: Sequence[EdgeFit], statement: StatedEdge | None, spec: ObjectSpec
) -> EdgeMatch:
    """Edge that a tip shows, from its fits with the vertical known.

    Raises:
        ImportRefused: no edge fits, the images contradict what is stated, or several edges fit.
    """
    ranked = sorted(fits, key=lambda fit: fit.mismatch)
    best = ranked[0]
    if best.mismatch > 1:
        raise ImportRefused(
            f"{tip.name}: no tip of the object fits what is seen; nearest is {tip_words(best.tip, spec)}, "
            f"{best.words}: was the object level on the table, and are the tags' places right? Leave this "
            f"strike out (--strike {SKIPPED})"
        )
    others = ranked[1:]
    if statement is not None:
        named = [fit for fit in ranked if fit.mismatch <= 1 and statement.names(fit.tip)]
        if not named or named[0].mismatch > best.mismatch + MIN_LEAD:
            raise _contradiction(tip, statement, best, spec)
        best, others = named[0], [*named[1:], *(fit for fit in ranked if not statement.names(fit.tip))]
    rivals = others if statement is None else [fit for fit in others if statement.names(fit.tip)]
    if rivals and rivals[0].mismatch <= min(1.0, best.mismatch + MIN_LEAD):
        raise ImportRefused(
            f"{tip.name}: may show {tip_words(best.tip, spec)} ({best.words}) or "
            f"{tip_words(rivals[0].tip, spec)} ({rivals[0].words}): state which (--edge), or leave it out "
            f"(--strike {SKIPPED})"
        )
    return EdgeMatch(best, min(others, key=lambda fit: fit.mismatch, default=None))


def _contradiction(tip: TipInView, statement: StatedEdge, best: EdgeFit, spec: ObjectSpec) -> ImportRefused:
    """Error: the images show another edge than the user states, with both sides."""
    return ImportRefused(
        f"{tip.name}: by --edge {statement.text} it is {statement.words}, but the images show "
        f"{tip_words(best.tip, spec)}, {best.words}: state --edge "
        f"{statement.strike_id}={best.tip.axis.id}, or leave it out (--strike {SKIPPED})"
    )
