"""Tosses left out one by one: the exported body of all else, thrown in MuJoCo and compared with the video.

Attitude and spin at the launch are fitted to the first 0.15 s of the flight without a law of rotation
(`flight/launch.py`), so that no asset is favoured: all begin alike. Only the place and velocity of the centre
of mass are each asset's own, as its c is. From the middle of these frames MuJoCo runs alone. Compared is the
attitude in every frame after them, as tracked from that frame's image alone.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from analyze.errors import EstimationError
from analyze.export.body import ExportBody
from analyze.flight.launch import MIN_FRAMES, fitted_launch
from analyze.flight.tracked_attitude import tracked_attitudes
from analyze.geometry.rotations import angle_between
from analyze.pipeline.object_markers import placed_markers
from analyze.pipeline.solved import solve_strikes
from analyze.predict.angle_error import AngleError
from analyze.predict.assets import ESTIMATED, UNIFORM, strike_assets
from analyze.predict.thrown import ROOM_AIR, Throw, thrown_attitudes
from analyze.tracking.camera_model import camera_from_spec
from schemas.toss_result import TossVerdict
from schemas.wording import counted

if TYPE_CHECKING:
    from analyze.flight.toss import TossMotion
    from analyze.pipeline.evidence import Evidence
    from analyze.pipeline.solved import EstimateOptions
    from analyze.predict.thrown import Air
    from analyze.types import Array

START_S = 0.15
"""time from the flight's first frame on [s] whose frames give the launch"""
MAX_ATTITUDE_SD = np.radians(3.0)
"""standard deviation of a frame's attitude [rad] above which it is neither used nor compared"""
_MIN_COMPARED = 5
"""least number of frames that are compared"""


@dataclass(frozen=True)
class PredictedToss:
    """One toss, thrown by three bodies that do not know it."""

    toss_id: str
    """id of the toss"""
    time: Array
    """(n,) times of the frames compared, since the flight's first [s]"""
    measured: Array
    """(n, 3, 3) attitude in the video, from O to W"""
    measured_sd: Array
    """(n,) standard deviation of this attitude [rad]"""
    simulated: dict[str, Array]
    """(n, 3, 3) simulated attitude, by name of the asset"""

    def error(self, asset: str) -> AngleError:
        """Error of an asset's attitude: the angle of the turn between simulated and tracked one."""
        return AngleError.of(angle_between(self.measured, self.simulated[asset]))

    @property
    def gain(self) -> float:
        """Rms error of the uniform body over that of the estimated one."""
        return self.error(UNIFORM).rms / max(self.error(ESTIMATED).rms, 1e-9)


@dataclass(frozen=True)
class SkippedToss:
    """Toss that could not be predicted."""

    toss_id: str
    """id of the toss"""
    reason: str
    """reason in words"""


def usable_tosses(evidence: Evidence, options: EstimateOptions) -> dict[str, TossMotion]:
    """Tosses with a good flight that are not excluded, by id."""
    return {
        toss.toss_id: toss
        for toss in evidence.tosses
        if toss.verdict is TossVerdict.GOOD
        and toss.flight is not None
        and toss.toss_id not in options.exclude
    }


def predict_toss(
    evidence: Evidence, options: EstimateOptions, toss: TossMotion, air: Air = ROOM_AIR
) -> PredictedToss:
    """Predict one toss from an estimate that leaves it out.

    Args:
        evidence: strikes and tosses of all recordings.
        options: choices of the user.
        toss: the toss to leave out and predict.
        air: air in the simulation.

    Raises:
        EstimationError: the others do not suffice for an estimate, or the toss has too few frames.
    """
    if toss.flight is None:
        raise EstimationError("it has no free flight: choose another toss")
    manifest = evidence.recordings[evidence.recorded_in.get(toss.toss_id, 0)].manifest
    camera = camera_from_spec(manifest.cameras[0].calibration)
    tags = toss.flight.tags_at(placed_markers(evidence.spec))
    track = tracked_attitudes(toss.flight.views, toss.flight.path, tags, camera, MAX_ATTITUDE_SD)
    count = int(np.searchsorted(track.time, START_S))
    if count < MIN_FRAMES or len(track) - count < _MIN_COMPARED:
        raise EstimationError(
            f"its attitude is sure in {counted(count, 'frame')} of the first {START_S} s and in"
            f" {len(track) - count} later on, {MIN_FRAMES} and {_MIN_COMPARED} are needed: film at a higher"
            " rate, nearer, or with more markers"
        )
    begin, rest = track.part(slice(count)), track.part(slice(count, None))
    solved = solve_strikes(evidence, replace(options, exclude=options.exclude | {toss.toss_id}))
    if not solved.struck.com.observed:
        raise EstimationError(
            "without it the strikes and other tosses leave the centre of mass open: strike over more edges"
        )
    launch = fitted_launch(begin)
    gravity = np.array([0.0, 0.0, -manifest.g_m_s2])
    simulated: dict[str, Array] = {}
    for asset in strike_assets(evidence.model, solved.struck):
        place, velocity = launch.place(begin, asset.inertial.com, gravity)
        throw = Throw(launch.R_world_object, launch.spin, place, velocity, gravity, air)
        body = ExportBody(evidence.spec.name, evidence.model, asset.inertial, {})
        simulated[asset.name] = thrown_attitudes(body, throw, rest.time - launch.time)
    return PredictedToss(toss.toss_id, rest.time, rest.R_world_object, rest.sd, simulated)
