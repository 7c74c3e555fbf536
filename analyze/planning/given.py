"""What strikes that were made already say: the posterior that the next plan starts from."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from analyze.errors import PlanError
from analyze.geometry.edge_line import EdgeLine
from analyze.planning.hypothesis import Hypothesis, Region
from analyze.planning.information import Belief, Candidate
from analyze.planning.pivots import PivotAxis, swing
from analyze.types import Array

SAME_AXIS = np.cos(np.radians(3.0))
SHARES = tuple(np.linspace(1.0, 0.0, 21).tolist())
"""tried of two results"""
LEAST_HALF = 5e-4
"""m, half edge below which Q does not shrink: the edges themselves are known no better"""


@dataclass(frozen=True)
class StrikeMade:
    """One strike that was used."""

    axis_id: str
    phi_sd: float
    """rad"""
    k_sd: float | None
    """relative"""
    heading: float = 0.0
    """rad, of object and striker on the table"""


@dataclass(frozen=True)
class Given:
    """A result so far, in O."""

    name: str
    """the file's, for messages"""
    com: Array
    """(3,) m"""
    com_covariance: Array
    """(3, 3) m^2; unobserved directions carry the prior's"""
    unit_inertia: Array | None
    """(3, 3) m^2 about c, per kilogram"""
    strikes: tuple[StrikeMade, ...]
    directions: Mapping[str, Array] = field(default_factory=dict[str, Array])
    """(3,) unit, of the struck axes by id: that the ids mean the same edges still"""
    edges: Mapping[str, EdgeLine] = field(default_factory=dict[str, EdgeLine])
    """of the struck axes by id, where the plans are at hand: they tell better than ids"""


def together(results: Sequence[Given]) -> Given:
    """Results of different strikes as one, whatever their order.

    They share errors (the edges, the table), and do not say how much: their c are joined by covariance intersection, which never makes c
    surer than it is (Julier and Uhlmann 1997). Recordings that are estimated together know c better.
    """
    ordered = sorted(results, key=lambda each: (float(np.trace(each.com_covariance)), each.name))
    first = ordered[0]
    com, covariance = first.com, first.com_covariance
    for other in ordered[1:]:
        com, covariance = _intersection(com, covariance, other.com, other.com_covariance)
    most = max(ordered, key=lambda each: len(each.strikes))
    strikes = tuple(strike for each in ordered for strike in each.strikes)
    directions = {name: direction for each in reversed(ordered) for name, direction in each.directions.items()}
    edges = {name: edge for each in reversed(ordered) for name, edge in each.edges.items()}
    return Given(", ".join(each.name for each in ordered), com, covariance, most.unit_inertia, strikes, directions, edges)


def _intersection(a: Array, A: Array, b: Array, B: Array) -> tuple[Array, Array]:
    """Means (3,) and covariances (3, 3) joined whatever their correlation, with the share of each that gives the least trace."""
    of_a, of_b = np.linalg.inv(A), np.linalg.inv(B)
    joined: list[Array] = [np.asarray(np.linalg.inv(share * of_a + (1 - share) * of_b), dtype=np.float64) for share in SHARES]
    best = int(np.argmin([np.trace(each) for each in joined]))
    share, covariance = SHARES[best], joined[best]
    return covariance @ (share * of_a @ a + (1 - share) * of_b @ b), covariance


def believed_after(believed: Hypothesis, given: Given) -> Hypothesis:
    """Q around the measured c, half edges two standard deviations, where that is smaller than before."""
    values, vectors = np.linalg.eigh(given.com_covariance)
    half = np.maximum(2 * np.sqrt(np.maximum(values, 0.0)), LEAST_HALF)
    half = np.minimum(half, max(float(believed.region.half.max()), LEAST_HALF))
    region = Region(given.com, vectors.T, half)
    return Hypothesis(region, believed.unit_inertia if given.unit_inertia is None else given.unit_inertia)


def with_strikes(belief: Belief, given: Given, axes: Sequence[PivotAxis], believed: Hypothesis, mass: float, gravity: float) -> Belief:
    """The belief, and in it the information of the strikes made.

    Raises:
        PlanError: a strike's axis is not one of the object's.
    """
    known = {axis.id: axis for axis in axes}
    made: dict[str, dict[float, Array]] = {}
    for strike in given.strikes:
        axis = _meant(strike.axis_id, given, known)
        if axis is None:
            raise PlanError(
                f"{given.name}: strike on axis {strike.axis_id!r}, which this object does not have: plan from the first strike anew"
            )
        weight = np.diag([strike.phi_sd**-2, 0.0 if strike.k_sd is None else strike.k_sd**-2])
        so_far = made.setdefault(axis.id, {})
        so_far[strike.heading] = so_far.get(strike.heading, np.zeros((2, 2))) + weight
    struck = tuple(
        Candidate(known[name], swing(known[name], believed.region.centre, mass, believed.unit_inertia, gravity), np.eye(2)) for name in made
    )
    return Belief(belief.com_sd, belief.inertia, belief.inertia_sd, made, struck)


def _meant(name: str, given: Given, known: Mapping[str, PivotAxis]) -> PivotAxis | None:
    """The axis that a result calls `name`: by where its edge runs, else by id and direction; None: the object has no such axis."""
    axis, told, edge = known.get(name), given.directions.get(name), given.edges.get(name)
    if edge is not None:
        near = [(edge.distance(_line(each)), each.id != name, each.id) for each in known.values() if edge.is_same(_line(each))]
        if near:
            return known[min(near)[2]]
    if axis is None or (told is not None and float(told @ axis.direction) < SAME_AXIS):
        return None
    return axis


def _line(axis: PivotAxis) -> EdgeLine:
    return EdgeLine(axis.direction, axis.plane.up, axis.point, axis.radius)
