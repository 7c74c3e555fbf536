"""Errors of balance angle phi and of k from errors of the tipping angle that change slowly with it.

The place of a marker's edges among the pixels, errors of the lens model, and a contact that wanders along a
rim shift the tipping angle theta by some thousandths of a degree, alike in frames whose theta is nearly the
same. Averaging frames does not reduce such an error, and the fit absorbs most of it, so that the residuals do
not show it. The frames of a strike that passes balance lie on both sides of phi. One that rocked back
extrapolates to phi, and so multiplies the error by 5 (energy ratio 0.95) to 100 (0.5).

The camera's calibration leaves a strain in the image: an edge at the angle b in the image appears turned by
0.5 strain sin 2b. As the object tips, theta is therefore off by 0.5 strain (sin 2(theta + b) - sin 2b).
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from analyze.motion.balance_fit import ESTIMATOR
from analyze.motion.pendulum_motion import trajectory
from analyze.motion.verdict import smooth_peak

if TYPE_CHECKING:
    from analyze.motion.tip_angle import PlanarMotion
    from analyze.types import Array, MotionFit

CORRELATION_RAD = math.radians(0.3)
"""difference of theta [rad] over which the correlation of the error falls to 0.61

A marker's corner moves by about one pixel meanwhile. Calibrated with RIM_SD and TWIST_SHARE on rocked-back
strikes: through a camera whose corners have a bias that goes with the pixels (0 to 0.03 px), and over rims in
a contact simulator (MuJoCo).
"""
RIM_SD = 4e-5
"""standard deviation of the error on a round rim [rad], whose contact wanders along it"""
TWIST_SHARE = 0.14
"""standard deviation of the error for a body that turns about other axes by alpha [rad], over alpha
squared"""
_SCALE = np.array([0.1, 20.0, 0.02, 0.2])
"""typical changes of phi, k, theta0, omega0 [rad, rad/s^2, rad, rad/s], for conditioning"""
_RCOND = 1e-9
"""least singular value that counts, over the largest"""


def strain_modes(theta: Array, strain_sd: float) -> Array:
    """Errors (n, 2) [rad] of the tipping angle by one standard deviation of the image's strain.

    The columns are those of two strains whose directions in the image differ by 45 deg, independent of each
    other and each of 0.71 `strain_sd`, since the strain's direction is unknown.

    Args:
        theta: (n,) tipping angle [rad].
        strain_sd: standard deviation of the strain that the calibration leaves in the image.
    """
    size = 0.5 * strain_sd / math.sqrt(2.0)
    return size * np.column_stack([np.sin(2.0 * theta), np.cos(2.0 * theta) - 1.0])


def with_slow_error(fit: MotionFit, motion: PlanarMotion, rolls: bool, radius: float) -> MotionFit:
    """Copy of a strike's fit whose covariance includes errors of theta that change slowly with theta.

    theta is the tipping angle. Two errors are included: a Gaussian process over theta with the sd
    `slow_error_sd` [rad] and the correlation exp(-d^2 / 2 L^2) at a difference d, where L is
    `CORRELATION_RAD`; and that of the image's strain (a small stretch of the image in one direction, which an
    imperfect camera calibration leaves; see `strain_modes`). Their effect on phi and k is that on a pendulum
    fitted to the same frames, also for fits that follow the motion of the edge.

    Args:
        fit: balance angle phi [rad] and rate constant k [rad/s^2] of theta'' = -k sin(phi - theta).
        motion: the motion that was fitted.
        rolls: True if the edge is a round rim.
        radius: radius of the edge's rounding [m].

    Returns:
        The fit with the (2, 2) covariance of (phi, k) increased; unchanged without k, or without any such
        error.
    """
    sd = slow_error_sd(fit, motion, rolls)
    if fit.k is None or (sd == 0.0 and motion.angle.strain_sd == 0.0):
        return fit
    angle, used = motion.angle, slice(*fit.window)
    theta, noise = angle.theta[used], np.maximum(angle.sd[used], 1e-6)
    time = np.asarray((angle.time_ns[used] - fit.time0_ns) * 1e-9, dtype=np.float64)
    jacobian = trajectory(time, fit.phi, fit.k, fit.theta0, fit.omega0, radius)[2]
    inverse = np.linalg.pinv(jacobian * _SCALE / noise[:, None], rcond=_RCOND)
    solve = (inverse * _SCALE[:, None])[:2] / noise
    correlation = np.exp(-0.5 * ((theta[:, None] - theta) / CORRELATION_RAD) ** 2)
    strained = solve @ strain_modes(theta, angle.strain_sd)
    added: Array = np.asarray(
        sd * sd * solve @ correlation @ solve.T + strained @ strained.T, dtype=np.float64
    )
    return replace(fit, covariance=fit.covariance + added)


def slow_error_sd(fit: MotionFit, motion: PlanarMotion, rolls: bool) -> float:
    """Standard deviation [rad] of the error of the tipping angle theta that changes slowly with theta.

    It joins errors of the camera, of a round rim, and of rotation about other axes in the fit's window. That
    of the camera is left out for the moment balance, the fit that follows the edge by the same images: an
    error of the image shifts theta and the edge together, and the fit cancels most of that.

    Args:
        fit: the fit, with its estimator and window.
        motion: the motion with the rotation about other axes.
        rolls: True if the edge is a round rim.
    """
    used = slice(*fit.window)
    turned = smooth_peak(motion.angle.off_axis[used], motion.off_axis_sd[used])
    by_camera = 0.0 if fit.estimator == ESTIMATOR else motion.angle.slow_sd
    return math.hypot(by_camera, RIM_SD if rolls else 0.0, TWIST_SHARE * turned**2)
