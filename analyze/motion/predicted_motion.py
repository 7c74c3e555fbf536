"""Theta(t) of a strike as phi and k from elsewhere and its own first free frames foretell it, beside what was seen, frame by frame.

The pendulum is started by the first frames and let run with the foretold phi and k. What the edge did besides (it slid, or rolled on a
flank that is no circle) is as the strike's own fit has it: what that fit makes of the motion less the pendulum with the same numbers.
Upright is unstable: an error of the start grows with e^(sqrt(k) t), and so does the band. Where it has grown so wide that it says
nothing, and errors no longer add up, the foretelling ends.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from analyze.least_squares.robust import lag_one_correlation
from analyze.motion.pendulum import trajectory

if TYPE_CHECKING:
    from analyze.types import Array, MotionFit, TipAngle

START_S = 0.1
"""of the free motion, from which the start is taken"""
LEAST_START = 6
"""frames of it"""
MOST_START = 0.4
"""of the frames"""
LEAST_FORETOLD = 4
"""frames"""
VAGUE = math.radians(3.0)
"""1 sigma at which the foretelling ends"""
_ROUNDS, _SETTLED = 12, 1e-9
_PARAMETERS = 4


@dataclass(frozen=True)
class PredictedValues:
    """Phi and k of a strike as they are foretold."""

    phi: float
    """rad"""
    k: float
    """rad/s^2"""
    covariance: Array
    """(2, 2) of (phi, ln k): of what foretells them"""
    own: Array
    """(2, 2), by which the strike's own phi and ln k scatter, its frames' noise with it"""


@dataclass(frozen=True)
class PredictedMotion:
    """Theta(t) measured less foretold, over the strike's free frames."""

    strike_id: str
    k: float
    """rad/s^2, as foretold"""
    time: Array
    """(n,) s since the first of them"""
    offset: Array
    """(n,) rad"""
    sd: Array
    """(n,) rad, expected of that: of phi and k, the start, and the frame's noise"""
    start: int
    """so many of them gave the start"""
    seconds: float
    """of the whole free motion; more than `time` where the foretelling ended before"""
    squared: float
    """chi^2 of two: what phi and k the later frames speak for, against the foretold ones"""

    @property
    def worst(self) -> int:
        """The foretold frame that is farthest off for its sd."""
        return self.start + int(np.argmax(np.abs(self.offset[self.start :]) / self.sd[self.start :]))

    @property
    def outside(self) -> float:
        """Share of the foretold frames off by more than 1.96 sd: 0.05 is usual."""
        return float(np.mean(np.abs(self.offset[self.start :]) > 1.96 * self.sd[self.start :]))


def predicted_motion(
    strike_id: str, angle: TipAngle, fit: MotionFit, told: PredictedValues
) -> PredictedMotion:
    """Start the pendulum by the first free frames, let it run with the foretold phi and k, and compare.

    Args:
        strike_id: of the strike.
        angle: theta(t) as it was seen.
        fit: the strike's own, whose window holds its free frames.
        told: phi and k from elsewhere.
    """
    inside, first = slice(*fit.window), int(angle.time_ns[fit.window[0]])
    time = np.asarray((angle.time_ns[inside] - first) * 1e-9, dtype=np.float64)
    since = np.maximum(time - 1e-9 * (fit.time0_ns - first), 0.0)
    alone, speed, own_by = trajectory(since, fit.phi, fit.k or told.k, fit.theta0, fit.omega0)
    seen = alone + fit.residual
    noise = _noise(fit.residual, angle.sd[inside])
    count = len(time)
    start = min(max(int(np.searchsorted(time, START_S)), LEAST_START), int(MOST_START * count))
    early = slice(0, start)
    state = np.array([seen[0], speed[0]])
    for _ in range(_ROUNDS):
        expected, _, by = trajectory(time[early], told.phi, told.k, float(state[0]), float(state[1]))
        step = _least_squares(by[:, 2:4], noise[early, early]) @ (seen[early] - expected)
        state = state + step
        if float(np.abs(step).max()) < _SETTLED:
            break
    expected, _, by = trajectory(time, told.phi, told.k, float(state[0]), float(state[1]))
    # An error e of the early frames moves the start, and with it all that follows.
    left = np.eye(count)
    left[:, early] -= by[:, 2:4] @ _least_squares(by[early, 2:4], noise[early, early])
    by_body = left @ (by[:, :2] * np.array([1.0, told.k]))
    of_frames = left @ noise @ left.T
    own_rows = own_by * np.array([1.0, fit.k or told.k, 1.0, 1.0])
    by_frames = np.asarray(
        np.linalg.pinv(own_rows.T @ np.linalg.solve(noise, own_rows), hermitian=True)[:2, :2],
        dtype=np.float64,
    )
    body = told.covariance + _beyond(told.own, by_frames)
    offset, sd = (
        seen - expected,
        np.sqrt(np.diag(of_frames) + np.einsum("ni,ij,nj->n", by_body, body, by_body)),
    )
    vague = np.flatnonzero(sd[start + LEAST_FORETOLD :] > VAGUE)
    end = start + LEAST_FORETOLD + int(vague[0]) if len(vague) else count
    late = slice(start, end)
    squared = _against(offset[late], by_body[late], of_frames[late, late], body)
    return PredictedMotion(
        strike_id, told.k, time[:end], offset[:end], sd[:end], start, float(time[-1]), squared
    )


def _least_squares(by: Array, noise: Array) -> Array:
    """(p, n): what (n,) values make of p parameters."""
    weighted = np.linalg.solve(noise, by)
    return np.asarray(np.linalg.solve(by.T @ weighted, weighted.T), dtype=np.float64)


def _against(offset: Array, by: Array, noise: Array, body: Array) -> float:
    """Chi^2 of the change of (phi, ln k) that the offsets (n,) speak for, which `body` (2, 2) and they themselves leave uncertain."""
    weighted = np.linalg.solve(noise, by)
    information = by.T @ weighted
    # (I^-1 + body)^-1 without the inverse of an I that may be singular.
    told = weighted.T @ offset
    return float(told @ np.linalg.solve(information + information @ body @ information, told))


def _noise(residual: Array, sd: Array) -> Array:
    """(n, n) rad^2, of frames: as large, and as alike from frame to frame, as what the strike's own fit leaves."""
    n = len(residual)
    z = residual / sd
    squares = max(float(np.sum(z * z)), 1e-30)
    alike = lag_one_correlation(z)
    away = np.abs(np.subtract.outer(np.arange(n), np.arange(n)))
    return squares / max(n - _PARAMETERS, 1) * np.outer(sd, sd) * alike**away


def _beyond(own: Array, by_frames: Array) -> Array:
    """What of the strike's own scatter (2, 2) is not its frames' noise."""
    values, vectors = np.linalg.eigh(own - by_frames)
    return np.asarray((vectors * np.maximum(values, 0.0)) @ vectors.T, dtype=np.float64)
