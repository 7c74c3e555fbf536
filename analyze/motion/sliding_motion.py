"""Planar motion of a body whose pivot edge sticks to the table or slides on it, under Coulomb friction.

The edge's rounding has its centre line at (x, rho), c stands at R (-sin psi, cos psi) from it, psi = phi -
theta, theta the tipping angle, phi the balance angle. With s = x - rho theta the sliding, and horizontal and
vertical force T and N of the table (per mass),

    T = s'' + rho theta'' + R (theta'' cos psi + theta'^2 sin psi) + g sin(tilt)
    N = g cos(tilt) + R (theta'' sin psi - theta'^2 cos psi)
    J theta'' = -(R cos psi + rho) T - R sin psi N

where J is the moment of inertia about c per mass. An edge that sticks rolls on its rounding, s'' = 0; one
that slides has T = -mu N sign(s'). It starts to slide where sticking would need |T| > mu N (Coulomb's law;
static and kinetic friction are taken as equal, see `SlidingFit`). Many cases are integrated at once, for
derivatives by differences.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from analyze.motion.pendulum_motion import G

if TYPE_CHECKING:
    from analyze.types import Array

_MAX_STEP_S = 2.1e-3
"""longest integration step [s]"""
_MIN_INERTIA_SHARE = 0.02
"""least J over R^2; trial steps of a fit may leave the physical range"""
_MAX_SPEED = 60.0
"""largest angular speed [rad/s] of a trial"""


@dataclass(frozen=True)
class SlidingBodies:
    """Bodies in the plane across their pivot edge, c cases at once."""

    mu: Array
    """(c,) coefficient of friction between edge and table"""
    phi: Array
    """(c,) balance angle against the table's normal [rad]"""
    k: Array
    """(c,) rate of the tip, g R / (J + (R + rho)^2) [rad/s^2]"""
    R: Array
    """(c,) distance of the centre of mass from the centre line of the edge's rounding [m]"""
    tilt: Array
    """(c,) lean of the vertical against the table's normal in the direction of tipping [rad]"""
    radius: float
    """radius rho of the edge's rounding [m]"""
    gravity: float = G
    """magnitude of gravity [m/s^2]"""

    @property
    def inertia(self) -> Array:
        """Moment of inertia (c,) about the axis through the centre of mass, per mass [m^2]."""
        least = _MIN_INERTIA_SHARE * self.R**2
        return np.maximum(self.gravity * self.R / self.k - (self.R + self.radius) ** 2, least)


def held_forces(bodies: SlidingBodies, theta: Array, omega: Array) -> tuple[Array, Array, Array]:
    """Angular acceleration [rad/s^2], T and N [m/s^2], each (c,), of an edge that sticks and rolls.

    Args:
        bodies: the c bodies.
        theta: (c,) tipping angle [rad].
        omega: (c,) angular speed [rad/s].
    """
    law = _Law(bodies)
    side, up = law.arms(theta)
    pull, load = law.without_turning(omega, side, up)
    alpha = law.held(side, up, pull, load)
    return alpha, (up + law.rho) * alpha + pull, load + side * alpha


def sliding_path(time: Array, bodies: SlidingBodies, start: Array) -> tuple[Array, Array, Array]:
    """Tipping angle [rad], sliding [m] and load N [m/s^2], each (n, c), of c bodies over time.

    Args:
        time: (n,) times [s], ascending; the first is that of the start.
        bodies: the c bodies.
        start: (4, c) tipping angle [rad], angular speed [rad/s], sliding [m] and its speed [m/s] at the
            start; a speed of 0 is an edge that sticks until friction gives out.
    """
    law, state = _Law(bodies), np.array(start, dtype=np.float64)
    mode = np.sign(state[3])
    found = np.empty((3, len(time), state.shape[1]))
    for i in range(len(time)):
        if i:
            span = float(time[i] - time[i - 1])
            steps = max(1, int(np.ceil(span / _MAX_STEP_S - 1e-9)))
            for _ in range(steps):
                state, mode = law.step(state, mode, span / steps)
        found[0, i], found[1, i] = state[0], state[2]
        found[2, i] = law.accelerations(state[0], state[1], mode)[2]
    return found[0], found[1], found[2]


