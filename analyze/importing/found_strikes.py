"""Strikes that nobody planned, as the images show them: a plan of what was struck, and the camera's pose.

The object may stand anywhere on the table and in any heading: only its resting face is level. Where the
camera's pose is not known, the resting object gives it: the vertical and the height over the table from all
strikes; the origin of the world frame, and its direction, are those of the strikes' mean placement.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from analyze.cameras.camera_file import CameraFile
from analyze.errors import ImportRefused
from analyze.geometry.object_model import load_object_model
from analyze.geometry.rotations import inverse_transform, nearest_rotation, transform
from analyze.geometry.station import turned_camera
from analyze.importing.camera_pose import MAX_DEVIATION_M, MAX_DEVIATION_RAD, EstimatedCameraPose
from analyze.importing.edge_matches import EdgeMatch, match_edges
from analyze.importing.headings import common_headings, largest_group
from analyze.importing.matching import TipInView
from analyze.importing.options import ImportOptions
from analyze.importing.stated_edges import stated_edges
from analyze.importing.tip_view import TagView, view_by_placed_tag
from analyze.importing.windows import BY_IMAGES, SKIPPED, Clip, FoundTip, stated_ids
from analyze.pipeline.read_evidence import placed_markers
from analyze.planning.possible_tips import PossibleTips
from analyze.planning.view import MAX_MARKER_ANGLE
from analyze.reading.object_file import ObjectFiles
from analyze.tracking.camera_model import camera_from_spec
from analyze.types import Array, CameraModel, Marker
from schemas.strike_plan import FOUND_PLAN_VERSION, Pivot, PlanMethod, PlannedStrike, StrikePlan

MIN_LEVEL_SIGHT = 0.2
"""least length of a camera's direction of sight on the table for it to count, 1 if it looks level"""
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
    if all(marker.T_object_marker is None for marker in markers):
        raise ImportRefused(
            f"{options.object_path}: has no place of a tag on the object (T_object_marker), without which "
            "strikes are recognised only with the plan that was struck: give it (--plan), or measure the "
            "places with a ruler"
        )
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
    matches = match_edges(seen, [every[number] for number in kept], possible, spec, up)
    as_planned = [_camera_as_planned(match, tip) for match, tip in zip(matches, seen, strict=True)]
    place: EstimatedCameraPose | None = None
    if placed is None:
        _refuse_uneven(seen, as_planned)
        headings, T_world_camera, place = _by_object(as_planned)
    else:
        headings, T_world_camera = _headings(as_planned, placed), placed
        _refuse_off_table(seen, as_planned, placed)
    common = common_headings(headings)
    lens = replace(camera_from_spec(camera.calibration), T_world_camera=T_world_camera)
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
        for number, match, heading in zip(kept, matches, headings, strict=True)
    ]
    return FoundStrikes(plan, ids, tuple(found), place)


def _strike_ids(clips: Sequence[Clip], tips: Sequence[FoundTip], strikes: Sequence[str]) -> list[str]:
    """Ids of the strikes: files' names if all are s1, s2 and so on, else numbered in the order of the tips.

    Args:
        clips: the sources.
        tips: tips that become strikes.
        strikes: values of --strike; empty, or one per tip.

    Raises:
        ImportRefused: --strike is not given once per tip, or names a strike, as of a plan.
    """
    stated_ids(clips, tips, strikes, strikes)
    for each in strikes:
        if each not in (SKIPPED, BY_IMAGES):
            raise ImportRefused(
                f"--strike {each}: without a plan strikes have no names: state an edge "
                f"(--edge s1=+x,bottom), or leave a strike out (--strike {SKIPPED})"
            )
    names = [clips[tip.clip].path.stem for tip in tips]
    if len(set(names)) == len(names) and all(re.fullmatch(r"s\d+", name) for name in names):
        return names
    return [f"s{number}" for number in range(1, len(tips) + 1)]


def _camera_as_planned(match: EdgeMatch, tip: TipInView) -> Array:
    """Pose (4, 4) [m] of the camera in W, if the object stood with its edge along W's y through the origin.

    Args:
        match: edge and resting face.
        tip: the object in the camera's view.
    """
    axis = match.best.tip.axis
    T_camera_object = np.eye(4) if tip.view is None else tip.view.T_camera_object
    return transform(axis.R_world_object, axis.p_world_object) @ inverse_transform(T_camera_object)


