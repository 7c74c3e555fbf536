"""View of one strike for registration: the object at rest on a known face, and tipping over an edge.

Registration estimates where the object's markers are glued on.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from analyze.motion.strike import end_of_rest_ns
from analyze.tracking.camera_model import undistort
from schemas.strike_result import Verdict

if TYPE_CHECKING:
    from collections.abc import Sequence

    from analyze.motion.support_function import SupportFunction
    from analyze.types import Array, CameraModel, IntArray, Marker, MarkerTrack, TipMotion
    from schemas.strike_plan import PlannedStrike

MAX_TIP_FRAMES = 60
"""most frames of a tip that are used, evenly over its angle"""
MODEL_SD_PX = 0.02
"""standard deviation of each corner caused by lens model and pixels [px]; it varies as the tag moves, but not
at rest"""
INDEPENDENT_ON_RIM = 4
"""number of frames of a tip over a rim whose errors by lens and pixels count as independent: they depend on
how obliquely a marker is seen, which hardly changes, and over a rim images alone give all of its pose"""
_NO_FRAMES: tuple[IntArray, Array] = np.zeros(0, dtype=np.int64), np.zeros(0)
"""times and angles of no frames"""
MIN_RESTING_FRAMES = 3
"""least number of frames at rest"""
MIN_TURN_RAD = 0.1
"""least turn [rad] that determines the axis"""
EDGE_ON_TABLE = (Verdict.GOOD, Verdict.ROCKED_BACK, Verdict.SLID)
"""verdicts on strikes whose edge stayed on the table; its position along the table is free in the fit"""
PLACED_AS_PLANNED = (
    *EDGE_ON_TABLE,
    Verdict.STRUCK_TWICE,
    Verdict.TWISTED,
    Verdict.ROLLED,
    Verdict.AIRBORNE,
    Verdict.NOT_MOVED,
)
"""verdicts on strikes before which the object was placed as planned"""


@dataclass(frozen=True)
class StrikeView:
    """Marker corners [px, free of lens distortion] of one strike, with planned pose and pivot line.

    Frame 0 is the median of the frames at rest, the others show the object tipping. There are m markers and f
    frames. O is the object frame, M a marker's, C the camera's, W the world frame.
    """

    strike_id: str
    """id of the strike"""
    axis_id: str
    """id of the pivot axis"""
    marker_ids: tuple[int | str, ...]
    """(m,) names of the markers seen"""
    R_world_object: Array
    """(3, 3) planned rotation from O to W; its heading is as accurate as the hand"""
    p_object_pivot: Array
    """(3,) point on the centre line of the edge's rounding, in O [m]"""
    direction: Array
    """(3,) unit vector of that line in O"""
    radius: float
    """radius of the rounding [m]"""
    pivot_sd: float
    """standard deviation of that line across itself [m]"""
    rolls: bool
    """True if the edge is a round rim, whose touching point is unknown"""
    ideal: Array
    """(f, m, 4, 2) corners of m markers in f frames [ideal px]"""
    sd: Array
    """(f, m) standard deviation of a corner [px], infinite if the marker was not seen"""
    theta: Array
    """(f,) first guess of theta [rad], 0 at rest"""
    R_camera_marker: Array
    """(m, 3, 3) rotation from M to C at rest, by the images alone"""
    p_camera_marker: Array
    """(m, 3) position in C at rest [m]"""
    camera: CameraModel
    """camera with its recorded pose in W"""
    setup: int = 0
    """number of the recording: its strikes share a camera and a table"""
    on_curve: bool = False
    """True if the body rolls on a curve of its shape, so that no line of it stays at one height"""
    heading: float = 0.0
    """angle about W's z by which object and striker were turned on the table [rad]; `R_world_object` is then
    into W turned by it"""
    rim_centre: Array | None = None
    """(3,) point on the axis of a round rim, in O [m]; None over a straight edge, or on another curve"""

    @property
    def on_rim(self) -> bool:
        """True if the body tips over a round rim, a circle about a known axis."""
        return self.rim_centre is not None