class _Law:
    """Newton's law of c bodies on their edges, with what does not change during the motion."""

    def __init__(self, bodies: SlidingBodies) -> None:
        self._bodies = bodies
        self.rho, self.inertia = bodies.radius, bodies.inertia
        self._along, self._down = bodies.gravity * np.sin(bodies.tilt), bodies.gravity * np.cos(bodies.tilt)

    def arms(self, theta: Array) -> tuple[Array, Array]:
        """R sin psi and R cos psi [m], each (c,)."""
        psi = self._bodies.phi - theta
        return self._bodies.R * np.sin(psi), self._bodies.R * np.cos(psi)

    def without_turning(self, omega: Array, side: Array, up: Array) -> tuple[Array, Array]:
        """T and N [m/s^2], each (c,), less the parts by angular acceleration and sliding."""
        square = omega * omega
        return square * side + self._along, self._down - square * up

    def held(self, side: Array, up: Array, pull: Array, load: Array) -> Array:
        """Angular acceleration (c,) [rad/s^2] of an edge that sticks."""
        arm = up + self.rho
        return -(arm * pull + side * load) / (self.inertia + arm * arm + side * side)

    def accelerations(self, theta: Array, omega: Array, mode: Array) -> tuple[Array, Array, Array]:
        """Angular acceleration [rad/s^2], acceleration of the sliding and N [m/s^2], each (c,).

        Args:
            theta: (c,) tipping angle [rad].
            omega: (c,) angular speed [rad/s].
            mode: (c,) 0 for an edge that sticks, +1 or -1 for one that slides forwards or backwards.
        """
        side, up = self.arms(theta)
        pull, load = self.without_turning(omega, side, up)
        if not mode.any():
            alpha = self.held(side, up, pull, load)
            return alpha, np.zeros_like(alpha), load + side * alpha
        # T = rub N, and N follows from the moment about c.
        rub = -self._bodies.mu * mode
        arm = side + rub * (up + self.rho)
        alpha = -arm * load / (self.inertia + arm * side)
        if not mode.all():
            alpha = np.where(mode == 0, self.held(side, up, pull, load), alpha)
        normal = load + side * alpha
        slide = rub * normal - pull - (up + self.rho) * alpha
        return alpha, np.where(mode == 0, 0.0, slide), normal

    def rates(self, state: Array, mode: Array) -> Array:
        """Time derivatives (4, c) of angle, angular speed, sliding and sliding speed.

        Args:
            state: (4, c) angle [rad], angular speed [rad/s], sliding [m], sliding speed [m/s].
            mode: (c,) as in `accelerations`.
        """
        found = np.empty_like(state)
        found[0], found[2] = state[1], state[3]
        found[1], found[3], _ = self.accelerations(state[0], state[1], mode)
        return found

    def after(self, state: Array, mode: Array, h: Array | float) -> Array:
        """State (4, c) after h [s] by the classical Runge-Kutta method, in one mode."""
        first = self.rates(state, mode)
        second = self.rates(state + (h / 2) * first, mode)
        third = self.rates(state + (h / 2) * second, mode)
        fourth = self.rates(state + h * third, mode)
        found = state + (h / 6) * (first + 2 * (second + third) + fourth)
        np.clip(found[1], -_MAX_SPEED, _MAX_SPEED, out=found[1])
        return found

    def step(self, state: Array, mode: Array, h: float) -> tuple[Array, Array]:
        """State (4, c) and mode (c,) after h [s]; an edge whose sliding stops on the way may stick."""
        after = self.after(state, mode, h)
        stops = (mode != 0) & (after[3] * mode < 0)
        if stops.any():
            # To the instant at which it stops, then on with friction the other way, or stuck.
            part = np.where(stops, h * state[3] / np.where(stops, state[3] - after[3], 1.0), h)
            at = self.after(state, mode, part)
            at[3] = np.where(stops, 0.0, at[3])
            mode = np.where(stops, self.mode_from_rest(at), mode)
            after = np.where(stops, self.after(at, mode, h - part), after)
        rests = mode == 0
        if rests.any():
            mode = np.where(rests, self.mode_from_rest(after), mode)
        return after, mode

    def mode_from_rest(self, state: Array) -> Array:
        """Mode (c,) in which an edge that does not slide goes on: 0 if friction holds it."""
        _, pull, load = held_forces(self._bodies, state[0], state[1])
        return np.where(np.abs(pull) <= self._bodies.mu * load, 0.0, -np.sign(pull))
