"""phi and k of one strike whose contact rolls on a curved flank of known section (METHOD section 3; equations in rolling_motion.py).

phi is the angle at which c stands over the contact. What a hinge's centre line p is, the flank has as its centre of curvature where it
touches at phi: near phi it rolls like the circle about that point. With R the distance of c from there and rho that circle's radius,
k = g R / (I_c / m + (R + rho)^2) as ever, and the plane through that point at phi holds c (docs/decisions/0017). Of a circle the motion
tells phi and k alone. A flank that is none says something of R too, which is a fifth unknown with a wide prior: c is expected near the
section's middle.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from analyze.errors import EstimationError
from analyze.least_squares.levenberg_marquardt import (
    Observations,
    minimise,
    residual_variance,
    unit_covariance,
)
from analyze.motion.pendulum import trajectory
from analyze.motion.pivot_fit import FittedModel, Sample, cut_sample, fit_model, motion_fit
from analyze.motion.rolling_guess import Expected, first_guess
from analyze.motion.rolling_motion import G, energy_ratio, rolled, stance, tips_at
from analyze.types import RollingContact

if TYPE_CHECKING:
    from analyze.motion.support_function import SupportFunction
    from analyze.types import Array, MotionFit, TipAngle

ESTIMATOR = "rolling_fit"
_SOLID = 1.35
"""J over a^2 + b^2, of a solid body; of a circle the motion does not feel it"""
_GYRATION = 5.0
"""I_c / m over the variance of where c is expected: a fifth of the section's area"""
_ANYWHERE = 1.0
"""sd of the place of a c that nothing is known of, over its distance from the pivot point"""
_SCALE = np.array([20.0, 1.0, 1.0, 0.01, 0.1])
"""1/m^2, 1/m, 1/m, rad, rad/s: sizes of the parameters' changes"""
_STEPS = 1e-5 * _SCALE
_LINEAR_SD = math.radians(0.3)
"""of phi, from which on a linearised covariance is not believed"""


def rolling_fit(angle: TipAngle, window: tuple[int, int], flank: SupportFunction) -> MotionFit:
    """Fit phi, k, theta0, omega0 (and how far c is from the contact, where the flank tells) over angle[window[0]:window[1]].

    Args:
        angle: of the strike.
        window: range of frames in which only gravity and the table act.
        flank: the body's section about the pivot point.

    Raises:
        EstimationError: the window is too short or holds no tipping motion.
    """
    cut = cut_sample(angle, window, 5)
    expected = _expected(cut, flank)
    # What is expected of the body is three more observations.
    seen = Observations(np.append(cut.theta, expected.values()), np.append(cut.sd, np.ones(3)))
    steps = np.concatenate([np.zeros((1, 5)), np.diag(_STEPS), -np.diag(_STEPS)])

    def model(x: Array) -> tuple[Array, Array]:
        sets = x + steps
        theta = np.concatenate([rolled(cut.time, sets, flank), expected.rows() @ sets[:, :3].T])
        return theta[:, 0], (theta[:, 1:6] - theta[:, 6:]) / (2 * _STEPS)

    solution = minimise(
        seen, model, first_guess(cut.time, cut.theta, cut.sd, flank, expected), _SCALE, positive=0
    )
    x = solution.parameters
    balance = tips_at(flank, x[:3])
    phi, k, _ = stance(
        flank, x[:3] + steps[:, :3], np.full(len(steps), balance if balance is not None else 0.0)
    )
    if balance is None or np.isnan(phi + k).any() or not 0.5 < k[0] < 5000.0:
        raise EstimationError("the motion is no tip over a curved flank: look at the images")
    by = np.stack([(values[1:6] - values[6:]) / (2 * _STEPS) for values in (phi, k)])
    of_fitted = unit_covariance(solution, seen.sd, _SCALE) * residual_variance(solution, seen.sd)
    covariance = by @ of_fitted @ by.T
    fitted = FittedModel(np.array([phi[0], k[0], *x[3:]]), solution.residual[: len(cut.time)], covariance)
    fit = motion_fit(
        ESTIMATOR, angle, window, cut, replace(fitted, covariance=covariance * _stretched(cut, fitted) ** 2)
    )
    ratio = energy_ratio(flank, x[:3], fit.phi, fit.theta0, fit.omega0)
    along, over, radius = flank.centre(fit.phi)
    own = flank.of_shape(fit.phi)
    return replace(
        fit,
        rolling=RollingContact(
            along, over, radius, flank.sd, ratio, own, flank.rough * radius if own else 0.0
        ),
    )


def _expected(cut: Sample, flank: SupportFunction) -> Expected:
    """Where c is before the motion is looked at: near the section's middle, or anywhere."""
    if math.isfinite(flank.middle_sd):
        ahead, above = flank.middle
        return Expected(ahead, above, flank.middle_sd, ahead**2 + above**2 + _GYRATION * flank.middle_sd**2)
    phi, solid = float(cut.guess[0]), G / (_SOLID * float(cut.guess[1]))
    return Expected(-solid * math.sin(phi), solid * math.cos(phi), _ANYWHERE * solid, _SOLID * solid**2)


def _stretched(cut: Sample, fitted: FittedModel) -> float:
    """How much wider than linearised phi's interval is: that of a hinge's motion with the same phi, k and noise."""
    if math.sqrt(float(fitted.covariance[0, 0])) <= _LINEAR_SD:
        return 1.0
    x = fitted.parameters[:4]
    hinge = replace(cut, theta=trajectory(cut.time, *(float(each) for each in x))[0] + fitted.residual)

    def model(x: Array) -> tuple[Array, Array]:
        theta, _, jacobian = trajectory(cut.time, float(x[0]), float(x[1]), float(x[2]), float(x[3]))
        return theta, jacobian

    believed, linear = (fit_model(hinge, model, x, profiled).covariance[0, 0] for profiled in (True, False))
    return max(1.0, math.sqrt(float(believed / linear)))
