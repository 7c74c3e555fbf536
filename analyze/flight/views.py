"""Tags of an object, and their corners in the frames of one flight: the data of the fit in pixels."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from analyze.tracking.camera_model import undistort
from analyze.tracking.pose import marker_corners

if TYPE_CHECKING:
    from collections.abc import Sequence

    from analyze.types import Array, CameraModel, IntArray, Marker, MarkerTrack


@dataclass(frozen=True)
class TagSet:
    """Places of an object's k tags in the object frame O, as stated, with standard deviations."""

    names: tuple[int | str, ...]
    """names of the tags"""
    corners: Array
    """(k, 4, 3) their corners in O [m]"""
    place_sd: Array
    """(k,) 1 sigma of a tag's centre, along each axis [m]"""
    turn_sd: Array
    """(k,) 1 sigma of a tag's turn, about each axis [rad]"""
    shared_errors: bool = False
    """True if the sd of the corners includes errors that neighbouring frames share, as of views of print"""

    @property
    def centres(self) -> Array:
        """Centres (k, 3) of the tags in the object frame O [m]."""
        return self.corners.mean(axis=1)


@dataclass(frozen=True)
class TossViews:
    """Corners of an object's tags in n frames of one toss, in m views; a view is one tag in one frame."""

    time_ns: IntArray
    """(n,) log times of the frames [ns], at which the corners were there"""
    frame: IntArray
    """(m,) index of each view's frame"""
    tag: IntArray
    """(m,) index of each view's tag in the `TagSet`"""
    corners: Array
    """(m, 4, 2) corners [ideal px, free of lens distortion]"""
    sd: Array
    """(m,) 1 sigma of a corner's coordinate [px]"""
    R_camera_tag: Array
    """(m, 3, 3) rotation of each view's tag into the camera frame, from this view and its neighbours"""
    p_camera_tag: Array
    """(m, 3) its centre in the camera frame [m]"""
    rows: Array
    """(m, 4) rows of the corners in the image, from its middle row down [px]"""

    def __len__(self) -> int:
        return len(self.time_ns)

    @property
    def seconds(self) -> Array:
        """Times (n,) of the frames since the first [s]."""
        return 1e-9 * (self.time_ns - self.time_ns[0]).astype(np.float64)

    def part(self, start: int, stop: int) -> TossViews:
        """Views in the frames with indices [start, stop) only."""
        kept = (self.frame >= start) & (self.frame < stop)
        return TossViews(
            self.time_ns[start:stop],
            self.frame[kept] - start,
            self.tag[kept],
            self.corners[kept],
            self.sd[kept],
            self.R_camera_tag[kept],
            self.p_camera_tag[kept],
            self.rows[kept],
        )


def tag_set(markers: Sequence[Marker], *, shared_errors: bool = False) -> TagSet:
    """Tags of those markers whose place on the object is known.

    Args:
        markers: markers of the object, or squares that stand for views of its print.
        shared_errors: True if the sd of the corners includes errors that neighbouring frames share.
    """
    placed = [(marker, pose) for marker in markers if (pose := marker.T_object_marker) is not None]
    return TagSet(
        tuple(marker.id for marker, _ in placed),
        np.array([marker_corners(marker.size) @ pose[:3, :3].T + pose[:3, 3] for marker, pose in placed]),
        np.array([marker.place_sd for marker, _ in placed]),
        np.array([marker.turn_sd for marker, _ in placed]),
        shared_errors,
    )


def toss_views(tracks: Sequence[MarkerTrack], camera: CameraModel, tags: TagSet) -> TossViews:
    """Corners of the tags in all frames of a toss in which at least one was found, in order of time.

    Args:
        tracks: tracks of the tags; those of tags without a place are ignored.
        camera: camera that took the frames.
        tags: the object's tags.
    """
    index = {name: number for number, name in enumerate(tags.names)}
    used = [track for track in tracks if track.marker_id in index]
    if not used:
        none = np.zeros(0, dtype=np.int64)
        corners, turns, places = np.zeros((0, 4, 2)), np.zeros((0, 3, 3)), np.zeros((0, 3))
        return TossViews(none, none, none, corners, np.zeros(0), turns, places, np.zeros((0, 4)))
    stamps = np.concatenate([track.time_ns for track in used])
    time_ns, frame = np.unique(stamps, return_inverse=True)
    return TossViews(
        time_ns,
        frame.astype(np.int64),
        np.concatenate([np.full(len(track.time_ns), index[track.marker_id]) for track in used]),
        undistort(camera, np.concatenate([track.corners_px for track in used])),
        np.concatenate([track.corner_sd_px for track in used]),
        np.concatenate([track.R_camera_marker for track in used]),
        np.concatenate([track.p_camera_marker for track in used]),
        np.concatenate([track.corners_px[..., 1] for track in used]) - 0.5 * (camera.height - 1),
    )
