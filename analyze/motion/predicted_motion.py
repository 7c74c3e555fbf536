"""Comparison of measured theta(t) with a prediction from other strikes and the first free frames.

theta(t) is the tipping angle. A pendulum starts from the first free frames and moves with the balance angle
phi and rate k that are predicted from the other strikes. Any other motion of the edge (sliding, or rolling
on a curve that is not a circle) is not predicted: it is taken from the strike's own fit, as the difference
of that fit from a pendulum with the fit's phi and k. Upright is unstable: an error of the start grows with
e^(sqrt(k) t), and so does the prediction's standard deviation. Once it is so large that errors no longer add
up linearly, the prediction ends.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from analyze.least_squares.intervals import SIGMAS_95
from analyze.least_squares.robust import lag_one_correlation
from analyze.motion.pendulum_motion import trajectory

if TYPE_CHECKING:
    from analyze.types import Array, MotionFit, TipAngle

START_DURATION_S = 0.1
"""duration of the first part of the free motion, from which the start is estimated [s]"""
MIN_START_FRAMES = 6
"""least number of frames in that part"""
MAX_START_SHARE = 0.4
"""largest share of the frames used for the start"""
MIN_PREDICTED_FRAMES = 4
"""least number of predicted frames"""
MAX_PREDICTION_SD = math.radians(3.0)
"""standard deviation [rad] at which the prediction ends"""
_MAX_STEPS, _STEP_TOLERANCE = 12, 1e-9
"""Gauss-Newton steps for the start, and the step [rad, rad/s] that ends them"""
_PARAMETERS = 4
"""number of parameters of a strike's own fit: phi, k, theta0, omega0"""


@dataclass(frozen=True)
class PredictedValues:
    """Balance angle phi [rad] and rate k [rad/s^2] of a strike, as predicted from other strikes.

    k is that of the tip's equation theta'' = -k sin(phi - theta), theta the tipping angle. With them come the
    covariances of (phi, ln k) of the prediction and of the strike's own fit.
    """

    phi: float
    """balance angle [rad]"""
    k: float
    """rate of the tip, the k of theta'' = -k sin(phi - theta) [rad/s^2]"""
    covariance: Array
    """(2, 2) covariance of (phi, ln k) [rad, 1] caused by the errors of the other strikes"""
    own: Array
    """(2, 2) covariance of the strike's own (phi, ln k) [rad, 1], its frames' noise included"""


@dataclass(frozen=True)
class PredictedMotion:
    """Measured minus predicted tipping angle theta [rad] of one strike, in n frames.

    The prediction takes balance angle phi and rate k (theta'' = -k sin(phi - theta), rad/s^2) from the other
    strikes, and the start from the strike's own first free frames. The n frames are the free ones (in which
    only gravity and the table act) up to the prediction's end.
    """

    strike_id: str
    """id of the strike"""
    k: float
    """predicted k [rad/s^2]"""
    time: Array
    """(n,) time since the first free frame [s]"""
    offset: Array
    """(n,) measured minus predicted theta [rad]"""
    sd: Array
    """(n,) standard deviation of `offset` [rad] by phi and k, the start, and the frame's noise"""
    start: int
    """number of frames from which the start was estimated"""
    seconds: float
    """duration of the whole free motion [s]; longer than `time` if the prediction ended earlier"""
    chi2: float
    """chi^2, with 2 degrees of freedom, of the shift of (phi, ln k) that the predicted frames imply"""

    @property
    def worst(self) -> int:
        """Index of the predicted frame whose measured angle is off its prediction by most sd.

        The angle is the tipping angle; the index is that of the arrays (n,) of the free frames (in which only
        gravity and the table act).
        """
        return self.start + int(np.argmax(np.abs(self.offset[self.start :]) / self.sd[self.start :]))

    @property
    def outside(self) -> float:
        """Share (0 to 1) of predicted frames whose angle is over 1.96 sd off (0.05 expected)."""
        return float(np.mean(np.abs(self.offset[self.start :]) > SIGMAS_95 * self.sd[self.start :]))


