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

_MAX_STEP_S = 1e-3
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
    def J(self) -> Array:
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
    rho, g = bodies.radius, bodies.gravity
    side, up, along, down = _arms(bodies, theta)
    pull, load = omega**2 * side + g * along, g * down - omega**2 * up
    alpha = -((up + rho) * pull + side * load) / (bodies.J + (up + rho) ** 2 + side**2)
    return alpha, (up + rho) * alpha + pull, load + side * alpha


def sliding_path(time: Array, bodies: SlidingBodies, start: Array) -> tuple[Array, Array, Array]:
    """Tipping angle [rad], sliding [m] and load N [m/s^2], each (n, c), of c bodies over time.

    Args:
        time: (n,) times [s], ascending; the first is that of the start.
        bodies: the c bodies.
        start: (4, c) tipping angle [rad], angular speed [rad/s], sliding [m] and its speed [m/s] at the
            start; a speed of 0 is an edge that sticks until friction gives out.
    """
    state = np.array(start, dtype=np.float64)
    mode = np.sign(state[3])
    found = np.empty((2, len(time), state.shape[1]))
    load = np.empty_like(found[0])
    found[:, 0], load[0] = state[[0, 2]], _load(bodies, state, mode)
    for i in range(1, len(time)):
        span = float(time[i] - time[i - 1])
        steps = max(1, int(np.ceil(span / _MAX_STEP_S - 1e-9)))
        for _ in range(steps):
            state, mode = _step(bodies, state, mode, span / steps)
        found[:, i], load[i] = state[[0, 2]], _load(bodies, state, mode)
    return found[0], found[1], load


def _arms(bodies: SlidingBodies, theta: Array) -> tuple[Array, Array, Array, Array]:
    """R sin psi and R cos psi [m], sine and cosine of the tilt, each (c,)."""
    psi = bodies.phi - theta
    return bodies.R * np.sin(psi), bodies.R * np.cos(psi), np.sin(bodies.tilt), np.cos(bodies.tilt)


def _rates(bodies: SlidingBodies, state: Array, mode: Array) -> Array:
    """Time derivatives (4, c) of angle, angular speed, sliding and sliding speed.

    Args:
        bodies: the c bodies.
        state: (4, c) angle [rad], angular speed [rad/s], sliding [m], sliding speed [m/s].
        mode: (c,) 0 for an edge that sticks, +1 or -1 for one that slides forwards or backwards.
    """
    theta, omega = state[0], np.clip(state[1], -_MAX_SPEED, _MAX_SPEED)
    alpha, slide = _accelerations(bodies, theta, omega, mode)
    return np.stack([omega, alpha, state[3], slide])


def _accelerations(bodies: SlidingBodies, theta: Array, omega: Array, mode: Array) -> tuple[Array, Array]:
    """Angular acceleration [rad/s^2] and acceleration of the sliding [m/s^2], each (c,)."""
    rho, g = bodies.radius, bodies.gravity
    held, _, _ = held_forces(bodies, theta, omega)
    side, up, along, down = _arms(bodies, theta)
    load = g * down - omega**2 * up
    # T = rub N: N follows from the moment about c.
    rub = -bodies.mu * mode
    arm = side + rub * (up + rho)
    inertia = bodies.J + arm * side
    free = -arm * load / np.where(np.abs(inertia) < 1e-9, 1e-9, inertia)
    force = rub * (load + side * free)
    slide = force - g * along - rho * free - up * free - omega**2 * side
    sticks = mode == 0
    return np.where(sticks, held, free), np.where(sticks, 0.0, slide)


def _load(bodies: SlidingBodies, state: Array, mode: Array) -> Array:
    """Load N (c,) [m/s^2] of the table on the edge, per mass."""
    alpha, _ = _accelerations(bodies, state[0], state[1], mode)
    side, up, _, down = _arms(bodies, state[0])
    return bodies.gravity * down + side * alpha - state[1] ** 2 * up


def _step(bodies: SlidingBodies, state: Array, mode: Array, h: float) -> tuple[Array, Array]:
    """State (4, c) and mode (c,) after `h` [s]; an edge whose sliding stops on the way may stick."""
    after = _runge_kutta(bodies, state, mode, np.full(state.shape[1], h))
    stops = (mode != 0) & (after[3] * mode < 0)
    if np.any(stops):
        # To the instant at which it stops, then on with friction the other way, or stuck.
        part = np.where(stops, h * state[3] / np.where(stops, state[3] - after[3], 1.0), h)
        at = _runge_kutta(bodies, state, mode, part)
        at[3] = np.where(stops, 0.0, at[3])
        again = np.where(stops, _sliding_mode(bodies, at), mode)
        after = np.where(stops, _runge_kutta(bodies, at, again, h - part), after)
        mode = again
    rests = mode == 0
    if np.any(rests):
        mode = np.where(rests, _sliding_mode(bodies, after), mode)
    return after, mode


def _sliding_mode(bodies: SlidingBodies, state: Array) -> Array:
    """Mode (c,) in which an edge at rest goes on: 0 if friction holds it, else the sign of its sliding."""
    _, pull, load = held_forces(bodies, state[0], state[1])
    return np.where(np.abs(pull) <= bodies.mu * load, 0.0, -np.sign(pull))


def _runge_kutta(bodies: SlidingBodies, state: Array, mode: Array, h: Array) -> Array:
    first = _rates(bodies, state, mode)
    second = _rates(bodies, state + h / 2 * first, mode)
    third = _rates(bodies, state + h / 2 * second, mode)
    fourth = _rates(bodies, state + h * third, mode)
    return state + h / 6 * (first + 2 * (second + third) + fourth)
