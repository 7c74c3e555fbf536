"""Where the camera stood, from the object itself: before each strike it rests where the plan puts it, its tag where its file says.

    T_world_camera = T_world_object T_object_marker T_camera_marker^-1

A hand puts an object down to a degree and a few millimetres; the strikes' mean is better, and how far they are apart says how good.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from analyze.errors import ImportRefused
from analyze.geometry.rotations import angle_between, inverse_transform, nearest_rotation, transform
from analyze.geometry.station import turned_camera
from analyze.tracking.track import track_markers
from analyze.types import Array, CameraModel, ImageFrame, Marker
from schemas.strike_plan import PlannedStrike

APART_RAD, APART_M = math.radians(6.0), 0.04
"""of a strike from the others, from which on the object stood otherwise or the camera was moved"""


@dataclass(frozen=True)
class CameraView:
    """The camera's place by one strike."""

    strike_id: str
    T_world_camera: Array
    """(4, 4)"""


@dataclass(frozen=True)
class CameraPlace:
    """The camera's place by all strikes."""

    T_world_camera: Array
    """(4, 4)"""
    apart_rad: float
    """root mean square of the strikes about it"""
    apart_m: float
    views: int


def view_of(
    frames: Iterable[ImageFrame], rest_until_ns: int, camera: CameraModel, markers: Sequence[Marker], planned: PlannedStrike, strike_id: str
) -> CameraView | None:
    """The camera's place by one strike; None where no marker whose place on the object is known rests in view.

    Args:
        frames: from rest into the motion, which tells a tag's two possible poses apart.
        rest_until_ns: time of the last frame at rest.
        camera: its lens; its place is not used.
        markers: of the object.
        planned: how the object lies.
        strike_id: for messages.

    Raises:
        TrackingError: the images are not of this camera, or of another object.
    """
    tracks = track_markers(frames, camera, markers, planned.visible_markers).tracks
    placed = {marker.id: marker.T_object_marker for marker in markers if marker.T_object_marker is not None}
    best = max((track for track in tracks if track.marker_id in placed), key=lambda track: len(track.time_ns), default=None)
    if best is None or not np.any(resting := best.time_ns <= rest_until_ns):
        return None
    T_camera_marker = transform(nearest_rotation(best.R_camera_marker[resting].mean(axis=0)), best.p_camera_marker[resting].mean(axis=0))
    T_world_object = transform(np.array(planned.R_world_object), np.array(planned.p_world_object))
    turned = T_world_object @ placed[best.marker_id] @ inverse_transform(T_camera_marker)
    # A strike with a heading is written down in W turned by it.
    standing = turned_camera(replace(camera, T_world_camera=turned), -planned.heading_rad)
    return CameraView(strike_id, standing.T_world_camera)


def placed_by(views: Sequence[CameraView]) -> CameraPlace:
    """The mean of the strikes' views.

    Raises:
        ImportRefused: there is none, or one is far from the others.
    """
    if not views:
        raise ImportRefused(
            "nothing says where the camera stood: the camera file has no T_world_camera, and no tag whose T_object_marker the object file "
            "gives rests in view: film the board on the table (`analyze calibrate --table`), or measure T_object_marker"
        )
    R, p = np.array([view.T_world_camera[:3, :3] for view in views]), np.array([view.T_world_camera[:3, 3] for view in views])
    # The middle one of all, by its distances: one that is far off does not move it.
    middle = int(np.argmin([np.median(angle_between(R, one)) for one in R]))
    turned, shifted = angle_between(R, R[middle]), np.linalg.norm(p - np.median(p, axis=0), axis=1)
    worst = int(np.argmax(np.maximum(turned / APART_RAD, shifted / APART_M)))
    if turned[worst] > APART_RAD or shifted[worst] > APART_M:
        raise ImportRefused(
            f"strike {views[worst].strike_id}: the camera seems to stand {math.degrees(turned[worst]):.0f} deg and "
            f"{1000 * shifted[worst]:.0f} mm from where the other strikes show it: the object lay otherwise than planned, or the camera "
            "was moved: leave that strike out (--strike -), or place the camera by the board (`analyze calibrate --table`)"
        )
    mean = transform(nearest_rotation(R.mean(axis=0)), p.mean(axis=0))
    apart_rad = float(np.sqrt(np.mean(angle_between(R, mean[:3, :3]) ** 2)))
    return CameraPlace(mean, apart_rad, float(np.sqrt(np.mean(np.sum((p - mean[:3, 3]) ** 2, axis=1)))), len(views))
