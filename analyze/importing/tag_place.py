"""Place of a tag on the object, from tips of assumed strikes.

A tip shows in the tag's frame M which way is up, and the line about which the object turned. If the strike is
the planned one, up is up and the line is the planned edge, which gives the tag's rotation, and its position
across the edge; the position along it follows from the object's surface, on which the tag lies.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from analyze.geometry.object_model import ObjectModel
from analyze.geometry.rotations import nearest_rotation, transform
from analyze.importing.camera_pose import MAX_DEVIATION_M
from analyze.importing.matching import Placement
from analyze.importing.tip_view import TagView
from analyze.registration.surface import height_over
from analyze.types import Array
from schemas.object_spec import MarkerSpec

MAX_TILT = math.radians(8.0)
"""largest angle between what is up, or a turning line, in one tip and as a tag's place predicts it [rad]"""
MAX_OFFSET_M, MAX_OFFSET_SHARE = 0.001, 0.015
"""largest distance of a turning line from the one that a tag's place predicts: a length [m] plus a share of
its distance from the tag"""
MAX_OVERHANG_M = 0.005
"""largest height of a tag's middle or corner over the surface on which it lies [m]"""
MAX_TILT_ON_SURFACE = math.radians(20.0)
"""largest angle between a tag's normal and that of the surface under it [rad]"""
MIN_FACING = 0.5
"""least cosine between a tag's normal and the edge for the surface to determine the place along the edge"""
MAX_SEARCH_STEPS, SURFACE_TOLERANCE_M = 60, 1e-4
"""most steps along a line to the surface, and height at which it is reached [m]"""


@dataclass(frozen=True)
class TaggedBody:
    """The object's exterior with its tags, on a table before a camera of known pose."""

    model: ObjectModel
    """the object's exterior"""
    tags: Mapping[int | str, MarkerSpec]
    """each tag's size and thickness, by its name"""
    T_world_camera: Array
    """(4, 4) pose of the camera in the world frame, translation in m"""


def tag_place(seen: Sequence[tuple[Placement, TagView]], body: TaggedBody) -> Array | None:
    """T_object_marker (4, 4) [m] of a tag by its tips; None if they contradict each other or the body.

    Its rotation maps up and the direction of the turning line of each tip to those of the plan. Across the
    edges its position follows from the lines, along parallel edges from the body's surface.

    Args:
        seen: each tip's assumed placement, and the tag's view with a turning line.
        body: the object, its tags and the camera.
    """
    rows: list[tuple[Array, Array, Array, TagView]] = []
    for placement, view in seen:
        strike = placement.strikes[0]
        up = np.array(strike.R_world_object)[2]
        # The object rolls on its rounding, at first about the line on the table below the rounding's centre.
        below = np.array(strike.pivot.point) - strike.pivot.radius_m * up
        rows.append((up, np.array(strike.pivot.direction), below, view))
    turns = [_axes(up, along) @ _axes(*_seen_axes(view, body)).T for up, along, _, view in rows]
    R = nearest_rotation(np.sum(turns, axis=0))
    across = [np.eye(3) - np.outer(along, along) for _, along, _, _ in rows]
    total: Array = np.sum(across, axis=0)
    right: Array = np.sum(
        [P @ (point - R @ _line_point(view)) for P, (_, _, point, view) in zip(across, rows, strict=True)],
        axis=0,
    )
    t: Array = np.asarray(np.linalg.pinv(total, rcond=0.02) @ right, dtype=np.float64)
    if any(abs(float(rows[0][1] @ along)) < 1 - 1e-2 for _, along, _, _ in rows):
        shifted: Array | None = t
    else:
        shifted = _moved_to_surface(t, R, seen[0], body)
    if shifted is None or not _lies_on(body.model, body.tags[seen[0][1].marker], R, shifted):
        return None
    for up, along, point, view in rows:
        up_seen, along_seen = _seen_axes(view, body)
        apart = R @ _line_point(view) + shifted - point
        offset = float(np.linalg.norm(apart - along * float(along @ apart)))
        limit = MAX_OFFSET_M + MAX_OFFSET_SHARE * float(np.linalg.norm(_line_point(view)))
        if min(float(R @ up_seen @ up), float(R @ along_seen @ along)) < math.cos(MAX_TILT) or offset > limit:
            return None
    T_object_marker = transform(R, shifted)
    if not all(placement.is_seen_from_its_end(view.on_object(T_object_marker)) for placement, view in seen):
        return None
    return T_object_marker


