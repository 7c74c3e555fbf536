"""phi and k of one strike whose edge slid or hopped: the moment balance about the line that touches, in which friction has no part.

With s(t) the sliding of the contact along the table, z(t) the height of the edge over it (both seen by the camera), psi = phi - theta and
R the distance of c from the edge, the balance of moments about the touching line is, per I_edge,

    theta'' = -k [ sin psi + (cos psi + rho / R) s'' / g + sin psi z'' / g ]

(it holds while the edge touches, whatever the friction, and in flight, when nothing touches). In the weak form, integrated by parts,

    Omega = theta' + (k / g) [ (cos psi + rho / R) s' + sin psi z' ],    Omega' = -k sin psi + (k / g) [ sin psi s' - cos psi z' ] theta'

only the velocities of the edge are left, and their errors stay where they are instead of adding up: s enters theta as -(k / g) cos psi s.
An edge that holds makes it `pivot_fit`. The rolling of a rounded edge is in s only as far as it slides against that.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from analyze.motion.edge_motion import moved_by_offset
from analyze.motion.pendulum import G
from analyze.motion.pivot_fit import Sample, correlation_factor, fit_model, motion_fit, sample
from analyze.motion.runge_kutta import advanced

if TYPE_CHECKING:
    from analyze.motion.tip_angle import PlanarMotion
    from analyze.types import Array, MotionFit

ESTIMATOR = "moment_balance"
_R_TIMES_K = G / 1.35
"""m rad/s^2, of a solid or hollow body over its edge, within 15 %: only rho / R needs it"""
_STEPS = np.array([1e-6, 1e-3, 1e-6, 1e-5])
"""of phi, k, theta0, omega0, for derivatives"""
_OUTLIER = 5.0
_LEAST_SCALE = 0.7
"""of the frames' stated variances, however small the residuals are"""
_MOST_STEP_S = 0.02
"""of the integration: frames may be missing"""
_START_FRAMES = 6
_START_K = 70.0
"""rad/s^2, of a body of 0.2 m"""


def moment_balance(
    motion: PlanarMotion, window: tuple[int, int], radius: float, phi: float | None = None, offset_covariance: Array | None = None
) -> MotionFit:
    """Fit phi, k, theta0, omega0 over motion.angle[window[0]:window[1]] with the edge's own motion as it was seen.

    Args:
        motion: theta, slip and lift through the strike.
        window: range of frames in which only gravity and the table act.
        radius: of the edge's rounding [m].
        phi: to start from [rad], where theta(t) is not like a hinge's at all.
        offset_covariance: (2, 2) m^2, of where the edge was taken to be (EdgeMotion); None: known exactly.

    Raises:
        EstimationError: the window is too short or holds no tipping motion.
    """
    angle = motion.angle
    cut = sample(angle, window, 4)
    inside = slice(*window)
    slip, lift = angle.slip[inside] - angle.slip[window[0]], motion.lift[inside] - motion.lift[window[0]]
    if phi is not None:
        cut = replace(cut, guess=np.array([phi, _START_K, *cut.guess[2:]]))
    # What the edge's place is not known to goes into theta at once: see above.
    psi = cut.guess[0] - cut.theta
    by_place = np.stack([np.ones_like(psi), cut.guess[1] / G * np.cos(psi), cut.guess[1] / G * np.sin(psi)], axis=-1)
    variance = np.einsum("ni,nij,nj->n", by_place, motion.covariance[inside], by_place)
    cut = replace(cut, sd=np.sqrt(np.maximum(variance, (0.1 * cut.sd) ** 2)))

    def model(x: Array) -> tuple[Array, Array]:
        steps = np.concatenate([np.zeros((1, 4)), np.diag(_STEPS), -np.diag(_STEPS)])
        theta = driven(cut.time, x + steps, slip, lift, radius)
        return theta[:, 0], (theta[:, 1:5] - theta[:, 5:]) / (2 * _STEPS)

    fitted = fit_model(cut, model, cut.guess[:4], profiled=False)
    offset = np.zeros((2, 2)) if offset_covariance is None else offset_covariance
    covariance = _covariance(
        cut, fitted.parameters, model(fitted.parameters)[1], fitted.residual, (slip, lift, radius), (motion.covariance[inside], offset)
    )
    fit = motion_fit(ESTIMATOR, angle, window, cut, replace(fitted, covariance=covariance))
    first = slice(0, min(_START_FRAMES, len(cut.time)))
    s_rate, z_rate = (_slope(cut.time[first], values[first]) for values in (slip, lift))
    psi = fit.phi - fit.theta0
    k = float(fitted.parameters[1])
    turning = k / G * ((math.cos(psi) + radius * k / _R_TIMES_K) * s_rate + math.sin(psi) * z_rate)
    return replace(fit, omega0=fit.omega0 - turning)


def _slope(time: Array, values: Array) -> float:
    away = time - np.mean(time)
    return float(away @ values) / float(away @ away)


