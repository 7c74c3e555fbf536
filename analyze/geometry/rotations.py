"""Conversions between rotation vectors, matrices and unit quaternions (wxyz), and rigid transforms.

A rotation matrix `R_a_b` (..., 3, 3) maps vectors of b to a. Angles in rad, right hand. Leading axes
broadcast. scipy's Rotation broadcasts from version 1.17 on only, and orthogonalises noisy matrices, which
changes their rotation vectors.
"""

from __future__ import annotations

import numpy as np

from analyze.types import Array

SMALL_ANGLE = 1e-6
"""Angle [rad] below which the sine's series is used."""


def hat(vector: Array) -> Array:
    """Cross-product matrices (..., 3, 3) of `vector` (..., 3): multiplied by b they give vector x b."""
    vector = np.asarray(vector, dtype=np.float64)
    x, y, z = vector[..., 0], vector[..., 1], vector[..., 2]
    found = np.zeros((*vector.shape, 3))
    found[..., 2, 1], found[..., 0, 2], found[..., 1, 0] = x, y, z
    found[..., 1, 2], found[..., 2, 0], found[..., 0, 1] = -x, -y, -z
    return found


def plane_basis(up: Array) -> tuple[Array, Array]:
    """Orthonormal vectors u, v (3,) perpendicular to the unit vector `up` (3,), with u x v = up."""
    x, y, z = up.tolist()
    # Cross product of the coordinate axis farthest from `up` with it; written out, as it is called thousands
    # of times.
    u: Array = np.array(((0.0, -z, y), (z, 0.0, -x), (-y, x, 0.0))[int(np.argmin(np.abs(up)))])
    u /= np.sqrt(u @ u)
    a, b, c = u.tolist()
    return u, np.array([y * c - z * b, z * a - x * c, x * b - y * a])


def matrix_from_vector(vector: Array) -> Array:
    """Rotation matrices (..., 3, 3) of rotation vectors (..., 3) [rad]: axis times angle (Rodrigues 1840)."""
    vector = np.asarray(vector, dtype=np.float64)
    angle = np.linalg.norm(vector, axis=-1)[..., None, None]
    safe = np.where(angle < SMALL_ANGLE, 1.0, angle)
    first = np.where(angle < SMALL_ANGLE, 1.0 - angle**2 / 6, np.sin(safe) / safe)
    second = np.where(angle < SMALL_ANGLE, 0.5 - angle**2 / 24, 2 * (np.sin(safe / 2) / safe) ** 2)
    cross = hat(vector)
    return np.eye(3) + first * cross + second * (cross @ cross)


def vector_from_matrix(matrix: Array) -> Array:
    """Rotation vectors (..., 3) [rad], axis times angle in [0, pi], of rotation matrices (..., 3, 3).

    At pi the axis may have either sign.
    """
    quaternion = wxyz_from_matrix(matrix)
    scalar, axis = quaternion[..., :1], quaternion[..., 1:]
    sine = np.linalg.norm(axis, axis=-1, keepdims=True)
    half = np.arctan2(sine, scalar)
    safe = np.where(sine < SMALL_ANGLE, 1.0, sine)
    return axis * np.where(sine < SMALL_ANGLE, 2.0, 2 * half / safe)


