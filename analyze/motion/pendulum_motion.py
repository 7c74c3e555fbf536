"""Free tipping motion theta'' = -k sin(phi - theta), and its derivatives.

theta is the tipping angle, phi the balance angle, k = m g R / I_edge the rate [rad/s^2] (mass m, gravity g, R
the distance of the centre of mass from the edge, I_edge the moment of inertia about the edge). In psi = theta
- phi this is the inverted pendulum psi'' = k sin psi. It is integrated in equal steps of fourth order,
together with its variational equations: at a step of 8 ms and k = 100 rad/s^2 the error stays below 6e-6 rad
over 0.5 s, a tenth of the best camera's noise. Plain floats, because arrays of four numbers would cost twenty
times as much.
"""

# scipy is only partly typed.
# pyright: reportMissingTypeStubs=false, reportUnknownMemberType=false, reportUnknownVariableType=false

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from scipy.integrate import cumulative_trapezoid

if TYPE_CHECKING:
    from collections.abc import Sequence

    from analyze.types import Array

_MAX_STEP_S = 0.009
"""longest integration step [s]"""
G = 9.81
"""standard gravity [m/s^2]; it only scales small corrections, so that an error of 1 % does not matter"""
_MAX_PSI = 50.0
"""angle from balance [rad] at which the integration of a trial stops"""


def trajectory(
    time: Array, phi: float, k: float, theta0: float, omega0: float, radius: float = 0.0
) -> tuple[Array, Array, Array]:
    """Motion of a tip and its derivatives by the parameters, by Nystroem's method.

    For psi'' = f(psi), psi = theta - phi, that method needs only three values of f per step. An edge of
    radius rho rolls: the centre of mass comes nearer to the contact on either side of the balance
    (docs/decisions/0025). With e = k rho / g, g the gravity, and i the inertia about the contact over that at
    balance

        psi'' = sin psi (k + e psi'^2) / i,    i = 1 - 2 e (1 - cos psi)

    and conservation of energy gives psi'^2 at every psi.

    Source: Hairer, Norsett and Wanner, Solving Ordinary Differential Equations I, II.14, table 14.2.

    Args:
        time: (n,) time since the initial state [s], ascending, the first may be 0.
        phi: balance angle [rad], at which the centre of mass stands above the contact.
        k: rate [rad/s^2] of the tip.
        theta0: tipping angle theta at time 0 [rad].
        omega0: angular speed at time 0 [rad/s].
        radius: radius rho of the edge's rounding [m].

    Returns:
        theta (n,) [rad], angular speed omega (n,) [rad/s], and d theta / d (phi, k, theta0, omega0) (n, 4).
        Once theta is more than 50 rad from balance, the last values are repeated.
    """
    sin, cos = math.sin, math.cos
    e = k * radius / G
    psi, omega = theta0 - phi, omega0
    inertia0 = 1.0 - 2.0 * e * (1.0 - cos(psi))
    energy = inertia0 * omega * omega + 2.0 * k * cos(psi)
    by_psi0, by_speed0 = -2.0 * sin(psi) * (k + e * omega * omega), 2.0 * inertia0 * omega  # of the energy

    def pull(psi: float) -> tuple[float, float, float]:
        """Angular acceleration psi'' [rad/s^2] at the angle psi [rad], and its two derivatives.

        They are its derivatives by psi [1/s^2] and by the energy [1/rad] of the motion. psi is the tipping
        angle less the balance angle. The energy [rad^2/s^2], i psi'^2 + 2 k cos psi, stays
        constant during the motion. k is the rate constant of the tip [rad/s^2], i the inertia about the
        contact over that at balance (1 for a sharp edge).
        """
        s, c = sin(psi), cos(psi)
        by_inertia = 1.0 / (1.0 - 2.0 * e * (1.0 - c))
        strength = (k + e * (energy - 2.0 * k * c) * by_inertia) * by_inertia
        force = s * strength
        return force, c * strength + 4.0 * e * s * force * by_inertia, e * s * by_inertia * by_inertia

    a, da, b, db = 1.0, 0.0, 0.0, 1.0  # d (psi, omega) by psi_0 and by omega_0
    now = 0.0
    rows: list[tuple[float, float, float, float]] = []
    for target in time.tolist():
        gap = target - now
        steps = max(1, math.ceil(gap / _MAX_STEP_S)) if gap > 0 else 0
        h = gap / steps if steps else 0.0
        half, eighth, square_half = 0.5 * h, 0.125 * h * h, 0.5 * h * h
        sixth, square_sixth = h / 6.0, h * h / 6.0
        for _ in range(steps):
            f1, slope, gain = pull(psi)
            a1, b1 = slope * a + gain * by_psi0, slope * b + gain * by_speed0
            f2, slope, gain = pull(psi + half * omega + eighth * f1)
            a2 = slope * (a + half * da + eighth * a1) + gain * by_psi0
            b2 = slope * (b + half * db + eighth * b1) + gain * by_speed0
            f3, slope, gain = pull(psi + h * omega + square_half * f2)
            a3 = slope * (a + h * da + square_half * a2) + gain * by_psi0
            b3 = slope * (b + h * db + square_half * b2) + gain * by_speed0
            psi += h * omega + square_sixth * (f1 + 2.0 * f2)
            omega += sixth * (f1 + 4.0 * f2 + f3)
            a += h * da + square_sixth * (a1 + 2.0 * a2)
            da += sixth * (a1 + 4.0 * a2 + a3)
            b += h * db + square_sixth * (b1 + 2.0 * b2)
            db += sixth * (b1 + 4.0 * b2 + b3)
        now = target
        rows.append((psi, omega, a, b))
        if not abs(psi) < _MAX_PSI:
            rows.extend([rows[-1]] * (len(time) - len(rows)))
            break
    angle, speed, by_theta0, by_omega0 = np.array(rows).T
    # Scale invariance psi(t; k, omega0) = F(sqrt(k) t, omega0 / sqrt(k)) gives the derivative by k without
    # another equation. The change of e with k is neglected: less than a hundredth of it.
    by_k = (time * speed - omega0 * by_omega0) / (2.0 * k)
    return angle + phi, speed, np.stack([1.0 - by_theta0, by_k, by_theta0, by_omega0], axis=-1)


