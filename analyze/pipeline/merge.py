"""Several recordings of one object as one body of evidence: strikes renamed, the same edges recognised, whatever the order given.

Recordings count by the time at which they began: `2:s3.1` is strike s3.1 of the second.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np

from analyze.errors import EstimationError, JoinError
from analyze.geometry.edge_line import SAME_LINE, EdgeLine
from analyze.pipeline.evidence import Evidence, RecordingHead
from analyze.types import TipMotion
from schemas.session_manifest import LevelReading, SessionManifest
from schemas.strike_plan import PlannedStrike, StrikePlan


def in_order(heads: Sequence[RecordingHead]) -> list[RecordingHead]:
    """By the time at which they began, whatever the order in which they were named."""
    return sorted(heads, key=_began)


def refuse_apart(heads: Sequence[RecordingHead], overridden: bool = False) -> None:
    """Say so where recordings cannot be evidence of one object.

    Args:
        heads: two or more.
        overridden: an object file given afterwards takes the place of theirs.

    Raises:
        JoinError: a strike would count twice, or they are of different objects or, whatever file is given afterwards, shapes.
    """
    for one, other in combinations(heads, 2):
        same = one.manifest.recording_id == other.manifest.recording_id
        twice = sorted(set(one.strike_ids) & set(other.strike_ids)) if same else []
        if one.content_id == other.content_id or twice:
            held = "the same recording" if one.content_id == other.content_id else f"of one recording, and both hold strike {twice[0]}"
            raise JoinError(f"{one.path} and {other.path} are {held}: no strike may count twice, name it once")
        if _geometry(one) != _geometry(other):
            names = (one.manifest.object.name, other.manifest.object.name)
            between = "of different objects" if names[0] != names[1] else "of different shapes"
            raise JoinError(f"{one.path} ({names[0]}) and {other.path} ({names[1]}) are {between}: estimate each by itself")
        if one.manifest.object_sha256 != other.manifest.object_sha256 and not overridden:
            raise JoinError(
                f"{one.path} and {other.path} describe their object differently ({_difference(one, other)}): "
                "if it is one, give what holds for both with --object"
            )


def strikes_to_leave_out(heads: Sequence[RecordingHead], asked: frozenset[str]) -> frozenset[str]:
    """Ids, as in the joint, of the strikes asked for; of several recordings a bare id does where only one holds it.

    Args:
        heads: in their order.
        asked: by the user.

    Raises:
        EstimationError: there is no such strike, or more than one.
    """
    names = {joint_id(heads, i, strike): strike for i, head in enumerate(heads) for strike in head.strike_ids}
    found: set[str] = set()
    for name in sorted(asked):
        meant = [name] if name in names else [joint for joint, own in names.items() if own == name]
        if not meant:
            raise EstimationError(f"{paths_text(heads)}: no strike {name!r} to exclude: its strikes are {', '.join(names) or 'none'}")
        if len(meant) > 1:
            raise EstimationError(f"{paths_text(heads)}: more than one strike {name!r} to exclude: say which of {', '.join(meant)}")
        found.update(meant)
    return frozenset(found)


def joint_id(heads: Sequence[RecordingHead], index: int, own: str) -> str:
    """A strike's id in the joint: its own where there is one recording, else with the recording's number before it."""
    return own if len(heads) == 1 else f"{index + 1}:{own}"


def paths_text(heads: Sequence[RecordingHead]) -> str:
    """The files, for messages."""
    return ", ".join(str(head.path) for head in heads)


def join(evidence: Sequence[Evidence]) -> Evidence:
    """One body of evidence of recordings of one object, the same whatever their order.

    Edges are recognised by direction, resting face and place: under one id where two plans mean the same, under two where they do not.

    Args:
        evidence: one per recording.

    Raises:
        JoinError: as `refuse_apart`.
    """
    if len(evidence) == 1:
        return evidence[0]
    ordered = sorted(evidence, key=lambda each: _began(each.recordings[0]))
    heads = [each.recordings[0] for each in ordered]
    refuse_apart(heads, all(each.object_path_used for each in ordered))
    first = ordered[0]
    strikes: list[PlannedStrike] = []
    motions: list[TipMotion] = []
    where: dict[str, int] = {}
    for i, (each, ids) in enumerate(zip(ordered, joint_axes(ordered), strict=True)):
        strikes += [
            strike.model_copy(update={"id": joint_id(heads, i, strike.id), "axis_id": ids[strike.axis_id]}) for strike in each.plan.strikes
        ]
        for motion in each.motions:
            name = joint_id(heads, i, motion.strike_id)
            motions.append(replace(motion, strike_id=name, plan_strike_id=joint_id(heads, i, motion.plan_strike_id)))
            where[name] = i
    return replace(
        first,
        recordings=tuple(heads),
        plan=StrikePlan(object_name=first.plan.object_name, object_sha256=first.object_sha256, strikes=strikes),
        motions=tuple(motions),
        tracking={joint_id(heads, i, name): value for i, each in enumerate(ordered) for name, value in each.tracking.items()},
        frames_lost={joint_id(heads, i, name): value for i, each in enumerate(ordered) for name, value in each.frames_lost.items()},
        blows={joint_id(heads, i, name): value for i, each in enumerate(ordered) for name, value in each.blows.items()},
        recorded_in=where,
    )


def joint_axes(ordered: Sequence[Evidence]) -> list[dict[str, str]]:
    """By recording, what its plan's axes are called in the joint, by their own names: one edge has one name in all."""
    known: dict[str, EdgeLine] = {}
    return [_axis_ids(each.plan, number, known) for number, each in enumerate(ordered, 1)]


