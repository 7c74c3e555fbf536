"""Matches tips in videos with planned strikes, by the tag at rest and the edge of the tip.

The pose of the object in the camera's frame shows which side faces the camera; the line about which the
object turns is an edge of the object, and its sense shows on which face beside that edge the object rested.
Neither needs the camera's pose.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from analyze.errors import ImportRefused
from analyze.importing.tip_view import TipView, TurningLine
from analyze.importing.windows import SKIPPED
from analyze.tags.side_names import side_name
from analyze.types import Array
from schemas.object_spec import ObjectSpec
from schemas.strike_plan import PlannedStrike, StrikePlan

MAX_TILT = math.radians(20.0)
"""largest angle between the line about which an object turned and a planned edge [rad]"""
MAX_OFFSET_M, MAX_OFFSET_SHARE = 0.005, 0.15
"""largest distance between these lines: a length [m] plus a share of the line's distance from the tag, which
cover an error of the tag's stated place of several millimetres"""
MAX_CAMERA_ANGLE = math.radians(60.0)
"""largest angle between the camera's direction of sight and the planned edge [rad]"""
MAX_UP_ANGLE = math.radians(35.0)
"""largest angle between a placement's vertical, as the camera sees it, and that of the other strikes [rad]"""
MIN_LEAD = 0.3
"""least difference between the mismatches of two placements (`Placement.mismatch`, 1 is the largest allowed)
for the better one to be chosen"""


@dataclass(frozen=True)
class TipInView:
    """Tip found in a clip, with the object's pose at rest and the line about which it turned, as seen."""

    name: str
    """name of the clip's file, with the time in it if it shows several strikes"""
    view: TipView | None
    """pose at rest and turning line; None if no tag of known pose on the object is seen"""
    why_no_tip: str = ""
    """part of a sentence: why no tip was found in the clip; "" if one was"""


@dataclass(frozen=True)
class Placement:
    """Planned strikes for which the object is put down in the same way; a video cannot distinguish them."""

    strikes: tuple[PlannedStrike, ...]
    """the strikes, in the plan's order"""

    @property
    def names(self) -> str:
        """Ids of the strikes: "s1, s2"."""
        return ", ".join(strike.id for strike in self.strikes)

    def is_seen_from_its_end(self, view: TipView) -> bool:
        """True if the camera looks along the edge in the planned direction, to within `MAX_CAMERA_ANGLE`."""
        return float(_sight(view) @ _planned_sight(self.strikes[0])) > math.cos(MAX_CAMERA_ANGLE)

    def differences(self, line: TurningLine) -> tuple[float, float]:
        """Angle [rad] and distance [m], at the tag, between a turning line and the planned edge."""
        pivot = self.strikes[0].pivot
        direction, apart = np.array(pivot.direction), line.point - np.array(pivot.point)
        angle = math.acos(float(np.clip(direction @ line.direction, -1.0, 1.0)))
        return angle, float(np.linalg.norm(apart - direction * (direction @ apart)))

    def mismatches(self, line: TurningLine) -> tuple[float, float]:
        """Angle and distance between a turning line and the planned edge, relative to the largest allowed."""
        angle, offset = self.differences(line)
        return angle / MAX_TILT, offset / (MAX_OFFSET_M + MAX_OFFSET_SHARE * line.distance)

    def mismatch(self, view: TipView) -> float:
        """Mismatch of a tip with this placement: 0 for a perfect match, above 1 if it is excluded.

        It is infinite if the camera sees the object from another end, or no turning line was determined.
        """
        if view.line is None or not self.is_seen_from_its_end(view):
            return math.inf
        return math.hypot(*self.mismatches(view.line))

    def up_in_camera(self, view: TipView) -> Array:
        """Unit vector (3,) upwards in the camera's frame, if the view shows the object in this placement."""
        return view.T_camera_object[:3, :3] @ np.array(self.strikes[0].R_world_object)[2]

    def words(self, spec: ObjectSpec) -> str:
        """Placement in words: sides on the table and towards the camera, and the one that it tips towards."""
        strike = self.strikes[0]
        R_world_object = np.array(strike.R_world_object)
        under = side_name(spec, -R_world_object[2])
        facing = side_name(spec, -_planned_sight(strike))
        return (
            f"{under} underneath, {facing} to the camera, tips towards {side_name(spec, R_world_object[0])}"
        )


@dataclass(frozen=True)
class Match:
    """Placement of the plan that a tip shows; without one, why it shows none or why it is not known which."""

    placement: Placement | None
    """the placement; None if it is not determined"""
    misfit: str = ""
    """sentence: the object tips as in no strike of the plan; "" if it does, or nothing is known"""
    unknown: str = ""
    """part of a sentence: why the placement is not determined; "" if it is, or if there is a misfit"""


