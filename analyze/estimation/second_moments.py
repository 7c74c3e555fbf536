"""Log-Cholesky parameters of the second moments per kilogram about the centre of mass c.

Rucker and Wensing 2022 ("Smooth parameterization of rigid-body inertia"): the 4 x 4 pseudo-inertia is A A^T
with A upper triangular and exponentials on its diagonal. Its last column is then c itself and its scale the
mass, which leaves six numbers for the second moments about c per kilogram, S = U U^T. Every value of the six
is possible, since every such S belongs to a body: moments positive, triangle inequality strict.
"""

from __future__ import annotations

import numpy as np

from analyze.types import TENSOR_ENTRIES, Array

MIN_EIGENVALUE_FRACTION = 1e-3
"""Lower bound of an eigenvalue of the second-moment matrix over its trace, so that the tensor is possible."""


def unit_inertia(numbers: Array) -> tuple[Array, Array]:
    """Inertia tensor per kilogram about the centre of mass (3, 3) [m^2], and its derivatives (6, 3, 3).

    The tensor is tr(S) - S with the second moments S = U U^T, U upper triangular. The derivatives are by the
    six `numbers`.

    Args:
        numbers: (6,) logarithms of U's diagonal [m], then U's entries 12, 13, 23 [m].
    """
    U = np.zeros((3, 3))
    for (i, j), number in zip(TENSOR_ENTRIES, numbers.tolist(), strict=True):
        U[i, j] = np.exp(number) if i == j else number
    S = U @ U.T
    by = np.zeros((6, 3, 3))
    for n, (i, j) in enumerate(TENSOR_ENTRIES):
        size = U[i, i] if i == j else 1.0
        by[n, i, :] += size * U[:, j]
        by[n, :, i] += size * U[:, j]
    by = np.trace(by, axis1=1, axis2=2)[:, None, None] * np.eye(3) - by
    return np.trace(S) * np.eye(3) - S, by


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
    return np.stack([matrix[..., i, j] for i, j in TENSOR_ENTRIES], axis=-1)


def symmetric_matrix(entries: Array) -> Array:
    """Symmetric matrix (3, 3) of six entries (6,) in the order xx, yy, zz, xy, xz, yz."""
    matrix = np.zeros((3, 3))
    for (i, j), value in zip(TENSOR_ENTRIES, entries.tolist(), strict=True):
        matrix[i, j] = matrix[j, i] = value
    return matrix
