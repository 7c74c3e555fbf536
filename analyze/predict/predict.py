"""Strikes left out one by one: the exported body of all others, simulated and compared with the video.

A strike's simulation starts just after its impact: tipping angle and rate are fitted to the first tenth of
a second of free motion, with the balance angle and rate constant of the body that is simulated (each asset
gets the start that suits it best). From there MuJoCo runs alone. Compared is the tipping angle of every later
frame up to the landing. Tosses are in `tosses.py`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from analyze.errors import EstimationError
from analyze.export.body import ExportBody
from analyze.export.contact import MjcfContact
from analyze.motion.pendulum_motion import trajectory
from analyze.motion.predicted_motion import MAX_START_SHARE, MIN_START_FRAMES, START_DURATION_S
from analyze.pipeline.contact_properties import contact_properties
from analyze.pipeline.estimate_recordings import mergeable_heads, read_recordings
from analyze.pipeline.merge import merge_evidence, paths_text
from analyze.pipeline.solved import SolvedStrikes, solve_strikes, usable_motions
from analyze.predict.angle_error import AngleError
from analyze.predict.assets import ESTIMATED, SHELL, UNIFORM, Asset, strike_assets
from analyze.predict.scene import Start, Surroundings, simulated_angle
from analyze.predict.tosses import PredictedToss, SkippedToss, predict_toss, usable_tosses
from analyze.progress import no_progress

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from analyze.cache.results import ResultCache
    from analyze.pipeline.estimate import EstimateOptions
    from analyze.pipeline.evidence import Evidence
    from analyze.progress import Progress
    from analyze.types import Array, TipMotion
    from schemas.strike_plan import PlannedStrike

_MAX_STEPS = 12
"""Gauss-Newton steps for the start"""
_MIN_FRAMES = 5
"""least number of frames that are compared"""


@dataclass(frozen=True)
class PredictedStrike:
    """One strike, simulated by three bodies that do not know it."""

    strike_id: str
    """id of the strike"""
    time: Array
    """(n,) time of the frames since the simulation's start [s]"""
    measured: Array
    """(n,) tipping angle in the video [rad]"""
    simulated: dict[str, Array]
    """(n,) simulated tipping angle [rad], by name of the asset"""
    start: int
    """number of frames from which the start was fitted; the later ones are compared"""
    friction: float | None
    """coefficient of friction used; None for MuJoCo's default"""
    friction_is_bound: bool
    """True if only a lower bound of friction is known, which was used"""

    def error(self, asset: str) -> AngleError:
        """Error of an asset's simulation over the frames compared."""
        return AngleError.of((self.simulated[asset] - self.measured)[self.start :])

    @property
    def gain(self) -> float:
        """Rms error of the uniform body over that of the estimated one, by frames from the start's end on."""
        return self.error(UNIFORM).rms / max(self.error(ESTIMATED).rms, 1e-9)


@dataclass(frozen=True)
class SkippedStrike:
    """Strike that could not be predicted."""

    strike_id: str
    """id of the strike"""
    reason: str
    """reason in words"""


@dataclass(frozen=True)
class Predictions:
    """Predicted strikes and tosses of one object, at least one, and those that could not be."""

    name: str
    """name of the object"""
    strikes: tuple[PredictedStrike, ...]
    """predicted strikes, in recording order"""
    skipped: tuple[SkippedStrike, ...]
    """strikes that could not be predicted"""
    tosses: tuple[PredictedToss, ...] = ()
    """predicted tosses, in recording order"""
    skipped_tosses: tuple[SkippedToss, ...] = ()
    """tosses that could not be predicted"""