def energy_ratio(phi: float, k: float, theta0: float, omega0: float) -> float:
    """Energy ratio of a tip over a hinge: kinetic energy at rest pose over the energy to reach balance.

    omega_rest^2 / (2 k (1 - cos phi)), with omega_rest, the angular speed at theta = 0 (real or
    extrapolated), from the energy integral omega^2 / 2 + k cos(theta - phi) = const. The edge's rounding is
    left out.

    Args:
        phi: balance angle [rad].
        k: rate of the pendulum [rad/s^2].
        theta0: tipping angle theta at some time [rad].
        omega0: angular speed at that time [rad/s].
    """
    square = omega0 * omega0 + 2.0 * k * (math.cos(theta0 - phi) - math.cos(phi))
    return square / (2.0 * k * (1.0 - math.cos(phi)))


def first_guess(time: Array, theta: Array) -> Array:
    """First guess (4,) of phi, k, theta0, omega0 by linear least squares on the twice integrated equation.

    The equation is theta'' = -k sin(phi - theta) of the tipping angle theta. The four are balance angle
    [rad], rate [rad/s^2], and angle [rad] and speed [rad/s] at the first time. Nothing is differentiated:
    theta(t) = theta0 + omega0 t - A II cos(theta) + B II sin(theta), A = k sin(phi), B = k cos(phi), II the
    double integral over time.

    Args:
        time: (n,) times [s].
        theta: (n,) tipping angle [rad].
    """
    return _solved(_integrated_columns(time, theta), theta)[1]


def first_guess_with_jump(time: Array, theta: Array, frames: Sequence[int]) -> list[tuple[float, int, Array]]:
    """First guesses of a tip with a jump in angular speed at one frame, for several frames.

    Each is a linear least-squares solution of the twice integrated pendulum equation.

    Args:
        time: (n,) times [s].
        theta: (n,) tipping angle [rad].
        frames: indices of `time` at which a jump is tried.

    Returns:
        (sum of squares [rad^2], frame, (5,) parameters) for each frame, the best first. The parameters are
        balance angle phi [rad], rate k [rad/s^2], theta0 [rad] and omega0 [rad/s] at the first time, and the
        jump [rad/s].
    """
    columns = _integrated_columns(time, theta)
    found: list[tuple[float, int, Array]] = []
    for frame in frames:
        rows = np.column_stack([columns, np.maximum(time - time[frame], 0.0)])
        squares, guess = _solved(rows, theta)
        found.append((squares, frame, guess))
    return sorted(found, key=lambda each: each[0])


def _solved(columns: Array, theta: Array) -> tuple[float, Array]:
    """Sum of squared residuals [rad^2] and solution (p,) of the twice integrated pendulum equation.

    The solution begins with balance angle phi [rad], rate k [rad/s^2], and angle theta0 [rad] and speed
    omega0 [rad/s] at the first time; a factor for each column after the fourth follows.

    Args:
        columns: (n, p) 1, t, -II cos(theta), II sin(theta), then any further columns; II is the double
            integral over the time t since the first.
        theta: (n,) tipping angle [rad].
    """
    x = np.linalg.lstsq(columns, theta, rcond=None)[0]
    by_sin, by_cos = float(x[2]), float(x[3])
    guess = np.array([math.atan2(by_sin, by_cos), math.hypot(by_sin, by_cos), x[0], x[1], *x[4:]])
    return float(np.sum((theta - columns @ x) ** 2)), guess


def _integrated_columns(time: Array, theta: Array) -> Array:
    """Columns (n, 4) of the twice integrated pendulum equation: 1, t, -II cos(theta), II sin(theta).

    II is the double integral over time from the first time on, t the time since then.

    Args:
        time: (n,) times [s].
        theta: (n,) tipping angle [rad].
    """
    once = cumulative_trapezoid(np.stack([-np.cos(theta), np.sin(theta)]), time, initial=0)
    twice = cumulative_trapezoid(once, time, initial=0)
    return np.stack([np.ones_like(time), time - time[0], *twice], axis=-1)
