"""Edge radii from all strikes: estimates, and a check of stated radii by the strikes alone.

The balance angle phi of a tip changes with the edge's radius in proportion to cos phi - sin phi. Tips of
unlike phi, or over opposite edges, therefore determine the radius, without any statement of the user.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from analyze.estimation.agreement import agreement
from analyze.estimation.centre_of_mass import centre_of_mass
from analyze.estimation.joint import JointSolution, solve_joint
from analyze.estimation.joint_model import OWN_RADIUS, RADIUS, centre_line_shift, radius_sds
from analyze.estimation.priors import ComPrior, SystematicErrors
from analyze.geometry.edge_radius import ASSUMED
from analyze.types import Array, EdgeRadius, EquiPlane, RadiusPrior, RadiusSource

REFUTED_SDS = 3.0
"""Difference between stated and measured radius of all edges, in its 1 sigma, above which the statement is
refuted."""
REFUTED_EDGE_SDS = 3.5
"""The same for one edge alone; higher, as an object has several edges."""
STATED = (RadiusSource.STATED, RadiusSource.EDGE)
"""Origins of a radius that the user stated."""


@dataclass(frozen=True)
class RadiusCheck:
    """Comparison of stated edge radii with those that the strikes show where nothing is stated."""

    stated: float
    """Mean of the stated radii of the edges compared [m]."""
    stated_sd: float
    """1 sigma of it [m]."""
    measured: float
    """Mean radius of the same edges by the strikes, with the prior of radii that are not given [m]."""
    measured_sd: float
    """1 sigma of it [m]."""
    difference_sds: float
    """Difference of the strikes' own radius, without any prior, from the stated one, over its 1 sigma."""
    axis_ids: tuple[str, ...]
    """Pivot axes that are refuted; all that are stated if the mean of all is, otherwise single ones."""

    @property
    def refuted(self) -> bool:
        """True if the strikes contradict the stated radius of any edge."""
        return bool(self.axis_ids)


def estimated_radii(solution: JointSolution) -> tuple[EdgeRadius, ...]:
    """Radius [m] with sd of every pivot edge that is rounded, from the solution of the joint problem.

    Flanks whose radius is that of the shape's section are left out. The order is that of the axes' first
    strikes.
    """
    axes = _rounded_axes(solution)
    values, covariance = _radii(solution, axes)
    return tuple(
        EdgeRadius(plane.axis_id, float(value), float(sd), prior_of(plane, solution))
        for plane, value, sd in zip(axes, values, np.sqrt(np.diag(covariance)), strict=True)
    )


def prior_of(plane: EquiPlane, solution: JointSolution) -> RadiusPrior:
    """Prior of the radius of a plane's edge: its own, or else that of the errors that all edges share."""
    if plane.radius_prior is not None:
        return plane.radius_prior
    common, own = radius_sds(plane, solution.model.systematic)
    return RadiusPrior(plane.edge_radius, common, own, RadiusSource.STATED)


def with_radius_not_given(
    planes: Sequence[EquiPlane], axis_ids: Sequence[str] | None = None
) -> tuple[EquiPlane, ...]:
    """Equi-planes as they are if the radius of their edges was not stated: line moved, prior wide.

    A plane passes through its pivot's centre line, which moves with the expected radius. Edges whose radius
    was seen on a scan, or is part of the shape, keep theirs.

    Args:
        planes: Equi-planes of the strikes.
        axis_ids: Pivot axes whose radius is taken as not given; None for all with a stated radius.
    """
    return tuple(
        _with_assumed(plane)
        if _is_stated(plane) and (axis_ids is None or plane.axis_id in axis_ids)
        else plane
        for plane in planes
    )


def without_refuted_radii(
    planes: Sequence[EquiPlane],
    recorded_in: Sequence[int],
    systematic: SystematicErrors,
    prior: ComPrior,
) -> tuple[tuple[EquiPlane, ...], RadiusCheck | None]:
    """Equi-planes in which a radius that the strikes contradict counts as not given, and the comparison.

    The second is None if no edge's radius is stated. A centre of mass that moved between two recordings can
    look like a wrong radius. The statement stands if a centre of mass of its own for each recording explains
    the strikes better than another radius does (Akaike 1974).

    Args:
        planes: Equi-planes of the strikes, with the stated radii.
        recorded_in: (strikes,) number of each strike's recording.
        systematic: Standard deviations of errors that strikes share.
        prior: Prior of the centre of mass.
    """
    check = check_stated_radii(planes, systematic, prior)
    if check is None or not check.refuted:
        return tuple(planes), check
    others = len(set(recorded_in)) - 1
    if others:
        com = centre_of_mass(planes, systematic, prior)
        moved = agreement(planes, recorded_in, com, systematic, prior)
        by_moving = moved.chi_squared - 2 * len(com.position) * others
        if not moved.holds and by_moving > check.difference_sds**2 - 2:
            return tuple(planes), replace(check, axis_ids=())
    return with_radius_not_given(planes, check.axis_ids), check