def levels_of(recordings: Sequence[RecordingHead]) -> list[int]:
    """Which levelling of a table each recording stands on: one rig with one reading of its level, or one sd, counts as one, levelled once.

    Two rigs without a name count as one too. That errs to the safe side: what is shared is not averaged away.
    """
    found: list[tuple[str, float, LevelReading | None]] = []
    for recording in recordings:
        level = _level(recording.manifest)
        if level not in found:
            found.append(level)
    return [found.index(_level(recording.manifest)) for recording in recordings]


def _level(manifest: SessionManifest) -> tuple[str, float, LevelReading | None]:
    return str(manifest.rig.get("name", "")), manifest.gravity_tilt_sd_rad, manifest.level


def _began(head: RecordingHead) -> tuple[str, str]:
    return head.manifest.created, head.content_id


def _geometry(head: RecordingHead) -> tuple[object, ...]:
    """What of the object cannot be corrected afterwards: edges were planned on it."""
    shape = head.manifest.object.shape
    return head.shape_sha256, shape.unit, shape.box, shape.cylinder


def _difference(one: RecordingHead, other: RecordingHead) -> str:
    """The first entry of the object file that differs."""
    a, b = (head.manifest.object.model_dump(mode="json") for head in (one, other))
    return next((key for key in a if a[key] != b[key]), "by their checksums")


def _axis_ids(plan: StrikePlan, number: int, known: dict[str, EdgeLine]) -> dict[str, str]:
    """Ids in the joint of a plan's axes, by their own ids; those not seen before are added to `known`. Within one plan ids tell."""
    own: dict[str, EdgeLine] = {}
    for strike in plan.strikes:
        own.setdefault(strike.axis_id, edge_line(strike))
    before = dict(known)
    found: dict[str, str] = {}
    for name, edge in own.items():
        rivals = [(other != name, edge.distance(line), other) for other, line in before.items() if other not in found.values()]
        nearest = min((rival for rival in rivals if rival[1] < SAME_LINE), default=None)
        if nearest is not None:
            found[name] = nearest[2]
            continue
        found[name] = name if name not in known else f"{number}:{name}"
        known[found[name]] = edge
    return found


def edge_line(strike: PlannedStrike) -> EdgeLine:
    """The edge of a planned strike, in O."""
    direction, up = np.array(strike.pivot.direction), np.array(strike.R_world_object)[2]
    return EdgeLine(direction / np.linalg.norm(direction), up, np.array(strike.pivot.point), strike.pivot.radius_m)
