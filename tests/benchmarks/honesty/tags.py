"""Tags on a true body, and their corners in the camera's image while the body is at rest.

One tag lies flat on each side that looks at the camera in a strike of the plan. A strike recorded under
another strike's name, or a body put down otherwise, therefore shows its tags turned against the plan. Corners
are projected by tests/analyze/tracking/rendering.py, which shares nothing with the tracker.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from analyze.geometry.station import turned_camera
from analyze.motion.placement import judge_placement
from analyze.motion.strike import end_of_rest_ns
from analyze.motion.strike_task import StrikeTask
from analyze.planning.view import default_camera
from analyze.tracking.camera_model import undistort
from analyze.tracking.pose import solve_pose
from analyze.types import CameraModel, Marker, MarkerTrack, TipMotion
from schemas.strike_plan import PlannedStrike
from tests.analyze.tracking.rendering import corners_of, project
from tests.benchmarks.honesty.bodies import TrueBody
from tests.benchmarks.honesty.disturbances import Disturbance
from tests.benchmarks.honesty.observed import T0, View, tag_error
from tests.benchmarks.honesty.struck import StruckMotion

TAG = 0.024
"""edge of a tag's black square [m]"""
SAME_SIDE = np.cos(np.radians(15))
"""cosine of the angle up to which one tag serves two sides"""
FACING = 0.35
"""cosine of the angle between a tag's normal and the ray to the camera, above which the tag is seen"""
BORDER = 3
"""least distance of a seen tag from the image's border [px]"""
CORNER_PX = 0.05
"""noise of a corner [px]"""
RESTING_FRAMES = 8
"""frames at rest that are projected; a recording has 30 or more"""
DISTANCE_OF_STRAIN = 0.06
"""image radius over focal length at which the strain of a wrong k1 is taken"""


@dataclass(frozen=True)
class Tags:
    """Tags of a body: where they are, and where the user states them; numbered from 0."""

    poses: tuple[np.ndarray, ...]
    """true poses (4, 4) in O"""
    markers: tuple[Marker, ...]
    """markers with their places as the user states them"""


def stick_tags(
    body: TrueBody, strikes: Sequence[PlannedStrike], view: View, disturbance: Disturbance
) -> Tags:
    """Stick a tag on each side that looks at the camera in a planned strike, and state its place with errors.

    Args:
        body: true body.
        strikes: strikes of the plan.
        view: errors of the tags' stated places.
        disturbance: without places of tags if it has an entry `unplaced`.
    """
    poses: list[np.ndarray] = []
    markers: list[Marker] = []
    for strike in strikes:
        pose = _true_tag(body, strike)
        if any(pose[:3, 2] @ other[:3, 2] > SAME_SIDE for other in poses):
            continue
        error = tag_error(view, -pose[:3, 2])
        markers.append(_stated_marker(len(poses), pose, error, disturbance))
        poses.append(pose)
    return Tags(tuple(poses), tuple(markers))


def _true_tag(body: TrueBody, planned: PlannedStrike) -> np.ndarray:
    """True pose (4, 4) in O of the tag on the side that looks at the camera in a planned strike."""
    R = np.array(planned.R_world_object)
    turn = planned.heading_rad
    out, up = R.T @ [-np.sin(turn), -np.cos(turn), 0.0], R[2]
    corners = 1e-3 * np.concatenate([piece.reshape(-1, 3) for piece in body.pieces])
    middle = 0.5 * (corners.min(axis=0) + corners.max(axis=0))
    pose = np.eye(4)
    pose[:3, :3] = np.stack([np.cross(up, out), up, out], axis=1)
    pose[:3, 3] = middle + out * float((corners @ out).max() - middle @ out)
    return pose


def _stated_marker(number: int, true: np.ndarray, error: np.ndarray, disturbance: Disturbance) -> Marker:
    """Tag with the pose that the user states, off by place and turn `error` (6,) in O; none if unplaced."""
    if disturbance.unplaced is not None:
        return Marker(number, TAG, None)
    pose = true.copy()
    pose[:3, :3] = Rotation.from_rotvec(-error[3:]).as_matrix() @ true[:3, :3]
    pose[:3, 3] -= error[:3]
    return Marker(number, TAG, pose)


