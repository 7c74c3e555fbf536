"""Walk of the centre of mass c along directions that the strikes leave open, all else being solved again.

The walk along one coordinate of c is that of the profile likelihood (Venzon and Moolgavkar 1988): all other
unknowns follow it. Two directions give a grid, whose second coordinate is walked from every point of the
first.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from analyze.estimation.joint_model import COM
from analyze.types import Array

MAX_DROP = 5.0
"""Decrease of the log density from its largest value at which the walk ends (3.2 sd of a normal)."""
MAX_CHANGE = 1.6
"""Largest change of the log density from one point to the next; a longer step is shortened."""


@dataclass(frozen=True)
class ProfilePoint:
    """Least-squares solution of all strikes, with the centre of mass c held at given coordinates.

    It is held along one or two directions.
    """

    x: Array
    """(count,) unknowns."""
    covariance: Array
    """(count, count) covariance of the unknowns given the held coordinates of c."""
    log_density: float
    """Logarithm of the density of the held coordinates, up to a constant."""
    slopes: Array
    """(n, count) change of the unknowns per metre of the held coordinates."""


class HeldProblem(Protocol):
    """Least-squares problem that can be solved with the centre of mass c held at given coordinates."""

    def inside(self, x: Array) -> bool:
        """True if c, of the unknowns `x` (count,), is where it may be."""
        ...

    def solved(self, x: Array, directions: Array, values: Array) -> ProfilePoint:
        """Most likely solution with c held at the coordinates `values` along `directions`.

        Args:
            x: (count,) unknowns to start from.
            directions: (n, 3) orthonormal directions, in the object frame O.
            values: (n,) coordinates of c along them [m].
        """
        ...


def walk(
    problem: HeldProblem, directions: Array, sds: Array, x: Array, most: int
) -> list[tuple[ProfilePoint, Array]]:
    """Solutions with c held at points along one or two directions, each with the lengths it stands for.

    c is the centre of mass; the lengths (n,) [m] are those of the part of each direction between neighbouring
    points. With two directions c is first held along the first alone. Held along both it would fall off a
    ridge of the density that runs askew to them, and the walk would end far inside the distribution.

    Args:
        problem: Problem of all strikes.
        directions: (n, 3) one or two orthonormal directions, in the object frame O.
        sds: (n,) sd of c along them by linear propagation [m].
        x: (count,) unknowns to start from, near the most likely ones.
        most: Largest number of points on either side.
    """
    first = directions[:1]
    start = problem.solved(x, first, first @ x[COM])
    line = _line(problem, first, 0, float(sds[0]), start, most)
    if len(directions) == 1:
        return [(point, np.array([part])) for point, part in line]
    found: list[tuple[ProfilePoint, Array]] = []
    for alone, part in line:
        sd = float(np.sqrt(directions[1] @ alone.covariance[COM, COM] @ directions[1]))
        both = problem.solved(alone.x, directions, directions @ alone.x[COM])
        across = _line(problem, directions, 1, sd, both, most)
        found += [(point, np.array([part, other])) for point, other in across]
    return found


def _line(
    problem: HeldProblem, directions: Array, moving: int, sd: float, start: ProfilePoint, most: int
) -> list[tuple[ProfilePoint, float]]:
    """Solutions with c held at points along one direction, each with the length [m] that it stands for.

    The direction is row `moving` of `directions` (n, 3), in the object frame O; along another one, c stays
    where it is at `start`. The first step is a third of `sd` [m]. Steps grow where the log density is flat
    and shrink where it falls fast. On either side at most `most` steps are tried, until the log density has
    fallen by `MAX_DROP`. A step by which c would leave the box that its prior is made from is shortened.
    """
    held = directions @ start.x[COM]
    at, points = [float(held[moving])], [start]
    for sign in (-1.0, 1.0):
        step, place, point = sd / 3, float(held[moving]), start
        best = max(each.log_density for each in points)
        for _ in range(most):
            values = held.copy()
            values[moving] = place + sign * step
            there = problem.solved(point.x + sign * step * point.slopes[moving], directions, values)
            change = abs(there.log_density - point.log_density)
            if change > MAX_CHANGE or not problem.inside(there.x):
                step *= 0.4
                continue
            place = float(values[moving])
            step *= 1.5 if change < MAX_CHANGE / 4 else 1.0
            at.append(place)
            points.append(there)
            point, best = there, max(best, there.log_density)
            if there.log_density < best - MAX_DROP:
                break
    order = np.argsort(at)
    places = np.array(at)[order]
    edges = np.concatenate([places[:1], (places[1:] + places[:-1]) / 2, places[-1:]])
    parts = np.diff(edges) if len(places) > 1 else np.array([sd])
    return [(points[i], float(part)) for i, part in zip(order.tolist(), parts.tolist(), strict=True)]
