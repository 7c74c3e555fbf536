"""Strikes that nobody planned, as the images show them, as a plan of what was struck."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from analyze.cameras.camera_file import CameraFile
from analyze.errors import ImportRefused
from analyze.geometry.object_model import load_object_model
from analyze.geometry.station import turned_camera
from analyze.importing.camera_pose import EstimatedCameraPose
from analyze.importing.edge_matches import MAX_TURN, EdgeMatch, match_edges
from analyze.importing.found_placing import found_placing
from analyze.importing.headings import common_headings
from analyze.importing.matching import MAX_OFFSET_M, TipInView
from analyze.importing.options import ImportOptions
from analyze.importing.stated_edges import stated_edges
from analyze.importing.tip_view import TagView, view_by_placed_tag
from analyze.importing.windows import BY_IMAGES, SKIPPED, Clip, FoundTip, stated_ids
from analyze.pipeline.object_markers import placed_markers
from analyze.planning.possible_tips import SAME_TANGENT, PossibleTip, PossibleTips
from analyze.planning.view import MAX_MARKER_ANGLE
from analyze.reading.object_file import ObjectFiles
from analyze.tracking.camera_model import camera_from_spec
from analyze.types import CameraModel, Marker
from schemas.object_spec import ObjectSpec
from schemas.strike_plan import FOUND_PLAN_VERSION, Pivot, PlanMethod, PlannedStrike, StrikePlan

DOUBTFUL_MISMATCH = 0.6
"""mismatch of a strike with its edge, 1 is the largest allowed, from which on it is remarked"""
WARNING = (
    "nobody planned these strikes: faces, headings and edges were found in the images, and no place or force "
    "of the strikes is known"
)
"""note in plans of strikes that were found in images"""


@dataclass(frozen=True)
class FoundStrike:
    """Strike found in images, with the edge that it shows and the object's heading on the table."""

    strike_id: str
    """id of the strike in the plan of what was struck"""
    match: EdgeMatch
    """edge and resting face, with the next that come into question"""
    heading: float
    """heading as seen, rotation about the vertical [rad]; strikes of a plan that nearly share it have one"""


@dataclass(frozen=True)
class FoundStrikes:
    """Strikes found in images, as a plan of what was struck, with the camera's pose."""

    plan: StrikePlan
    """what was struck"""
    ids: tuple[str, ...]
    """id of each tip in the plan; `SKIPPED` for those that are left out"""
    strikes: tuple[FoundStrike, ...]
    """the strikes, in the order of the tips"""
    place: EstimatedCameraPose | None
    """camera's pose from the resting object; None if the camera file states the pose"""
    remarks: tuple[str, ...]
    """remarks for the user on strikes to look at before agreeing"""


def find_strikes(
    options: ImportOptions,
    files: ObjectFiles,
    camera: CameraFile,
    clips: Sequence[Clip],
    tips: Sequence[FoundTip],
    tags: Sequence[Sequence[TagView]],
) -> FoundStrikes:
    """Strikes that nobody planned, recognised by the tags at rest and the edges that the object tips over.

    Args:
        options: options of the import.
        files: object file and shape.
        camera: lens of the camera and, if known, its pose.
        clips: the sources.
        tips: tips that become strikes.
        tags: for each tip the views of its tags, the best first.

    Raises:
        ImportRefused: an edge is not recognised, contradicts what is stated or the other strikes, or all
            tips are left out.
    """
    spec, markers = files.spec, placed_markers(files.spec)
    names = _strike_ids(clips, tips, options.strikes)
    possible = PossibleTips(load_object_model(spec, files.shape_bytes, files.shape_name), spec)
    every = stated_edges(options.edges, names, possible.tips)
    skipped = [each == SKIPPED for each in options.strikes] or [False] * len(tips)
    kept = [number for number, left_out in enumerate(skipped) if not left_out]
    if not kept:
        raise ImportRefused("every source is left out: nothing remains to import")
    seen = [
        TipInView(
            tips[number].name,
            view_by_placed_tag(tags[number], markers),
            clips[tips[number].clip].why_no_strike if tips[number].onset is None else "",
        )
        for number in kept
    ]
    placed = np.array(camera.calibration.T_world_camera) if camera.placed else None
    up = None if placed is None else placed[2, :3]
    matches = _with_shared_tangents(match_edges(seen, [every[number] for number in kept], possible, spec, up))
    placing = found_placing(seen, matches, placed)
    common = common_headings(placing.headings, [match.best.tip.axis.id for match in matches])
    lens = replace(camera_from_spec(camera.calibration), T_world_camera=placing.T_world_camera)
    strikes = [
        _strike(names[number], match, heading, _facing(match, tags[number], markers), lens)
        for number, match, heading in zip(kept, matches, common, strict=True)
    ]
    plan = StrikePlan(
        schema_version=FOUND_PLAN_VERSION,
        method=PlanMethod.IMAGES,
        object_name=spec.name,
        object_sha256=files.sha256,
        strikes=strikes,
        warnings=[WARNING],
    )
    ids = tuple(SKIPPED if left_out else name for name, left_out in zip(names, skipped, strict=True))
    found = [
        FoundStrike(names[number], match, heading)
        for number, match, heading in zip(kept, matches, placing.headings, strict=True)
    ]
    clip_of = [tips[number].clip for number in kept]
    return FoundStrikes(
        plan, ids, tuple(found), placing.estimated, (*_doubtful(found), *_turned_back(found, clip_of))
    )


