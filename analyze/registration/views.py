"""What one strike shows of where its markers are: the object at rest on a known face, and as it turns about a known edge."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from analyze.motion.strike import rest_end
from analyze.tracking.camera_model import undistort
from schemas.result import Verdict

if TYPE_CHECKING:
    from collections.abc import Sequence

    from analyze.motion.flank import Flank
    from analyze.types import Array, CameraModel, IntArray, Marker, MarkerTrack, TipMotion
    from schemas.strike_plan import PlannedStrike

TIP_FRAMES = 60
"""of a tip at most, evenly over its angle"""
IMAGE_PX = 0.02
"""px, what a lens model and the camera's pixels may add to each corner's noise; it comes out anew as the tag moves on, not at rest"""
_NOTHING: tuple[IntArray, Array] = np.zeros(0, dtype=np.int64), np.zeros(0)
LEAST_RESTING = 3
LEAST_TURN = 0.1
"""rad; of a smaller turn the axis cannot be told"""
TURNED_ABOUT_ITS_EDGE = (Verdict.GOOD, Verdict.ROCKED_BACK, Verdict.SLID)
"""the edge stayed on the table; where it went along it is left open"""
SEEN_AT_REST = (*TURNED_ABOUT_ITS_EDGE, Verdict.STRUCK_TWICE, Verdict.TWISTED, Verdict.ROLLED, Verdict.AIRBORNE, Verdict.NOT_MOVED)
"""the object lay as planned before it was struck"""


@dataclass(frozen=True)
class StrikeView:
    """One strike: frame 0 is the mean of the resting ones, the others are of the tip."""

    strike_id: str
    axis_id: str
    marker_ids: tuple[int | str, ...]
    """(m,)"""
    R_world_object: Array
    """(3, 3) as planned; its heading is only as the hand placed it"""
    p_object_pivot: Array
    """(3,) m, on the centre line of the edge's rounding"""
    direction: Array
    """(3,) unit, of that line in O"""
    radius: float
    """m"""
    pivot_sd: float
    """m, of that line across itself"""
    rolls: bool
    """it is a rim: nobody knows which point of it the body tipped over"""
    ideal: Array
    """(f, m, 4, 2) px"""
    sd: Array
    """(f, m) px, inf where the marker was not seen"""
    theta: Array
    """(f,) rad, 0 at rest; start values"""
    R_camera_marker: Array
    """(m, 3, 3) at rest, as the images alone show it"""
    p_camera_marker: Array
    """(m, 3) m"""
    camera: CameraModel
    """with its place in W as recorded"""
    setup: int = 0
    """number of the recording: strikes of one share a camera and a table"""
    flank: bool = False
    """the shape is a curve there: the body rolls, and no line of it keeps its height"""

    @property
    def turn(self) -> float:
        """Largest angle seen of the tip [rad]."""
        return float(np.max(self.theta, initial=0.0))


def strike_view(
    tracks: Sequence[MarkerTrack],
    markers: Sequence[Marker],
    camera: CameraModel,
    planned: PlannedStrike,
    motion: TipMotion,
    setup: int = 0,
    section: Flank | None = None,
) -> StrikeView | None:
    """Choose the frames that tell of the markers' places; None where no marker was surely seen at rest.

    Args:
        tracks: of the strike's window.
        markers: of the object; nothing but their ids and sizes is used.
        camera: that saw it.
        planned: how the object was to lie, and the edge.
        motion: what the strike was taken for.
        setup: number of the recording.
        section: the curved flank that it rolls on, by its shape; None: its edge is one, rounded as planned. A flank's tip is left out.
    """
    if motion.verdict not in SEEN_AT_REST:
        return None
    known = {marker.id for marker in markers}
    end_ns = rest_end(tracks, 0)
    seen = [t for t in tracks if t.marker_id in known and np.count_nonzero(t.time_ns < end_ns) >= LEAST_RESTING]
    if not seen:
        return None
    time_ns, theta = _tip(motion, planned) if section is None else _NOTHING
    frames = 1 + len(time_ns)
    ideal, sd = np.zeros((frames, len(seen), 4, 2)), np.full((frames, len(seen)), np.inf)
    R, p = np.zeros((len(seen), 3, 3)), np.zeros((len(seen), 3))
    for j, track in enumerate(seen):
        corners = undistort(camera, track.corners_px)
        still = np.flatnonzero(track.time_ns < end_ns)
        ideal[0, j] = np.median(corners[still], axis=0)
        sd[0, j] = np.hypot(np.median(track.corner_sd_px[still]) / np.sqrt(len(still)), IMAGE_PX)
        middle = still[len(still) // 2]
        R[j], p[j] = track.R_camera_marker[middle], track.p_camera_marker[middle]
        at = np.searchsorted(track.time_ns, time_ns)
        for f, index in enumerate(at.tolist()):
            if index < len(track.time_ns) and track.time_ns[index] == time_ns[f]:
                ideal[1 + f, j] = corners[index]
                sd[1 + f, j] = np.hypot(track.corner_sd_px[index], IMAGE_PX)
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
        flank=section is not None,
    )


def _tip(motion: TipMotion, planned: PlannedStrike) -> tuple[IntArray, Array]:
    """Times [ns] and angles [rad] of the chosen frames of the tip; none where it did not turn about its edge, or that is a rim."""
    angle, phases = motion.angle, motion.phases
    if angle is None or phases is None or phases.stage_one is None or planned.rolls or motion.verdict not in TURNED_ABOUT_ITS_EDGE:
        return _NOTHING
    start, stop = (phases.stage_one[0], phases.stage_one[1]) if motion.fit is None else motion.fit.window
    theta = angle.theta[start:stop]
    if len(theta) == 0 or float(np.max(theta)) < LEAST_TURN:
        return _NOTHING
    wanted = np.linspace(float(np.min(theta)), float(np.max(theta)), TIP_FRAMES)
    chosen = start + np.unique(np.argmin(np.abs(theta[None, :] - wanted[:, None]), axis=1))
    return angle.time_ns[chosen], angle.theta[chosen]
