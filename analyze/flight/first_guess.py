"""First guess of a flight's motion from the poses of single tags."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from analyze.flight.flight_model import TossStart
from analyze.geometry.rotations import nearest_rotation, vector_from_matrix

if TYPE_CHECKING:
    from analyze.flight.views import TagSet, TossViews
    from analyze.types import Array, CameraModel

_SPIN_FRAMES = 6
"""number of frames over whose differences the first spin is averaged"""


def body_poses(views: TossViews, tags: TagSet, camera: CameraModel) -> tuple[Array, Array]:
    """Attitude (n, 3, 3) and place (n, 3) [m] of the object frame O in W in each frame, by its best tag.

    The best tag is the one that fills most of the image.
    """
    x, y = views.corners[..., 0], views.corners[..., 1]
    area = np.abs(np.sum(x * np.roll(y, -1, axis=1) - y * np.roll(x, -1, axis=1), axis=1))
    order = np.lexsort((area, views.frame))
    best = order[np.append(np.diff(views.frame[order]) > 0, True)]
    R_object_tag, p_object_tag = tag_poses(tags)
    tag = views.tag[best]
    R_world_camera = camera.T_world_camera[:3, :3]
    R = R_world_camera @ views.R_camera_tag[best] @ np.swapaxes(R_object_tag[tag], 1, 2)
    centre = views.p_camera_tag[best] @ R_world_camera.T + camera.T_world_camera[:3, 3]
    return R, centre - np.einsum("nij,nj->ni", R, p_object_tag[tag])


def tag_poses(tags: TagSet) -> tuple[Array, Array]:
    """Rotations (k, 3, 3) from the tags' frames to O, and their centres (k, 3) in O [m]."""
    along = tags.corners[:, 1] - tags.corners[:, 0]
    up = tags.corners[:, 0] - tags.corners[:, 3]
    x = along / np.linalg.norm(along, axis=1, keepdims=True)
    y = up / np.linalg.norm(up, axis=1, keepdims=True)
    return nearest_rotation(np.stack([x, y, np.cross(x, y)], axis=-1)), tags.centres


def first_start(views: TossViews, tags: TagSet, camera: CameraModel, com: Array, gravity: float) -> TossStart:
    """First guess of the motion at the first frame of a flight: fall of a point, mean spin of some frames.

    Args:
        views: the flight, at least three frames.
        tags: the object's tags.
        camera: camera that took the frames.
        com: (3,) point of the object near its centre of mass [m, in O].
        gravity: gravity [m/s^2].
    """
    R, origin = body_poses(views, tags, camera)
    time = views.seconds
    ahead = min(_SPIN_FRAMES, len(R) - 1)
    turns = vector_from_matrix(np.swapaxes(R[:ahead], 1, 2) @ R[1 : ahead + 1])
    spin = np.median(turns / np.diff(time[: ahead + 1])[:, None], axis=0)
    place = origin + R @ com + 0.5 * gravity * time[:, None] ** 2 * np.array([0.0, 0.0, 1.0])
    line, *_ = np.linalg.lstsq(np.column_stack([np.ones_like(time), time]), place, rcond=None)
    return TossStart(R[0], spin, line[0], line[1])
