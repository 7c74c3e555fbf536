"""Log-Cholesky parameters of the second moments per kilogram about the centre of mass c.

Rucker and Wensing 2022 ("Smooth parameterization of rigid-body inertia"): the 4 x 4 pseudo-inertia is A A^T
with A upper triangular and exponentials on its diagonal. Its last column is then c itself and its scale the
mass, which leaves six numbers for the second moments about c per kilogram, S = U U^T. Every value of the six
is possible, since every such S belongs to a body: moments positive, triangle inequality strict.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from analyze.types import TENSOR_ENTRIES, Array

MIN_EIGENVALUE_FRACTION = 1e-3
"""Lower bound of an eigenvalue of the second-moment matrix over its trace, so that the tensor is possible."""
_ROW, _COLUMN = np.array(TENSOR_ENTRIES).T
"""Indices (6,) of the rows and of the columns of a symmetric tensor's entries."""
_NUMBER, _DIAGONAL, _UNIT = np.arange(len(TENSOR_ENTRIES)), np.arange(3), np.eye(3)
"""Indices of the entries, and of rows, and the unit matrix."""


def unit_inertia(numbers: Array) -> tuple[Array, Array]:
    """Inertia tensor per kilogram about the centre of mass (3, 3) [m^2], and its derivatives (6, 3, 3).

    The tensor is tr(S) - S with the second moments S = U U^T, U upper triangular. The derivatives are by the
    six `numbers`. Both arrays are read-only.

    Args:
        numbers: (6,) logarithms of U's diagonal [m], then U's entries 12, 13, 23 [m].
    """
    return _unit_inertia(numbers.tobytes())


@lru_cache(maxsize=16)
def _unit_inertia(key: bytes) -> tuple[Array, Array]:
    """`unit_inertia` of the numbers whose bytes are `key`; each step of a fit asks for it several times."""
    numbers = np.frombuffer(key)
    U = np.zeros((3, 3))
    U[_ROW, _COLUMN] = numbers
    U[_DIAGONAL, _DIAGONAL] = sizes = np.exp(numbers[:3])
    S = U @ U.T
    columns = U[:, _COLUMN].T
    columns[:3] *= sizes[:, None]
    by = np.zeros((6, 3, 3))
    by[_NUMBER, _ROW, :] = columns
    by[_NUMBER, :, _ROW] += columns
    traces = by[:, 0, 0] + by[:, 1, 1] + by[:, 2, 2]
    J, by = (S[0, 0] + S[1, 1] + S[2, 2]) * _UNIT - S, traces[:, None, None] * _UNIT - by
    J.flags.writeable = by.flags.writeable = False
    return J, by


def log_cholesky(inertia: Array) -> Array:
    """Log-Cholesky numbers (6,) of an inertia tensor per kilogram (3, 3) [m^2].

    They are the logarithms of U's diagonal [m], then U's entries 12, 13, 23 [m], with U upper triangular and
    U U^T the second moments tr(inertia)/2 - inertia. An impossible tensor is replaced by the nearest possible
    one.
    """
    inertia = nearest_possible(inertia)
    S = np.trace(inertia) / 2 * np.eye(3) - inertia
    U = np.asarray(np.linalg.cholesky(S[::-1, ::-1]), dtype=np.float64)[::-1, ::-1]
    return np.array([np.log(U[i, j]) if i == j else U[i, j] for i, j in TENSOR_ENTRIES])


def scale_free(numbers: Array) -> tuple[Array, Array]:
    """Five numbers of a tensor's shape, without its size, and their derivative (5, 6) by all six `numbers`.

    They are the logarithms of U's entries 22 and 33 over its first one, then U's entries 12, 13, 23 over it.

    Args:
        numbers: (6,) log-Cholesky numbers, as in `unit_inertia`.
    """
    size = np.exp(-numbers[0])
    shape = np.concatenate([numbers[1:3] - numbers[0], size * numbers[3:]])
    by = np.zeros((5, 6))
    by[0, :2], by[1, [0, 2]] = (-1.0, 1.0), (-1.0, 1.0)
    by[2:, 0] = -shape[2:]
    by[[2, 3, 4], [3, 4, 5]] = size
    return shape, by


def with_size(shape: Array, log_size: float) -> Array:
    """Log-Cholesky numbers (6,) of the tensor with the `scale_free` numbers (5,) and a given size.

    `log_size` is the first of the six, the logarithm of U's first entry [m].
    """
    return np.concatenate([[log_size], shape[:2] + log_size, np.exp(log_size) * shape[2:]])


def nearest_possible(inertia: Array) -> Array:
    """Physically possible inertia tensor (3, 3) nearest to `inertia` (3, 3), in its unit.

    The tensor is possible, and its triangle inequality holds, if its second-moment matrix tr(I)/2 - I is
    positive definite. Eigenvalues of that matrix are therefore raised to at least `MIN_EIGENVALUE_FRACTION`
    of its trace. If they are as large already, `inertia` is returned unchanged.
    """
    second = np.trace(inertia) / 2 * np.eye(3) - inertia
    values, vectors = np.linalg.eigh(second)
    least = MIN_EIGENVALUE_FRACTION * max(float(np.trace(second)), 1e-15)
    if values.min() >= least:
        return inertia
    second = vectors @ np.diag(np.maximum(values, least)) @ vectors.T
    return np.trace(second) * np.eye(3) - second


def symmetric_entries(matrix: Array) -> Array:
    """Entries (..., 6) in the order xx, yy, zz, xy, xz, yz of symmetric matrices (..., 3, 3)."""
    return matrix[..., _ROW, _COLUMN]


def symmetric_matrix(entries: Array) -> Array:
    """Symmetric matrix (3, 3) of six entries (6,) in the order xx, yy, zz, xy, xz, yz."""
    matrix = np.zeros((3, 3))
    for (i, j), value in zip(TENSOR_ENTRIES, entries.tolist(), strict=True):
        matrix[i, j] = matrix[j, i] = value
    return matrix