def _with_shared_tangents(matches: Sequence[EdgeMatch]) -> list[EdgeMatch]:
    """Matches in which tips over one rim in nearly the same direction are about the tangent of the first."""
    tangents: list[PossibleTip] = []
    found: list[EdgeMatch] = []
    for match in matches:
        tip = match.best.tip
        if tip.axis.rolls:
            alike = [
                other
                for other in tangents
                if other.axis.plane.id == tip.axis.plane.id
                and other.axis.tip @ tip.axis.tip > math.cos(SAME_TANGENT)
            ]
            tip = alike[0] if alike else tip
            tangents += [] if alike else [tip]
        found.append(replace(match, best=replace(match.best, tip=tip)))
    return found


def refuse_unplanned(options: ImportOptions, spec: ObjectSpec) -> None:
    """Check that an import without a plan has what it needs, before the sources are searched.

    Args:
        options: options of the import.
        spec: object file.

    Raises:
        ImportRefused: an option needs a plan, or no tag's place on the object is known.
    """
    if options.whole:
        raise ImportRefused(
            "without a plan (--plan) strikes are recognised by their begin: leave out --whole, so that it is "
            "searched for"
        )
    for each in options.strikes:
        if each not in (SKIPPED, BY_IMAGES):
            raise ImportRefused(
                f"--strike {each}: without a plan strikes have no names: state an edge "
                f"(--edge s1=+x,bottom), or leave a strike out (--strike {SKIPPED})"
            )
    if all(marker.T_object_marker is None for marker in spec.marker):
        raise ImportRefused(
            f"{options.object_path}: has no place of a tag on the object (T_object_marker), without which "
            "strikes are recognised only with the plan that was struck: give it (--plan), or measure the "
            "places with a ruler"
        )


def _doubtful(strikes: Sequence[FoundStrike]) -> Iterator[str]:
    """Yield a remark for each strike whose edge differs much from the line about which the object turned."""
    for strike in strikes:
        best = strike.match.best
        if best.mismatch > DOUBTFUL_MISMATCH:
            yield (
                f"{strike.strike_id}: turns about a line {best.words} the edge {best.tip.axis.id}: was "
                "something under the object, or is a tag's place in the object file not right?"
            )


def _turned_back(strikes: Sequence[FoundStrike], clip_of: Sequence[int]) -> Iterator[str]:
    """Yield a remark for each strike of a clip that turns back over the edge of the one before.

    So does an object that a hand sets up again.

    Args:
        strikes: strikes in the order of their times.
        clip_of: number of the clip of each.
    """
    for number in range(1, len(strikes)):
        before, after = strikes[number - 1].match.best.tip.axis, strikes[number].match.best.tip.axis
        apart = after.point - before.point
        apart = apart - before.direction * float(before.direction @ apart)
        limit = MAX_OFFSET_M + before.radius + after.radius
        back = before.direction @ after.direction < -math.cos(MAX_TURN) and np.linalg.norm(apart) < limit
        if clip_of[number - 1] == clip_of[number] and back:
            yield (
                f"{strikes[number].strike_id}: turns back over the edge of {strikes[number - 1].strike_id}: "
                f"if a hand set the object up again, leave it out (--strike, {SKIPPED} in its place)"
            )


def _strike_ids(clips: Sequence[Clip], tips: Sequence[FoundTip], strikes: Sequence[str]) -> list[str]:
    """Ids of the strikes: files' names if all are s1, s2 and so on, else numbered in the order of the tips.

    Args:
        clips: the sources.
        tips: tips that become strikes.
        strikes: values of --strike; empty, or one per tip.

    Raises:
        ImportRefused: --strike is not given once per tip.
    """
    stated_ids(clips, tips, (), strikes)
    names = [clips[tip.clip].path.stem for tip in tips]
    if len(set(names)) == len(names) and all(re.fullmatch(r"s\d+", name) for name in names):
        return names
    return [f"s{number}" for number in range(1, len(tips) + 1)]


def _facing(match: EdgeMatch, views: Sequence[TagView], markers: Sequence[Marker]) -> list[int | str]:
    """Names of the tags that are seen at rest and face along the edge, the best first; else of all seen.

    Args:
        match: edge and resting face.
        views: views of the tags at rest, the best first.
        markers: markers of the object.
    """
    along, placed = match.best.tip.axis.direction, {marker.id: marker.T_object_marker for marker in markers}
    seen = [view.marker for view in views]
    facing: list[int | str] = []
    for name in seen:
        T = placed.get(name)
        if T is not None and abs(float(T[:3, 2] @ along)) > math.cos(MAX_MARKER_ANGLE):
            facing.append(name)
    return facing or seen


def _strike(
    strike_id: str, match: EdgeMatch, heading: float, markers: list[int | str], camera: CameraModel
) -> PlannedStrike:
    """Entry of the plan for a strike that was found: placement, edge, and what its geometry predicts.

    Args:
        strike_id: id of the strike.
        match: edge and resting face.
        heading: turn of the object about W's z [rad].
        markers: names of the tags to follow.
        camera: camera with its pose in W at heading 0.
    """
    tip, axis = match.best.tip, match.best.tip.axis
    return PlannedStrike(
        id=strike_id,
        plane_id=axis.plane.id,
        axis_id=axis.id,
        R_world_object=axis.R_world_object.tolist(),
        p_world_object=axis.p_world_object.tolist(),
        heading_rad=heading,
        pivot=Pivot(
            point=axis.point.tolist(), direction=axis.direction.tolist(), radius_m=axis.radius, sd_m=axis.sd
        ),
        phi_predicted_rad=tip.expected.phi,
        phi_predicted_sd_rad=tip.phi_sd,
        i_edge_predicted_kg_m2=tip.expected.i_edge,
        visible_markers=markers,
        camera_pose=turned_camera(camera, heading).T_world_camera.tolist(),
        rolls=axis.rolls,
        stands_surely=tip.stands_surely,
    )
