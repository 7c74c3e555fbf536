"""Rotation of one thrown body under the air's moment, and its derivatives by spin, tensor and air.

The motion is integrated step by step in plain numbers, as arrays of three cost a hundred times their
arithmetic. Derivatives of all single steps are taken at once and chained along the motion: a turn in the
world frame W stays as it is, so that only the angular velocities' derivatives need a chain.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from analyze.flight.attitude import STEP_RAD, cross, rotation_step, small_rotation
from analyze.geometry.rotations import matrix_from_wxyz

if TYPE_CHECKING:
    from collections.abc import Callable

    from analyze.flight.air_drag import AirLoad
    from analyze.types import Array

STEP = 1e-5
"""step of the numerical derivatives by spin [rad/s], shape and shift [m]"""
FACTOR_STEP = 1e-2
"""step of the numerical derivative by the coefficient of the air's moment"""
VARIANTS = 13
"""number of sets of unknowns: the nominal one, then spin (3), shape (5), air moment, its shift (3) moved"""
_SIZES = np.array([*[STEP] * 8, FACTOR_STEP, *[STEP] * 3])
_MAX_PIECES = 40
"""most steps from frame to frame: a fit that tries a faster spin takes it back"""


@dataclass(frozen=True)
class Air:
    """Air's load on a body in flight: law, coefficient of the moment, and shift of the force."""

    load: AirLoad
    """force and moment about c by the law, for a coefficient of 1"""
    velocity: Callable[[Array], Array]
    """velocity (n, 3) of c in W [m/s] at times (n,) [s]"""
    factor: float
    """coefficient of the moment"""
    shift: Array
    """(3,) shift of the place where the force acts [m, in O]"""


def tumble(attitude: Array, spin: Array, inertia: Array, time: Array, air: Air) -> tuple[Array, Array, Array]:
    """Attitudes (n, 4), angular velocities (n, 3) in O [rad/s] and turns (n, 3, 12) in W of one body.

    Attitudes are quaternions wxyz from O to W. The turns [rad] are the attitudes' derivatives by spin (3), by
    the tensor's shape (5), by the coefficient of the air's moment, and by the shift of its force (3). The
    air's load is that in the middle of each step of the motion itself.

    Args:
        attitude: (4,) attitude at the first time.
        spin: (3,) angular velocity in O there [rad/s].
        inertia: (6, 3, 3) tensor in O about c [m^2], then the tensors with each number of the shape moved by
            `STEP`.
        time: (n,) times [s], n at least 1.
        air: the air's load.
    """
    gaps = np.diff(time)
    turned = np.ceil(gaps * float(np.linalg.norm(spin)) / STEP_RAD)
    pieces = np.clip(np.nan_to_num(turned, nan=1.0), 1, _MAX_PIECES).astype(np.int64)
    steps = np.repeat(gaps / pieces, pieces)
    starts = time[0] + np.concatenate([[0.0], np.cumsum(steps)])[:-1]
    frames = np.concatenate([[0], np.cumsum(pieces)])
    velocities = air.velocity(starts + 0.5 * steps)
    q, w, loads = _integrated(attitude, spin, inertia[0], steps, velocities, air)
    turns = _turns(q, w, loads, inertia, steps, air)
    return q[frames], w[frames], turns[frames]


def _integrated(
    attitude: Array, spin: Array, inertia: Array, steps: Array, velocities: Array, air: Air
) -> tuple[Array, Array, Array]:
    """Attitudes (s + 1, 4), spins (s + 1, 3), and the air's loads (s, 6) in the middle of s steps."""
    moments, inverse = inertia.tolist(), np.linalg.inv(inertia).tolist()
    q: tuple[float, ...] = tuple(attitude.tolist())
    w: tuple[float, ...] = tuple(spin.tolist())
    attitudes, spins, loads = [q], [w], np.zeros((len(steps), 6))
    sx, sy, sz = air.shift.tolist()
    for number, (h, velocity) in enumerate(zip(steps.tolist(), velocities.tolist(), strict=True)):
        halfway = _product(q, (1.0, *(0.25 * h * each for each in w)))
        load = air.load((*_into_body(halfway, velocity), *w))
        loads[number] = load
        fx, fy, fz, mx, my, mz = load.tolist()
        moment = (
            air.factor * (mx + sy * fz - sz * fy),
            air.factor * (my + sz * fx - sx * fz),
            air.factor * (mz + sx * fy - sy * fx),
        )
        turn, w = _step(w, h, moments, inverse, moment)
        a, b, c, d = _product(q, turn)
        size = math.sqrt(a * a + b * b + c * c + d * d) or 1.0
        q = a / size, b / size, c / size, d / size
        attitudes.append(q)
        spins.append(w)
    return np.array(attitudes), np.array(spins), loads


