"""Overlay on the camera's image in raw (distorted) pixels: object at the fitted angle, and pivot axis."""

from __future__ import annotations

from typing import TYPE_CHECKING

import cv2
import numpy as np

from analyze.motion.rest_pose import rest_pose
from analyze.motion.strike import end_of_rest_ns
from analyze.tracking.camera_model import project, undistort, world_to_camera

if TYPE_CHECKING:
    from collections.abc import Sequence

    from analyze.geometry.object_model import ObjectModel
    from analyze.tracking.track import TrackingReport
    from analyze.types import Array, CameraModel, IntArray, Marker, MarkerTrack
    from schemas.strike_plan import PlannedStrike

_MAX_WIREFRAME_EDGES = 60
"""Sharp edges above which the outline is drawn instead: a denser wireframe would be unreadable."""
_MIN_REST_FRAMES = 3
"""Least number of frames at rest from which a rest pose is computed."""
_MIN_DEPTH_M = 0.02
"""Depth [m] in front of the camera below which points are not drawn."""


def camera_of_report(report: TrackingReport | None, camera: CameraModel) -> CameraModel:
    """Camera as seen from the object's planned pose: `camera`, or where its print saw it put down otherwise.

    Args:
        report: tracking of the strike; None if there is none.
        camera: camera with its pose in W, the world frame of the strike.
    """
    return camera if report is None or report.rest_view is None else report.rest_view.camera


def pose_at_rest(
    planned: PlannedStrike,
    tracks: Sequence[MarkerTrack],
    markers: Sequence[Marker],
    camera: CameraModel,
    contact_ns: int,
) -> tuple[Array, Array]:
    """Pose of the object at rest before a strike, measured from the marker with most frames at rest.

    The tipping angle theta is measured from this pose (motion/tip_angle.py). It is the planned pose if no
    marker both has a known place on the object and was seen in three frames at rest.

    Args:
        planned: planned strike.
        tracks: tracked markers of the strike.
        markers: markers on the object.
        camera: camera with its pose in W, the world frame of the strike.
        contact_ns: log time of the contact [ns].

    Returns:
        Rotation R_world_object (3, 3) from the object frame O to W, and position p_world_object (3,) [m] of
        O's origin in W.
    """
    R_planned, p_planned = (
        np.array(planned.R_world_object, dtype=float),
        np.array(planned.p_world_object, dtype=float),
    )
    by_id = {marker.id: marker for marker in markers}
    ends = end_of_rest_ns(tracks, contact_ns) if tracks else 0
    found = [(0, R_planned, p_planned)]
    for track in tracks:
        marker, still = by_id.get(track.marker_id), track.time_ns < ends
        if marker is None or marker.T_object_marker is None or np.count_nonzero(still) < _MIN_REST_FRAMES:
            continue
        corners = undistort(camera, track.corners_px)[still]
        rest = rest_pose(corners, track, still, marker, camera, R_planned)
        R_world_marker = camera.T_world_camera[:3, :3] @ rest.R
        p_world_marker = camera.T_world_camera[:3, :3] @ rest.p + camera.T_world_camera[:3, 3]
        R_world_object = R_world_marker @ marker.T_object_marker[:3, :3].T
        p_world_object = p_world_marker - R_world_object @ marker.T_object_marker[:3, 3]
        found.append((int(np.count_nonzero(still)), R_world_object, p_world_object))
    return max(found, key=lambda each: each[0])[1:]


def project_to_pixels(camera: CameraModel, points_world: Array) -> Array:
    """Project points (..., 3) [m] in the world frame W to raw (distorted) pixels (..., 2).

    Points behind the camera, or less than 20 mm in front of it, give NaN.
    """
    R, t = world_to_camera(camera)
    in_camera = points_world @ R.T + t
    near = in_camera[..., 2] < _MIN_DEPTH_M
    drawn = project(camera, np.where(near[..., None], [0.0, 0.0, 1.0], in_camera))
    return np.where(near[..., None], np.nan, drawn)


def wireframe(model: ObjectModel, camera: CameraModel, R: Array, p: Array) -> list[list[Array]]:
    """Lines of the object on the camera's image, in each of n poses.

    The lines are the sharp edges if there are 1 to 60 of them, else the outline of the convex hull.

    Args:
        model: exterior of the object.
        camera: camera with its pose in W.
        R: (n, 3, 3) rotations from the object frame O to W.
        p: (n, 3) positions of O's origin in W [m].

    Returns:
        For each pose a list of lines, each (m, 2) raw pixels; edges and hull corners that reach behind the
        camera, or closer than 20 mm to it, are left out.
    """
    edges = sharp_edges(model.vertices, model.faces)
    turned = np.swapaxes(R, 1, 2)
    if 0 < len(edges) <= _MAX_WIREFRAME_EDGES:
        drawn = project_to_pixels(camera, np.array(edges) @ turned[:, None] + p[:, None, None])
        return [[line for line in lines if np.all(np.isfinite(line))] for lines in drawn]
    return [
        _outline(points) for points in project_to_pixels(camera, model.hull_vertices @ turned + p[:, None])
    ]


def _outline(points: Array) -> list[Array]:
    whole = points[np.all(np.isfinite(points), axis=1)].astype(np.float32)
    if len(whole) < 3:
        return []
    ring = cv2.convexHull(whole.reshape(-1, 1, 2)).reshape(-1, 2).astype(np.float64)
    return [np.vstack([ring, ring[:1]])]


def axis_line(camera: CameraModel, pivot: Array, half_length: float) -> Array:
    """Points of the pivot axis, which lies along the y axis of the world frame W, on the camera's image.

    Args:
        camera: camera with its pose in W.
        pivot: (3,) point on the axis in W [m].
        half_length: distance [m] from `pivot` to either end.

    Returns:
        Raw pixels (m, 2) of at most 24 points in order of rising y: for a camera on the side of negative y
        the near end is first. Points behind the camera, or less than 20 mm in front of it, are left out.
    """
    along = np.linspace(-half_length, half_length, 24)[:, None] * np.array([0.0, 1.0, 0.0])
    line = project_to_pixels(camera, pivot + along)
    return line[np.all(np.isfinite(line), axis=1)]


def sharp_edges(vertices: Array, faces: IntArray) -> list[Array]:
    """Edges of a mesh at its border, or between triangles whose normals differ by more than 20 degrees.

    Args:
        vertices: (n, 3) vertices [m].
        faces: (f, 3) vertex indices of the triangles, all in one orientation.

    Returns:
        List with the two end points (2, 3) [m] of each edge, in the frame of the vertices.
    """
    corners = vertices[faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-30)
    owner = {(int(face[i]), int(face[(i + 1) % 3])): f for f, face in enumerate(faces) for i in range(3)}
    found: list[Array] = []
    for (a, b), f in owner.items():
        across = owner.get((b, a))
        if across is None or (a < b and normal[f] @ normal[across] < np.cos(np.radians(20.0))):
            found.append(vertices[[a, b]])
    return found
