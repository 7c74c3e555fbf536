"""Object at rest in a camera's view before a strike, and the line about which it then turns.

Both come from one tag whose pose on the object is known, without the camera's pose. T_a_b is the pose of b in
a; C is the camera's frame, O the object's.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from analyze.geometry.rotations import inverse_transform, nearest_rotation, transform, vector_from_matrix
from analyze.tracking.track import track_markers
from analyze.types import Array, CameraModel, ImageFrame, Marker, MarkerTrack

MIN_TURN, MAX_TURN = math.radians(3.0), math.radians(40.0)
"""rotations since rest [rad] between which images determine the line: below, noise prevails; above, the
object may have left its edge"""
MIN_IMAGES = 3
"""least number of images between these rotations"""


@dataclass(frozen=True)
class TurningLine:
    """Line in the object's frame O about which the object turned; positive by the right-hand rule."""

    direction: Array
    """(3,) unit vector along the line, in O"""
    point: Array
    """(3,) point of the line nearest to the tag, in O [m]"""
    distance: float
    """distance of the line from the tag's middle [m]"""


@dataclass(frozen=True)
class TipView:
    """Pose of the object at rest in the camera's frame, and the line about which it then turned."""

    marker: int | str
    """name of the tag that was followed"""
    T_camera_object: Array
    """(4, 4) pose of the object at rest in the camera's frame, translation in m"""
    line: TurningLine | None
    """line about which the object turned; None if it turned too little in view"""


def tip_view(
    frames: Iterable[ImageFrame], rest_until_ns: int, camera: CameraModel, markers: Sequence[Marker]
) -> TipView | None:
    """Follow the object's tags from rest into a tip; return its pose at rest and its turning line.

    Of the tags whose pose on the object is known, the one that is seen largest and longest is used.

    Args:
        frames: images from rest into the motion, which resolves a tag's pose ambiguity.
        rest_until_ns: time of the last frame at rest [ns], on the clock of `frames`.
        camera: lens of the camera; its pose is not used.
        markers: markers of the object.

    Returns:
        The view; None if no marker of known pose on the object is at rest in view.

    Raises:
        TrackingError: a marker of the object is in view twice, only markers of other objects are, the images
            have another size than the lens, or its row delay is too long for the frame rate.
    """
    tracks = track_markers(frames, camera, markers).tracks
    placed = {marker.id: marker.T_object_marker for marker in markers if marker.T_object_marker is not None}
    rested = [
        track for track in tracks if track.marker_id in placed and np.any(track.time_ns <= rest_until_ns)
    ]
    best = max(rested, key=_pixels_seen, default=None)
    if best is None:
        return None
    T_object_marker = placed[best.marker_id]
    resting = best.time_ns <= rest_until_ns
    T_camera_marker = transform(
        nearest_rotation(best.R_camera_marker[resting].mean(axis=0)),
        best.p_camera_marker[resting].mean(axis=0),
    )
    T_marker_object = inverse_transform(T_object_marker)
    T_camera_object = T_camera_marker @ T_marker_object
    T_camera_marker_now = transform(best.R_camera_marker[~resting], best.p_camera_marker[~resting])
    motion = inverse_transform(T_camera_object) @ T_camera_marker_now @ T_marker_object
    return TipView(best.marker_id, T_camera_object, _turning_line(motion, T_object_marker[:3, 3]))


def _pixels_seen(track: MarkerTrack) -> float:
    """Number of a tag's images times its mean side in them [px]."""
    sides = track.corners_px - np.roll(track.corners_px, 1, axis=1)
    return float(np.sum(np.mean(np.linalg.norm(sides, axis=2), axis=1)))


def _turning_line(motion: Array, middle: Array) -> TurningLine | None:
    """Line about which the object turned, from its displacements since rest; None if there are too few.

    The line's direction is the mean rotation vector. Its point solves (I - R) x = t by least squares for all
    displacements x -> R x + t, and is the one nearest to the tag.

    Args:
        motion: (n, 4, 4) displacements of the object since rest, in the frame O of the resting object [m].
        middle: (3,) middle of the tag in O [m].
    """
    turns = vector_from_matrix(motion[:, :3, :3])
    angles = np.linalg.norm(turns, axis=1)
    # The first images up to the largest angle: afterwards the object may have left its edge.
    past = np.flatnonzero(angles > MAX_TURN)
    before = np.arange(len(angles)) < (past[0] if len(past) else len(angles))
    used = before & (angles > MIN_TURN)
    if np.count_nonzero(used) < MIN_IMAGES:
        return None
    total: Array = turns[used].sum(axis=0)
    direction: Array = np.asarray(total / np.linalg.norm(total), dtype=np.float64)
    across = np.linalg.svd(direction[None, :])[2][1:].T
    R, t = motion[used, :3, :3], motion[used, :3, 3]
    # Measured from the tag's middle, so that the point has no component along the line.
    shift = t + R @ middle - middle
    lever = np.linalg.lstsq(((np.eye(3) - R) @ across).reshape(-1, 2), shift.reshape(-1), rcond=None)[0]
    offset: Array = np.asarray(across @ lever, dtype=np.float64)
    return TurningLine(direction, middle + offset, float(np.linalg.norm(offset)))