def _moved_to_surface(t: Array, R: Array, seen: tuple[Placement, TagView], body: TaggedBody) -> Array | None:
    """Position (3,) of a tag in O [m], moved along the edge to the body's surface; None if that misses it.

    A tag that hardly faces along the edge is moved to where the camera sees it, with the object put down as
    planned. None, too, if the two differ by more than the error of an object placed by hand.

    Args:
        t: (3,) position that is right across the edge [m].
        R: (3, 3) rotation from the tag's frame to O.
        seen: the tip's assumed placement, and the tag's view.
        body: the object and the camera.
    """
    placement, view = seen
    strike = placement.strikes[0]
    along, R_world_object = np.array(strike.pivot.direction), np.array(strike.R_world_object)
    heading = strike.heading_rad
    # The plan describes a strike with a heading in W turned by that heading.
    in_world = np.array([-math.sin(heading), math.cos(heading), 0.0])
    p = body.T_world_camera[:3, :3] @ view.T_camera_marker[:3, 3] + body.T_world_camera[:3, 3]
    planned = R_world_object @ t + np.array(strike.p_world_object)
    step = float(in_world @ p - planned[1]) * float((R_world_object @ along)[1])
    as_seen: Array = t + along * step
    facing = float(R[:, 2] @ along)
    if abs(facing) < MIN_FACING:
        return as_seen
    outwards: Array = along * math.copysign(1.0, facing)
    thickness = body.tags[view.marker].thickness_m
    reach = float(np.linalg.norm(body.model.extent)) + thickness
    point: Array = as_seen + outwards * (reach - float(outwards @ as_seen))
    for _ in range(MAX_SEARCH_STEPS):
        height = height_over(body.model, point)[0] - thickness
        if height < SURFACE_TOLERANCE_M:
            return point if abs(float(outwards @ (point - as_seen))) < MAX_DEVIATION_M else None
        point = point - outwards * height
        if float(outwards @ point) < -reach:
            break
    return None


def _lies_on(model: ObjectModel, tag: MarkerSpec, R: Array, t: Array) -> bool:
    """True if a tag lies on the body's surface with its middle and its corners, and faces outwards.

    Args:
        model: the object's exterior.
        tag: the tag, with its size and thickness.
        R: (3, 3) rotation from the tag's frame to O.
        t: (3,) position of its middle in O [m].
    """
    height, normal = height_over(model, t)
    if abs(height - tag.thickness_m) > MAX_OVERHANG_M or float(normal @ R[:, 2]) < math.cos(
        MAX_TILT_ON_SURFACE
    ):
        return False
    corners = [t + 0.5 * tag.size_m * (x * R[:, 0] + y * R[:, 1]) for x in (-1, 1) for y in (-1, 1)]
    return all(abs(height_over(model, corner)[0] - tag.thickness_m) < MAX_OVERHANG_M for corner in corners)


def _seen_axes(view: TagView, body: TaggedBody) -> tuple[Array, Array]:
    """Unit vectors (3,) upwards and along the turning line in the tag's frame, as seen in a tip."""
    up: Array = view.T_camera_marker[:3, :3].T @ body.T_world_camera[2, :3]
    return up, np.zeros(3) if view.line is None else view.line.direction


def _line_point(view: TagView) -> Array:
    """Point (3,) of the turning line nearest to the tag, in the tag's frame [m]."""
    return np.zeros(3) if view.line is None else view.line.point


def _axes(up: Array, along: Array) -> Array:
    """Matrix (3, 3) whose columns are up, the edge's direction, and the horizontal across it."""
    return np.stack([up, along, np.cross(up, along)], axis=-1)