def match_strikes(
    tips: Sequence[TipInView], plan: StrikePlan, spec: ObjectSpec, up_in_camera: Array | None
) -> list[Match]:
    """Placement of the plan that each tip shows.

    Args:
        tips: tips found in the videos.
        plan: strike plan with the placements.
        spec: object file, for the names of sides in messages.
        up_in_camera: (3,) unit vector upwards in the camera's frame; None if the camera's pose is unknown:
            then tips that only one placement explains determine it for the others.
    """
    placements = placements_of(plan)
    choices = [_ranked(tip, placements) for tip in tips]
    up = _common_up(tips, choices) if up_in_camera is None else up_in_camera
    matches: list[Match] = []
    for tip, found in zip(tips, choices, strict=True):
        left = found
        if up is not None and len(found) > 1:
            left = [each for each in found if _rises(each, tip.view, up)]
        if not found and tip.view is not None and tip.view.line is not None:
            matches.append(Match(None, _no_such_strike(tip.name, tip.view, tip.view.line, placements, spec)))
        elif len(left) == 1:
            matches.append(Match(left[0]))
        else:
            matches.append(Match(None, unknown=_why_unknown(tip, left or found)))
    return matches


def matched_ids(matches: Sequence[Match], stated: Sequence[str | None]) -> list[str] | None:
    """Planned ids of the tips, as stated or by the placements that they show; None if one is not determined.

    Tips of one placement are the strikes of that placement that are not stated, in the plan's order; further
    tips repeat them.

    Args:
        matches: placement that each tip shows.
        stated: planned id of each tip, `SKIPPED` for one left out; None where it is not stated.
    """
    given: Counter[str] = Counter()
    ids: list[str] = []
    for match, name in zip(matches, stated, strict=True):
        if name is not None:
            ids.append(name)
            continue
        if match.placement is None:
            return None
        strikes = match.placement.strikes
        left = [strike.id for strike in strikes if strike.id not in stated] or [each.id for each in strikes]
        ids.append(left[given[match.placement.names] % len(left)])
        given[match.placement.names] += 1
    return ids


def refuse_contradiction(
    tips: Sequence[TipInView],
    ids: Sequence[str | None],
    matches: Sequence[Match],
    plan: StrikePlan,
    spec: ObjectSpec,
    stated_by: str,
) -> None:
    """Check the stated ids of tips against the placements that the images show.

    Args:
        tips: tips found in the videos.
        ids: planned id of each tip; `SKIPPED` for those left out, None for those of which it is not stated.
        matches: placement that each tip shows.
        plan: strike plan.
        spec: object file, for the names of sides.
        stated_by: what states the ids, for the message, such as "its name".

    Raises:
        ImportRefused: a tip shows another placement of the plan than that of its id.
    """
    placement_of = {strike.id: each for each in placements_of(plan) for strike in each.strikes}
    for tip, strike_id, match in zip(tips, ids, matches, strict=True):
        shown = match.placement
        if strike_id in (None, SKIPPED) or shown is None or placement_of[strike_id].names == shown.names:
            continue
        raise ImportRefused(
            f"{tip.name}: by {stated_by} it is {strike_id} ({placement_of[strike_id].words(spec)}), but the "
            f"images show {shown.names} ({shown.words(spec)}): import it as {shown.strikes[0].id}, or leave "
            f"it out (--strike {SKIPPED})"
        )


def refuse_undetermined(
    tips: Sequence[TipInView], matches: Sequence[Match], stated: Sequence[str | None]
) -> None:
    """Check that the images show the placement of every tip that is not stated, if they show that of any.

    Args:
        tips: tips found in the videos.
        matches: placement that each tip shows.
        stated: planned id of each tip; None where it is not stated.

    Raises:
        ImportRefused: the placements of some tips are recognised, and that of another one is not.
    """
    if all(match.placement is None for match in matches):
        return
    for tip, match, name in zip(tips, matches, stated, strict=True):
        if match.unknown and name is None:
            raise ImportRefused(
                f"{tip.name}: which strike it shows is unknown: {match.unknown}; the others are recognised: "
                f"name it with --strike ID, or leave it out (--strike {SKIPPED})"
            )


