"""Likelihood of the coefficient of friction, from the tipping angle and the path of the pivot edge.

For each of a range of coefficients mu the planar motion of `sliding_motion` is fitted to the frames of a
window: tipping angle, sliding and lift of the edge, with the balance angle, rate and distance R of the centre
of mass as uncertain as the strikes leave them. The chi^2 that is left, over mu, is the profile likelihood
(Venzon and Moolgavkar 1988). Where the edge slid it has a minimum: a value with its interval. Where it stuck
it is level above the largest T/N that the table had to hold: a bound. Static and kinetic friction are taken
as one coefficient.

The followed point lies beside the true edge by an unknown offset, and the contact creeps by some hundredths
of a millimetre (edge_offset.py); both are in the errors.
"""

# scipy and numpy are only partly typed.
# pyright: reportMissingTypeStubs=false, reportUnknownVariableType=false, reportUnknownArgumentType=false
# pyright: reportUnknownMemberType=false

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import TYPE_CHECKING

import numpy as np
from scipy.interpolate import PchipInterpolator

from analyze.errors import EstimationError
from analyze.motion.edge_offset import creep_covariance, displacement_per_error
from analyze.motion.sliding_motion import SlidingBodies, sliding_path

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from analyze.types import Array, EdgePath, IntArray, TipAngle

MU_GRID = np.geomspace(0.06, 1.8, 19)
"""(19,) coefficients of friction tried first"""
_FINE, _REFINED = 9, 2
"""number of coefficients tried between the neighbours of the best one, and how often"""
_CREEP = 6e-5
"""standard deviation [m] of the edge's own smooth motion (soft contact, slides of one end) and of the lens's
errors"""
_WHITE = 5e-6
"""standard deviation [m] of a frame's error beyond the stated one"""
_PLACE_SD = 5e-4
"""standard deviation [m] of the edge's assumed place, at least"""
_UNPLACED_SD = 2e-2
"""standard deviation [m] of the edge's assumed place where no marker's place on the object is known"""
_ROUNDS = 2
"""Gauss-Newton steps at every coefficient"""
_STEPS = np.array([1e-6, 1e-5, 1e-6, 1e-6, 1e-6, 1e-6, 1e-6])
"""differences of theta0, omega0, v0, phi, ln k, ln R, tilt, for derivatives"""
_DYNAMIC = len(_STEPS)
_OUTLIER_SIGMAS = 5.0
"""standardised residual above which a frame is left out"""
_MEDIAN_OF_NORMAL = 0.67
"""median of the absolute value of a standard normal variable"""
_MIN_LOAD = 0.05
"""least load of the table on the edge, over the weight, below which it may leave the table"""
MIN_FRAMES = 6
"""least number of frames of a window"""


@dataclass(frozen=True)
class PivotBody:
    """Body that tips about one edge: what the other estimates know of it."""

    phi: float
    """balance angle against gravity [rad]"""
    k: float
    """rate of the tip [rad/s^2]"""
    covariance: Array
    """(2, 2) covariance of (phi [rad], ln k)"""
    R: float
    """distance of the centre of mass from the centre line of the edge's rounding [m]"""
    R_sd: float
    """its standard deviation [m]"""
    radius: float
    """radius of the rounding [m]"""
    radius_sd: float
    """its standard deviation [m]"""
    tilt: float
    """lean of the vertical against the table's normal, in the direction of tipping [rad]"""
    tilt_sd: float
    """its standard deviation [rad]"""
    gravity: float
    """gravity [m/s^2]"""