def wxyz_from_matrix(matrix: Array) -> Array:
    """Unit quaternions wxyz (..., 4) with w >= 0 of rotation matrices (..., 3, 3).

    The largest component is the divisor (Shepperd 1978).
    """
    matrix = np.asarray(matrix, dtype=np.float64)
    m = matrix
    xx, yy, zz = m[..., 0, 0], m[..., 1, 1], m[..., 2, 2]
    squares = np.stack([1 + xx + yy + zz, 1 + xx - yy - zz, 1 - xx + yy - zz, 1 - xx - yy + zz], axis=-1)
    wx, wy, wz = m[..., 2, 1] - m[..., 1, 2], m[..., 0, 2] - m[..., 2, 0], m[..., 1, 0] - m[..., 0, 1]
    xy, xz, yz = m[..., 0, 1] + m[..., 1, 0], m[..., 0, 2] + m[..., 2, 0], m[..., 1, 2] + m[..., 2, 1]
    table = np.stack(
        [
            np.stack([squares[..., 0], wx, wy, wz], axis=-1),
            np.stack([wx, squares[..., 1], xy, xz], axis=-1),
            np.stack([wy, xy, squares[..., 2], yz], axis=-1),
            np.stack([wz, xz, yz, squares[..., 3]], axis=-1),
        ],
        axis=-2,
    )
    best = np.argmax(squares, axis=-1)
    row = np.take_along_axis(table, best[..., None, None], axis=-2)[..., 0, :]
    row = row / np.linalg.norm(row, axis=-1, keepdims=True)
    return np.copysign(1.0, row[..., :1]) * row


def matrix_from_wxyz(wxyz: Array) -> Array:
    """Rotation matrices (..., 3, 3) of quaternions wxyz (..., 4), which are normalised first."""
    wxyz = np.asarray(wxyz, dtype=np.float64)
    wxyz = wxyz / np.linalg.norm(wxyz, axis=-1, keepdims=True)
    scalar = wxyz[..., 0][..., None, None]
    cross = hat(wxyz[..., 1:])
    return np.eye(3) + 2 * scalar * cross + 2 * (cross @ cross)


def relative(R_a_b: Array, R_a_c: Array) -> Array:
    """Rotation R_b_c (..., 3, 3), which maps vectors of frame c to b, from the rotations of both to a.

    Args:
        R_a_b: (..., 3, 3) rotation from b to a.
        R_a_c: (..., 3, 3) rotation from c to a.
    """
    return np.swapaxes(R_a_b, -1, -2) @ R_a_c


def angle_between(R_a_b: Array, R_a_c: Array) -> Array:
    """Angle (...) [rad] in [0, pi] of the rotation between frames b and c.

    Args:
        R_a_b: (..., 3, 3) rotation from b to a.
        R_a_c: (..., 3, 3) rotation from c to a.
    """
    return np.linalg.norm(vector_from_matrix(relative(R_a_b, R_a_c)), axis=-1)


def nearest_rotation(matrix: Array) -> Array:
    """Rotation (..., 3, 3) nearest to `matrix` (..., 3, 3) in the Frobenius norm (Kabsch 1976).

    It removes the errors that rounding or averaging added to a rotation matrix.
    """
    u, _, vt = np.linalg.svd(matrix)
    sign = np.linalg.det(u @ vt)
    u = np.concatenate([u[..., :2], u[..., 2:] * sign[..., None, None]], axis=-1)
    return u @ vt


def transform(R_a_b: Array, p_a_b: Array) -> Array:
    """Rigid transform T_a_b (..., 4, 4), which maps points of frame b to frame a.

    Args:
        R_a_b: (..., 3, 3) rotation from b to a.
        p_a_b: (..., 3) origin of b, in a and in the unit of the points.
    """
    lead = np.broadcast_shapes(R_a_b.shape[:-2], p_a_b.shape[:-1])
    T_a_b = np.zeros((*lead, 4, 4))
    T_a_b[..., :3, :3] = R_a_b
    T_a_b[..., :3, 3] = p_a_b
    T_a_b[..., 3, 3] = 1.0
    return T_a_b


def inverse_transform(T_a_b: Array) -> Array:
    """Inverse T_b_a (..., 4, 4) of a rigid transform T_a_b (..., 4, 4) between frames a and b."""
    R_b_a = np.swapaxes(T_a_b[..., :3, :3], -1, -2)
    return transform(R_b_a, -(R_b_a @ T_a_b[..., :3, 3:])[..., 0])


def apply(T_a_b: Array, points_b: Array) -> Array:
    """Points (n, 3) in frame a from `points_b` (n, 3) in frame b, by the rigid transform T_a_b (4, 4)."""
    return points_b @ T_a_b[:3, :3].T + T_a_b[:3, 3]
