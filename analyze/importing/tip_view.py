"""Object at rest in a camera's view before a strike, and the line about which it then turns.

Both come from one tag, without the camera's pose: in the object's frame O if the tag's pose on the object is
known, else in the tag's frame M. T_a_b is the pose of b in a; C is the camera's frame.
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
    """Line in a frame fixed to the resting object about which it turned; positive by the right-hand rule.

    The frame is the object's frame O, or a tag's frame M.
    """

    direction: Array
    """(3,) unit vector along the line"""
    point: Array
    """(3,) point of the line nearest to the tag [m]"""
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


@dataclass(frozen=True)
class TagView:
    """Pose of one tag at rest in the camera's frame, and the line in its own frame about which it turned."""

    marker: int | str
    """name of the tag"""
    T_camera_marker: Array
    """(4, 4) pose of the tag at rest in the camera's frame, translation in m"""
    line: TurningLine | None
    """line about which the object turned, in the tag's frame M; None if it turned too little in view"""

    def on_object(self, T_object_marker: Array) -> TipView:
        """Pose and turning line of the object, whose frame follows from the tag's pose on it.

        Args:
            T_object_marker: (4, 4) pose of the tag in the object's frame [m].
        """
        R, t, line = T_object_marker[:3, :3], T_object_marker[:3, 3], self.line
        on_object = (
            None if line is None else TurningLine(R @ line.direction, R @ line.point + t, line.distance)
        )
        return TipView(self.marker, self.T_camera_marker @ inverse_transform(T_object_marker), on_object)


def tag_views(
    frames: Iterable[ImageFrame], rest_until_ns: int, camera: CameraModel, markers: Sequence[Marker]
) -> tuple[TagView, ...]:
    """Follow the object's tags from rest into a tip; return rest and turning line of each.

    Args:
        frames: images from rest into the motion, which resolves a tag's pose ambiguity.
        rest_until_ns: time of the last frame at rest [ns], on the clock of `frames`.
        camera: lens of the camera; its pose is not used.
        markers: markers of the object.

    Returns:
        Views of the tags that are seen at rest, the one that is seen largest and longest first.

    Raises:
        TrackingError: a marker of the object is in view twice, only markers of other objects are, the images
            have another size than the lens, or its row delay is too long for the frame rate.
    """
    tracks = track_markers(frames, camera, markers).tracks
    rested = [track for track in tracks if np.any(track.time_ns <= rest_until_ns)]
    views: list[TagView] = []
    for track in sorted(rested, key=_pixels_seen, reverse=True):
        resting = track.time_ns <= rest_until_ns
        T_camera_marker = transform(
            nearest_rotation(track.R_camera_marker[resting].mean(axis=0)),
            track.p_camera_marker[resting].mean(axis=0),
        )
        now = transform(track.R_camera_marker[~resting], track.p_camera_marker[~resting])
        line = _turning_line(inverse_transform(T_camera_marker) @ now)
        views.append(TagView(track.marker_id, T_camera_marker, line))
    return tuple(views)


def view_by_placed_tag(views: Sequence[TagView], markers: Sequence[Marker]) -> TipView | None:
    """View of the object by the first tag whose pose on the object is known; None if there is none.

    Args:
        views: views of the tags, the best first.
        markers: markers of the object.
    """
    placed = {marker.id: marker.T_object_marker for marker in markers if marker.T_object_marker is not None}
    return next((view.on_object(placed[view.marker]) for view in views if view.marker in placed), None)


def _pixels_seen(track: MarkerTrack) -> float:
    """Number of a tag's images times its mean side in them [px]."""
    sides = track.corners_px - np.roll(track.corners_px, 1, axis=1)
    return float(np.sum(np.mean(np.linalg.norm(sides, axis=2), axis=1)))


def _turning_line(motion: Array) -> TurningLine | None:
    """Line about which a tag turned, from its displacements since rest; None if there are too few.

    The line's direction is the mean rotation vector. Its point solves (I - R) x = t by least squares for all
    displacements x -> R x + t, and is the one nearest to the tag's middle.

    Args:
        motion: (n, 4, 4) displacements of the tag since rest, in the frame M of the resting tag [m].
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
    lever = np.linalg.lstsq(((np.eye(3) - R) @ across).reshape(-1, 2), t.reshape(-1), rcond=None)[0]
    point: Array = np.asarray(across @ lever, dtype=np.float64)
    return TurningLine(direction, point, float(np.linalg.norm(point)))
