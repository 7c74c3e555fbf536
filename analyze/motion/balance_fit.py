"""Balance angle phi and k of a strike whose edge slid or hopped, from the moment balance.

Friction has no moment about the line of contact with the table, so it does not enter.

theta(t) is the tipping angle since rest, phi the theta at which the centre of mass c stands above the
contact, psi = phi - theta, R the distance of c from the edge's centre line, rho the radius of the edge's
rounding, I_edge the moment of inertia about the contact line and k = m g R / I_edge. With s(t) the sliding of
the contact along the table and z(t) the height of the edge over it (both measured by the camera), the balance
of moments about the line of contact is, divided by I_edge,

    theta'' = -k [ sin psi + (cos psi + rho / R) s'' / g + sin psi z'' / g ]

(it holds while the edge touches, whatever the friction, and in flight, when nothing touches). In the weak
form, integrated by parts,

    Omega = theta' + (k / g) [ (cos psi + rho / R) s' + sin psi z' ],
    Omega' = -k sin psi + (k / g) [ sin psi s' - cos psi z' ] theta'

only the velocities of the edge are left, and their errors do not accumulate: s enters theta as -(k / g) cos
psi s. Their noise enters Omega' squared, and the expected value of that is subtracted. For an edge that does
not move this is the pendulum equation of `pivot_fit`. On a rounded edge s is the sliding relative to rolling.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from analyze.least_squares.levenberg_marquardt import with_differences
from analyze.least_squares.robust import correlation_factor, median_scale
from analyze.motion.edge_offset import displacement_per_error
from analyze.motion.pendulum_fit import FittedModel, Sample, cut_sample, fit_model, motion_fit
from analyze.motion.pendulum_motion import G
from analyze.motion.runge_kutta import runge_kutta_state

if TYPE_CHECKING:
    from collections.abc import Callable

    from analyze.least_squares.levenberg_marquardt import Model
    from analyze.motion.tip_angle import PlanarMotion
    from analyze.types import Array, MotionFit

ESTIMATOR = "moment_balance"
"""name of this estimator"""
_R_TIMES_K = G / 1.35
"""R k [m rad/s^2] of a solid or hollow body over its edge, within 15 %; only rho / R needs it"""
_DIFFERENTIATION_STEPS = np.array([1e-6, 1e-3, 1e-6, 1e-5])
"""steps of phi, k, theta0, omega0 for derivatives [rad, rad/s^2, rad, rad/s]"""
_OUTLIER_SIGMAS = 5.0
"""robust standard deviations beyond which a residual is clipped"""
_MIN_VARIANCE_SCALE = 0.7
"""least factor on the frames' stated variances, however small the residuals are"""
_MOST_CORRECTION = 2.0
"""largest correction of the fit for its bias, in standard deviations of the parameters together"""
_SCALE = np.array([0.1, 20.0, 0.02, 0.2])
"""typical changes of phi, k, theta0 and Omega0 [rad, rad/s^2, rad, rad/s], for conditioning"""
_MAX_STEP_S = 0.02
"""longest integration step [s]: frames may be missing"""
_START_FRAMES = 6
"""number of frames from which the edge's initial speed is computed"""
_START_K = 70.0
"""first guess of k [rad/s^2], for a body of 0.2 m"""


@dataclass(frozen=True)
class EdgeErrors:
    """Errors of the edge's measured motion (slip along the table, lift off it) that all frames share."""

    offset: Array
    """(3, 3) covariance [m^2] of the edge's assumed position along and off the table, and of its radius where
    the motion shows it"""
    by_radius: Array
    """(n, 2) errors of slip and lift per metre by which the edge's radius exceeds the assumed one, in every
    frame of the strike"""