def predicted_motion(
    strike_id: str, angle: TipAngle, fit: MotionFit, predicted: PredictedValues
) -> PredictedMotion:
    """Difference between measured tipping angle theta(t) and a pendulum with predicted phi and k.

    The pendulum is theta'' = -k sin(phi - theta); its start is fitted to the first frames. The prediction
    ends with the free frames (in which only gravity and the table act), or where its standard deviation
    exceeds `MAX_PREDICTION_SD`.

    Args:
        strike_id: id of the strike.
        angle: measured theta(t).
        fit: the strike's own fit; its window, indices [start, stop), is that of the free frames.
        predicted: balance angle phi [rad] and rate k [rad/s^2] from other strikes, with covariance.

    Returns:
        Offset [rad] (measured minus predicted) of every free frame up to the end of the prediction, with its
        standard deviation. Its chi^2 compares the changes of phi and ln k that best explain the offsets with
        their errors.
    """
    inside, first = slice(*fit.window), int(angle.time_ns[fit.window[0]])
    time = np.asarray((angle.time_ns[inside] - first) * 1e-9, dtype=np.float64)
    since = np.maximum(time - 1e-9 * (fit.time0_ns - first), 0.0)
    alone, speed, own_by = trajectory(since, fit.phi, fit.k or predicted.k, fit.theta0, fit.omega0)
    seen = alone + fit.residual
    noise = _noise(fit.residual, angle.sd[inside])
    count = len(time)
    start = min(
        max(int(np.searchsorted(time, START_DURATION_S)), MIN_START_FRAMES), int(MAX_START_SHARE * count)
    )
    early = slice(0, start)
    state = np.array([seen[0], speed[0]])
    for _ in range(_MAX_STEPS):
        expected, _, by = trajectory(
            time[early], predicted.phi, predicted.k, float(state[0]), float(state[1])
        )
        step = _estimator_rows(by[:, 2:4], noise[early, early]) @ (seen[early] - expected)
        state = state + step
        if float(np.abs(step).max()) < _STEP_TOLERANCE:
            break
    expected, _, by = trajectory(time, predicted.phi, predicted.k, float(state[0]), float(state[1]))
    # An error e of the early frames moves the start, and with it the prediction of all frames.
    left = np.eye(count)
    left[:, early] -= by[:, 2:4] @ _estimator_rows(by[early, 2:4], noise[early, early])
    by_body = left @ (by[:, :2] * np.array([1.0, predicted.k]))
    frames_covariance = left @ noise @ left.T
    own_rows = own_by * np.array([1.0, fit.k or predicted.k, 1.0, 1.0])
    by_frames = np.asarray(
        np.linalg.pinv(own_rows.T @ np.linalg.solve(noise, own_rows), hermitian=True)[:2, :2],
        dtype=np.float64,
    )
    body = predicted.covariance + _excess_scatter(predicted.own, by_frames)
    offset, sd = (
        seen - expected,
        np.sqrt(np.diag(frames_covariance) + np.einsum("ni,ij,nj->n", by_body, body, by_body)),
    )
    vague = np.flatnonzero(sd[start + MIN_PREDICTED_FRAMES :] > MAX_PREDICTION_SD)
    end = start + MIN_PREDICTED_FRAMES + int(vague[0]) if len(vague) else count
    late = slice(start, end)
    chi2 = _chi2_of_shift(offset[late], by_body[late], frames_covariance[late, late], body)
    return PredictedMotion(
        strike_id, predicted.k, time[:end], offset[:end], sd[:end], start, float(time[-1]), chi2
    )


def _estimator_rows(by: Array, noise: Array) -> Array:
    """Matrix (p, n) that turns n residuals into p parameters, by generalised least squares.

    Args:
        by: (n, p) derivatives of the observations by the parameters.
        noise: (n, n) covariance of the observations.
    """
    weighted = np.linalg.solve(noise, by)
    return np.asarray(np.linalg.solve(by.T @ weighted, weighted.T), dtype=np.float64)


def _chi2_of_shift(offset: Array, by: Array, noise: Array, body: Array) -> float:
    """Chi^2 of the shift of (phi, ln k) that best explains the offsets of the tipping angle theta.

    phi is the balance angle [rad], k [rad/s^2] the rate constant of theta'' = -k sin(phi - theta); chi^2 has
    2 degrees of freedom.

    Args:
        offset: (n,) measured minus predicted theta [rad].
        by: (n, 2) derivatives of theta by (phi, ln k).
        noise: (n, n) covariance of the offsets [rad^2].
        body: (2, 2) prior covariance of the shift (phi [rad], ln k).
    """
    weighted = np.linalg.solve(noise, by)
    information = by.T @ weighted
    # (I^-1 + body)^-1 without the inverse of an I that may be singular.
    score = weighted.T @ offset
    return float(score @ np.linalg.solve(information + information @ body @ information, score))


def _noise(residual: Array, sd: Array) -> Array:
    """Covariance (n, n) of the frames' noise [rad^2], by size and correlation of the residuals.

    Args:
        residual: (n,) measured minus fitted angle of a strike's own fit [rad].
        sd: (n,) stated standard deviation of the angle [rad].
    """
    n = len(residual)
    z = residual / sd
    squares = max(float(np.sum(z * z)), 1e-30)
    correlation = lag_one_correlation(z)
    away = np.abs(np.subtract.outer(np.arange(n), np.arange(n)))
    return squares / max(n - _PARAMETERS, 1) * np.outer(sd, sd) * correlation**away


def _excess_scatter(own: Array, by_frames: Array) -> Array:
    """Part (2, 2) of a strike's own covariance of (phi, ln k) that frame noise does not explain.

    phi is the balance angle [rad], k the rate constant of the tip [rad/s^2]; the covariances are in rad^2,
    rad and 1. Variances below 0, along the principal directions of the difference, count as 0.

    Args:
        own: (2, 2) the strike's own covariance.
        by_frames: (2, 2) covariance by its frames' noise.
    """
    values, vectors = np.linalg.eigh(own - by_frames)
    return np.asarray((vectors * np.maximum(values, 0.0)) @ vectors.T, dtype=np.float64)
