"""Error of the balance angle phi and of k from a pivot edge that creeps unseen, in a fit as a hinge.

A hinge is an edge that stays in place. An edge that slides or rises by some hundredths of a millimetre,
within the noise of the camera, moves phi and k by more than the noise of the angle does: on a bottle of 0.2 m
a creep of 0.1 mm changes k by 0.5 %. The residuals do not show it, because the parameters absorb it. What the
followed point's slip and lift show of the creep's size is therefore propagated to phi and k.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from analyze.motion.balance_fit import driven_theta
from analyze.motion.edge_offset import creep_covariance, displacement_per_offset, fit_creeping
from analyze.motion.pendulum_motion import trajectory

if TYPE_CHECKING:
    from analyze.motion.tip_angle import PlanarMotion
    from analyze.types import Array, MotionFit

_OFFSET_SD = 5e-4
"""standard deviation [m] of the edge's assumed position"""
_START_SD = 1e-4
"""standard deviation [m] of slip and lift of the edge before the window: under the impact it slides, and the
load passes from the whole face to the edge"""
_RADIUS_SD = 3e-4
"""standard deviation [m] of the edge's rounding, on which it rolls"""
_MIN_FRAMES = 10
"""least number of frames from which the size of the creep is estimated"""
_MAX_COLUMNS = 40
"""largest number of angles between which the path of the edge is interpolated"""
_UNSEEN_SHARE = 0.75
"""share of the creep's variance that the error keeps, as noise makes the size an upper estimate: chosen on
400 strikes simulated with hard, soft and hopping edges"""
_STEP = 1e-5
"""displacement of the edge [m] for derivatives"""
_SCALE = np.array([0.1, 20.0, 0.02, 0.2])
"""typical changes of phi, k, theta0, omega0 [rad, rad/s^2, rad, rad/s], for conditioning"""


def creep_error(fit: MotionFit, motion: PlanarMotion, radius: float) -> Array:
    """Covariance (2, 2) of a hinge fit's balance angle and rate by the edge's measured creep.

    A hinge is an edge that stays in place; creep is its small displacement while the object tips.

    Args:
        fit: the fit as a hinge: balance angle phi [rad], rate k [rad/s^2] of theta'' = -k sin(phi - theta),
            theta the tipping angle.
        motion: the motion, with slip (along the table) and lift of the assumed edge.
        radius: radius of the edge's rounding [m].

    Returns:
        The covariance of (phi, k) in rad and rad/s^2; all 0 with fewer than ten frames, or without k.
    """
    used = slice(*fit.window)
    theta = motion.angle.theta[used]
    if len(theta) < _MIN_FRAMES or fit.k is None:
        return np.zeros((2, 2))
    size = creep_size(motion, fit.window)
    gain = _gain(fit, motion, radius)
    nodes = np.linspace(float(theta.min()), float(theta.max()), gain.shape[2])
    shape = _UNSEEN_SHARE * size * size * creep_covariance(nodes)
    return np.asarray(gain[0] @ shape @ gain[0].T + gain[1] @ shape @ gain[1].T, dtype=np.float64)


def creep_size(motion: PlanarMotion, window: tuple[int, int]) -> float:
    """Root mean square [m] of the pivot edge's creep (its own displacements) in a window, without noise.

    Rotation about an edge beside the assumed one, rolling on a rounding other than the stated one, and a
    displacement before the window are no creep.

    Args:
        motion: the motion, with slip (along the table) and lift of the assumed edge.
        window: frames [start, stop).
    """
    used = slice(*window)
    theta = motion.angle.theta[used]
    still, one = np.zeros(len(theta)), np.ones(len(theta))
    moved = displacement_per_offset(theta)
    along = np.column_stack([moved[:, 0], theta, one, still])
    off = np.column_stack([moved[:, 1], still, still, one])
    seen = np.stack([motion.angle.slip[used], motion.lift[used]])
    prior = np.array([_OFFSET_SD, _OFFSET_SD, _RADIUS_SD, _START_SD, _START_SD])
    sd = np.maximum(motion.position_sd[used], 1e-7)
    return fit_creeping(theta, np.stack([along, off]), seen, sd, prior).size


def _gain(fit: MotionFit, motion: PlanarMotion, radius: float) -> Array:
    """Derivatives (2, 2, m) of a fit's (phi, k) by displacements of the edge at m tipping angles.

    The angles are equally spaced over the fit's window; between them the displacement is interpolated. First
    axis: slip (along the table), lift; second: phi [rad/m], k [rad/s^2/m].

    Args:
        fit: the fit with the edge taken to stay in place: balance angle phi and rate k of
            theta'' = -k sin(phi - theta), theta the tipping angle.
        motion: the motion that was fitted.
        radius: radius of the edge's rounding [m].
    """
    used = slice(*fit.window)
    theta, sd = motion.angle.theta[used], motion.angle.sd[used]
    time = np.asarray((motion.angle.time_ns[used] - fit.time0_ns) * 1e-9, dtype=np.float64)
    phi, k = fit.phi, fit.k or 1.0
    found = np.array([phi, k, fit.theta0, fit.omega0])
    jacobian = trajectory(time, phi, k, fit.theta0, fit.omega0, radius)[2] * _SCALE / sd[:, None]
    solve = (np.linalg.pinv(jacobian, rcond=1e-9) * _SCALE[:, None])[:2] / sd
    columns = min(_MAX_COLUMNS, len(theta))
    nodes = np.linspace(float(theta.min()), float(theta.max()), columns)
    path = _STEP * np.stack([np.interp(theta, nodes, row) for row in np.eye(columns)], axis=-1)
    path = np.concatenate([np.zeros((len(theta), 1)), path], axis=1)
    still = np.zeros_like(path)
    parameters = np.repeat(found[None], columns + 1, axis=0)
    moved = [
        driven_theta(time, parameters, path, still, radius),
        driven_theta(time, parameters, still, path, radius),
    ]
    # The fit follows the angle that the creeping edge causes.
    return np.stack([solve @ (each[:, 1:] - each[:, :1]) / _STEP for each in moved])