def real_camera(view: View) -> CameraModel:
    """Camera that takes the images, with the lens error that its calibration does not have."""
    k1 = view.strain / (3 * DISTANCE_OF_STRAIN**2)
    return replace(default_camera(), distortion=np.array([k1, 0.0, 0.0, 0.0, 0.0]))


def seen_tags(
    tags: Tags, camera: CameraModel, heading: float, R: np.ndarray, p: np.ndarray
) -> list[tuple[int, float, np.ndarray, np.ndarray]]:
    """Tags that a camera sees: number, size [m], rotation (3, 3) and centre (3,) [m] in the camera frame.

    Args:
        tags: tags of the body.
        camera: camera with its pose in the world frame of a strike without heading.
        heading: angle by which object and striker are turned about the vertical [rad].
        R: (3, 3) rotation from O to the world frame of the strike.
        p: (3,) origin of O there [m].
    """
    turn = Rotation.from_euler("z", heading).as_matrix()
    R_camera, p_camera = camera.T_world_camera[:3, :3], camera.T_world_camera[:3, 3]
    found = []
    for number, pose in enumerate(tags.poses):
        rotation = R_camera.T @ turn @ R @ pose[:3, :3]
        centre = R_camera.T @ (turn @ (R @ pose[:3, 3] + p) - p_camera)
        if -rotation[:, 2] @ centre < FACING * np.linalg.norm(centre):
            continue
        corners = project(camera, corners_of(TAG) @ rotation.T + centre)
        if np.all((corners > BORDER) & (corners < [camera.width - BORDER, camera.height - BORDER])):
            found.append((number, TAG, rotation, centre))
    return found


def misplaced(
    task: StrikeTask,
    made: PlannedStrike,
    tags: Tags,
    struck: StruckMotion,
    view: View,
    rng: np.random.Generator,
) -> TipMotion | None:
    """Result of a strike whose tags at rest are turned against the plan, with its verdict; else None.

    Args:
        task: the strike as recorded, and all strikes of its plan.
        made: the strike that was made; another one than recorded if the strike is mislabelled.
        tags: tags of the body.
        struck: true poses; the first is at rest.
        view: errors of the camera.
        rng: generator of the corners' noise.
    """
    camera = turned_camera(default_camera(), task.planned.heading_rad)
    tracks = _resting_tracks(made, tags, struck, view, rng)
    rest_end_ns = end_of_rest_ns(tracks, task.contact_time_ns)
    found = judge_placement(tracks, tags.markers, camera, task, rest_end_ns)
    if found is None:
        return None
    return TipMotion(task.strike_id, task.planned.id, found.code, found.reason, None, None, None, (), None)


def _resting_tracks(
    made: PlannedStrike, tags: Tags, struck: StruckMotion, view: View, rng: np.random.Generator
) -> list[MarkerTrack]:
    """Tracks of the tags that are seen at rest, with poses by the tracker's own solver."""
    camera, calibrated, n = real_camera(view), default_camera(), RESTING_FRAMES
    R = Rotation.from_quat(struck.quaternion[0]).as_matrix()
    time_ns = T0 + np.rint(1e9 * (np.arange(-n, 0) - 1) / view.rate).astype(np.int64)
    tracks = []
    for number, size, rotation, centre in seen_tags(tags, camera, made.heading_rad, R, struck.position[0]):
        corners = project(camera, corners_of(size) @ rotation.T + centre)
        corners = corners + rng.normal(0, CORNER_PX, (n, 4, 2))
        pairs = [solve_pose(each, size, calibrated.K) for each in undistort(calibrated, corners)]
        kept = [i for i, pair in enumerate(pairs) if pair is not None]
        poses = [pair for pair in pairs if pair is not None]
        tracks.append(
            MarkerTrack(
                number,
                time_ns[kept],
                corners[kept],
                np.full(len(kept), CORNER_PX),
                np.array([pair.R_camera_marker[0] for pair in poses]),
                np.array([pair.p_camera_marker[0] for pair in poses]),
                n,
            )
        )
    return tracks