@dataclass(frozen=True)
class FrictionLikelihood:
    """Chi^2 of one window's motion over the coefficient of friction between edge and table."""

    mu: Array
    """(m,) coefficients, ascending"""
    chi2: Array
    """(m,) chi^2 of the best motion at each, less the least; in units of the noise that is seen"""
    slid: float
    """range of the edge's sliding in the window at the best coefficient [m]"""
    frames: int
    """number of frames"""
    misfit: float
    """rms of the standardised residuals at the best coefficient"""

    def value(self, mu: Array) -> Array:
        """Chi^2 (n,) at coefficients (n,), interpolated between those tried, level beyond them."""
        inside = np.clip(mu, self.mu[0], self.mu[-1])
        return np.asarray(PchipInterpolator(self.mu, self.chi2)(inside), dtype=np.float64)


@dataclass(frozen=True)
class _Window:
    """Frames of a fit, whitened."""

    time: Array
    """(n,) [s]"""
    seen: Array
    """(n, 3) theta [rad], slip and lift [m]"""
    whiten: Array
    """(3 n, 3 n) matrix that makes residuals standard normal"""
    by_edge: Array
    """(n, 3, 3) derivatives of theta, slip and lift by the edge's offset (2) and radius [m]"""


def friction_likelihood(
    angle: TipAngle, path: EdgePath, window: tuple[int, int], body: PivotBody, moving: bool
) -> FrictionLikelihood:
    """Profile likelihood of the coefficient of friction from one window of a strike.

    Args:
        angle: theta(t) of the strike.
        path: sliding and lift of the planned edge in the same frames.
        window: frames [start, stop) in which only gravity and the table act, with the edge on the table.
        body: body and edge.
        moving: True if the edge may already slide in the first frame.

    Returns:
        Chi^2 over the coefficients tried (m,).

    Raises:
        EstimationError: the window has too few frames, or no motion fits it.
    """
    kept: IntArray = np.arange(*window, dtype=np.int64)
    result: FrictionLikelihood | None = None
    for _ in range(3):
        if len(kept) < MIN_FRAMES:
            raise EstimationError("too few frames for friction: film at a higher rate, or strike again")
        frames = _frames(angle, path, kept)
        result, bad = _profile(frames, body, path.place_sd, moving)
        if not np.any(bad):
            break
        kept = kept[~bad]
    if result is None or not np.all(np.isfinite(result.chi2)):
        raise EstimationError("no motion with friction fits these frames: leave this strike out")
    return result


def _frames(angle: TipAngle, path: EdgePath, kept: IntArray) -> _Window:
    time = (angle.time_ns[kept] - angle.time_ns[kept[0]]) * 1e-9
    theta = angle.theta[kept]
    n = len(kept)
    noise = np.zeros((3 * n, 3 * n))
    for i, each in enumerate(path.covariance[kept]):
        noise[3 * i : 3 * i + 3, 3 * i : 3 * i + 3] = each + np.diag([1e-14, _WHITE**2, _WHITE**2])
    creep = _CREEP**2 * creep_covariance(theta)
    for row in (1, 2):
        noise[row::3, row::3] += creep
    noise[::3, ::3] += angle.slow_sd**2 * np.exp(-np.abs(theta[:, None] - theta) / 0.01)
    by_edge = np.zeros((n, 3, 3))
    by_edge[:, 1:] = displacement_per_error(theta)
    seen = np.stack([theta, path.slip[kept], path.lift[kept]], axis=1)
    whiten = np.asarray(np.linalg.inv(np.linalg.cholesky(noise)), dtype=np.float64)
    return _Window(np.asarray(time, dtype=np.float64), seen, whiten, by_edge)


