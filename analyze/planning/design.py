"""Which strikes tell most about c: the predicted covariance, and the choice of axes and repeats (METHOD 1.6)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from analyze.planning.pivots import PivotAxis, Swing
from analyze.types import Array

WEAK_PRIOR = 0.1
"""m, 1 sigma of c before any strike"""
SINGULAR = 0.05
"""least singular value of the unit normals over the square root of their number, below which a set is refused"""
MOST_CANDIDATES = 18
GOOD_ENOUGH = 0.10
"""a more varied set may have a predicted sd larger by this part, per variety"""
MOMENT_WORTH = 0.40
"""the same for each further direction of axes: without tips about all three, a moment stays unmeasured, and with it what is shell and
what is inside"""

PARALLEL = 0.95
"""cosine above which two axes measure the same moment"""


@dataclass(frozen=True)
class Errors:
    """1 sigma of what spoils an equi-plane."""

    phi: float = np.radians(0.1)
    """rad, of one strike's angle"""
    tilt: float = np.radians(0.2)
    """rad, of gravity; all strikes share it"""
    edge_radius: float = 0.0
    """m; all strikes share it"""


@dataclass(frozen=True)
class Candidate:
    """An axis that can be used."""

    axis: PivotAxis
    expected: Swing


@dataclass(frozen=True)
class Design:
    """Chosen candidates, how often each is struck, and what that tells."""

    chosen: tuple[int, ...]
    """indices into the candidates"""
    repeats: tuple[int, ...]
    covariance: Array
    """(3, 3) m^2, of c"""


def predicted_covariance(candidates: Sequence[Candidate], repeats: Sequence[int], errors: Errors) -> Array:
    """Covariance (3, 3) [m^2] of c from `repeats` strikes on each candidate.

    Unknown beside c: gravity's tilt and the edges' radius (shared by all), the line's place (shared by repeats). One strike's row is
    n.dc + R*tilt + (cos phi - sin phi)*d_rho + dp = 0 with sd R*sigma_phi.
    """
    count = len(candidates)
    rows = np.zeros((count, 5 + count))
    weights = np.zeros(count)
    for i, (candidate, many) in enumerate(zip(candidates, repeats, strict=True)):
        phi, distance = candidate.expected.phi, candidate.expected.distance
        rows[i, :3] = normal(candidate)
        rows[i, 3] = distance * errors.tilt
        rows[i, 4] = (np.cos(phi) - np.sin(phi)) * errors.edge_radius
        rows[i, 5 + i] = candidate.axis.sd
        weights[i] = many / (distance * errors.phi) ** 2
    information = rows.T @ (rows * weights[:, None]) + np.diag(np.concatenate([np.full(3, WEAK_PRIOR**-2), np.ones(2 + count)]))
    return np.asarray(np.linalg.inv(information)[:3, :3], dtype=np.float64)


def normal(candidate: Candidate) -> Array:
    """Unit normal (3,) of the expected equi-plane, in O: the tip direction turned by phi."""
    phi = candidate.expected.phi
    return np.cos(phi) * candidate.axis.tip + np.sin(phi) * candidate.axis.plane.up


def spread(normals: Array) -> float:
    """Least singular value of unit normals (n, 3) over the square root of n: 0 where they leave a direction of c unknown."""
    if len(normals) < 3:
        return 0.0
    least = float(np.linalg.eigvalsh(normals.T @ normals)[0])
    return float(np.sqrt(max(least, 0.0) / len(normals)))


def unknown_direction(candidates: Sequence[Candidate]) -> Array:
    """Unit vector (3,) in O along which the candidates know c worst."""
    _, _, vt = np.linalg.svd(np.vstack([np.zeros((3, 3)), *(normal(candidate) for candidate in candidates)]))
    worst = vt[2]
    worst = worst * np.sign(worst[int(np.argmax(np.abs(worst)))])
    return np.where(np.abs(worst) < 1e-6, 0.0, worst)


def choose(candidates: Sequence[Candidate], strikes: int, errors: Errors) -> Design | None:
    """Set of axes with the least trace of c's covariance, varied sets preferred where they cost little; None: no set of rank 3.

    From 3 axes up to as many as get about two strikes each. Varied: directions that are not parallel, both ends of one line of
    resting planes, opposite edges of one plane (tilt cancels between them).
    """
    pool = _most_telling(candidates, errors)
    most = max(3, (strikes + 1) // 2)
    normals = np.array([normal(candidate) for candidate in candidates])
    best: tuple[float, Design] | None = None
    for size in range(3, min(most, 5, len(pool)) + 1):
        for subset in combinations(pool, size):
            members = [candidates[i] for i in subset]
            if spread(normals[list(subset)]) < SINGULAR:
                continue
            repeats = _repeats(members, strikes)
            covariance = predicted_covariance(members, repeats, errors)
            score = float(np.sqrt(np.trace(covariance))) * (1 - GOOD_ENOUGH) ** _variety(members)
            score *= (1 - MOMENT_WORTH) ** _directions(members)
            if best is None or score < best[0] * (1 - 1e-9):
                best = (score, Design(subset, repeats, covariance))
    return None if best is None else best[1]


def _repeats(members: Sequence[Candidate], strikes: int) -> tuple[int, ...]:
    """Strikes shared out evenly; what is left over goes to directions that few axes share, then to the largest R (it says least)."""
    each, left = divmod(strikes, len(members))
    directions = np.array([member.axis.direction for member in members])
    parallel = np.count_nonzero(np.abs(directions @ directions.T) > PARALLEL, axis=1)
    order = sorted(range(len(members)), key=lambda i: (int(parallel[i]), -members[i].expected.distance, i))
    extra = set(order[:left])
    return tuple(each + (i in extra) for i in range(len(members)))


def _directions(members: Sequence[Candidate]) -> int:
    return int(np.linalg.matrix_rank(np.array([member.axis.direction for member in members]), tol=0.3))


def _variety(members: Sequence[Candidate]) -> int:
    ups = np.array([member.axis.plane.up for member in members])
    tips = np.array([member.axis.tip for member in members])
    both_ends = bool(np.any(ups @ ups.T < -0.99))
    opposite_edges = bool(np.any((tips @ tips.T < -0.99) & (ups @ ups.T > 0.99)))
    return both_ends + opposite_edges


def _most_telling(candidates: Sequence[Candidate], errors: Errors) -> list[int]:
    """Up to `MOST_CANDIDATES` indices: one by one the candidate that lessens the trace most."""
    pool = list(range(len(candidates)))
    if len(pool) <= MOST_CANDIDATES:
        return pool
    taken: list[int] = []
    while len(taken) < MOST_CANDIDATES:
        rest = [i for i in pool if i not in taken]
        traces = [float(np.trace(predicted_covariance([candidates[j] for j in [*taken, i]], [1] * (len(taken) + 1), errors))) for i in rest]
        taken.append(rest[int(np.argmin(traces))])
    return sorted(taken)