def moment_balance(
    motion: PlanarMotion,
    window: tuple[int, int],
    radius: float,
    phi: float | None = None,
    errors: EdgeErrors | None = None,
) -> MotionFit:
    """Fit phi, k, theta0, omega0 by the moment balance, with the edge's measured motion, over one window.

    The moments about the line of contact balance, also while the edge slides or lifts.

    Args:
        motion: tipping angle theta, slip (sliding of the edge along the table) and lift (its height) of every
            frame.
        window: frames [start, stop) in which only gravity and the table act.
        radius: radius of the edge's rounding [m].
        phi: first guess of the balance angle phi [rad], for a motion unlike that of a hinge (edge in place);
            None to take the guess from theta(t).
        errors: errors of the edge's motion that all frames share, by its assumed position and radius; None
            if both are exact.

    Returns:
        The fit, with estimator "moment_balance": balance angle phi [rad], rate k [rad/s^2] (for an edge in
        place that of theta'' = -k sin(phi - theta)), theta0 [rad] and omega0 [rad/s] (theta and its rate at
        the window's first frame), the (2, 2) covariance of (phi, k), their errors by the radius, and
        residuals of theta [rad].

    Raises:
        EstimationError: the window has too few frames, or the best fit is not a tip over an edge.
    """
    angle = motion.angle
    sample = cut_sample(angle, window, 4)
    inside = slice(*window)
    slip, lift = angle.slip[inside] - angle.slip[window[0]], motion.lift[inside] - motion.lift[window[0]]
    if phi is not None:
        sample = replace(sample, guess=np.array([phi, _START_K, *sample.guess[2:]]))
    frames = motion.covariance[inside]

    def noise_sd(sets: Array) -> Array:
        """Standard deviation (n, c) [rad] of measured minus expected theta at c sets of parameters (c, 4)."""
        return _noise_sd(angle.theta[inside], frames, sets, 0.1 * angle.sd[inside])

    sample = replace(sample, sd=noise_sd(sample.guess[None])[:, 0])
    model = with_differences(
        partial(driven_theta, sample.time, slip=slip, lift=lift, radius=radius, path_noise=frames[:, 1:, 1:]),
        _DIFFERENTIATION_STEPS,
    )
    fitted = _without_bias(fit_model(sample, model, sample.guess), sample, model, noise_sd)
    if errors is None:
        errors = EdgeErrors(np.zeros((3, 3)), np.zeros((len(angle.theta), 2)))
    covariance, by_radius = _covariance(
        sample,
        fitted.parameters,
        model(fitted.parameters)[1],
        fitted.residual,
        (slip, lift, radius),
        (frames, replace(errors, by_radius=errors.by_radius[inside])),
    )
    fit = motion_fit(ESTIMATOR, angle, window, replace(fitted, covariance=covariance))
    first = slice(0, min(_START_FRAMES, len(sample.time)))
    s_rate, z_rate = (_slope(sample.time[first], values[first]) for values in (slip, lift))
    psi = fit.phi - fit.theta0
    k = float(fitted.parameters[1])
    turning = k / G * ((math.cos(psi) + radius * k / _R_TIMES_K) * s_rate + math.sin(psi) * z_rate)
    return replace(fit, omega0=fit.omega0 - turning, by_radius=by_radius)


def _without_bias(
    fitted: FittedModel, sample: Sample, model: Model, noise_sd: Callable[[Array], Array]
) -> FittedModel:
    """Fit without the bias by noise that depends on the parameters.

    The noise of slip and lift enters the expected theta by factors of phi and k. Least squares with a
    constant sd prefer a phi and k for which it cancels that of theta: k came out as much as one sd too large.
    Without the noise's expected share of the squared residuals there is no such preference (corrected score:
    Nakamura 1990, Biometrika 77). That sum has false minima, so that one Newton step is taken from the fit,
    of at most `_MOST_CORRECTION` sd.

    Args:
        fitted: least-squares fit of phi, k, theta0 and Omega0 with the sd of `sample`.
        sample: measured theta, and the sd of measured minus expected theta at the guess.
        model: function that gives the expected theta (n,) [rad] and its derivatives (n, 4).
        noise_sd: function that gives the sd of measured minus expected theta (n, c) [rad] at c sets (c, 4).
    """
    x, steps = fitted.parameters, np.diag(_DIFFERENTIATION_STEPS)
    J = model(x)[1] / sample.sd[:, None] * _SCALE
    above, below = noise_sd(x + steps) / sample.sd[:, None], noise_sd(x - steps) / sample.sd[:, None]
    by_noise = np.sum(above**2 - below**2, axis=0) / (2 * _DIFFERENTIATION_STEPS) * _SCALE
    off = np.abs(fitted.residual) / noise_sd(x[None])[:, 0]
    share = min(1.0, float(np.mean(np.minimum(off, _OUTLIER_SIGMAS) ** 2)))
    normal = J.T @ J
    step = 0.5 * share * np.linalg.pinv(normal, rcond=1e-14, hermitian=True) @ by_noise
    size = math.sqrt(float(step @ normal @ step))
    corrected = x + _SCALE * step * min(1.0, _MOST_CORRECTION / max(size, 1e-12))
    return replace(fitted, parameters=corrected, residual=sample.theta - model(corrected)[0])