def _profile(
    frames: _Window, body: PivotBody, place_sd: float | None, moving: bool
) -> tuple[FrictionLikelihood, NDArray[np.bool_]]:
    """Chi^2 over the coefficients of friction, and the mask (n,) of frames that no motion explains."""
    prior = _prior(frames, body, place_sd, moving)
    start = np.repeat(prior[0][None], len(MU_GRID), axis=0)
    found = _minimised(frames, body, MU_GRID, start, prior, _ROUNDS)
    for _ in range(_REFINED):
        best = int(np.argmin(found.chi2))
        fine = np.linspace(found.mu[max(best - 1, 0)], found.mu[min(best + 1, len(found.mu) - 1)], _FINE + 2)
        near = np.repeat(found.x[best][None], _FINE, axis=0)
        found = found.joined(_minimised(frames, body, fine[1:-1], near, prior, _ROUNDS))
    best = int(np.argmin(found.chi2))
    residual = found.left[best].reshape(-1, 3)
    # Whitened residuals of one frame depend on earlier ones: what is left is each frame's own surprise.
    rms = float(np.sqrt(np.mean(residual**2)))
    usual = max(1.0, float(np.median(np.abs(residual))) / _MEDIAN_OF_NORMAL)
    bad = np.max(np.abs(residual), axis=1) > _OUTLIER_SIGMAS * usual
    bad |= found.load[best] < _MIN_LOAD * body.gravity
    scale = max(1.0, rms * np.sqrt(residual.size / max(residual.size - 8, 1)))
    keep = np.append(True, np.diff(found.mu) > 1e-12)
    result = FrictionLikelihood(
        found.mu[keep],
        (found.chi2[keep] - found.chi2[best]) / scale**2,
        float(np.ptp(found.slip[best])),
        len(frames.time),
        rms,
    )
    return result, bad


def _prior(frames: _Window, body: PivotBody, place_sd: float | None, moving: bool) -> tuple[Array, Array]:
    """Parameters (11,) before the fit and their inverse covariance (11, 11).

    They are theta0 [rad], omega0 [rad/s], v0 [m/s], phi [rad], ln k, ln R, tilt [rad], sliding at the start
    [m], offset of the followed point along and off the table and radius beyond the stated one [m].
    """
    first = min(len(frames.time), 7)
    slope = np.polyfit(frames.time[:first], frames.seen[:first, 0], 2)
    speed = float(np.polyfit(frames.time[:first], frames.seen[:first, 1], 1)[0])
    start = np.array(
        [slope[2], slope[1], speed if moving else 0.0, body.phi - body.tilt, np.log(body.k), np.log(body.R)]
    )
    start = np.concatenate([start, [body.tilt, frames.seen[0, 1], 0.0, 0.0, 0.0]])
    place = _UNPLACED_SD if place_sd is None else max(_PLACE_SD, place_sd)
    covariance = np.zeros((11, 11))
    wide = [1.0, 10.0, 1.0 if moving else 1e-9]
    covariance[:3, :3] = np.diag(np.square(wide))
    covariance[3:5, 3:5] = body.covariance
    covariance[5, 5] = (body.R_sd / body.R) ** 2
    # phi is measured against gravity: in the table's frame it errs with the tilt.
    covariance[3, 3] += body.tilt_sd**2
    covariance[6, 6], covariance[3, 6] = body.tilt_sd**2, -(body.tilt_sd**2)
    covariance[6, 3] = covariance[3, 6]
    covariance[7, 7] = 0.1**2
    covariance[8, 8] = covariance[9, 9] = place**2
    covariance[10, 10] = body.radius_sd**2
    covariance += np.diag(np.full(11, 1e-18))
    return start, np.asarray(np.linalg.inv(covariance), dtype=np.float64)


@dataclass(frozen=True)
class _Solutions:
    """Best motion at each of m coefficients of friction, ascending."""

    mu: Array
    """(m,) coefficients"""
    x: Array
    """(m, 11) parameters, as in `_prior`"""
    chi2: Array
    """(m,)"""
    left: Array
    """(m, 3 n) whitened residuals"""
    slip: Array
    """(m, n) sliding [m]"""
    load: Array
    """(m, n) load of the table on the edge, per mass [m/s^2]"""

    def joined(self, other: _Solutions) -> _Solutions:
        """Both together, ordered by coefficient."""
        order = np.argsort(np.concatenate([self.mu, other.mu]), kind="stable")
        pairs = ((getattr(self, each.name), getattr(other, each.name)) for each in fields(self))
        return _Solutions(*(np.concatenate(pair)[order] for pair in pairs))


