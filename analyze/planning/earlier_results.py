"""Results of strikes already made, with which the next plan starts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from analyze.errors import PlanError
from analyze.geometry.edge_line import SAME_LINE, EdgeLine
from analyze.planning.hypothesis import Hypothesis, Region
from analyze.planning.information import Belief, Candidate
from analyze.planning.pivots import PivotAxis, swing
from analyze.types import Array

SAME_AXIS_COSINE = np.cos(np.radians(3.0))
"""Cosine above which two directions are the same axis."""
INTERSECTION_WEIGHTS = tuple(np.linspace(1.0, 0.0, 21).tolist())
"""Weights of the first of two results that are tried in covariance intersection."""
MIN_HALF_EDGE = 5e-4
"""Smallest half edge [m] of the region of the centre of mass: the edges' places are not known better."""


@dataclass(frozen=True)
class StrikeMade:
    """Strike used in an earlier result: its axis, and 1 sigma of what was measured from its tip.

    Measured are the balance angle phi [rad] and the rate constant k [rad/s^2]: the tip is
    theta'' = -k sin(phi - theta), with theta the tipping angle.
    """

    axis_id: str
    """Id of the pivot axis in the plan."""
    phi_sd: float
    """1 sigma of phi [rad]."""
    k_sd: float | None
    """Relative 1 sigma of k; None if k was not used."""
    heading: float = 0.0
    """Heading of object and striker on the table [rad]."""


@dataclass(frozen=True)
class EarlierResult:
    """Result of an earlier estimate of the object, from which a plan starts, in the object frame.

    It has the centre of mass c (3,) [m] with covariance, the inertia (3, 3) about c per kilogram [m^2], the
    strikes that were made, and direction and edge of each struck axis.
    """

    name: str
    """Name of the result's file, for messages."""
    com: Array
    """(3,) centre of mass [m]."""
    com_covariance: Array
    """(3, 3) covariance of c [m^2]; unobserved directions have the prior's variance."""
    unit_inertia: Array | None
    """(3, 3) inertia about c per kilogram [m^2]; None if not estimated."""
    strikes: tuple[StrikeMade, ...]
    """Strikes that the result was estimated from."""
    directions: Mapping[str, Array] = field(default_factory=dict[str, Array])
    """Unit direction (3,) of each struck axis by its id, to check that the ids still name the same edges."""
    edges: Mapping[str, EdgeLine] = field(default_factory=dict[str, EdgeLine])
    """Edge of each struck axis by id, where the plans are available; identifies axes better than ids."""


def merge_results(results: Sequence[EarlierResult]) -> EarlierResult:
    """Merge results of different strikes of one object into one result.

    The order of the results does not matter. They share errors (the edges, the table) to an unknown degree:
    their centres of mass are merged by covariance intersection, which never understates the covariance
    (Julier and Uhlmann 1997). Estimating all recordings together would be more precise. The inertia is that
    of the result with the most strikes. Where several results name an axis, direction and edge are those of
    the one with the most precise centre of mass.

    Args:
        results: At least one result.

    Returns:
        The merged result, with the strikes of all.
    """
    ordered = sorted(results, key=lambda each: (float(np.trace(each.com_covariance)), each.name))
    first = ordered[0]
    com, covariance = first.com, first.com_covariance
    for other in ordered[1:]:
        com, covariance = _intersection(com, covariance, other.com, other.com_covariance)
    most = max(ordered, key=lambda each: len(each.strikes))
    strikes = tuple(strike for each in ordered for strike in each.strikes)
    directions = {
        name: direction for each in reversed(ordered) for name, direction in each.directions.items()
    }
    edges = {name: edge for each in reversed(ordered) for name, edge in each.edges.items()}
    return EarlierResult(
        ", ".join(each.name for each in ordered),
        com,
        covariance,
        most.unit_inertia,
        strikes,
        directions,
        edges,
    )


def _intersection(a: Array, A: Array, b: Array, B: Array) -> tuple[Array, Array]:
    """Covariance intersection (cautious average) of two estimates of one vector.

    The inverse covariances are averaged with the weights, of those tried, that give the smallest trace.

    Args:
        a: (3,) mean of the first estimate.
        A: (3, 3) covariance of the first.
        b: (3,) mean of the second.
        B: (3, 3) covariance of the second.

    Returns:
        Mean (3,) and covariance (3, 3), valid for any correlation of the two estimates.
    """
    of_a, of_b = np.linalg.inv(A), np.linalg.inv(B)
    merged: list[Array] = [np.linalg.inv(share * of_a + (1 - share) * of_b) for share in INTERSECTION_WEIGHTS]
    best = int(np.argmin([np.trace(each) for each in merged]))
    share, covariance = INTERSECTION_WEIGHTS[best], merged[best]
    return covariance @ (share * of_a @ a + (1 - share) * of_b @ b), covariance