def _noise_sd(theta: Array, frames: Array, sets: Array, least: Array) -> Array:
    """Standard deviation (n, c) [rad] of measured minus expected theta, by the noise of each frame.

    The noise of slip s and lift z enters the expected theta as -(k / g) (cos psi s + sin psi z), with psi =
    phi - theta.

    Args:
        theta: (n,) tipping angle [rad].
        frames: (n, 3, 3) covariance of theta, slip and lift in every frame [rad, m].
        sets: (c, 2 or more) balance angle phi [rad] and rate k [rad/s^2] of c bodies; further columns are
            ignored.
        least: (n,) least result [rad].
    """
    psi, by_g = sets[:, 0] - theta[:, None], sets[:, 1] / G
    effect = np.stack([np.ones_like(psi), by_g * np.cos(psi), by_g * np.sin(psi)], axis=-1)
    variance = np.einsum("nci,nij,ncj->nc", effect, frames, effect)
    return np.sqrt(np.maximum(variance, np.square(least)[:, None]))


def _slope(time: Array, values: Array) -> float:
    """Slope of `values` (n,) over `time` (n,) [s], in their unit per second, by least squares."""
    away = time - np.mean(time)
    return float(away @ values) / float(away @ away)


def _covariance(
    sample: Sample,
    x: Array,
    jacobian: Array,
    residual: Array,
    edge: tuple[Array, Array, float],
    known: tuple[Array, EdgeErrors],
) -> tuple[Array, tuple[float, float]]:
    """Covariance (2, 2) of balance angle phi and rate k, and their errors by the edge's radius.

    The covariance is that by errors of theta, slip, lift and the edge's position. The errors of phi [rad/m]
    and k [rad/s^2/m] are those per metre by which the edge's radius exceeds the assumed one.

    theta is the tipping angle, phi the balance angle [rad], k the rate of the tip [rad/s^2]. The part caused
    by theta, slip and lift is multiplied by the ratio of the residuals' variance to the variance expected
    from these errors, but by no less than 0.7. Outliers are clipped first.

    Args:
        sample: the fitted part of theta(t).
        x: (4,) best parameters phi, k, and at the first time theta and Omega, the speed with the edge's
            motion included (see `driven_theta`) [rad, rad/s^2, rad, rad/s].
        jacobian: (n, 4) derivatives of theta by them.
        residual: (n,) measured minus fitted theta [rad].
        edge: slip (n,) [m], lift (n,) [m], radius of the rounding [m].
        known: (n, 3, 3) covariance of theta, slip, lift in every frame [rad, m]; errors that these n frames
            share.
    """
    n = len(sample.time)
    (slip, lift, radius), (frames, shared) = edge, known
    step = 1e-5
    moved, still = np.concatenate([np.zeros((n, 1)), step * np.eye(n)], axis=1), np.zeros((n, n + 1))
    slips, lifts = np.hstack([moved, still]) + slip[:, None], np.hstack([still, moved]) + lift[:, None]
    parameters = np.repeat(x[None], 2 * (n + 1), axis=0)
    by_slip, by_lift = np.hsplit(driven_theta(sample.time, parameters, slips, lifts, radius), 2)
    # (n, n, 3): derivative of the residual of frame i by the errors of frame j's theta, slip and lift.
    effect = np.stack(
        [np.eye(n), -(by_slip[:, 1:] - by_slip[:, :1]) / step, -(by_lift[:, 1:] - by_lift[:, :1]) / step],
        axis=-1,
    )
    # One product of matrices: the triple sum took ten seconds for a strike at 960 frames a second.
    noise = np.einsum("ija,jab->ijb", effect, frames).reshape(n, -1) @ effect.reshape(n, -1).T
    misplaced = displacement_per_error(sample.theta) - displacement_per_error(sample.theta[:1])
    by_offset = np.einsum("ija,jac->ic", effect[..., 1:], misplaced)
    weighted = jacobian * _SCALE / sample.sd[:, None]
    solve = np.linalg.pinv(weighted.T @ weighted, rcond=1e-14, hermitian=True) @ weighted.T / sample.sd
    left = np.eye(n) - jacobian * _SCALE @ solve
    expected = float(np.trace(left @ noise @ left.T / sample.sd[:, None] / sample.sd))
    # Outliers are relative to the median residual, and correlated residuals average out less, as in
    # pivot_fit.
    off = residual / sample.sd
    most = _OUTLIER_SIGMAS * max(1.0, median_scale(off))
    found = float(np.sum(np.minimum(np.abs(off), most) ** 2)) * correlation_factor(off)
    # The edge's position error is common to all frames, so that it leaves next to nothing in the residuals.
    covariance = (
        solve @ noise @ solve.T * max(_MIN_VARIANCE_SCALE, found / expected)
        + solve @ by_offset @ shared.offset @ by_offset.T @ solve.T
    )
    covariance = covariance * np.outer(_SCALE, _SCALE)
    rolled = np.einsum("ija,ja->i", effect[..., 1:], shared.by_radius - shared.by_radius[0])
    by_phi, by_k = (_SCALE * (solve @ rolled))[:2]
    return np.asarray(covariance[:2, :2], dtype=np.float64), (float(by_phi), float(by_k))