def placements_of(plan: StrikePlan) -> list[Placement]:
    """Placements of a plan, each with its strikes, in the plan's order."""
    groups: dict[tuple[object, ...], list[PlannedStrike]] = {}
    for strike in plan.strikes:
        pose = np.round([*np.ravel(strike.R_world_object), *strike.p_world_object, strike.heading_rad], 4)
        groups.setdefault(tuple((pose + 0.0).tolist()), []).append(strike)
    return [Placement(tuple(strikes)) for strikes in groups.values()]


def _ranked(tip: TipInView, placements: Sequence[Placement]) -> list[Placement]:
    """Placements that explain a tip, the best first; those that explain it clearly worse are left out."""
    if tip.view is None:
        return []
    rated = sorted((each.mismatch(tip.view), number) for number, each in enumerate(placements))
    best = rated[0][0]
    return [placements[number] for rating, number in rated if rating <= min(1.0, best + MIN_LEAD)]


def _why_unknown(tip: TipInView, found: Sequence[Placement]) -> str:
    """Part of a sentence: why the placement that a tip shows is not determined.

    Args:
        tip: the tip.
        found: placements that explain it equally well; none if nothing is known of its turning line.
    """
    if tip.why_no_tip:
        return tip.why_no_tip
    if tip.view is None:
        return "no tag with T_object_marker in the object file is seen at rest"
    if not found:
        return "its tag is seen in too little of the tip"
    return f"it may be {' or '.join(each.names for each in found)}, which look alike"


def _common_up(tips: Sequence[TipInView], choices: Sequence[Sequence[Placement]]) -> Array | None:
    """Unit vector (3,) upwards in the camera's frame, from the tips that only one placement explains.

    None if there is no such tip, or if they disagree by more than `MAX_UP_ANGLE`.
    """
    seen = [
        found[0].up_in_camera(tip.view)
        for tip, found in zip(tips, choices, strict=True)
        if len(found) == 1 and tip.view is not None
    ]
    if not seen:
        return None
    total: Array = np.sum(seen, axis=0)
    up: Array = total / max(float(np.linalg.norm(total)), 1e-9)
    return up if min(float(each @ up) for each in seen) > math.cos(MAX_UP_ANGLE) else None


def _rises(placement: Placement, view: TipView | None, up: Array) -> bool:
    """True if the upward direction of a placement, by a view of the object, is near to the direction `up`.

    Near is within `MAX_UP_ANGLE`. `up` (3,) is a unit vector in the camera's frame. False without a view.
    """
    return view is not None and float(placement.up_in_camera(view) @ up) > math.cos(MAX_UP_ANGLE)


def _sight(view: TipView) -> Array:
    """Unit direction (3,) in which the camera looks, in the object's frame O, with the object at rest."""
    return view.T_camera_object[2, :3]


def _planned_sight(strike: PlannedStrike) -> Array:
    """Unit direction (3,) of the camera's sight in a strike as planned, in the object frame O.

    The camera looks along +y of the world frame of a strike with heading 0. The heading is the angle by which
    object and striker are turned about the vertical; the camera is not turned.
    """
    heading = strike.heading_rad
    return np.array(strike.R_world_object).T @ np.array([math.sin(heading), math.cos(heading), 0.0])


def _no_such_strike(
    name: str, view: TipView, line: TurningLine, placements: Sequence[Placement], spec: ObjectSpec
) -> str:
    """Sentence: the images show a tip that the plan does not have; with the planned one that is nearest.

    Args:
        name: name of the clip.
        view: pose of the object at rest.
        line: line about which the object turned.
        placements: placements of the plan.
        spec: object file, for the names of sides.
    """
    facing = side_name(spec, _nearest_axis(-_sight(view)))
    ends = [each for each in placements if each.is_seen_from_its_end(view)]
    if not ends:
        planned = sorted({side_name(spec, -_planned_sight(each.strikes[0])) for each in placements})
        return (
            f"{name}: shows the object with {facing} to the camera, the plan's strikes show "
            f"{' or '.join(planned)}"
        )
    nearest = min(ends, key=lambda each: math.hypot(*each.mismatches(line)))
    angle, offset = nearest.differences(line)
    return (
        f"{name}: with {facing} to the camera the object tips over an edge of no planned strike; nearest is "
        f"{nearest.names} ({nearest.words(spec)}), whose edge is {math.degrees(angle):.0f} deg and "
        f"{1000 * offset:.0f} mm off"
    )


def _nearest_axis(direction: Array) -> Array:
    """Signed unit vector (3,) along the coordinate axis nearest to `direction` (3,)."""
    axis = np.zeros(3)
    largest = int(np.argmax(np.abs(direction)))
    axis[largest] = math.copysign(1.0, float(direction[largest]))
    return axis
