"""The body's second moments as a matrix that any six numbers make possible: the inertia part of a log-Cholesky pseudo-inertia.

Rucker and Wensing 2022 ("Smooth parameterization of rigid-body inertia"): the 4 x 4 pseudo-inertia is A A^T with A upper triangular and
exponentials on its diagonal. Its last column is then c itself and its scale the mass, so that what remains are six numbers of the second
moments about c per kilogram, S = U U^T. Every such S belongs to a body: moments positive, triangle inequality strict.
"""

from __future__ import annotations

import numpy as np

from analyze.types import Array

ENTRIES = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
"""of a symmetric matrix, in the order of all vectors of six; of U too"""
SMALLEST_EIGENVALUE = 1e-3
"""of the second-moment matrix, relative to its trace: keeps the tensor that of a body"""


def unit_inertia(numbers: Array) -> tuple[Array, Array]:
    """Inertia about c per kilogram (3, 3) [m^2], and its derivatives (6, 3, 3).

    Args:
        numbers: (6,) logarithms of U's diagonal [m], then U's 12, 13, 23 [m].
    """
    U = np.zeros((3, 3))
    for (i, j), number in zip(ENTRIES, numbers.tolist(), strict=True):
        U[i, j] = np.exp(number) if i == j else number
    S = U @ U.T
    by = np.zeros((6, 3, 3))
    for n, (i, j) in enumerate(ENTRIES):
        size = U[i, i] if i == j else 1.0
        by[n, i, :] += size * U[:, j]
        by[n, :, i] += size * U[:, j]
    by = np.trace(by, axis1=1, axis2=2)[:, None, None] * np.eye(3) - by
    return np.trace(S) * np.eye(3) - S, by


def numbers_of(inertia: Array) -> Array:
    """The six numbers of an inertia (3, 3) [m^2]; of the nearest possible one."""
    inertia = possible(inertia)
    S = np.trace(inertia) / 2 * np.eye(3) - inertia
    U = np.asarray(np.linalg.cholesky(S[::-1, ::-1]), dtype=np.float64)[::-1, ::-1]
    return np.array([np.log(U[i, j]) if i == j else U[i, j] for i, j in ENTRIES])


def possible(inertia: Array) -> Array:
    """Nearest tensor (3, 3) that a body can have: its second-moment matrix tr(I)/2 - I positive definite, hence the triangle inequality."""
    second = np.trace(inertia) / 2 * np.eye(3) - inertia
    values, vectors = np.linalg.eigh(second)
    least = SMALLEST_EIGENVALUE * max(float(np.trace(second)), 1e-15)
    if values.min() >= least:
        return inertia
    second = vectors @ np.diag(np.maximum(values, least)) @ vectors.T
    return np.trace(second) * np.eye(3) - second


def six(matrix: Array) -> Array:
    """(..., 6) of symmetric matrices (..., 3, 3)."""
    return np.stack([matrix[..., i, j] for i, j in ENTRIES], axis=-1)


def symmetric(entries: Array) -> Array:
    """(3, 3) of (6,)."""
    matrix = np.zeros((3, 3))
    for (i, j), value in zip(ENTRIES, entries.tolist(), strict=True):
        matrix[i, j] = matrix[j, i] = value
    return matrix
