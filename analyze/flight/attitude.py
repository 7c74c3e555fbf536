"""Attitude of rotating bodies over time: Euler's equations J w' = T - w x J w, integrated numerically.

J is the inertia tensor about the centre of mass, w the angular velocity and T the moment that acts, all in
the object frame O. Attitudes are unit quaternions wxyz of the rotation from O to the world frame W.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from analyze.types import Array

STEP_RAD = 0.2
"""largest turn of the fastest body in a step of the integration [rad]: an error of some 1e-6 rad"""


def rotated_attitudes(
    attitude: Array,
    spin: Array,
    inertia: Array,
    time: Array,
) -> tuple[Array, Array]:
    """Attitudes (v, f, n, 4) and angular velocities (v, f, n, 3) of f bodies, for v sets of unknowns.

    No moment acts. Runge-Kutta of the fourth order, in steps of at most `STEP_RAD`.

    Args:
        attitude: (v, f, 4) quaternions wxyz from O to W at the first time.
        spin: (v, f, 3) angular velocity in O there [rad/s].
        inertia: (v, 3, 3) tensor in O about the centre of mass, up to its factor.
        time: (f, n) times [s]; equal ones at the end of a shorter motion.
    """
    inverse = np.asarray(np.linalg.inv(inertia), dtype=np.float64)
    path = np.empty((*attitude.shape[:2], time.shape[1], 4))
    spins = np.empty((*attitude.shape[:2], time.shape[1], 3))
    path[:, :, 0], spins[:, :, 0] = attitude, spin
    fastest = float(np.linalg.norm(spin, axis=-1).max())
    q, w = attitude, spin
    for frame in range(1, time.shape[1]):
        gap = time[:, frame] - time[:, frame - 1]
        pieces = max(1, int(np.ceil(float(np.abs(gap).max()) * fastest / STEP_RAD)))
        step = gap / pieces
        h = step[None, :, None]
        for _ in range(pieces):
            q, w = rotation_step(q, w, inertia, inverse, h)
            q = q / np.sqrt(np.einsum("vfi,vfi->vf", q, q))[..., None]
        path[:, :, frame], spins[:, :, frame] = q, w
    return path, spins


def rotation_step(
    q: Array, w: Array, inertia: Array, inverse: Array, h: Array, moment: Array | float = 0.0
) -> tuple[Array, Array]:
    """Attitudes (v, f, 4), not normalised, and angular velocities (v, f, 3) after one Runge-Kutta step.

    Args:
        q: (v, f, 4) attitudes before the step.
        w: (v, f, 3) angular velocities in O [rad/s].
        inertia: (v, 3, 3) tensors in O about the centre of mass.
        inverse: (v, 3, 3) their inverses.
        h: (1, f, 1) lengths of the steps [s].
        moment: (v, f, 3) constant moment in O, in units of the inertia times rad/s^2.
    """

    def rates(q: Array, w: Array) -> tuple[Array, Array]:
        whole = cross(w @ inertia, w) + moment  # the tensors are symmetric
        return 0.5 * times_vector(q, w), whole @ inverse

    q1, w1 = rates(q, w)
    q2, w2 = rates(q + 0.5 * h * q1, w + 0.5 * h * w1)
    q3, w3 = rates(q + 0.5 * h * q2, w + 0.5 * h * w2)
    q4, w4 = rates(q + h * q3, w + h * w3)
    return q + h / 6 * (q1 + 2 * q2 + 2 * q3 + q4), w + h / 6 * (w1 + 2 * w2 + 2 * w3 + w4)


def cross(a: Array, b: Array) -> Array:
    """Cross product (..., 3), several times as fast as numpy's."""
    a1, a2, a3, b1, b2, b3 = a[..., 0], a[..., 1], a[..., 2], b[..., 0], b[..., 1], b[..., 2]
    first = a2 * b3 - a3 * b2
    found = np.empty((*first.shape, 3))
    found[..., 0], found[..., 1], found[..., 2] = first, a3 * b1 - a1 * b3, a1 * b2 - a2 * b1
    return found


def times_vector(q: Array, vector: Array) -> Array:
    """Quaternion (..., 4) times the pure quaternion of a vector (..., 3)."""
    w, x, y, z = q[..., 0], q[..., 1], q[..., 2], q[..., 3]
    a, b, c = vector[..., 0], vector[..., 1], vector[..., 2]
    found = np.empty_like(q)
    found[..., 0] = -x * a - y * b - z * c
    found[..., 1] = w * a + y * c - z * b
    found[..., 2] = w * b + z * a - x * c
    found[..., 3] = w * c + x * b - y * a
    return found


def turned(q: Array, by: Array) -> Array:
    """Quaternions (..., 4) turned in their own frame by small rotation vectors (..., 3) [rad]."""
    moved = q + 0.5 * times_vector(q, by)
    return moved / np.linalg.norm(moved, axis=-1, keepdims=True)


def small_rotation(fitted: Array, measured: Array) -> Array:
    """Rotation vectors (..., 3) [rad] from measured to fitted attitudes (..., 4), in the measured frame.

    They are exact to the third order of the angle.
    """
    scalar = np.sum(measured * fitted, axis=-1, keepdims=True)
    part = (
        measured[..., :1] * fitted[..., 1:]
        - fitted[..., :1] * measured[..., 1:]
        - cross(measured[..., 1:], fitted[..., 1:])
    )
    return 2.0 * np.sign(scalar) * part