def predict_recordings(
    paths: Sequence[Path],
    options: EstimateOptions,
    wanted: Sequence[str] = (),
    progress: Progress | None = None,
    cache: ResultCache | None = None,
) -> Predictions:
    """Predict strikes and tosses of recordings of one object, each from an estimate that leaves it out.

    Args:
        paths: one or more recordings (MCAP), in any order.
        options: choices of the user.
        wanted: ids of strikes and tosses; empty for all that can be used.
        progress: called with (text, done, total) before each of them.
        cache: cache of strikes read before; None to read all anew.

    Raises:
        RecordingError, MergeError, ShapeError, PlanError, TrackingError: the recordings cannot be read or
            merged.
        EstimationError: a wanted id names no usable strike or toss, or none can be predicted.
    """
    heads, options = mergeable_heads(paths, options)
    evidence = merge_evidence(read_recordings(heads, options, progress, cache))
    try:
        return predict_left_out(evidence, options, wanted, progress)
    except EstimationError as error:
        raise EstimationError(f"{paths_text(heads)}: {error}") from None


def predict_left_out(
    evidence: Evidence,
    options: EstimateOptions,
    wanted: Sequence[str] = (),
    progress: Progress | None = None,
) -> Predictions:
    """Predict strikes and tosses, each from an estimate that leaves it out.

    Args:
        evidence: fitted motions of all strikes.
        options: choices of the user.
        wanted: ids of strikes and tosses; empty for all that can be used.
        progress: called with (text, done, total) before each of them.

    Raises:
        EstimationError: a wanted id names no usable strike or toss, or none can be predicted.
    """
    progress = progress or no_progress
    strikes = {m.strike_id: m for m in usable_motions(evidence) if m.strike_id not in options.exclude}
    flights = usable_tosses(evidence, options)
    usable = [*strikes, *flights]
    if unknown := [each for each in wanted if each not in usable]:
        raise EstimationError(
            f"{unknown[0]} cannot be predicted: it is not one of the usable strikes and tosses"
            f" ({', '.join(usable)}): choose one of these"
        )
    found: list[PredictedStrike] = []
    skipped: list[SkippedStrike] = []
    tosses: list[PredictedToss] = []
    skipped_tosses: list[SkippedToss] = []
    chosen = list(dict.fromkeys(wanted)) or usable
    for number, name in enumerate(chosen):
        progress(f"predicting {name}", number, len(chosen))
        try:
            if name in strikes:
                found.append(predict_strike(evidence, options, strikes[name]))
            else:
                tosses.append(predict_toss(evidence, options, flights[name]))
        except EstimationError as error:
            if name in strikes:
                skipped.append(SkippedStrike(name, str(error)))
            else:
                skipped_tosses.append(SkippedToss(name, str(error)))
    reasons = [(each.strike_id, each.reason) for each in skipped]
    reasons += [(each.toss_id, each.reason) for each in skipped_tosses]
    if not found and not tosses:
        if not reasons:
            raise EstimationError("no strike or toss is usable: `analyze inspect` shows why, one by one")
        raise EstimationError(f"nothing can be predicted: {reasons[0][0]}: {reasons[0][1]}")
    return Predictions(evidence.spec.name, tuple(found), tuple(skipped), tuple(tosses), tuple(skipped_tosses))


def predict_strike(evidence: Evidence, options: EstimateOptions, motion: TipMotion) -> PredictedStrike:
    """Predict one strike from an estimate that leaves it out.

    Args:
        evidence: fitted motions of all strikes.
        options: choices of the user.
        motion: the strike to leave out and predict.

    Raises:
        EstimationError: the others do not suffice for an estimate, or the strike has too few frames, or did
            not turn about its planned edge.
    """
    if motion.carried_by is not None or (motion.fit is not None and motion.fit.rolling is not None):
        raise EstimationError("it did not turn about its planned edge alone: choose another strike")
    time, measured, count = _frames(motion)
    without = replace(options, exclude=options.exclude | {motion.strike_id})
    solved = solve_strikes(evidence, without)
    if not solved.struck.com.observed:
        raise EstimationError(
            "without it the other strikes leave the centre of mass open: strike over more edges, or give"
            " further recordings of the object"
        )
    planned = evidence.planned(motion)
    around, bound = _surroundings(solved, evidence, planned, motion)
    simulated: dict[str, Array] = {}
    for asset in strike_assets(evidence.model, solved.struck):
        phi, k = balance(asset, planned, around)
        body = ExportBody(evidence.spec.name, evidence.model, asset.inertial, {})
        start = fitted_start(time[:count], measured[:count], phi, k)
        simulated[asset.name] = simulated_angle(body, evidence.model, planned, start, around, time)
    return PredictedStrike(motion.strike_id, time, measured, simulated, count, around.contact.friction, bound)


