"""Checks on single images before a strike: markers in view, rest, and placement against the plan.

A strike is one impact that tips the object; its plan states how the object is put down.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from analyze.motion.rest_pose import placement_error
from analyze.tracking.camera_model import distort, pixel_map, undistort
from analyze.tracking.edges import fit_square
from analyze.tracking.marker import detect
from analyze.tracking.pose import solve_pose
from schemas.tags import USUAL_FAMILY, name_order

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from analyze.types import Array, CameraModel, ImageFrame, Marker
    from schemas.strike_plan import PlannedStrike
    from schemas.tags import TagFamily

_MAX_STILL_PX = 0.3
"""largest motion of a corner at rest [px]"""
_MAX_STILL_GREY = 5.0
"""largest mean difference of two images [grey levels] at rest, if no marker is in view"""
_OTHER_GREY, _MAX_OTHER = 20.0, 0.005
"""difference of a pixel's grey level that no noise makes, and largest share of such pixels at rest: an object
fills only part of the image"""
_REST_DURATION_NS = 240_000_000
"""time without motion [ns] that counts as rest"""
RESTED_NS = 360_000_000
"""time before an image at rest in which all images show rest [ns]"""
_SATURATED = 254
"""grey level of a saturated pixel"""
_MAX_ERROR_RATIO = 2.0
"""ratio of reprojection errors up to which the second pose of a square is considered"""


@dataclass(frozen=True)
class Scene:
    """Markers found in one image, share of its saturated pixels, and a coarse copy of it."""

    time_ns: int
    """log_time of the image [ns]"""
    corners: dict[int | str, Array]
    """refined corners (4, 2) [raw px] by marker id"""
    duplicate_ids: tuple[int | str, ...]
    """marker ids found more than once in the image"""
    saturated_fraction: float
    """share of saturated pixels, of every second pixel in both directions"""
    coarse: NDArray[np.float32]
    """every eighth pixel in both directions [grey levels], to detect motion if no marker is in view"""


def read_scene(
    frame: ImageFrame, camera: CameraModel, families: Sequence[TagFamily] = (USUAL_FAMILY,)
) -> Scene:
    """Markers in one image, with sub-pixel corners [raw px], share of saturated pixels, and a coarse copy.

    A marker whose edges cannot be fitted keeps the detector's corners. Of a marker found twice, the larger
    view is kept, and its id is listed in `duplicate_ids`.

    Args:
        frame: the image, with its time.
        camera: camera that took it.
        families: marker families (code dictionaries) that are searched.
    """
    corners: dict[int | str, Array] = {}
    duplicate_ids: list[int | str] = []
    for sighting in detect(frame.image, families):
        if sighting.marker_id in corners:
            duplicate_ids.append(sighting.marker_id)
            continue
        square = fit_square(
            frame.image, pixel_map(camera), undistort(camera, sighting.corners_px), sighting.corners_px
        )
        corners[sighting.marker_id] = (
            sighting.corners_px if square is None else distort(camera, square.corners)
        )
    sparse = frame.image[::2, ::2]
    saturated = float(np.count_nonzero(sparse >= _SATURATED)) / sparse.size
    return Scene(
        frame.time_ns, corners, tuple(duplicate_ids), saturated, frame.image[::8, ::8].astype(np.float32)
    )


def at_rest(scenes: Sequence[Scene]) -> bool:
    """True if nothing has moved over the last 0.24 s (about one interval of the preview images).

    Nothing has moved if no marker's corner is off by more than 0.3 px, or, with no marker in view, the grey
    levels by more than 5 on average, or by more than 20 in more than 0.5 % of the image. False also if the
    images of the last 0.36 s do not span 0.24 s, or if different markers are seen in them.

    Args:
        scenes: markers and coarse grey levels of successive images, in order of time; none gives False.
    """
    if not scenes:
        return False
    last = scenes[-1]
    older = [scene for scene in scenes if last.time_ns - scene.time_ns <= RESTED_NS]
    if len(older) < 2 or last.time_ns - older[0].time_ns < _REST_DURATION_NS:
        return False
    for scene in older[:-1]:
        if scene.corners.keys() != last.corners.keys():
            return False
        if any(np.max(np.abs(scene.corners[i] - last.corners[i])) > _MAX_STILL_PX for i in last.corners):
            return False
        off = np.abs(scene.coarse - last.coarse)
        if not last.corners and (off.mean() > _MAX_STILL_GREY or (off > _OTHER_GREY).mean() > _MAX_OTHER):
            return False
    return True


@dataclass(frozen=True)
class PlacementCheck:
    """Angle [rad] of the object's orientation to the planned one, and the correction in words.

    The angle is None if it cannot be determined; the text is empty if nothing is to be done.
    """

    error: float | None
    """angle to the planned orientation [rad]; None if no marker with a known place is in view"""
    text: str
    """instruction for the user; empty if nothing is to be done"""


def check_placement(
    scene: Scene, markers: Mapping[int | str, Marker], camera: CameraModel, planned: PlannedStrike
) -> PlacementCheck:
    """Compare the object's orientation, as its markers show it, with the planned one.

    Args:
        scene: markers in the image.
        markers: the object's markers by id.
        camera: camera with its pose in the world frame W.
        planned: the planned strike, with the object's orientation R_world_object and the markers expected in
            view.

    Returns:
        Angle to the planned orientation [rad], and an instruction to the user, empty below 8 deg. The angle
        is None, with the reason as text, if a marker is in view twice, or if no marker in view has both a
        known place on the object and a pose.
    """
    wanted = ", ".join(str(i) for i in planned.visible_markers) or "any"
    if scene.duplicate_ids:
        return PlacementCheck(None, f"marker {scene.duplicate_ids[0]} is in view twice: cover or remove one")
    known = {i: corners for i, corners in scene.corners.items() if i in markers}
    if not known:
        strange = sorted(scene.corners, key=name_order)
        if strange:
            return PlacementCheck(
                None,
                f"marker {strange[0]} is not on this object:"
                f" put the right object down, marker {wanted} towards the camera",
            )
        return PlacementCheck(None, f"no marker is in view: place tag {wanted} towards the camera")
    R_world_object = np.array(planned.R_world_object, dtype=float)
    orientations: list[Array] = []
    seen: list[Marker] = []
    for i, corners in known.items():
        marker = markers[i]
        R = _pose_near_plan(undistort(camera, corners), marker, camera, R_world_object)
        if R is not None:
            orientations.append(R)
            seen.append(marker)
    found = placement_error(orientations, seen, camera, R_world_object)
    if found is None:
        return PlacementCheck(
            None,
            "the object file gives no pose for these markers: the placement cannot be checked"
            " (`analyze register` finds the poses afterwards)",
        )
    error, correction = found
    return PlacementCheck(
        error, _advice(error, correction, wanted, any(i in known for i in planned.visible_markers))
    )


def _pose_near_plan(
    corners_ideal: Array, marker: Marker, camera: CameraModel, R_world_object: Array
) -> Array | None:
    """Rotation (3, 3) from a marker's frame to the camera frame; None if its corners give no finite pose.

    A square has two pose solutions. If both fit the image and the marker's place on the object is known, the
    one nearer to the planned orientation is taken, otherwise the one that fits better.

    Args:
        corners_ideal: (4, 2) corners without lens distortion [ideal px].
        marker: the marker.
        camera: camera with its pose in the world frame W.
        R_world_object: (3, 3) planned rotation from object frame O to W.
    """
    pair = solve_pose(corners_ideal, marker.size, camera.K)
    if pair is None:
        return None
    if marker.T_object_marker is None or pair.error_px[1] > _MAX_ERROR_RATIO * max(
        float(pair.error_px[0]), 0.02
    ):
        return pair.R_camera_marker[0]
    expected = camera.T_world_camera[:3, :3].T @ R_world_object @ marker.T_object_marker[:3, :3]
    return max(pair.R_camera_marker, key=lambda R: float(np.trace(R.T @ expected)))


def _advice(error: float, correction: Array, wanted: str, wanted_seen: bool) -> str:
    """Instruction to the user that corrects a misplacement of the object; empty below 8 deg.

    Args:
        error: angle to the planned orientation [rad].
        correction: (3,) rotation vector in the world frame W from the present to the planned orientation
            [rad].
        wanted: names of the markers that should face the camera.
        wanted_seen: True if one of them is in view.
    """
    degrees = math.degrees(error)
    if degrees < 8.0:
        return ""
    if not wanted_seen:
        return f"turned by {degrees:.0f} deg: place tag {wanted} towards the camera"
    if abs(correction[2]) > 0.9 * error:
        sense = "anticlockwise" if correction[2] > 0 else "clockwise"
        return f"turned by {degrees:.0f} deg: turn it {sense}, seen from above, by {degrees:.0f} deg"
    return f"turned by {degrees:.0f} deg: it lies on another face; put it down as on its card"
