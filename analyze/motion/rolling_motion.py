"""Motion of a body that rolls on a curved section, in linear parameters x, and its phi and k.

The section is the body's cross-section across the pivot axis. theta is the tipping angle, phi the balance
angle, k [rad/s^2] the rate of the tip at balance. With the centre of mass c at (-b, a) from the pivot point p
at rest (horizontal in the direction of tipping, and up), m the mass, I_c the inertia about the axis through
c, J = I_c / m + a^2 + b^2, s the height of c over the table, s' the horizontal distance from c to the
contact, rho the section's radius of curvature there and M = I_c / m + s^2 + s'^2, rolling without sliding
means (method 3)

    M theta'' = -s' (g + rho theta'^2)
    M / J = 1 + m(theta) . x,    s' / J = f(theta) . x,    x = (1, a, b) / J

The functions m and f depend on the section alone. Integrated are theta and the moment of momentum about the
contact per mass (its second sign differs, because M changes with theta),

    Omega = M theta',    Omega' = -s' (g - rho theta'^2)
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from analyze.motion.pendulum_motion import G
from analyze.motion.runge_kutta import runge_kutta_state

if TYPE_CHECKING:
    from analyze.motion.support_function import SupportFunction
    from analyze.types import Array

_MAX_STEP_S = 0.01
"""longest integration step [s]"""
_MIN_INERTIA = 1e-2
"""lower bound of M / J: trial steps of a fit may leave the physical range"""
_MAX_SPEED = 60.0
"""upper bound of the angular speed [rad/s] in a trial step of a fit"""
_BALANCE_RANGE, _BALANCE_ANGLES = (0.0, 2.0), 400
"""range of angles [rad] in which a balance is sought, and the number of angles tried"""
_NEWTON_STEPS = 6
"""number of Newton steps for the balance angle"""
_MIN_DISTANCE = 1e-3
"""lower bound of the distance R of c from the centre of curvature [m]"""


def columns(section: SupportFunction, theta: Array) -> tuple[Array, Array, Array]:
    """Coefficients by which a rolling body's inertia and lever depend on its parameters x (3,).

    x = (1, a, b) / J: at rest the centre of mass is b [m] behind the pivot point (against the tip) and a [m]
    above it; J [m^2] is the inertia per mass about that point. At each tipping angle, 1 + m . x is the
    inertia about the contact over that about the pivot point at rest, and f . x the horizontal distance [m]
    from the centre of mass to the contact over J; m and f are the coefficients returned.

    Args:
        section: support function of the body's cross-section: height of the pivot point over the table at
            each tipping angle.
        theta: (...) tipping angles [rad].

    Returns:
        m (..., 3), f (..., 3), and the section's radius of curvature at the contact (...) [m].
    """
    h, ahead, radius = section.evaluate(theta)
    cos, sin = np.cos(theta), np.sin(theta)
    m = np.stack(
        [h * h + ahead * ahead, 2.0 * (h * cos - ahead * sin), 2.0 * (h * sin + ahead * cos)], axis=-1
    )
    return m, np.stack([ahead, -sin, cos], axis=-1), radius


def rolling_theta(time: Array, x: Array, section: SupportFunction) -> Array:
    """Tipping angles theta (n, c) [rad] of c bodies that tip by rolling, by the Runge-Kutta method.

    Args:
        time: (n,) time [s].
        x: (c, 5) 1 / J, a / J, b / J, and at the first time theta [rad] and its rate [rad/s]. At rest the
            centre of mass is a [m] above the pivot point and -b [m] from it in the direction of tipping; J =
            I_c / m + a^2 + b^2 [m^2], I_c the moment of inertia about the centre of mass.
        section: support function (the pivot point's height over the table by tipping angle) of the
            cross-section on which the bodies roll.
    """
    one, a, b = x[:, 0], x[:, 1], x[:, 2]
    body = x[:, :3]
    theta = x[:, 3]
    state = np.stack(
        [theta, x[:, 4] * np.maximum(1.0 + np.sum(columns(section, theta)[0] * body, axis=-1), _MIN_INERTIA)]
    )
    found = np.empty((len(time), len(theta)))
    found[0] = theta

    def rate(state: Array) -> Array:
        """Time derivatives (2, c) of tipping angle [rad/s] and momentum [rad/s^2] of c bodies.

        The momentum [rad/s] is the angular speed times the inertia about the contact, over the inertia about
        the pivot point at rest.

        Args:
            state: (2, c) tipping angle [rad] and momentum [rad/s].
        """
        theta, turn = state
        h, ahead, radius = section.evaluate(theta)
        cos, sin = np.cos(theta), np.sin(theta)
        s, slope = one * h + a * cos + b * sin, one * ahead - a * sin + b * cos
        inertia = np.maximum(
            1.0 + h * (2.0 * s - one * h) + ahead * (2.0 * slope - one * ahead), _MIN_INERTIA
        )
        speed = np.minimum(np.maximum(turn / inertia, -_MAX_SPEED), _MAX_SPEED)
        return np.stack([speed, -slope * (G - radius * speed * speed)])

    for i in range(1, len(time)):
        state = runge_kutta_state(rate, state, float(time[i] - time[i - 1]), _MAX_STEP_S)
        found[i] = state[0]
    return found


def balance_angle(section: SupportFunction, body: Array) -> float | None:
    """Least tipping angle [rad] at which c passes over the contact; None if it never does up to 2 rad.

    c is the centre of mass. The angle is accurate to 0.3 deg: the last one of a grid before the passage.

    Args:
        section: support function of the cross-section on which the body rolls: height of the pivot point over
            the table at each tipping angle.
        body: (3,) 1 / J, a / J, b / J: c is at (-b, a) [m] from the pivot point (in the direction of tipping,
            up), J [m^2] is the inertia per mass about the pivot point.
    """
    theta = np.linspace(*_BALANCE_RANGE, _BALANCE_ANGLES)
    ahead = columns(section, theta)[1] @ body
    passed = np.flatnonzero((ahead[:-1] > 0.0) & (ahead[1:] <= 0.0))
    return float(theta[passed[0]]) if len(passed) else None


def balance_parameters(section: SupportFunction, body: Array, start: float) -> tuple[Array, Array]:
    """Balance angle phi [rad] and k [rad/s^2], (c,) each, of c bodies; NaN where a body has none.

    k, the rate constant of the tip, is g R / (I_c / m + (R + rho)^2), with g gravity, R the distance of the
    centre of mass from the cross-section's centre of curvature at phi, rho the radius of curvature there and
    I_c / m the inertia per mass about the centre of mass.

    Args:
        section: support function of the cross-section: the pivot point's height over the table by tipping
            angle, as the section rolls.
        body: (c, 3) 1 / J, a / J, b / J of each body. At rest its centre of mass is at (-b, a) [m] from the
            pivot point (in the direction of tipping, up); J = I_c / m + a^2 + b^2 [m^2].
        start: approximate balance angle of all bodies [rad].
    """
    J = 1.0 / body[:, 0]
    a, b = J * body[:, 1], J * body[:, 2]
    phi = np.full(len(body), start)
    distance, radius = np.ones_like(phi), np.zeros_like(phi)
    for _ in range(_NEWTON_STEPS):
        height, ahead, radius = section.evaluate(phi)
        cos, sin = np.cos(phi), np.sin(phi)
        distance = a * cos + b * sin + height - radius
        slope = ahead - a * sin + b * cos
        # s'' = -R, the distance: Newton on s' = 0.
        phi = phi + np.clip(slope / np.maximum(distance, _MIN_DISTANCE), -0.2, 0.2)
    k = G * distance / (J - a * a - b * b + (distance + radius) ** 2)
    lost = np.where((distance < _MIN_DISTANCE) | (J <= 0.0) | (k <= 0.0), np.nan, 0.0)
    return phi + lost, k + lost


def energy_ratio(section: SupportFunction, body: Array, phi: float, theta: float, omega: float) -> float:
    """Energy ratio: energy of a rolling body over the energy needed to reach balance; 1 just reaches it.

    The first is kinetic plus potential energy at (theta, omega), the second potential energy at balance phi;
    both are relative to rest at theta = 0.

    Args:
        section: support function of the cross-section on which the body rolls: height [m] of the pivot point
            over the table for each tipping angle.
        body: (3,) 1 / J, a / J, b / J, with the centre of mass at rest a [m] above the pivot point and -b [m]
            from it in the direction of tipping, J = I_c / m + a^2 + b^2 [m^2] (I_c about the centre of mass).
        phi: balance angle [rad].
        theta: tipping angle [rad].
        omega: angular speed there [rad/s].
    """
    at = np.array([0.0, phi, theta])
    h, _, _ = section.evaluate(at)
    rest, top, now = body[0] * h + body[1] * np.cos(at) + body[2] * np.sin(at)
    inertia = 1.0 + float(columns(section, at[2:])[0][0] @ body)
    return float((0.5 * inertia * omega**2 / G + now - rest) / (top - rest))