def _frames(motion: TipMotion) -> tuple[Array, Array, int]:
    """Times (n,) [s] and angles (n,) [rad] from the release to the landing, and the frames of the start.

    Raises:
        EstimationError: they are too few.
    """
    if motion.angle is None or motion.phases is None or motion.phases.stage_one is None:
        raise EstimationError("it has no free motion: choose another strike")
    first = motion.phases.stage_one[0]
    last = (motion.phases.stage_two or motion.phases.stage_one)[1]
    used = slice(first, max(last - 1, first))
    time = (motion.angle.time_ns[used] - motion.angle.time_ns[first]) * 1e-9
    count = max(int(np.searchsorted(time, START_DURATION_S)), MIN_START_FRAMES)
    count = min(count, int(MAX_START_SHARE * len(time)))
    if count < 3 or len(time) - count < _MIN_FRAMES:
        raise EstimationError(
            "too few frames of free motion: film at a higher rate, or choose another strike"
        )
    return np.asarray(time, dtype=np.float64), motion.angle.theta[used], count


def _surroundings(
    solved: SolvedStrikes, evidence: Evidence, planned: PlannedStrike, motion: TipMotion
) -> tuple[Surroundings, bool]:
    """Table and gravity of a strike by the other strikes; True if only a bound of friction is known."""
    contact = contact_properties(solved.evidence, solved.struck.com)
    friction, bound = None, False
    if contact.friction is not None:
        bound = contact.friction.value is None
        friction = contact.friction.bound if contact.friction.value is None else contact.friction.value
    restitution = None if contact.restitution is None else contact.restitution.mean
    tilts = solved.struck.com.tilts
    recording = evidence.recorded_in.get(motion.strike_id, 0)
    levels = (
        plane.level for plane in solved.planes if evidence.recorded_in.get(plane.strike_id, 0) == recording
    )
    lean = (0.0, 0.0)
    if tilts:
        x, y = tilts[min(next(levels, 0), len(tilts) - 1)].lean
        cos, sin = math.cos(planned.heading_rad), math.sin(planned.heading_rad)
        lean = (float(cos * x + sin * y), float(cos * y - sin * x))
    gravity = evidence.recording_of(motion.strike_id).manifest.g_m_s2
    return Surroundings(gravity, lean, MjcfContact(friction, restitution)), bound


def balance(asset: Asset, planned: PlannedStrike, around: Surroundings) -> tuple[float, float]:
    """Balance angle [rad] and rate constant [rad/s^2] of an asset over a planned edge.

    Args:
        asset: the body.
        planned: rest pose and edge.
        around: table and gravity.
    """
    own, line = asset.inertial, np.array(planned.pivot.direction)
    arm = np.array(planned.R_world_object) @ (own.com - np.array(planned.pivot.point))
    R = math.hypot(float(arm[0]), float(arm[2]))
    inertia = float(line @ own.inertia @ line) / own.mass + (R + planned.pivot.radius_m) ** 2
    return math.atan2(-float(arm[0]), float(arm[2])) + around.lean[0], around.gravity * R / inertia


def fitted_start(time: Array, theta: Array, phi: float, k: float) -> Start:
    """State at the first frame that fits n frames best, for a pendulum of given balance angle and rate.

    Args:
        time: (n,) times [s]; the first is 0.
        theta: (n,) measured angle [rad].
        phi: balance angle [rad].
        k: rate constant [rad/s^2].
    """
    state = np.array([theta[0], (theta[-1] - theta[0]) / time[-1]])
    for _ in range(_MAX_STEPS):
        expected, _, by = trajectory(time, phi, k, float(state[0]), float(state[1]))
        step = np.linalg.lstsq(by[:, 2:4], theta - expected, rcond=None)[0]
        state = state + step
        if float(np.abs(step).max()) < 1e-9:
            break
    return Start(float(state[0]), float(state[1]))


ASSETS = (ESTIMATED, UNIFORM, SHELL)
"""names of the assets, in the order of the table"""
