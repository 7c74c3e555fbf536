"""Centre of mass c and gravity g from free flights: c moves on a parabola however the body rotates.

With x(t) the position and R(t) the rotation of the object frame O in the world frame W (z up), and p0, v0 the
start and velocity of c,

    x(t) + R(t) c = p0 + v0 t - 1/2 g t^2 z - drag

is linear in c, g and, for every flight, p0 and v0. Rotation in flight reveals c; free rotation reveals the
inertia only up to a factor, because no moment acts. Flights differ in tracking quality, and a stretch in
which a hand still holds the body is not a flight: residuals follow a multivariate t distribution, every
flight with a scale of its own (Lange, Little and Taylor 1989).
"""

# scipy is only partly typed.
# pyright: reportMissingTypeStubs=false, reportUnknownMemberType=false, reportUnknownVariableType=false

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.integrate import cumulative_trapezoid

from analyze.errors import EstimationError
from analyze.least_squares.grouped_errors import group_freedom, jackknife_covariance
from analyze.least_squares.intervals import student_sigmas_95

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from analyze.motion.body_motion import BodyMotion
    from analyze.types import Array


MIN_THROWS = 8
"""least number of throws"""
_T_FREEDOM = 4.0
"""degrees of freedom of Student's t distribution of the residuals"""
_ROUNDS = 50


@dataclass(frozen=True)
class Flight:
    """Poses of a thrown body in which only gravity and air act, with the number of the throw."""

    motion: BodyMotion
    """poses of the body"""
    group: int
    """number of the throw, whose flights may share errors"""


@dataclass(frozen=True)
class FlightBody:
    """Centre of mass c [m, in O] and gravity g [m/s^2], fitted to free flights of one body.

    O is the object frame.
    """

    com: Array
    """(3,) c in O [m]"""
    gravity: float
    """g [m/s^2], in the unit of length of the motion's positions"""
    covariance: Array
    """(4, 4) covariance of (c, g)"""
    freedom: Array
    """(4,) degrees of freedom of the variances of (c, g)"""
    flights: int
    """number of flights"""
    residual: float
    """rms residual of the median flight [m]"""

    @property
    def com_sd(self) -> Array:
        """Standard deviation (3,) of the centre of mass along the axes of the object frame O [m]."""
        return np.sqrt(np.diag(self.covariance)[:3])

    @property
    def gravity_sd(self) -> float:
        """Standard deviation of the fitted gravity g [m/s^2]."""
        return float(np.sqrt(self.covariance[3, 3]))

    @property
    def half_width(self) -> Array:
        """Half-widths (4,) of the 95 % intervals of centre of mass (3) [m, in O] and gravity [m/s^2].

        They are by Student's t; O is the object frame.
        """
        return student_sigmas_95(self.freedom) * np.sqrt(np.diag(self.covariance))


def fit_flights(flights: Sequence[Flight], drag: float) -> FlightBody:
    """Fit the centre of mass c and gravity g to all flights of a body together.

    A throw may consist of several flights, between touches of the table; they may share errors.

    Args:
        flights: flights of one body; z of the world frame W, in which its poses are given, is vertical.
        drag: deceleration over squared speed [1/m]: density * drag coefficient * area / (2 mass).

    Returns:
        c in the object frame O [m], g [m/s^2], their covariance, and the median over the flights of their rms
        residual [m].

    Raises:
        EstimationError: fewer than `MIN_THROWS` (8) throws, or flights without the rotation that determines
            c.
    """
    systems = [_without_start(flight.motion, drag) for flight in flights]
    groups = np.array([flight.group for flight in flights])
    if len(np.unique(groups)) < MIN_THROWS:
        raise EstimationError(
            f"{len(np.unique(groups))} throws do not determine the centre of mass:"
            f" {MIN_THROWS} are the least, 100 a good number"
        )
    products = np.array([matrix.T @ matrix for matrix, _ in systems])
    rights = np.array([matrix.T @ level for matrix, level in systems])
    squares = np.array([float(level @ level) for _, level in systems])
    counts = np.array([len(level) - 6 for _, level in systems], dtype=np.float64)
    equations = _Equations(products, rights, squares, counts)
    x, weight, left = equations.solved(np.zeros(4))
    names, member = np.unique(groups, return_inverse=True)
    without = np.array([equations.part(member != g).solved(x)[0] for g in range(len(names))])
    by_throw = np.zeros((len(names), 4, 4))
    np.add.at(by_throw, member, weight[:, None, None] * products)
    return FlightBody(
        x[:3],
        float(x[3]),
        jackknife_covariance(without),
        group_freedom(np.asarray(np.linalg.inv(by_throw.sum(axis=0)), dtype=np.float64), by_throw),
        len(flights),
        float(np.sqrt(np.median(left / counts))),
    )


