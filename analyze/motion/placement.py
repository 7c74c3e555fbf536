"""Check of the object's placement before a strike: markers at rest against the plan.

A strike that was recorded under another strike's name, or before which the object was put down in another
way, shows its markers turned against the plan. Its tipping angle, slip and lift would then be measured about
a line that is not the pivot edge.
"""

# scipy is only partly typed.
# pyright: reportMissingTypeStubs=false

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial.transform import Rotation

from analyze.geometry.station import turned_camera
from analyze.motion.strike_task import Judgement
from analyze.tracking.camera_model import undistort
from analyze.tracking.pose import solve_pose
from schemas.strike_result import Verdict

if TYPE_CHECKING:
    from collections.abc import Sequence

    from analyze.motion.strike_task import StrikeTask
    from analyze.types import Array, CameraModel, Marker, MarkerTrack
    from schemas.strike_plan import PlannedStrike

MAX_TURN = math.radians(15.0)
"""largest angle [rad] between the object's orientation at rest and the planned one

Hands place an object to a few degrees, markers are glued on as accurately, and a small square shows its tilt
to some degrees.
"""
MIN_RESTING_FRAMES = 3
"""least number of frames at rest"""
MAX_ERROR_RATIO, MIN_ERROR_PX = 2.0, 0.02
"""ratio of reprojection errors up to which the second pose of a square is considered; the first one's error
counts as at least `MIN_ERROR_PX` [px]"""
UPRIGHT_SHARE = 0.9
"""share of a turn about the vertical from which on it is called one"""


def judge_placement(
    tracks: Sequence[MarkerTrack],
    markers: Sequence[Marker],
    camera: CameraModel,
    task: StrikeTask,
    rest_end_ns: int,
) -> Judgement | None:
    """Verdict "wrong placement" on a strike before which the object was turned against its planned pose.

    It is given for turns of more than `MAX_TURN` (15 deg), otherwise None; the position is not checked. The
    reason names the strike of the plan that the markers at rest fit, if there is one. None also if no marker
    with a known place on the object is seen at rest in three frames.

    Args:
        tracks: tracks of the strike's window.
        markers: markers of the object.
        camera: camera with its pose in the world frame W of the planned strike.
        task: the strike as planned, and all strikes of its plan.
        rest_end_ns: time on the recording's clock (log_time) [ns]; frames before it are at rest.
    """
    seen = _orientations(tracks, markers, camera, rest_end_ns)
    if not seen:
        return None
    planned = task.planned
    turn, vector = _turn(seen, camera, planned, planned)
    if turn <= MAX_TURN:
        return None
    others = [strike for strike in task.plan_strikes if strike.id != planned.id]
    turns = [_turn(seen, camera, planned, strike)[0] for strike in others]
    degrees = math.degrees(turn)
    if turns and min(turns) <= MAX_TURN:
        fits = others[int(np.argmin(turns))].id
        text = (
            f"looks like {fits}, not {planned.id}: at rest the markers are turned by"
            f" {math.degrees(min(turns)):.0f} deg against {fits}, by {degrees:.0f} deg against {planned.id}:"
            f" record it as {fits}, or leave it out with --exclude"
        )
        return Judgement(Verdict.WRONG_PLACEMENT, text)
    upright = abs(float(vector[2])) > UPRIGHT_SHARE * turn
    where = "about the vertical" if upright else "onto another face"
    text = (
        f"not placed as on the card of {planned.id}: turned by {degrees:.0f} deg {where}, and it fits no"
        " other strike of the plan: strike again, or correct the markers' places in the object file"
    )
    return Judgement(Verdict.WRONG_PLACEMENT, text)


def _orientations(
    tracks: Sequence[MarkerTrack], markers: Sequence[Marker], camera: CameraModel, rest_end_ns: int
) -> list[list[Array]]:
    """Orientations of the object at rest that each marker allows, one or two per marker.

    A square has two poses that explain its corners; the second is left out if it fits clearly worse.

    Args:
        tracks: tracks of the strike's window.
        markers: markers of the object; those without a known place on it are left out.
        camera: camera that took the frames.
        rest_end_ns: time on the recording's clock (log_time) [ns]; frames before it are at rest.

    Returns:
        For each marker seen at rest a list of rotations (3, 3) from object frame O to camera frame.
    """
    by_id = {marker.id: marker for marker in markers}
    found: list[list[Array]] = []
    for track in tracks:
        marker, still = by_id.get(track.marker_id), track.time_ns < rest_end_ns
        if marker is None or marker.T_object_marker is None or np.count_nonzero(still) < MIN_RESTING_FRAMES:
            continue
        pair = solve_pose(
            np.median(undistort(camera, track.corners_px[still]), axis=0), marker.size, camera.K
        )
        if pair is None:
            continue
        most = MAX_ERROR_RATIO * max(float(pair.error_px[0]), MIN_ERROR_PX)
        found.append(
            [
                R @ marker.T_object_marker[:3, :3].T
                for R, error in zip(pair.R_camera_marker, pair.error_px, strict=True)
                if error <= most
            ]
        )
    return [each for each in found if each]


def _turn(
    seen: list[list[Array]], camera: CameraModel, as_planned: PlannedStrike, strike: PlannedStrike
) -> tuple[float, Array]:
    """Rotation of the object, as the markers show it at rest, against its pose in a strike of the plan.

    Of a marker's two possible poses the one nearer to the strike counts; of the markers, the median one.

    Args:
        seen: for each marker its possible rotations (3, 3) from object to camera frame.
        camera: camera with its pose in the world frame of `as_planned`.
        as_planned: the strike for which the camera's pose is given.
        strike: the strike that is compared; its world frame is turned about the vertical by the difference of
            the two strikes' headings (directions of the tip on the table).

    Returns:
        Angle [rad], and rotation vector (3,) [rad] in the world frame W of `strike`, z up.
    """
    there = turned_camera(camera, strike.heading_rad - as_planned.heading_rad)
    R_world_camera, R_planned = there.T_world_camera[:3, :3], np.array(strike.R_world_object, dtype=float)
    turns: list[Array] = []
    for poses in seen:
        vectors = [Rotation.from_matrix(R_world_camera @ R @ R_planned.T).as_rotvec() for R in poses]
        turns.append(min(vectors, key=lambda vector: float(np.linalg.norm(vector))))
    turns.sort(key=lambda vector: float(np.linalg.norm(vector)))
    middle = turns[len(turns) // 2]
    return float(np.linalg.norm(middle)), middle
