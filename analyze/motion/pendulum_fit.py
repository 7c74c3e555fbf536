"""Balance angle phi and k of one strike: the pendulum fitted to theta(t) while only gravity acts.

theta(t) is the tipping angle, phi the theta at which the centre of mass stands above the pivot edge, and k =
m g R / I_edge [rad/s^2] the pendulum's rate (mass m, gravity g, R the distance of the centre of mass from the
edge, I_edge the moment of inertia about the edge). Levenberg-Marquardt with exact derivatives and Huber's
loss (analyze/least_squares), because the error of a misread frame is not Gaussian. The covariance is that of
the linearised fit, scaled by the residuals' own variance and by their correlation from frame to frame, so
that it stays correct where the camera's noise is misjudged or the contact is not quite a hinge. If phi is
then uncertain by more than 0.3 deg, the interval of the profile likelihood replaces it. An error of theta's
zero moves phi by the same amount; its variance is added at the end.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from analyze.errors import EstimationError
from analyze.least_squares.levenberg_marquardt import (
    Minimum,
    minimise,
    residual_variance,
    unit_covariance,
)
from analyze.motion.pendulum_motion import first_guess, trajectory
from analyze.motion.profile import FittedTip, profile_sd
from analyze.types import MotionFit

if TYPE_CHECKING:
    from analyze.least_squares.levenberg_marquardt import Model
    from analyze.types import Array, TipAngle

MIN_FRAMES = 8
"""least number of frames of a fit"""
MAX_LINEAR_PHI_SD = math.radians(0.3)
"""phi sd [rad] above which a linearised covariance is replaced by the profile likelihood"""
_SCALE = np.array([0.1, 20.0, 0.02, 0.2, 0.1])
"""typical changes of phi, k, theta0, omega0 and a jump in speed [rad, rad/s^2, rad, rad/s, rad/s], for
conditioning"""
_FALLBACK_K = 60.0
"""first guess of k [rad/s^2] if the linear guess is not a tip"""


@dataclass(frozen=True)
class Sample:
    """Part of the tipping angle theta(t) that is fitted, with a first guess of the motion's parameters.

    They are those of theta'' = -k sin(phi - theta): balance angle phi [rad], rate constant k [rad/s^2], and
    the angle theta0 [rad] and its rate omega0 [rad/s] at the first time.
    """

    time: Array
    """(n,) time since the first frame [s]"""
    theta: Array
    """(n,) tipping angle [rad]"""
    sd: Array
    """(n,) random standard deviation of theta [rad]"""
    guess: Array
    """(4,) first guess of phi, k, theta0, omega0 [rad, rad/s^2, rad, rad/s]"""


@dataclass(frozen=True)
class FittedModel:
    """Best parameters of a model of the tipping angle theta(t), with residuals and covariance.

    phi is the balance angle, k the rate constant of theta'' = -k sin(phi - theta), theta0 the angle and
    omega0 its rate at the first time.
    """

    parameters: Array
    """(p,) phi, k, theta0, omega0 [rad, rad/s^2, rad, rad/s], then any further parameters of the model"""
    residual: Array
    """(n,) measured minus fitted theta [rad]"""
    covariance: Array
    """(2, 2) covariance of (phi, k)"""


def pivot_fit(angle: TipAngle, window: tuple[int, int], radius: float = 0.0) -> MotionFit:
    """Fit phi, k, theta0, omega0 of the pendulum to theta(t) over one window.

    Args:
        angle: tipping angle theta(t) of the strike.
        window: frames [start, stop) in which only gravity acts.
        radius: radius of the edge's rounding [m], on which the edge rolls; 0 for a sharp edge.

    Returns:
        The fit: balance angle phi [rad], rate k [rad/s^2] of theta'' = -k sin(phi - theta), theta0 [rad] and
        omega0 [rad/s] (theta and its rate at the window's first frame), the (2, 2) covariance of (phi, k),
        and the residuals of theta [rad].

    Raises:
        EstimationError: the window has too few frames, or the best fit is not a tip over an edge.
    """
    sample = cut_sample(angle, window, 4)
    fitted = fit_model(sample, hinge_model(sample.time, radius), sample.guess, radius)
    return motion_fit("pivot_fit", angle, window, fitted)


def hinge_model(time: Array, radius: float) -> Model:
    """Model of a tip over an edge in place: function of (4,) phi, k, theta0, omega0.

    phi is the balance angle [rad], k [rad/s^2] the rate of theta'' = -k sin(phi - theta) (or of its form for
    an edge that rolls on its rounding), theta0 and omega0 are tipping angle theta [rad] and speed [rad/s] at
    the first time. The function gives theta (n,) [rad] at the times, and its derivatives (n, 4) by the four.

    Args:
        time: (n,) times [s].
        radius: radius of the edge's rounding [m].
    """

    def model(x: Array) -> tuple[Array, Array]:
        """Tipping angle (n,) [rad], and derivatives (n, 4) by x (4,).

        x holds the balance angle phi [rad], the rate k [rad/s^2] of theta'' = -k sin(phi - theta) (or of its
        form for an edge that rolls on its rounding), and tipping angle theta0 [rad] and speed omega0 [rad/s]
        at the first time.
        """
        phi, k, theta0, omega0 = (float(each) for each in x)
        theta, _, jacobian = trajectory(time, phi, k, theta0, omega0, radius)
        return theta, jacobian

    return model


def cut_sample(angle: TipAngle, window: tuple[int, int], parameters: int) -> Sample:
    """Cut a window out of theta(t), and guess the parameters of a pendulum that moves like it.

    Args:
        angle: tipping angle theta(t) of the strike.
        window: frames [start, stop).
        parameters: number of parameters that will be fitted.

    Returns:
        The window's times since its first frame [s], angles [rad], their standard deviations, and the guess:
        balance angle phi [rad], rate constant k [rad/s^2], and angle [rad] and speed [rad/s] at the first
        frame. The guess is the linear least-squares solution; if that has no phi between 0 and 2 rad or no k
        above 1 rad/s^2, it is a rough one from the largest angle.

    Raises:
        EstimationError: the window has fewer than `MIN_FRAMES` (8) or `parameters` + 3 frames.
    """
    first, last = window
    if last - first < max(MIN_FRAMES, parameters + 3):
        raise EstimationError(
            f"only {last - first} frames of free tipping, {MIN_FRAMES} are needed:"
            " raise the frame rate or strike less hard"
        )
    time = np.asarray((angle.time_ns[first:last] - angle.time_ns[first]) * 1e-9, dtype=np.float64)
    theta, sd = angle.theta[first:last], np.maximum(angle.sd[first:last], 1e-6)
    guess = first_guess(time, theta)
    if not (0.0 < guess[0] < 2.0 and guess[1] > 1.0):
        speed = float(theta[2] - theta[0]) / float(time[2] - time[0])
        guess = np.array([max(0.3, 0.8 * float(np.max(theta))), _FALLBACK_K, float(theta[0]), speed])
    return Sample(time, theta, sd, guess)


def fit_model(sample: Sample, model: Model, start: Array, radius: float | None = None) -> FittedModel:
    """Fit a model of the tipping angle theta(t) whose first parameters are balance angle phi and rate k.

    k [rad/s^2] is the rate constant of the tip, theta'' = -k sin(phi - theta).

    Args:
        sample: measured tipping angle theta(t) at n times.
        model: function that gives theta (n,), and its derivatives (n, p) by the parameters, at parameters
            (p,).
        start: (p,) first parameters phi [rad], k [rad/s^2], theta0 [rad], omega0 [rad/s], and for p = 5 a
            jump in speed [rad/s].
        radius: radius of the edge's rounding [m] if the model is the pendulum itself (`hinge_model`), so that
            the profile likelihood may replace the linearised interval of an uncertain phi; None otherwise.

    Returns:
        The best parameters (p,), the residuals (n,) [rad], and the covariance (2, 2) of (phi, k).

    Raises:
        EstimationError: the best fit is not a tip over an edge: phi outside 0 to 2.5 rad, k outside 0.5 to
            5000 rad/s^2, or a motion that grows beyond all bounds.
    """
    scale = _SCALE[: len(start)]
    minimum = minimise(sample.theta, sample.sd, model, start, scale)
    phi, k = float(minimum.parameters[0]), float(minimum.parameters[1])
    if not (0.0 < phi < 2.5 and 0.5 < k < 5000.0 and np.isfinite(minimum.jacobian).all()):
        raise EstimationError(
            f"the motion is not a tip over an edge (phi {math.degrees(phi):.1f} deg, k {k:.1f} rad/s^2):"
            " look at the images"
        )
    covariance = _covariance(minimum, sample, scale, radius)
    return FittedModel(minimum.parameters, minimum.residual, covariance[:2, :2])


def motion_fit(estimator: str, angle: TipAngle, window: tuple[int, int], fitted: FittedModel) -> MotionFit:
    """MotionFit of fitted parameters, with the uncertain zero of theta added to the variance of phi.

    theta is the tipping angle, phi the balance angle.

    Args:
        estimator: name of the estimator.
        angle: tipping angle theta(t) of the strike.
        window: frames [start, stop) that were fitted.
        fitted: the fitted phi [rad], rate constant k [rad/s^2], theta [rad] and its rate [rad/s] at the first
            frame, the covariance of (phi, k), and the residuals of theta.
    """
    covariance = fitted.covariance.copy()
    covariance[0, 0] += angle.zero_sd**2
    phi, k, theta0, omega0 = (float(x) for x in fitted.parameters[:4])
    return MotionFit(
        estimator=estimator,
        phi=phi,
        k=k,
        covariance=covariance,
        theta0=theta0,
        omega0=omega0,
        time0_ns=int(angle.time_ns[window[0]]),
        window=window,
        residual=fitted.residual,
    )


def _covariance(minimum: Minimum, sample: Sample, scale: Array, radius: float | None) -> Array:
    """Covariance (p, p) of the fitted parameters, whose first is the balance angle phi.

    It is scaled up as a whole to the profile likelihood's interval of phi if that is wider, the linearised sd
    of phi exceeds 0.3 deg, and `radius` is not None.

    Args:
        minimum: the least-squares solution.
        sample: the fitted part of theta(t).
        scale: (p,) typical changes of the parameters.
        radius: radius of the edge's rounding [m] if the model is the pendulum itself, otherwise None.
    """
    inverse, variance = unit_covariance(minimum, sample.sd, scale), residual_variance(minimum, sample.sd)
    linear_sd = math.sqrt(float(inverse[0, 0]) * variance)
    if linear_sd <= MAX_LINEAR_PHI_SD or radius is None:
        return inverse * variance
    weight = np.sqrt(minimum.weight) / sample.sd
    tip = FittedTip(sample.time, sample.theta, weight, minimum.parameters, inverse, radius)
    return inverse * variance * max(1.0, profile_sd(tip, variance) / linear_sd) ** 2
