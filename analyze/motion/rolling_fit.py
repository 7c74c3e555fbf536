"""Balance angle phi and k of a strike that rolls on a cross-section of known shape (method 3).

The equations are those of rolling_motion.py. phi is the tipping angle at which the centre of mass c stands
over the contact. The centre of curvature of the section, at the point that touches at phi, replaces a hinge's
centre line p: near phi the section rolls like the circle about that point. With R the distance of c from
there, rho that circle's radius, m the mass and I_c the inertia about the axis through c, the rate of the tip
is k = g R / (I_c / m + (R + rho)^2) [rad/s^2] as for a hinge, and the plane through that point at phi
contains c (docs/decisions/0017). On a circle the motion determines phi and k alone. On any other curve it
depends on R too, which is a fifth unknown with a wide prior: c is expected near the section's middle.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from analyze.errors import EstimationError
from analyze.least_squares.levenberg_marquardt import (
    minimise,
    residual_variance,
    unit_covariance,
    with_differences,
)
from analyze.motion.pendulum_fit import (
    MAX_LINEAR_PHI_SD,
    FittedModel,
    Sample,
    cut_sample,
    fit_model,
    hinge_model,
    motion_fit,
)
from analyze.motion.pendulum_motion import G
from analyze.motion.rolling_guess import ComPrior, first_rolling_guess
from analyze.motion.rolling_motion import balance_angle, balance_parameters, energy_ratio, rolling_theta
from analyze.types import RollingContact

if TYPE_CHECKING:
    from analyze.motion.support_function import SupportFunction
    from analyze.types import Array, MotionFit, TipAngle

ESTIMATOR = "rolling_fit"
"""name of this estimator"""
_SOLID_RATIO = 1.35
"""J / (a^2 + b^2) of a solid body, with c at (-b, a) from the pivot point and J = I_c / m + a^2 + b^2; on a
circle the motion does not depend on it"""
_GYRATION_RATIO = 5.0
"""I_c / m over the variance of c's expected position: a fifth of the section's area"""
_VAGUE_SD_RATIO = 1.0
"""standard deviation of an unknown position of c, over its distance from the pivot point"""
_SCALE = np.array([20.0, 1.0, 1.0, 0.01, 0.1])
"""typical changes of the parameters 1 / J, a / J, b / J, theta0, omega0 [1/m^2, 1/m, 1/m, rad, rad/s]"""
_STEPS = 1e-5 * _SCALE
"""differentiation steps of the parameters"""


def rolling_fit(angle: TipAngle, window: tuple[int, int], section: SupportFunction) -> MotionFit:
    """Fit a body that rolls on a known section to theta(t) over one window.

    Five parameters are fitted: 1 / J, a / J, b / J, and theta0 and omega0, theta and its rate at the window's
    first frame. The body's centre of mass c is at (-b, a) [m] from the pivot point at rest (x in the
    direction of tipping, z up), and J = I_c / m + a^2 + b^2, I_c / m the inertia per mass about the axis
    through c. A wide prior (c near the section's middle) enters as three more observations, since theta(t)
    alone may not determine all five.

    Args:
        angle: tipping angle theta(t) of the strike.
        window: frames [start, stop) in which only gravity and the table act.
        section: the body's cross-section about the pivot point.

    Returns:
        The fit: balance angle phi [rad], rate k [rad/s^2] (m g R over the moment of inertia about the contact
        at balance, R the distance of c from the section's centre of curvature there), theta0 [rad], omega0
        [rad/s], the (2, 2) covariance of (phi, k), residuals of theta [rad], and in `rolling` the section's
        circle of curvature at phi.

    Raises:
        EstimationError: the window has too few frames, the body has no balance on the section, or k is
            outside 0.5 to 5000 rad/s^2.
    """
    sample = cut_sample(angle, window, 5)
    expected = _expected(sample, section)
    # The prior of the body enters as three more observations.
    seen, sd = np.append(sample.theta, expected.values()), np.append(sample.sd, np.ones(3))

    def expect(sets: Array) -> Array:
        """Expected observations (n + 3, c) of a rolling body for c sets (c, 5) of its parameters.

        They are the tipping angles [rad] at n times, then the three combinations of 1 / J, a / J and b / J of
        which the prior of centre of mass and inertia states a value, each over its sd. The parameters are
        1 / J, a / J, b / J, theta0 [rad] and omega0 [rad/s] (first angle and speed), with J [m^2] the inertia
        per mass about the pivot point, a [m] the height of the centre of mass above it at rest, and -b [m]
        its offset from it in the direction of tipping.
        """
        return np.concatenate([rolling_theta(sample.time, sets, section), expected.rows() @ sets[:, :3].T])

    solution = minimise(
        seen,
        sd,
        with_differences(expect, _STEPS),
        first_rolling_guess(sample.time, sample.theta, sample.sd, section, expected),
        _SCALE,
        positive_index=0,
    )
    x = solution.parameters
    balance = balance_angle(section, x[:3])
    at_balance = with_differences(
        lambda sets: np.stack(balance_parameters(section, sets[:, :3], balance or 0.0)), _STEPS
    )
    (phi, k), by = at_balance(x)
    if balance is None or np.isnan(by).any() or not 0.5 < k < 5000.0:
        raise EstimationError("the motion is not a tip over a curved section: look at the images")
    of_fitted = unit_covariance(solution, sd, _SCALE) * residual_variance(solution, sd)
    covariance = by @ of_fitted @ by.T
    fitted = FittedModel(np.array([phi, k, *x[3:]]), solution.residual[: len(sample.time)], covariance)
    fit = motion_fit(
        ESTIMATOR,
        angle,
        window,
        replace(fitted, covariance=covariance * _stretch_factor(sample, fitted) ** 2),
    )
    energy = energy_ratio(section, x[:3], fit.phi, fit.theta0, fit.omega0)
    along, over, radius = section.centre(fit.phi)
    of_shape = section.touches_curve(fit.phi)
    return replace(
        fit,
        rolling=RollingContact(
            along, over, radius, section.sd, energy, of_shape, section.roughness * radius if of_shape else 0.0
        ),
    )


def _expected(sample: Sample, section: SupportFunction) -> ComPrior:
    """Prior of the centre of mass c for the fit of a body that rolls on its cross-section.

    c is expected near the middle of a known section. If the section is only a circle (`middle_sd` infinite),
    c is expected where a solid body with the first guess of phi and k has it, with a wide sd: the
    distance from there to the pivot.

    Args:
        sample: measured tipping angle with a first guess of balance angle phi and rate constant k of the tip.
        section: support function of the cross-section: height [m] of the pivot point over the table for each
            tipping angle.

    Returns:
        Place of c ahead of and above the pivot point at rest [m], its sd [m], and the expected inertia per
        mass about that point [m^2].
    """
    if math.isfinite(section.middle_sd):
        ahead, above = section.middle
        return ComPrior(
            ahead, above, section.middle_sd, ahead**2 + above**2 + _GYRATION_RATIO * section.middle_sd**2
        )
    phi, solid = float(sample.guess[0]), G / (_SOLID_RATIO * float(sample.guess[1]))
    return ComPrior(
        -solid * math.sin(phi), solid * math.cos(phi), _VAGUE_SD_RATIO * solid, _SOLID_RATIO * solid**2
    )


def _stretch_factor(sample: Sample, fitted: FittedModel) -> float:
    """Width of phi's interval by profile likelihood over that by linearisation; at least 1.

    phi is the balance angle. The ratio is computed for a hinge (sharp edge that stays in place) with the phi,
    k (rate constant) and residuals of the rolling fit. It is 1 if phi's sd is at most 0.3 deg.

    Args:
        sample: the fitted part of theta(t), the tipping angle.
        fitted: the rolling fit.
    """
    if math.sqrt(float(fitted.covariance[0, 0])) <= MAX_LINEAR_PHI_SD:
        return 1.0
    x = fitted.parameters
    model = hinge_model(sample.time, 0.0)
    hinge = replace(sample, theta=model(x)[0] + fitted.residual)
    believed, linear = (fit_model(hinge, model, x, radius).covariance[0, 0] for radius in (0.0, None))
    return max(1.0, math.sqrt(float(believed / linear)))