def strike_view(
    tracks: Sequence[MarkerTrack],
    markers: Sequence[Marker],
    camera: CameraModel,
    planned: PlannedStrike,
    motion: TipMotion,
    setup: int = 0,
    section: SupportFunction | None = None,
    rim_centre: Array | None = None,
) -> StrikeView | None:
    """Resting and tipping frames of a strike, for registration; None if it cannot be used.

    None if the object was not placed as planned or its motion could not be read, by the verdict, or if no
    marker was seen in three frames at rest. There are no tipping frames if the edge did not stay on the
    table, or if the contact rolls other than along a circular rim.

    Args:
        tracks: tracks of the strike's window.
        markers: markers of the object; only their ids are used.
        camera: camera that took them.
        planned: planned placement and edge.
        motion: analysed motion with its verdict.
        setup: number of the recording.
        section: cross-section on which the body rolls, if it is curved; only resting frames are then used.
            None for an edge with the planned rounding.
        rim_centre: (3,) point on the axis of the planned round rim [m], in the object frame; None for a
            straight edge, or a rim that is no circle.
    """
    if motion.verdict not in PLACED_AS_PLANNED:
        return None
    known = {marker.id for marker in markers}
    end_ns = end_of_rest_ns(tracks, 0)
    seen = [
        t
        for t in tracks
        if t.marker_id in known and np.count_nonzero(t.time_ns < end_ns) >= MIN_RESTING_FRAMES
    ]
    if not seen:
        return None
    hinge = section is None and (rim_centre is not None or not planned.rolls)
    time_ns, theta = _tip(motion) if hinge else _NO_FRAMES
    frames = 1 + len(time_ns)
    model_sd = MODEL_SD_PX * (
        max(1.0, len(time_ns) / INDEPENDENT_ON_RIM) ** 0.5 if rim_centre is not None else 1.0
    )
    ideal, sd = np.zeros((frames, len(seen), 4, 2)), np.full((frames, len(seen)), np.inf)
    R, p = np.zeros((len(seen), 3, 3)), np.zeros((len(seen), 3))
    for j, track in enumerate(seen):
        corners = undistort(camera, track.corners_px)
        still = np.flatnonzero(track.time_ns < end_ns)
        ideal[0, j] = np.median(corners[still], axis=0)
        sd[0, j] = np.hypot(np.median(track.corner_sd_px[still]) / np.sqrt(len(still)), MODEL_SD_PX)
        middle = still[len(still) // 2]
        R[j], p[j] = track.R_camera_marker[middle], track.p_camera_marker[middle]
        _, index, frame = np.intersect1d(track.time_ns, time_ns, return_indices=True)
        ideal[1 + frame, j] = corners[index]
        sd[1 + frame, j] = np.hypot(track.corner_sd_px[index], model_sd)
    direction = np.array(planned.pivot.direction, dtype=np.float64)
    return StrikeView(
        strike_id=motion.strike_id,
        axis_id=planned.axis_id,
        marker_ids=tuple(track.marker_id for track in seen),
        R_world_object=np.array(planned.R_world_object, dtype=np.float64),
        p_object_pivot=np.array(planned.pivot.point, dtype=np.float64),
        direction=direction / np.linalg.norm(direction),
        radius=planned.pivot.radius_m,
        pivot_sd=planned.pivot.sd_m,
        rolls=planned.rolls,
        ideal=ideal,
        sd=sd,
        theta=np.concatenate([[0.0], theta]),
        R_camera_marker=R,
        p_camera_marker=p,
        camera=camera,
        setup=setup,
        on_curve=section is not None,
        heading=planned.heading_rad,
        rim_centre=rim_centre if section is None else None,
    )


def _tip(motion: TipMotion) -> tuple[IntArray, Array]:
    """Log times (n,) [ns] and tipping angles (n,) [rad] of the frames of a tip that are used.

    Used are at most `MAX_TIP_FRAMES` (60) frames of the fit's window, or without a fit of the free motion up
    to balance, spread evenly over the angle. n is 0 for a strike that shows no tip on the table: its
    verdict is not good, rocked back or slid (`EDGE_ON_TABLE`), or its tip was not measured or is below
    `MIN_TURN_RAD` (0.1 rad).

    Args:
        motion: analysed motion of the strike with its verdict and phases.
    """
    angle, phases = motion.angle, motion.phases
    if angle is None or phases is None or phases.stage_one is None or motion.verdict not in EDGE_ON_TABLE:
        return _NO_FRAMES
    start, stop = phases.stage_one if motion.fit is None else motion.fit.window
    theta = angle.theta[start:stop]
    if len(theta) == 0 or float(np.max(theta)) < MIN_TURN_RAD:
        return _NO_FRAMES
    wanted = np.linspace(float(np.min(theta)), float(np.max(theta)), MAX_TIP_FRAMES)
    chosen = start + np.unique(np.argmin(np.abs(theta[None, :] - wanted[:, None]), axis=1))
    return angle.time_ns[chosen], angle.theta[chosen]