def driven_theta(
    time: Array,
    parameters: Array,
    slip: Array,
    lift: Array,
    radius: float,
    jump: tuple[int, Array] | None = None,
    path_noise: Array | None = None,
) -> Array:
    """Tipping angles theta (n, c) [rad] of c bodies whose pivot edge slips and lifts as given.

    The equation of motion is integrated by the Runge-Kutta method.

    Args:
        time: (n,) times [s], ascending.
        parameters: (c, 4 or more) per body: balance angle phi [rad], rate k of the tip [rad/s^2], and at the
            first time theta [rad] and Omega [rad/s] = theta' + (k / g) [(cos psi + rho / R) s' + sin psi z'],
            with psi = phi - theta, s' and z' the speeds of slip and lift, and R the distance of the centre of
            mass from the edge, taken as g / (1.35 k), as for a solid body; further columns are ignored.
        slip: (n,) or (n, c) sliding of the edge [m], linear between the times.
        lift: (n,) or (n, c) height of the edge [m], linear between the times.
        radius: radius rho of the edge's rounding [m].
        jump: index of a time, and the jumps in angular speed (c,) [rad/s] there; None for no jump.
        path_noise: (n, 2, 2) covariance [m^2] of the noise of slip and lift in each frame; the speeds' noise
            enters the acceleration squared, and its expected value is subtracted. None for a path without
            noise.
    """
    phi, k = parameters[:, 0].copy(), parameters[:, 1].copy()
    state = parameters[:, 2:4].T.copy()
    by_g = k / G
    rolled, by_rounding = radius * k / _R_TIMES_K, radius * by_g
    twice_by_rounding = 2.0 * by_rounding
    found = np.empty((len(time), len(phi)))
    found[0] = state[0]
    gaps = np.diff(time)
    # (n - 1, c) speeds of the edge, times k / g, from frame to frame.
    slips, lifts = (
        by_g * (np.diff(path.reshape(len(time), -1), axis=0) / gaps[:, None]) for path in (slip, lift)
    )
    noise: tuple[Array, Array] | None = None

    def rate(state: Array, s: Array, z: Array, noise: tuple[Array, Array] | None) -> Array:
        """Time derivative (2, c) of the state of c motions: of tipping angle and Omega [rad/s, rad/s^2].

        Omega = theta' + (cos psi + rho / R) s + sin psi z is the angular speed theta' plus a term in the
        edge's speed: psi is balance angle less tipping angle, rho the radius of the edge's rounding, R the
        centre of mass's distance from the edge. k is the rate constant of the tip [rad/s^2], g gravity.

        Args:
            state: (2, c) tipping angle [rad] and Omega [rad/s].
            s: (c,) speed of the edge along the table, times k / g [rad/s].
            z: (c,) speed of the edge off the table, times k / g [rad/s].
            noise: difference (c,) of the variances of the noise of s and z, and their covariance (c,)
                [rad^2/s^2]; None without noise.
        """
        psi = phi - state[0]
        sin, cos = np.sin(psi), np.cos(psi)
        found = np.empty_like(state)
        speed = np.subtract(state[1], (cos + rolled) * s + sin * z, out=found[0])
        # Rolling on the rounding, as in pendulum_motion.trajectory.
        pull = (
            sin * (k + by_rounding * (speed * speed)) / (1.0 - twice_by_rounding * (1.0 - cos))
            if radius
            else sin * k
        )
        np.subtract((sin * s - cos * z) * speed, pull, out=found[1])
        if noise is not None:
            found[1] += sin * cos * noise[0] + (sin * sin - cos * cos) * noise[1]
        return found

    # A trial step of a fit may diverge; its misfit is then no number, and the step is refused.
    with np.errstate(over="ignore", invalid="ignore"):
        for i in range(1, len(time)):
            if jump is not None and i - 1 == jump[0]:
                state[1] += jump[1]
            gap = float(gaps[i - 1])
            if path_noise is not None:
                both = (by_g / gap) ** 2 * (path_noise[i] + path_noise[i - 1])[..., None]
                noise = both[0, 0] - both[1, 1], both[0, 1]
            moving = partial(rate, s=slips[i - 1], z=lifts[i - 1], noise=noise)
            state = runge_kutta_state(moving, state, gap, _MAX_STEP_S)
            found[i] = state[0]
    return found
