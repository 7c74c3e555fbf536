"""Headings of strikes that nobody planned, and the camera's pose, from the object at rest on the table.

The object may stand anywhere on the table and in any heading: only its resting face is level. Where the
camera's pose is not known, the resting object gives it: the vertical and the height over the table from all
strikes; the origin of the world frame, and its direction, are those of the strikes' mean placement.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from analyze.errors import ImportRefused
from analyze.geometry.rotations import inverse_transform, nearest_rotation, transform
from analyze.importing.camera_pose import MAX_DEVIATION_M, MAX_DEVIATION_RAD, EstimatedCameraPose
from analyze.importing.edge_matches import EdgeMatch
from analyze.importing.headings import largest_group
from analyze.importing.matching import TipInView
from analyze.importing.windows import SKIPPED
from analyze.types import Array

MIN_LEVEL_SIGHT = 0.2
"""least length of a camera's direction of sight on the table for it to count, 1 if it looks level"""


@dataclass(frozen=True)
class Placing:
    """Headings of the strikes in the world frame, with the camera's pose in it."""

    headings: list[float]
    """heading of each strike, rotation of the object about the vertical [rad]"""
    T_world_camera: Array
    """(4, 4) pose of the camera in W [m]"""
    estimated: EstimatedCameraPose | None
    """the pose with its scatter, if it was estimated from the object"""


def found_placing(
    tips: Sequence[TipInView], matches: Sequence[EdgeMatch], T_world_camera: Array | None
) -> Placing:
    """Headings of strikes and pose of the camera, from the object at rest.

    Args:
        tips: the strikes in the camera's view.
        matches: edge and resting face of each.
        T_world_camera: (4, 4) pose of the camera in W [m]; None if it is unknown.

    Raises:
        ImportRefused: a strike shows another table than the others, or than the camera's pose.
    """
    as_planned = [_camera_as_planned(match, tip) for match, tip in zip(matches, tips, strict=True)]
    if T_world_camera is not None:
        _refuse_off_table(tips, as_planned, T_world_camera)
        return Placing(_headings(as_planned, T_world_camera), T_world_camera, None)
    _refuse_uneven(tips, as_planned)
    return _by_object(as_planned)


def _camera_as_planned(match: EdgeMatch, tip: TipInView) -> Array:
    """Pose (4, 4) [m] of the camera in W, if the object stood with its edge along W's y through the origin.

    Args:
        match: edge and resting face.
        tip: the object in the camera's view.
    """
    axis = match.best.tip.axis
    T_camera_object = np.eye(4) if tip.view is None else tip.view.T_camera_object
    return transform(axis.R_world_object, axis.p_world_object) @ inverse_transform(T_camera_object)


def _by_object(as_planned: Sequence[Array]) -> Placing:
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
    return Placing(headings, mean, EstimatedCameraPose(mean, *scatter, len(poses)))


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
