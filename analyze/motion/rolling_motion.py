"""Motion of a body that rolls on a flank, in numbers in which it is linear, and what phi, k and R these are.

With c at (-b, a) from the pivot point p at rest, J = I_c / m + a^2 + b^2, s the height of c over the table, s' how far ahead of c it
touches, rho the flank's radius there and M = I_c / m + s^2 + s'^2, rolling without sliding means (METHOD section 3)

    M theta'' = -s' (g + rho theta'^2),    M / J = 1 + m(theta) . x,    s' / J = f(theta) . x,    x = (1, a, b) / J

m and f are the flank's alone. Where the contact slides by u and lifts by z besides, the balance of moments about the touching line (no
friction in it) is, in the weak form in which only their velocities enter,

    Omega = M theta' + s u' + s' z',    Omega' = -s' (g - rho theta'^2) + (s' u' + s'' z') theta'
"""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from analyze.motion.runge_kutta import advanced

if TYPE_CHECKING:
    from analyze.motion.support_function import SupportFunction
    from analyze.types import Array

G = 9.81
"""m/s^2; a hundredth of it is a hundredth of what rolling adds to the pendulum"""
_MOST_STEP_S = 0.01
_LEAST = 1e-2
"""of M / J: trial steps of a fit may leave what a body can be"""
_FASTEST = 60.0
"""rad/s, for the same reason"""
_TIPS, _TRIED = (0.0, 2.0), 400
"""rad, where a balance is looked for, and at how many angles"""
_NEWTON = 6
_NEAREST = 1e-3
"""m, of c from the centre of curvature"""


def columns(flank: SupportFunction, theta: Array) -> tuple[Array, Array, Array]:
    """The flank's m (..., 3), f (..., 3) and rho (...) at theta (...)."""
    h, ahead, radius = flank.at(theta)
    cos, sin = np.cos(theta), np.sin(theta)
    m = np.stack(
        [h * h + ahead * ahead, 2.0 * (h * cos - ahead * sin), 2.0 * (h * sin + ahead * cos)], axis=-1
    )
    return m, np.stack([ahead, -sin, cos], axis=-1), radius


def rolled(time: Array, x: Array, flank: SupportFunction, slide: tuple[Array, Array] | None = None) -> Array:
    """Theta (n, c) of c motions (RK4).

    Args:
        time: (n,) s.
        x: (c, 5) 1 / J, a / J, b / J, and at the first time theta and Omega / M (the speed, where nothing slides).
        flank: what it rolls on.
        slide: (n,) or (n, c) m each, how far the contact had slid and lifted, straight between the times; None: it only rolled.
    """
    one, a, b = x[:, 0], x[:, 1], x[:, 2]
    body = x[:, :3]
    theta = x[:, 3]
    state = np.stack(
        [theta, x[:, 4] * np.maximum(1.0 + np.sum(columns(flank, theta)[0] * body, axis=-1), _LEAST)]
    )
    found = np.empty((len(time), len(theta)))
    found[0] = theta

    def rate(state: Array, u: Array | None, z: Array | None) -> Array:
        theta, turn = state
        h, ahead, radius = flank.at(theta)
        cos, sin = np.cos(theta), np.sin(theta)
        s, slope = one * h + a * cos + b * sin, one * ahead - a * sin + b * cos
        inertia = np.maximum(1.0 + h * (2.0 * s - one * h) + ahead * (2.0 * slope - one * ahead), _LEAST)
        if u is None or z is None:
            speed = _possible(turn / inertia)
            return np.stack([speed, -slope * (G - radius * speed * speed)])
        speed = _possible((turn - s * u - slope * z) / inertia)
        return np.stack(
            [speed, -slope * (G - radius * speed * speed) + (slope * u + (one * radius - s) * z) * speed]
        )

    for i in range(1, len(time)):
        gap = float(time[i] - time[i - 1])
        u, z = (None, None) if slide is None else ((path[i] - path[i - 1]) / gap for path in slide)
        state = advanced(partial(rate, u=u, z=z), state, gap, _MOST_STEP_S)
        found[i] = state[0]
    return found


def _possible(speed: Array) -> Array:
    return np.minimum(np.maximum(speed, -_FASTEST), _FASTEST)


def tips_at(flank: SupportFunction, body: Array) -> float | None:
    """Angle [rad] at which c of a body (3,) first stands over the contact so that it tips on; None where it never does."""
    theta = np.linspace(*_TIPS, _TRIED)
    ahead = columns(flank, theta)[1] @ body
    passed = np.flatnonzero((ahead[:-1] > 0.0) & (ahead[1:] <= 0.0))
    return float(theta[passed[0]]) if len(passed) else None


def stance(flank: SupportFunction, body: Array, phi: Array) -> tuple[Array, Array, Array]:
    """phi, k and R (c,) of bodies (c, 3), phi near `phi` (c,); NaN where c does not stand there so that it tips."""
    J = 1.0 / body[:, 0]
    a, b = J * body[:, 1], J * body[:, 2]
    phi = phi.copy()
    distance, radius = np.ones_like(phi), np.zeros_like(phi)
    for _ in range(_NEWTON):
        height, ahead, radius = flank.at(phi)
        cos, sin = np.cos(phi), np.sin(phi)
        distance = a * cos + b * sin + height - radius
        slope = ahead - a * sin + b * cos
        # s'' = -R, the distance: Newton on s' = 0.
        phi = phi + np.clip(slope / np.maximum(distance, _NEAREST), -0.2, 0.2)
    k = G * distance / (J - a * a - b * b + (distance + radius) ** 2)
    lost = np.where((distance < _NEAREST) | (J <= 0.0) | (k <= 0.0), np.nan, 0.0)
    return phi + lost, k + lost, distance + lost


def energy_ratio(flank: SupportFunction, body: Array, phi: float, theta: float, omega: float) -> float:
    """Energy at theta, omega over what it takes to stand up at phi, both against rest at theta = 0; body (3,)."""
    at = np.array([0.0, phi, theta])
    h, _, _ = flank.at(at)
    rest, top, now = body[0] * h + body[1] * np.cos(at) + body[2] * np.sin(at)
    inertia = 1.0 + float(columns(flank, at[2:])[0][0] @ body)
    return float((0.5 * inertia * omega**2 / G + now - rest) / (top - rest))