@dataclass(frozen=True)
class _Equations:
    """Normal equations of each of f flights in (c, g).

    c (3,) is the centre of mass in the object frame O [m], g the magnitude of gravity, a scalar [m/s^2].
    """

    products: Array
    """(f, 4, 4) normal matrix of each flight"""
    rights: Array
    """(f, 4) right side of the normal equations of each flight"""
    squares: Array
    """(f,) sum of squares of the right side of each flight's own equations [m^2]"""
    counts: Array
    """(f,) degrees of freedom of each flight's residuals"""

    def part(self, kept: NDArray[np.bool_]) -> _Equations:
        """Normal equations of only those flights for which the mask `kept` (f,) is True."""
        return _Equations(self.products[kept], self.rights[kept], self.squares[kept], self.counts[kept])

    def solved(self, start: Array) -> tuple[Array, Array, Array]:
        """Solve the equations of all f flights together for centre of mass c and gravity g, robustly.

        Args:
            start: (4,) (c, g) with which to begin, in m and m/s^2; zeros to begin with equal weights.

        Returns:
            (c, g) (4,), c in the object frame O; robust weight (f,) of each flight; sum of squares (f,) [m^2]
            of each flight's residuals.

        Raises:
            EstimationError: the flights do not determine c.
        """
        x, weight = start, np.ones(len(self.counts))
        left = self._left(x)
        if start.any():
            weight = self._weights(left, weight)
        normal = np.einsum("f,frc->rc", weight, self.products)
        size = np.sqrt(np.diag(normal))
        if np.linalg.cond(normal / np.outer(size, size)) > 1e8:
            raise EstimationError(
                f"{len(self.counts)} flights do not determine the centre of mass:"
                " throw so that the body turns in flight"
            )
        flat = self.products.reshape(-1, 16)
        for _ in range(_ROUNDS):
            normal = (weight @ flat).reshape(4, 4)
            before, x = x, np.asarray(np.linalg.solve(normal, weight @ self.rights), dtype=np.float64)
            left = self._left(x)
            weight = self._weights(left, weight)
            if np.max(np.abs(x - before)) < 1e-7:
                break
        return x, weight, left

    def _left(self, x: Array) -> Array:
        """Sum of squares (f,) [m^2] of each flight's residuals for the solution `x` (4,).

        `x` holds the centre of mass (3) [m], in the object frame, and gravity [m/s^2].
        """
        quadratic = self.products @ x @ x
        return np.maximum(self.squares - 2 * self.rights @ x + quadratic, 0.0)

    def _weights(self, left: Array, weight: Array) -> Array:
        """Robust weights (f,) of the flights; a flight whose residuals are large counts less.

        Args:
            left: (f,) sum of squares [m^2] of each flight's residuals.
            weight: (f,) weights with which the residuals' common variance is computed.
        """
        variance = float(weight @ left) / float(self.counts.sum())
        return (_T_FREEDOM + self.counts) / (_T_FREEDOM + left / variance)


def distance_from_parabola(flights: Sequence[Flight], com: Array, gravity: float, drag: float) -> Array:
    """Rms distance (flights,) [m] of a point of the body from its best-fitting free fall, in each flight.

    Start and velocity of the fall are fitted per flight, gravity and drag are given.

    Args:
        flights: flights of one body.
        com: (3,) point in the object frame O [m].
        gravity: g [m/s^2].
        drag: deceleration by air over squared speed [1/m].
    """
    found: list[float] = []
    for flight in flights:
        matrix, level = _without_start(flight.motion, drag)
        found.append(
            float(np.sqrt(np.sum((level - matrix @ np.append(com, gravity)) ** 2) / (len(level) - 6)))
        )
    return np.array(found)


def _without_start(motion: BodyMotion, drag: float) -> tuple[Array, Array]:
    """Linear equations of one flight in (c, g), its unknown start position and velocity eliminated.

    c (3,) is the centre of mass in the object frame O [m], g the magnitude of gravity, which acts along -z of
    the world frame [m/s^2].

    Args:
        motion: the flight.
        drag: deceleration by air over squared speed [1/m].

    Returns:
        (3 n, 4) coefficients of (c, g) and (3 n,) right side [m], for n frames.
    """
    time = motion.time - motion.time.mean()
    line, _ = np.linalg.qr(np.column_stack([np.ones_like(time), time]))

    def rest(values: Array) -> Array:
        """Values (n, ...), one row per frame, less their best straight line in time."""
        return values - line @ (line.T @ values)

    slowed = _twice_integrated(motion, drag)
    rows: list[Array] = []
    level: list[Array] = []
    for axis in range(3):
        fall = 0.5 * time**2 if axis == 2 else np.zeros_like(time)
        rows.append(rest(np.column_stack([motion.R_world_object[:, axis, :], fall])))
        level.append(rest(slowed[:, axis] - motion.position[:, axis]))
    return np.concatenate(rows), np.concatenate(level)


def _twice_integrated(motion: BodyMotion, drag: float) -> Array:
    """Displacement (n, 3) in the world frame [m] by air drag, the deceleration integrated twice.

    The speed is that of the object frame's origin; the displacement is 0 at the first time.

    Args:
        motion: the flight.
        drag: deceleration over squared speed [1/m].
    """
    velocity = np.gradient(motion.position, motion.time, axis=0)
    slowing = -drag * np.linalg.norm(velocity, axis=1, keepdims=True) * velocity
    once = cumulative_trapezoid(slowing, motion.time, axis=0, initial=0)
    return cumulative_trapezoid(once, motion.time, axis=0, initial=0)