def _turns(q: Array, w: Array, loads: Array, inertia: Array, steps: Array, air: Air) -> Array:
    """Turns (s + 1, 3, 12) in W at the ends of s steps, from the derivatives of every single step."""
    count = len(steps)
    spins = np.tile(w[:-1], (VARIANTS, 1, 1))
    spins[1:4] += STEP * np.eye(3)[:, None, :]
    tensors = np.tile(inertia[0], (VARIANTS, 1, 1))
    tensors[4:9] = inertia[1:]
    factors = np.full((VARIANTS, 1, 1), air.factor)
    factors[9] += FACTOR_STEP
    shifts = np.tile(air.shift, (VARIANTS, 1, 1))
    shifts[10:, 0] += STEP * np.eye(3)
    moment = factors * (loads[:, 3:] + cross(shifts, loads[None, :, :3]))
    still = np.tile(np.array([1.0, 0.0, 0.0, 0.0]), (VARIANTS, count, 1))
    inverse = np.asarray(np.linalg.inv(tensors), dtype=np.float64)
    ends, spun = rotation_step(still, spins, tensors, inverse, steps[None, :, None], moment)
    by_turn = small_rotation(ends[1:], ends[0]).transpose(1, 2, 0) / _SIZES
    by_spin = (spun[1:] - spun[0]).transpose(1, 2, 0) / _SIZES
    chain = np.zeros((count + 1, 3, 12))
    chain[0, :, :3] = np.eye(3)
    own = by_spin.copy()
    own[..., :3] = 0.0
    for number in range(count):
        chain[number + 1] = by_spin[number, :, :3] @ chain[number] + own[number]
    turned = by_turn[..., :3] @ chain[:-1]
    turned[..., 3:] += by_turn[..., 3:]
    turns = np.zeros((count + 1, 3, 12))
    np.cumsum(matrix_from_wxyz(q[1:]) @ turned, axis=0, out=turns[1:])
    return turns


def _step(
    w: tuple[float, ...],
    h: float,
    inertia: list[list[float]],
    inverse: list[list[float]],
    moment: tuple[float, float, float],
) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Turn (quaternion wxyz, not normalised) and new spin of a body by one Runge-Kutta step of length h."""
    x, y, z = w
    half, sixth = 0.5 * h, h / 6.0
    a1, b1, c1 = _spin_rate(x, y, z, inertia, inverse, moment)
    x2, y2, z2 = x + half * a1, y + half * b1, z + half * c1
    a2, b2, c2 = _spin_rate(x2, y2, z2, inertia, inverse, moment)
    x3, y3, z3 = x + half * a2, y + half * b2, z + half * c2
    a3, b3, c3 = _spin_rate(x3, y3, z3, inertia, inverse, moment)
    x4, y4, z4 = x + h * a3, y + h * b3, z + h * c3
    a4, b4, c4 = _spin_rate(x4, y4, z4, inertia, inverse, moment)
    spun = (
        x + sixth * (a1 + 2.0 * (a2 + a3) + a4),
        y + sixth * (b1 + 2.0 * (b2 + b3) + b4),
        z + sixth * (c1 + 2.0 * (c2 + c3) + c4),
    )
    # Attitude: q' = q w / 2, from no turn.
    p1, q1, r1 = 0.5 * x, 0.5 * y, 0.5 * z
    s2, p2, q2, r2 = _attitude_rate(1.0, half * p1, half * q1, half * r1, x2, y2, z2)
    s3, p3, q3, r3 = _attitude_rate(1.0 + half * s2, half * p2, half * q2, half * r2, x3, y3, z3)
    s4, p4, q4, r4 = _attitude_rate(1.0 + h * s3, h * p3, h * q3, h * r3, x4, y4, z4)
    return (
        1.0 + sixth * (2.0 * (s2 + s3) + s4),
        sixth * (p1 + 2.0 * (p2 + p3) + p4),
        sixth * (q1 + 2.0 * (q2 + q3) + q4),
        sixth * (r1 + 2.0 * (r2 + r3) + r4),
    ), spun


def _spin_rate(
    x: float,
    y: float,
    z: float,
    inertia: list[list[float]],
    inverse: list[list[float]],
    moment: tuple[float, float, float],
) -> tuple[float, float, float]:
    """Angular acceleration in O by Euler's equations: J w' = T - w x J w."""
    (a, b, c), (_, d, e), (_, _, f) = inertia
    l1, l2, l3 = a * x + b * y + c * z, b * x + d * y + e * z, c * x + e * y + f * z
    u1 = l2 * z - l3 * y + moment[0]
    u2 = l3 * x - l1 * z + moment[1]
    u3 = l1 * y - l2 * x + moment[2]
    (a, b, c), (_, d, e), (_, _, f) = inverse
    return a * u1 + b * u2 + c * u3, b * u1 + d * u2 + e * u3, c * u1 + e * u2 + f * u3


def _attitude_rate(
    s: float, x: float, y: float, z: float, wx: float, wy: float, wz: float
) -> tuple[float, float, float, float]:
    """Rate q w / 2 of a quaternion q, with scalar s and vector x, y, z, at a spin w in O."""
    a, b, c = 0.5 * wx, 0.5 * wy, 0.5 * wz
    return -x * a - y * b - z * c, s * a + y * c - z * b, s * b + z * a - x * c, s * c + x * b - y * a


def _product(p: tuple[float, ...], q: tuple[float, ...]) -> tuple[float, float, float, float]:
    """Product of two quaternions wxyz."""
    a, b, c, d = p
    s, x, y, z = q
    return (
        a * s - b * x - c * y - d * z,
        a * x + b * s + c * z - d * y,
        a * y - b * z + c * s + d * x,
        a * z + b * y - c * x + d * s,
    )


def _into_body(q: tuple[float, ...], vector: list[float]) -> tuple[float, float, float]:
    """Vector in O of a vector in W, with a quaternion wxyz from O to W of any length."""
    s, x, y, z = q
    a, b, c = vector
    twice = 2.0 / (s * s + x * x + y * y + z * z or 1.0)
    # v + 2 u x (u x v) - 2 s u x v
    e, f, g = y * c - z * b, z * a - x * c, x * b - y * a
    return (
        a + twice * (y * g - z * f - s * e),
        b + twice * (z * e - x * g - s * f),
        c + twice * (x * f - y * e - s * g),
    )