def _covariance(
    cut: Sample, x: Array, jacobian: Array, residual: Array, edge: tuple[Array, Array, float], known: tuple[Array, Array]
) -> Array:
    """(2, 2) of phi and k: errors of theta, slip and lift of every frame, and of the edge's place, carried through the motion and the fit.

    Args:
        cut: the data.
        x: (4,) parameters.
        jacobian: (n, 4).
        residual: (n,) rad.
        edge: slip (n,), lift (n,) [m], radius [m].
        known: (n, 3, 3) covariance of theta, slip, lift of every frame; (2, 2) of the edge's place.
    """
    n = len(cut.time)
    (slip, lift, radius), (frames, offset) = edge, known
    step = 1e-5
    moved = np.concatenate([np.zeros((n, 1)), step * np.eye(n)], axis=1)
    still = np.zeros((n, n + 1))
    parameters = np.repeat(x[None], n + 1, axis=0)
    by_slip = driven(cut.time, parameters, slip[:, None] + moved, lift[:, None] + still, radius)
    by_lift = driven(cut.time, parameters, slip[:, None] + still, lift[:, None] + moved, radius)
    # (n, n, 3): what an error of frame j's theta, slip and lift makes of the residual of frame i
    effect = np.stack([np.eye(n), -(by_slip[:, 1:] - by_slip[:, :1]) / step, -(by_lift[:, 1:] - by_lift[:, :1]) / step], axis=-1)
    # As one product of matrices: of a strike at 960 frames a second the triple sum itself took ten seconds.
    noise = np.einsum("ija,jab->ijb", effect, frames).reshape(n, -1) @ effect.reshape(n, -1).T
    misplaced = moved_by_offset(cut.theta) - moved_by_offset(cut.theta[:1])
    by_offset = np.einsum("ija,jac->ic", effect[..., 1:], misplaced)
    scale = np.array([0.1, 20.0, 0.02, 0.2])
    weighted = jacobian * scale / cut.sd[:, None]
    solve = np.linalg.pinv(weighted.T @ weighted, rcond=1e-14, hermitian=True) @ weighted.T / cut.sd
    left = np.eye(n) - jacobian * scale @ solve
    expected = float(np.trace(left @ noise @ left.T / cut.sd[:, None] / cut.sd))
    # Outliers are those of what most frames are off, and what is left from frame to frame alike averages out less, as in pivot_fit.
    off = residual / cut.sd
    most = _OUTLIER * max(1.0, 1.4826 * float(np.median(np.abs(off))))
    found = float(np.sum(np.minimum(np.abs(off), most) ** 2)) * correlation_factor(off)
    # The place of the edge is off by the same in every frame, which leaves next to nothing in the residuals.
    covariance = solve @ noise @ solve.T * max(_LEAST_SCALE, found / expected) + solve @ by_offset @ offset @ by_offset.T @ solve.T
    covariance = covariance * np.outer(scale, scale)
    return np.asarray(covariance[:2, :2], dtype=np.float64)


def driven(time: Array, parameters: Array, slip: Array, lift: Array, radius: float, kick: tuple[int, Array] | None = None) -> Array:
    """Theta (n, c) of c sets of parameters (c, 4 or more) phi, k, theta0, Omega0 (RK4).

    Args:
        time: (n,) s.
        parameters: (c, 4 or more).
        slip: (n,) or (n, c) m, straight between the times.
        lift: (n,) m, the same.
        radius: m, of the rounding.
        kick: time index, and the jumps in speed (c,) [rad/s] there.
    """
    phi, k = parameters[:, 0].copy(), parameters[:, 1].copy()
    state = parameters[:, 2:4].T.copy()
    by_g = k / G
    rolled, by_rounding = radius * k / _R_TIMES_K, radius * by_g
    found = np.empty((len(time), len(phi)))
    found[0] = state[0]

    def rate(state: Array, s: Array, z: Array) -> Array:
        """With s and z, the speeds of the edge, times k / g."""
        psi = phi - state[0]
        sin, cos = np.sin(psi), np.cos(psi)
        found = np.empty_like(state)
        speed = np.subtract(state[1], (cos + rolled) * s + sin * z, out=found[0])
        # Rolling on its rounding, as pendulum.trajectory has it.
        pull = sin * (k + by_rounding * (speed * speed)) / (1.0 - 2.0 * by_rounding * (1.0 - cos)) if radius else sin * k
        np.subtract((sin * s - cos * z) * speed, pull, out=found[1])
        return found

    for i in range(1, len(time)):
        if kick is not None and i - 1 == kick[0]:
            state[1] += kick[1]
        gap = float(time[i] - time[i - 1])
        s, z = by_g * ((slip[i] - slip[i - 1]) / gap), by_g * ((lift[i] - lift[i - 1]) / gap)
        state = advanced(partial(rate, s=s, z=z), state, gap, _MOST_STEP_S)
        found[i] = state[0]
    return found