def updated_hypothesis(believed: Hypothesis, given: EarlierResult) -> Hypothesis:
    """Hypothesis with the region of the centre of mass centred on the measured one.

    A hypothesis is the region believed to hold the centre of mass, with the inertia per kilogram. The new
    region is a box along the principal axes of the measured covariance. Its half edges are two standard
    deviations, at least `MIN_HALF_EDGE` and otherwise at most the largest half edge of `believed`. The
    inertia is the result's, or that of `believed` if the result has none.

    Args:
        believed: Hypothesis before.
        given: Earlier result of the object.
    """
    values, vectors = np.linalg.eigh(given.com_covariance)
    half = np.maximum(2 * np.sqrt(np.maximum(values, 0.0)), MIN_HALF_EDGE)
    half = np.minimum(half, max(float(believed.region.half.max()), MIN_HALF_EDGE))
    region = Region(given.com, vectors.T, half)
    return Hypothesis(region, believed.unit_inertia if given.unit_inertia is None else given.unit_inertia)


def with_strikes_made(
    belief: Belief,
    given: EarlierResult,
    axes: Sequence[PivotAxis],
    believed: Hypothesis,
    mass: float,
    gravity: float,
) -> Belief:
    """Belief about centre of mass and inertia, with the information of the strikes made added.

    The belief is the prior of centre of mass and inertia. A heading is the turn of object and striker about
    the vertical.

    Args:
        belief: Belief before any strike.
        given: Result of the strikes made.
        axes: All pivot axes of the object.
        believed: Region of the centre of mass and inertia per kilogram, for the expected swings.
        mass: Mass of the object [kg].
        gravity: Gravity [m/s^2].

    Returns:
        A new belief that also holds, by axis and heading, the inverse covariance (2, 2) of balance angle and
        ln k (k [rad/s^2] the rate constant m g R / I_edge of the tip), summed over the strikes made.

    Raises:
        PlanError: a strike's axis is not one of the object's.
    """
    known = {axis.id: axis for axis in axes}
    made: dict[str, dict[float, Array]] = {}
    for strike in given.strikes:
        axis = _identified_axis(strike.axis_id, given, known)
        if axis is None:
            raise PlanError(
                f"{given.name}: strike on axis {strike.axis_id!r}, which this object does not have: check "
                "that it belongs to this object, or plan from the first strike anew"
            )
        weight = np.diag([strike.phi_sd**-2, 0.0 if strike.k_sd is None else strike.k_sd**-2])
        so_far = made.setdefault(axis.id, {})
        so_far[strike.heading] = so_far.get(strike.heading, np.zeros((2, 2))) + weight
    struck = tuple(
        Candidate(
            known[name],
            swing(known[name], believed.region.centre, mass, believed.unit_inertia, gravity),
            np.eye(2),
        )
        for name in made
    )
    return Belief(belief.com_sd, belief.inertia, belief.inertia_sd, made, struck)


def _identified_axis(name: str, given: EarlierResult, known: Mapping[str, PivotAxis]) -> PivotAxis | None:
    """Axis of the object that a result calls `name`; None if the object has none.

    The axis is the one nearest to the line of the result's edge. If the result has no line, or no axis is
    near it, the axis with the id `name` is taken, unless the result has a direction and it differs.

    Args:
        name: Id of the axis in the result.
        given: Earlier result.
        known: Axes of the object by id.
    """
    axis, direction, edge = known.get(name), given.directions.get(name), given.edges.get(name)
    if edge is not None:
        near = [(edge.distance(_line(each)), each.id != name, each.id) for each in known.values()]
        if near and min(near)[0] < SAME_LINE:
            return known[min(near)[2]]
    if axis is None or (direction is not None and float(direction @ axis.direction) < SAME_AXIS_COSINE):
        return None
    return axis


def _line(axis: PivotAxis) -> EdgeLine:
    return EdgeLine(axis.direction, axis.plane.up, axis.point, axis.radius)
