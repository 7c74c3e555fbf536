"""Merging of several recordings' evidence (fitted strikes): strikes renamed, shared edges identified.

Recordings are numbered by start time, whatever the order given: `2:s3.1` is strike s3.1 of the second.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import combinations
from typing import TypeVar

import numpy as np

from analyze.errors import EstimationError, MergeError
from analyze.flight.toss import TossMotion
from analyze.geometry.edge_line import SAME_LINE, EdgeLine
from analyze.pipeline.evidence import Evidence, RecordingHead
from analyze.types import TipMotion
from schemas.session_manifest import LevelReading, SessionManifest
from schemas.strike_plan import PlanMethod, PlannedStrike, StrikePlan

V = TypeVar("V")


def by_start_time(heads: Sequence[RecordingHead]) -> list[RecordingHead]:
    """New list of recordings, sorted by start time, or by content id where start times are equal."""
    return sorted(heads, key=_start_key)


def refuse_unmergeable(heads: Sequence[RecordingHead], overridden: bool = False) -> None:
    """Raise MergeError if recordings cannot be merged for one estimate of one object.

    Args:
        heads: two or more recordings.
        overridden: True if an object file given afterwards replaces the recordings' own.

    Raises:
        MergeError: a strike would count twice, the recordings are of different shapes, or their object files
            differ and none was given afterwards.
    """
    for one, other in combinations(heads, 2):
        same = one.manifest.recording_id == other.manifest.recording_id
        twice = sorted(set(one.strike_ids) & set(other.strike_ids)) if same else []
        if one.content_id == other.content_id or twice:
            held = (
                "the same recording"
                if one.content_id == other.content_id
                else f"of one recording, and both hold strike {twice[0]}"
            )
            raise MergeError(
                f"{one.path} and {other.path} are {held}: no strike may count twice: give it once"
            )
        if _geometry(one) != _geometry(other):
            names = (one.manifest.object.name, other.manifest.object.name)
            between = "of different objects" if names[0] != names[1] else "of different shapes"
            raise MergeError(
                f"{one.path} ({names[0]}) and {other.path} ({names[1]}) are {between}: estimate each by"
                " itself"
            )
        if one.manifest.object_sha256 != other.manifest.object_sha256 and not overridden:
            raise MergeError(
                f"{one.path} and {other.path} describe their object differently ({_difference(one, other)}): "
                "if it is the same object, give one object file for both with --object"
            )


def resolve_exclusions(heads: Sequence[RecordingHead], asked: frozenset[str]) -> frozenset[str]:
    """Merged ids of the strikes and tosses that a user excludes.

    A merged id is the strike's own id with the recording's number before it (`2:s3.1`) if there are several
    recordings. The user may give a bare id, without number, where only one recording holds it.

    Args:
        heads: recordings by start time.
        asked: ids as the user gave them, bare or merged.

    Returns:
        Merged ids of the strikes and tosses named.

    Raises:
        EstimationError: no strike, or more than one, has such an id.
    """
    names = {
        merged_id(heads, i, name): name
        for i, head in enumerate(heads)
        for name in (*head.strike_ids, *head.toss_ids)
    }
    found: set[str] = set()
    for name in sorted(asked):
        meant = [name] if name in names else [merged for merged, own in names.items() if own == name]
        if not meant:
            raise EstimationError(
                f"{paths_text(heads)}: no strike {name!r} to exclude: its strikes are"
                f" {', '.join(names) or 'none'}"
            )
        if len(meant) > 1:
            raise EstimationError(
                f"{paths_text(heads)}: more than one strike {name!r} to exclude: give one of"
                f" {', '.join(meant)}"
            )
        found.update(meant)
    return frozenset(found)


def merged_id(heads: Sequence[RecordingHead], index: int, own: str) -> str:
    """Id of a strike among several recordings: the recording's number before its own id (`2:s3.1`).

    With a single recording it is the strike's own id.

    Args:
        heads: recordings by start time.
        index: index of the strike's recording in `heads`; its number is one more.
        own: id of the strike in that recording.
    """
    return own if len(heads) == 1 else f"{index + 1}:{own}"


def paths_text(heads: Sequence[RecordingHead]) -> str:
    """Paths of the recordings, separated by commas, for messages."""
    return ", ".join(str(head.path) for head in heads)


def merge_evidence(evidence: Sequence[Evidence]) -> Evidence:
    """Merge the evidence (fitted strikes) of recordings of one object; their order does not matter.

    Edges are identified by direction, resting face and place: an edge that two plans share gets one id,
    different edges get different ids. A planned strike that an earlier recording's plan holds too, unchanged
    and under the same id, is one planned strike: struck in either recording, it is not missing.
    Object, shape and labels are the first recording's by start time.

    Args:
        evidence: one per recording, at least one.

    Returns:
        Evidence with all strikes, renamed by `merged_id`; that of a single recording is returned unchanged.

    Raises:
        MergeError: a strike would count twice, or the recordings are of different objects or shapes.
    """
    if len(evidence) == 1:
        return evidence[0]
    ordered = sorted(evidence, key=lambda each: _start_key(each.recordings[0]))
    heads = [each.recordings[0] for each in ordered]
    refuse_unmergeable(heads, all(each.object_path_used for each in ordered))

    def merged(tables: Sequence[Mapping[str, V]]) -> dict[str, V]:
        return {
            merged_id(heads, i, name): value
            for i, table in enumerate(tables)
            for name, value in table.items()
        }

    first = ordered[0]
    planned: list[tuple[PlannedStrike, str]] = []
    strikes: list[PlannedStrike] = []
    motions: list[TipMotion] = []
    tosses: list[TossMotion] = []
    recorded_in: dict[str, int] = {}
    for i, (each, ids) in enumerate(zip(ordered, merged_axis_ids(ordered), strict=True)):
        plan_ids: dict[str, str] = {}
        for strike in each.plan.strikes:
            known = next((name for other, name in planned if other == strike), None)
            plan_ids[strike.id] = name = known or merged_id(heads, i, strike.id)
            if known is None:
                planned.append((strike, name))
                strikes.append(strike.model_copy(update={"id": name, "axis_id": ids[strike.axis_id]}))
        for motion in each.motions:
            name = merged_id(heads, i, motion.strike_id)
            motions.append(replace(motion, strike_id=name, plan_strike_id=plan_ids[motion.plan_strike_id]))
            recorded_in[name] = i
        for toss in each.tosses:
            name = merged_id(heads, i, toss.toss_id)
            tosses.append(replace(toss, toss_id=name))
            recorded_in[name] = i
    return replace(
        first,
        recordings=tuple(heads),
        plan=StrikePlan(
            method=_merged_method([each.plan for each in ordered]),
            object_name=first.plan.object_name,
            object_sha256=first.object_sha256,
            strikes=strikes,
        ),
        motions=tuple(motions),
        tracking=merged([each.tracking for each in ordered]),
        frames_lost=merged([each.frames_lost for each in ordered]),
        impacts=merged([each.impacts for each in ordered]),
        choices=merged([each.choices for each in ordered]),
        camera_poses=merged([each.camera_poses for each in ordered]),
        recorded_in=recorded_in,
        tosses=tuple(tosses),
    )


def _merged_method(plans: Sequence[StrikePlan]) -> PlanMethod:
    """Method of the merged plan: some of its strikes lack an aim if they were found in images."""
    if any(plan.method is PlanMethod.IMAGES for plan in plans):
        return PlanMethod.IMAGES
    return PlanMethod.OURS


def merged_axis_ids(ordered: Sequence[Evidence]) -> list[dict[str, str]]:
    """Mapping from the ids of pivot axes in a recording's plan to merged ids, one for each recording.

    An edge has one id in all recordings, that of the first plan that has the edge. If another edge has that
    id already, the recording's number (from 1) is put before it.

    Args:
        ordered: evidence (plan and fitted strikes) of each recording, by start time.
    """
    known: dict[str, EdgeLine] = {}
    return [_axis_ids(each.plan, number, known) for number, each in enumerate(ordered, 1)]


def levelling_indices(recordings: Sequence[RecordingHead]) -> list[int]:
    """Number of each recording's levelling (set-up of the table), from 0 by first appearance.

    A levelling has one unknown tilt of the table. Recordings of one rig with equal level reading and tilt sd
    share one. Rigs without a name count as one rig: that errs on the safe side, since a shared error is not
    averaged away.
    """
    found: list[tuple[str, float, LevelReading | None]] = []
    for recording in recordings:
        level = _level(recording.manifest)
        if level not in found:
            found.append(level)
    return [found.index(_level(recording.manifest)) for recording in recordings]


def _level(manifest: SessionManifest) -> tuple[str, float, LevelReading | None]:
    """Rig name, sd of the table's tilt [rad] and level reading: the identity of a set-up of the table.

    They are those in the manifest (the recording's metadata). Recordings with equal values share one tilt.
    The reading is the tilt [rad] as read from a level or a plumb line; None if there is none.
    """
    return str(manifest.rig.get("name", "")), manifest.gravity_tilt_sd_rad, manifest.level


def _start_key(head: RecordingHead) -> tuple[str, str]:
    """Start time (ISO 8601) and content id (hash) of a recording, by which recordings are sorted."""
    return head.manifest.created, head.content_id


def _geometry(head: RecordingHead) -> tuple[object, ...]:
    """Shape that a recording's plan was made for: hash of the shape file, its unit, box and cylinder.

    Recordings with equal values are of one shape. The values are those recorded, also if another object file
    is given afterwards.
    """
    shape = head.manifest.object.shape
    return head.shape_sha256, shape.unit, shape.box, shape.cylinder


def _difference(one: RecordingHead, other: RecordingHead) -> str:
    """Name of the first entry in which the object files of two recordings differ, for a message.

    If all entries are equal, the text "by their checksums".
    """
    a, b = (head.manifest.object.model_dump(mode="json") for head in (one, other))
    return next((key for key in a if a[key] != b[key]), "by their checksums")


def _axis_ids(plan: StrikePlan, number: int, known: dict[str, EdgeLine]) -> dict[str, str]:
    """Ids that one plan's pivot axes get in the merged plan, keyed by their ids in the plan itself.

    Args:
        plan: strike plan of the recording.
        number: number of the recording, put before an id that another edge has already.
        known: edges of earlier recordings by merged id; it is modified: edges not seen before are added.
    """
    own: dict[str, EdgeLine] = {}
    for strike in plan.strikes:
        own.setdefault(strike.axis_id, edge_line(strike))
    before = dict(known)
    found: dict[str, str] = {}
    for name, edge in own.items():
        candidates = [
            (other != name, edge.distance(line), other)
            for other, line in before.items()
            if other not in found.values()
        ]
        nearest = min((each for each in candidates if each[1] < SAME_LINE), default=None)
        if nearest is not None:
            found[name] = nearest[2]
            continue
        found[name] = name if name not in known else f"{number}:{name}"
        known[found[name]] = edge
    return found


def edge_line(strike: PlannedStrike) -> EdgeLine:
    """Pivot edge of a planned strike: unit direction, upward direction at rest, point and radius [m].

    Directions and point are in the object frame O; the point lies on the centre line of the edge's rounding.
    """
    direction, up = np.array(strike.pivot.direction), np.array(strike.R_world_object)[2]
    return EdgeLine(
        direction / np.linalg.norm(direction), up, np.array(strike.pivot.point), strike.pivot.radius_m
    )