def _by_object(as_planned: Sequence[Array]) -> tuple[list[float], Array, EstimatedCameraPose]:
    """Heading of each strike [rad], and the camera's pose (4, 4) [m], from the object at rest.

    Headings are those against the largest group of strikes with nearly the same, which has heading 0. The
    pose is the mean over all strikes; its deviations are those of the vertical and of the height.

    Args:
        as_planned: camera's pose in W of each strike, if the object stood as planned.
    """
    sight = [_direction_of_sight(T) for T in as_planned]
    turned = [sight[0] - each for each in sight]
    zero = largest_group(turned)
    headings = [_wrapped(each - zero) for each in turned]
    poses = np.array([_about_z(heading) @ T for heading, T in zip(headings, as_planned, strict=True)])
    mean = transform(nearest_rotation(poses[:, :3, :3].mean(axis=0)), poses[:, :3, 3].mean(axis=0))
    leans = np.arccos(np.clip(poses[:, 2, :3] @ mean[2, :3], -1.0, 1.0))
    rises = poses[:, 2, 3] - mean[2, 3]
    scatter = float(np.sqrt(np.mean(leans**2))), float(np.sqrt(np.mean(rises**2)))
    return headings, mean, EstimatedCameraPose(mean, *scatter, len(poses))


def _headings(as_planned: Sequence[Array], T_world_camera: Array) -> list[float]:
    """Heading of each strike [rad] before a camera of known pose: turn of the object about W's z.

    Args:
        as_planned: camera's pose in W of each strike, if the object stood as planned.
        T_world_camera: (4, 4) pose of the camera in W [m].
    """
    turns = [T_world_camera[:3, :3] @ T[:3, :3].T for T in as_planned]
    return [math.atan2(float(R[1, 0] - R[0, 1]), float(R[0, 0] + R[1, 1])) for R in turns]


def _refuse_uneven(tips: Sequence[TipInView], as_planned: Sequence[Array]) -> None:
    """Check that all strikes show one table before one camera: its vertical, and its height.

    Args:
        tips: the strikes in the camera's view.
        as_planned: camera's pose in W of each strike, if the object stood as planned.

    Raises:
        ImportRefused: one strike differs from the others by more than an object placed by hand.
    """
    ups, heights = np.array([T[2, :3] for T in as_planned]), np.array([T[2, 3] for T in as_planned])
    apart = np.arccos(np.clip(ups @ ups.T, -1.0, 1.0))
    middle = int(np.argmin(np.median(apart, axis=1)))
    off = np.abs(heights - np.median(heights))
    worst = int(np.argmax(np.maximum(apart[middle] / MAX_DEVIATION_RAD, off / MAX_DEVIATION_M)))
    if apart[middle, worst] > MAX_DEVIATION_RAD or off[worst] > MAX_DEVIATION_M:
        raise ImportRefused(
            f"{tips[worst].name}: shows the table tilted by {math.degrees(apart[middle, worst]):.0f} deg and "
            f"{1000 * off[worst]:.0f} mm higher or lower than the other strikes: the camera was moved, or "
            f"the object did not lie on the table: leave it out (--strike {SKIPPED}), or measure the "
            "camera's pose with the board (`analyze calibrate --table`)"
        )


def _refuse_off_table(tips: Sequence[TipInView], as_planned: Sequence[Array], T_world_camera: Array) -> None:
    """Check that the object lay on the table that the camera file's pose refers to.

    Args:
        tips: the strikes in the camera's view.
        as_planned: camera's pose in W of each strike, if the object stood as planned.
        T_world_camera: (4, 4) pose of the camera in W [m].

    Raises:
        ImportRefused: the resting face is tilted, or too high or low.
    """
    for tip, T in zip(tips, as_planned, strict=True):
        lean = math.acos(float(np.clip(T[2, :3] @ T_world_camera[2, :3], -1.0, 1.0)))
        rise = float(T_world_camera[2, 3] - T[2, 3])
        if lean > MAX_DEVIATION_RAD or abs(rise) > MAX_DEVIATION_M:
            raise ImportRefused(
                f"{tip.name}: the object rests {1000 * rise:.0f} mm over the table, tilted by "
                f"{math.degrees(lean):.0f} deg, by the camera's pose (T_world_camera): the camera was moved "
                "after the board was filmed: leave the pose out of the camera file, or leave this strike out "
                f"(--strike {SKIPPED})"
            )


def _direction_of_sight(T_world_camera: Array) -> float:
    """Angle [rad] about z of the direction in which a camera looks; if it looks down, of its upper side."""
    ahead = T_world_camera[:2, 2]
    if float(np.linalg.norm(ahead)) < MIN_LEVEL_SIGHT:
        ahead = -T_world_camera[:2, 1]
    return math.atan2(float(ahead[1]), float(ahead[0]))


def _about_z(angle: float) -> Array:
    """Pose (4, 4) that turns about z by an angle [rad]."""
    turn = np.eye(4)
    turn[:2, :2] = [[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]]
    return turn


def _wrapped(angle: float) -> float:
    """Angle between -pi and pi [rad] that equals `angle` up to whole turns."""
    return math.remainder(angle, 2 * math.pi)


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