def check_stated_radii(
    planes: Sequence[EquiPlane], systematic: SystematicErrors, prior: ComPrior
) -> RadiusCheck | None:
    """Compare the stated radii of the edges with the strikes' own; None if no edge's radius is stated.

    The joint problem is solved with the prior of radii that are not given. What this prior contributed is
    then taken off again (information form), so that only the strikes' own information is compared: where
    they determine nothing, nothing can be refuted. The score of the statement is tested for the mean of all
    stated edges, then for each edge. Only the balance angles phi are used: the rate constants k add little,
    and a wrong frame rate would look like a wrong radius. Where faces may lie off their place, the comparison
    is made twice, with that error shared by all edges of a side face and with each edge's own; the weaker
    contradiction counts, since scans of real faces lie between the two.

    Args:
        planes: Equi-planes of the strikes, with the stated radii.
        systematic: Standard deviations of errors that strikes share.
        prior: Prior of the centre of mass.
    """
    stated = {plane.axis_id: plane for plane in planes if _is_stated(plane)}
    if not stated:
        return None
    checks = [_compared(planes, stated, systematic, prior)]
    if checks[0].refuted and systematic.face_sd > 0:
        apart = [replace(plane, wall="") for plane in planes]
        checks.append(_compared(apart, stated, systematic, prior))
    return min(checks, key=lambda check: (check.refuted, abs(check.difference_sds)))


def _compared(
    planes: Sequence[EquiPlane],
    stated: Mapping[str, EquiPlane],
    systematic: SystematicErrors,
    prior: ComPrior,
) -> RadiusCheck:
    """Compare stated radii with the strikes' own, by one model of the faces' errors.

    Args:
        planes: Equi-planes of the strikes, with the stated radii.
        stated: One plane for each pivot axis whose edge has a stated radius, by the axis's id.
        systematic: Standard deviations of errors that strikes share.
        prior: Prior of the centre of mass.
    """
    solution = solve_joint(with_radius_not_given(planes), systematic, prior)
    axes = [plane for plane in _rounded_axes(solution) if plane.axis_id in stated]
    values, covariance = _radii(solution, axes)
    ours = [stated[plane.axis_id] for plane in axes]
    common, own = np.array([radius_sds(plane, systematic) for plane in ours]).T
    believed = np.array([plane.edge_radius for plane in ours])
    stated_covariance = np.outer(common, common) + np.diag(own**2)
    wide = ASSUMED.common_sd**2 + np.diag(np.full(len(axes), ASSUMED.own_sd**2))
    inverse, inverse_wide = np.linalg.inv(covariance), np.linalg.inv(wide)
    information = inverse - inverse_wide
    information = (information + information.T) / 2
    score = inverse @ values - inverse_wide @ np.full(len(axes), ASSUMED.mean) - information @ believed
    variance = information + information @ stated_covariance @ information
    mean = np.ones(len(axes))
    together = _standardised(mean, score, variance)
    single = [_standardised(row, score, variance) for row in np.eye(len(axes))]
    names = [plane.axis_id for plane in axes]
    refuted = [name for name, each in zip(names, single, strict=True) if abs(each) > REFUTED_EDGE_SDS]
    compared = np.ones(len(axes), dtype=bool)
    difference = together
    if abs(together) > REFUTED_SDS:
        refuted = names
    elif refuted:
        compared = np.array([name in refuted for name in names])
        difference = max(single, key=abs)
    share = compared / compared.sum()
    return RadiusCheck(
        float(share @ believed),
        float(np.sqrt(share @ stated_covariance @ share)),
        float(share @ values),
        float(np.sqrt(share @ covariance @ share)),
        float(difference),
        tuple(refuted),
    )


def _standardised(direction: Array, score: Array, variance: Array) -> float:
    """Score of a common change of the radii along a direction, over its 1 sigma; 0 without information.

    Args:
        direction: (n,) weights of the edges.
        score: (n,) derivative of the log likelihood by the radii at the stated ones [1/m].
        variance: (n, n) its covariance if the statement is true [1/m^2].
    """
    sd2 = float(direction @ variance @ direction)
    return float(direction @ score) / float(np.sqrt(sd2)) if sd2 > 0 else 0.0


def _is_stated(plane: EquiPlane) -> bool:
    """True if the user stated the radius of a plane's edge, for all edges or for this one."""
    if not plane.rounded:
        return False
    return plane.radius_prior is None or plane.radius_prior.source in STATED


def _with_assumed(plane: EquiPlane) -> EquiPlane:
    """Copy of an equi-plane whose edge has the radius that is assumed where none is given."""
    more = ASSUMED.mean - plane.edge_radius
    return replace(
        plane,
        point=plane.point + more * centre_line_shift(plane),
        edge_radius=ASSUMED.mean,
        radius_prior=ASSUMED,
    )


def _rounded_axes(solution: JointSolution) -> list[EquiPlane]:
    """One equi-plane, that of the first strike, for each pivot axis whose edge is rounded."""
    found: dict[str, EquiPlane] = {}
    for plane in solution.model.planes:
        if plane.rounded:
            found.setdefault(plane.axis_id, plane)
    return list(found.values())


def _radii(solution: JointSolution, axes: Sequence[EquiPlane]) -> tuple[Array, Array]:
    """Estimated radii (n,) [m] of the edges of n pivot axes, and their covariance (n, n) [m^2]."""
    model = solution.model
    rows = np.zeros((len(axes), model.count))
    for row, plane in zip(rows, axes, strict=True):
        row[RADIUS], row[model.axis_term(plane.axis_id, OWN_RADIUS)] = radius_sds(plane, model.systematic)
    values = np.array([plane.edge_radius for plane in axes]) + rows @ solution.x
    return values, rows @ solution.covariance @ rows.T
