"""Strikes through images: tags drawn on the true body, tracked and analysed as a recording's.

Each frame is drawn by tests/analyze/tracking/rendering.py, which shares nothing with the tracker. Tags lie
flat on the faces that look at the camera. Not drawn: motion within an exposure, shading.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from analyze.motion.strike import analyse_strike
from analyze.motion.strike_task import StrikeTask
from analyze.planning.view import default_camera
from analyze.tracking.track import track_markers
from analyze.types import CameraModel, ImageFrame, Marker, TipMotion
from schemas.strike_plan import PlannedStrike
from tests.analyze.tracking.rendering import render
from tests.benchmarks.honesty.bodies import TrueBody
from tests.benchmarks.honesty.disturbances import Disturbance
from tests.benchmarks.honesty.observed import T0, View
from tests.benchmarks.honesty.struck import StruckMotion

TAG = 0.024
"""edge of a tag's black square [m]"""
REST = 0.15
"""time filmed before the push [s]"""
DISTANCE_OF_STRAIN = 0.06
"""image radius over focal length at which the strain of a wrong k1 is taken"""


def true_tag(body: TrueBody, planned: PlannedStrike) -> np.ndarray:
    """True pose (4, 4) in O of the tag on the side that looks at the camera in a planned strike."""
    R = np.array(planned.R_world_object)
    out, up = -R[1], R[2]
    corners = 1e-3 * np.concatenate([piece.reshape(-1, 3) for piece in body.pieces])
    middle = 0.5 * (corners.min(axis=0) + corners.max(axis=0))
    pose = np.eye(4)
    pose[:3, :3] = np.stack([np.cross(up, out), up, out], axis=1)
    pose[:3, 3] = middle + out * float((corners @ out).max() - middle @ out)
    return pose


def stated_marker(true: np.ndarray, error: np.ndarray, disturbance: Disturbance) -> Marker:
    """Tag with the pose that the user states, off by place and turn `error` (6,) in O; none if unplaced."""
    if disturbance.unplaced is not None:
        return Marker(0, TAG, None)
    pose = true.copy()
    pose[:3, :3] = Rotation.from_rotvec(-error[3:]).as_matrix() @ true[:3, :3]
    pose[:3, 3] -= error[:3]
    return Marker(0, TAG, pose)


def analyse_images(
    task: StrikeTask,
    body: TrueBody,
    motion: StruckMotion,
    view: View,
    disturbance: Disturbance,
    rng: np.random.Generator,
) -> TipMotion:
    """Motion of a strike by the tracker, from images of the true motion.

    Args:
        task: the strike as recorded, with its planned strike.
        body: true body.
        motion: true poses.
        view: frame rate, and errors of tags and lens.
        disturbance: sizes of the errors.
        rng: generator of the images' noise and of the frames' phase.
    """
    camera, true = default_camera(), true_tag(body, task.planned)
    direction = np.array(task.planned.pivot.direction)
    error = view.tags[tuple(np.rint(direction / max(np.abs(direction).max(), 0.5)).astype(int))]
    marker = stated_marker(true, error, disturbance)
    k1 = view.strain / (3 * DISTANCE_OF_STRAIN**2)
    real = replace(camera, distortion=np.array([k1, 0.0, 0.0, 0.0, 0.0]))
    report = track_markers(_frames(motion, true, real, view.rate, rng), camera, [marker])
    task = replace(task, images_end_ns=report.images_end_ns, unmarked_ns=report.unmarked_ns)
    return analyse_strike(report.tracks, [marker], camera, task)


def _frames(
    motion: StruckMotion,
    tag: np.ndarray,
    camera: CameraModel,
    rate: float,
    rng: np.random.Generator,
) -> Iterator[ImageFrame]:
    """Yield the images of a strike."""
    frames = np.arange(-round(REST * rate), int(motion.time[-1] * rate)) / rate + rng.random() / rate
    frames = frames[frames < motion.time[-1]]
    inside = np.clip(frames, 0.0, None)
    rotations = Slerp(motion.time, Rotation.from_quat(motion.quaternion))(inside).as_matrix()
    positions = np.stack([np.interp(inside, motion.time, axis) for axis in motion.position.T], axis=1)
    R, p = camera.T_world_camera[:3, :3], camera.T_world_camera[:3, 3]
    for number, (time, turned, place) in enumerate(zip(frames, rotations, positions, strict=True)):
        rotation = R.T @ turned @ tag[:3, :3]
        centre = R.T @ (turned @ tag[:3, 3] + place - p)
        image = render(camera, [(0, TAG, rotation, centre)], rng)
        yield ImageFrame(T0 + round(1e9 * time), number, image)