def _minimised(
    frames: _Window, body: PivotBody, mu: Array, x: Array, prior: tuple[Array, Array], rounds: int
) -> _Solutions:
    """Best motions at coefficients of friction (m,), from parameters x (m, 11) on."""
    mean, inverse = prior
    m, n = len(mu), len(frames.time)
    size = 3 * n
    best = _Solutions(
        mu, x.copy(), np.full(m, np.inf), np.zeros((m, size)), np.zeros((m, n)), np.zeros((m, n))
    )
    damping = np.full(m, 1e-6)
    for number in range(rounds + 1):
        expected, by, slip, load = _expected(frames, body, mu, x)
        left = ((frames.seen - expected).reshape(m, size)) @ frames.whiten.T
        off = x - mean
        chi2 = np.sum(left**2, axis=1) + np.einsum("mi,ij,mj->m", off, inverse, off)
        better = chi2 < best.chi2
        for kept, new in zip(
            (best.x, best.chi2, best.left, best.slip, best.load), (x, chi2, left, slip, load), strict=True
        ):
            kept[better] = new[better]
        damping = np.where(better, damping / 10, np.minimum(damping * 100, 1e2))
        if number == rounds:
            break
        J = frames.whiten @ by.reshape(m, size, -1)
        transposed = J.transpose(0, 2, 1)
        normal = transposed @ J + inverse
        gradient = (transposed @ left[..., None])[..., 0] - off @ inverse
        normal = normal + damping[:, None, None] * np.eye(11) * np.einsum("mii->mi", normal)[:, None]
        step = np.linalg.solve(normal, gradient[..., None])[..., 0]
        x = np.where(better[:, None], x + step, best.x)
    return best


def _expected(frames: _Window, body: PivotBody, mu: Array, x: Array) -> tuple[Array, Array, Array, Array]:
    """Expected theta, slip, lift (m, n, 3), derivatives (m, n, 3, 11), true sliding and load (m, n)."""
    m, n = len(mu), len(frames.time)
    offsets = np.concatenate([np.zeros((1, _DYNAMIC)), np.diag(_STEPS)])
    cases = np.repeat(x[:, None], _DYNAMIC + 1, axis=1)
    cases[:, :, :_DYNAMIC] += offsets
    theta, slip, load = _paths(frames.time, body, np.repeat(mu, _DYNAMIC + 1), cases.reshape(-1, 11))
    both = np.stack([theta, slip], axis=-1).reshape(n, m, _DYNAMIC + 1, 2).transpose(1, 0, 3, 2)
    expected = np.zeros((m, n, 3))
    expected[:, :, :2] = both[..., 0]
    expected += np.einsum("nij,mj->mni", frames.by_edge, x[:, 8:])
    by = np.zeros((m, n, 3, 11))
    by[:, :, :2, :_DYNAMIC] = (both[..., 1:] - both[..., :1]) / _STEPS
    by[:, :, 1, 7] = 1.0
    by[..., 8:] = frames.by_edge[None]
    return expected, by, both[:, :, 1, 0], load[:, :: _DYNAMIC + 1].T


def _bodies(body: PivotBody, mu: Array, x: Array) -> SlidingBodies:
    return SlidingBodies(mu, x[:, 3], np.exp(x[:, 4]), np.exp(x[:, 5]), x[:, 6], body.radius, body.gravity)


def _paths(time: Array, body: PivotBody, mu: Array, x: Array) -> tuple[Array, Array, Array]:
    """Theta [rad], sliding [m] and load [m/s^2], each (n, c), of c cases with parameters x (c, 11)."""
    start = np.stack([x[:, 0], x[:, 1], x[:, 7], np.where(np.abs(x[:, 2]) < 1e-5, 0.0, x[:, 2])])
    return sliding_path(time, _bodies(body, mu, x), start)
