"""Edge radii from all strikes: estimates, and a check of stated radii by the strikes alone.

The balance angle phi of a tip changes with the edge's radius in proportion to cos phi - sin phi. Tips of
unlike phi, or over opposite edges, therefore determine the radius, without any statement of the user.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from analyze.estimation.agreement import agreement
from analyze.estimation.centre_of_mass import centre_of_mass
from analyze.estimation.joint import JointSolution, solve_joint
from analyze.estimation.joint_model import JointModel, centre_line_shift, radius_sds
from analyze.estimation.priors import ComPrior, SystematicErrors
from analyze.estimation.radius_odds import ALIKE_SD, NOT_WRONG, WrongOdds, probability_wrong
from analyze.geometry.edge_radius import ASSUMED, FACE_OVER_OWN
from analyze.least_squares.intervals import normal_sd
from analyze.types import Array, EquiPlane, RadiusPrior, RadiusSource

REFUTED_SDS = 3.0
"""Difference between stated and measured radius of all edges, in its 1 sigma, above which the statement is
refuted."""
REFUTED_PART_SDS = 3.5
"""Difference between stated and measured radius of one face's edges, or of one edge, in its 1 sigma, above
which the statement is refuted; above `REFUTED_SDS`, as an object has several of them."""
CHECKED_FRACTION = 0.75
"""Uncertainty of the edges' mean radius by strikes and the prior of radii that are not given, over that by
the prior alone, up to which the strikes count as a check of what is stated."""
MIN_RADIUS_SD = 1e-6
"""Smallest sd of a radius [m] that is distinguished from 0."""
STATED = (RadiusSource.STATED, RadiusSource.EDGE)
"""Origins of a radius that the user stated."""


@dataclass(frozen=True)
class EdgeRadius:
    """Radius [m] of one pivot edge's rounding as all strikes together determine it, beside its prior."""

    axis_id: str
    """id of the pivot axis"""
    value: float
    """estimated radius [m]; may come out negative within its sd"""
    sd: float
    """standard deviation of `value` [m]"""
    prior: RadiusPrior
    """knowledge before the strikes"""


@dataclass(frozen=True)
class RadiusCheck:
    """Comparison of stated edge radii with the radii that the strikes show if nothing is stated."""

    stated: float
    """Mean of the stated radii of the edges compared [m]."""
    stated_sd: float
    """1 sigma of `stated` [m]."""
    measured: float
    """Mean radius [m] of the edges compared, by the strikes with the prior of radii that are not given."""
    measured_sd: float
    """1 sigma of `measured` [m]."""
    difference_sds: float
    """Difference of the strikes' own radius, without any prior, from the stated one, over its 1 sigma."""
    axis_ids: tuple[str, ...]
    """Pivot axes that are refuted; all that are stated if the mean of all is, otherwise single ones."""
    excess: float = 1.0
    """Factor on the sd of the statement by which it agrees with the strikes' own radius to 1 sigma."""
    wrong: WrongOdds = NOT_WRONG
    """Probabilities that the statement is wrong."""

    @property
    def refuted(self) -> bool:
        """True if the strikes contradict the stated radius of any edge."""
        return bool(self.axis_ids)


def estimated_radii(solution: JointSolution) -> tuple[EdgeRadius, ...]:
    """Radius [m] with sd of every pivot edge that is rounded, from the joint solution of all strikes.

    There is one per pivot axis, in the order of their first strikes, each with its prior. Flanks (curved
    sides that are part of the object's shape) are left out.
    """
    axes = _rounded_axes(solution)
    values, covariance = _radii(solution, axes)
    return tuple(
        EdgeRadius(plane.axis_id, float(value), float(sd), prior_of(plane, solution))
        for plane, value, sd in zip(axes, values, np.sqrt(np.diag(covariance)), strict=True)
    )


def strikes_determine_radius(solution: JointSolution) -> bool:
    """True if the strikes determine the mean radius of the edges whose radius was not given.

    They do if its sd, from `solution`, is below `CHECKED_FRACTION` of the sd assumed before any strike, or if
    there are no such edges. To learn whether the strikes check a stated radius, solve with it not given.
    """
    axes = [plane for plane in _rounded_axes(solution) if plane.radius_prior == ASSUMED]
    if not axes:
        return True
    prior_sd = np.sqrt(np.mean(_prior_covariance(solution.model, axes)))
    return bool(np.sqrt(np.mean(_radii(solution, axes)[1])) < CHECKED_FRACTION * prior_sd)


def prior_of(plane: EquiPlane, solution: JointSolution) -> RadiusPrior:
    """Prior, from before the strikes, of the radius of the edge that an equi-plane belongs to.

    It holds the mean, the sds of the errors that all edges and those of a face share, the sd of this edge's
    own deviation (all [m]), and where they come from. It is the plane's own prior; without one, the plane's
    radius with the sds that `solution` assumes for such edges.
    """
    if plane.radius_prior is not None:
        return plane.radius_prior
    common, of_face, own = radius_sds(plane, solution.model.systematic)
    return RadiusPrior(plane.edge_radius, common, own, RadiusSource.STATED, of_face)


def with_radius_not_given(
    planes: Sequence[EquiPlane], axis_ids: Sequence[str] | None = None
) -> tuple[EquiPlane, ...]:
    """Equi-planes (through pivot line and centre of mass) as if the radius of their edges were not stated.

    The radius and its large sd are then those assumed for any edge (`ASSUMED`). The centre line of the edge's
    rounding, through which the plane passes, moves with the radius. Edges whose radius was seen on a scan, or
    is part of the shape, keep theirs.

    Args:
        planes: Equi-planes of the strikes, in the object frame O.
        axis_ids: Pivot axes whose radius is taken as not given; None for all with a stated radius.

    Returns:
        All planes, in the same order.
    """
    return tuple(
        _with_assumed(plane)
        if _is_stated(plane) and (axis_ids is None or plane.axis_id in axis_ids)
        else plane
        for plane in planes
    )


def _with_doubt(
    planes: Sequence[EquiPlane], excess: float, wrong: WrongOdds, sources: Collection[RadiusSource] = STATED
) -> tuple[EquiPlane, ...]:
    """Strikes' planes in which stated edge radii have a larger sd, as the strikes make them unlikely.

    The sd grows by the factor `excess`, with which the mean radius by the strikes differs from the stated one
    by 1 sigma, as in averages of measurements that disagree (Birge 1932); not beyond the sd of a radius that
    is not given. It is at least that of a normal error with the 95 % interval of one that has the stated sd
    or, with the probabilities that the statement is wrong, that of a radius not given.

    Args:
        planes: Equi-planes of the strikes, in the object frame O.
        excess: Factor on the sd, at least 1.
        wrong: Probabilities that the statement is wrong.
        sources: Origins of the radii whose sd grows.
    """

    def larger(sd: float, added: float, limit: float, wrong: Mapping[float, float]) -> float:
        """Sd [m] of which `wrong` gives the probabilities of larger values [m], ascending."""
        sds = np.maximum([sd, *wrong], max(sd, MIN_RADIUS_SD))
        mixed = normal_sd(sds, np.array([1 - sum(wrong.values()), *wrong.values()]))
        return max(min(float(np.hypot(sd, added)), limit), mixed)

    def grown(prior: RadiusPrior) -> RadiusPrior:
        # A statement that is off does not say either that the edges are alike.
        more = np.sqrt(excess**2 - 1)
        own, face = more * prior.sd, FACE_OVER_OWN * more * prior.sd
        common = {ASSUMED.common_sd: wrong.any, ALIKE_SD: wrong.alike}
        return replace(
            prior,
            common_sd=larger(prior.common_sd, more * prior.common_sd, ASSUMED.common_sd, common),
            own_sd=larger(prior.own_sd, own, ASSUMED.own_sd, {ASSUMED.own_sd: wrong.any}),
            face_sd=larger(prior.face_sd, face, ASSUMED.face_sd, {ASSUMED.face_sd: wrong.any}),
        )

    return tuple(
        replace(plane, radius_prior=grown(plane.radius_prior))
        if plane.rounded and plane.radius_prior is not None and plane.radius_prior.source in sources
        else plane
        for plane in planes
    )


def without_refuted_radii(
    planes: Sequence[EquiPlane],
    recorded_in: Sequence[int],
    systematic: SystematicErrors,
    prior: ComPrior,
) -> tuple[tuple[EquiPlane, ...], RadiusCheck | None]:
    """Strikes' planes in which a stated edge radius that the strikes contradict counts as not given.

    If no radius is refuted, all are kept; their sd grows if they are off by more than 1 sigma, and with the
    probability that they are wrong. If one radius is stated for all edges and refuted for some, the others
    keep it with the sd of one that is not given. A centre of mass that moved between two recordings can look
    like a wrong radius: all stated radii are kept if a centre of mass of its own for each recording explains
    the strikes better than other radii do (Akaike 1974).

    Args:
        planes: Equi-planes (through pivot line and centre of mass) of the strikes, with the stated radii.
        recorded_in: (strikes,) number of each strike's recording.
        systematic: Standard deviations of errors that strikes share (table tilt, shape scale, edge radius).
        prior: Prior of the centre of mass.

    Returns:
        The planes, in the same order, and the comparison of stated radii with those by the strikes; None in
        its place if no edge's radius is stated.
    """
    check = check_stated_radii(planes, systematic, prior)
    if check is None:
        return tuple(planes), None
    if not check.refuted:
        return _with_doubt(planes, check.excess, check.wrong), check
    others = len(set(recorded_in)) - 1
    if others:
        com = centre_of_mass(planes, systematic, prior)
        moved = agreement(planes, recorded_in, com, systematic, prior)
        by_moving = moved.chi_squared - 2 * len(com.position) * others
        if not moved.holds and by_moving > check.difference_sds**2 - 2:
            return tuple(planes), replace(check, axis_ids=())
    # One radius for all edges that is wrong for some says little about the others.
    others_doubted = _with_doubt(planes, 1.0, WrongOdds(any=1.0), (RadiusSource.STATED,))
    return with_radius_not_given(others_doubted, check.axis_ids), check


def check_stated_radii(
    planes: Sequence[EquiPlane], systematic: SystematicErrors, prior: ComPrior
) -> RadiusCheck | None:
    """Compare the stated radii of the edges with the strikes' own; None if no edge's radius is stated.

    All strikes are solved together with the wide prior of radii that are not given. This prior's contribution
    is then subtracted again, as an inverse covariance, so that only what the strikes say is compared: where
    they determine nothing, nothing can be refuted. The derivative of the log likelihood at the stated radii
    (score) is tested for the mean of all stated edges, then for those of each face and for each edge. Only
    the balance angles phi are used: the rate constants k of the motion add little, and with a wrong frame
    rate they would look like a wrong radius. Where the object's faces may lie off their place, a
    contradiction is tested again: first that error is shared by all edges of a side face, then it is each
    edge's own. The weaker contradiction counts, since scans of real faces lie between the two.

    Args:
        planes: Equi-planes (through pivot line and centre of mass) of the strikes, with the stated radii.
        systematic: Standard deviations of errors that strikes share (table tilt, shape scale, face's place).
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
    """Compare stated edge radii with the strikes' own, for faces' errors as the planes describe them.

    An error of a side face's place is shared by the planes with the same `wall`; with an empty `wall`, each
    edge has its own.

    Args:
        planes: Equi-planes (through pivot line and centre of mass) of the strikes, with the stated radii.
        stated: One plane for each pivot axis whose edge has a stated radius, by the axis's id.
        systematic: Standard deviations of errors that strikes share.
        prior: Prior of the centre of mass.
    """
    solution = solve_joint(with_radius_not_given(planes), systematic, prior)
    axes = [plane for plane in _rounded_axes(solution) if plane.axis_id in stated]
    values, covariance = _radii(solution, axes)
    ours = [stated[plane.axis_id] for plane in axes]
    believed = np.array([plane.edge_radius for plane in ours])
    stated_covariance = _prior_covariance(JointModel(ours, systematic), ours)
    wide = _prior_covariance(solution.model, axes)
    inverse, inverse_wide = np.linalg.inv(covariance), np.linalg.inv(wide)
    information = inverse - inverse_wide
    information = (information + information.T) / 2
    score = inverse @ values - inverse_wide @ np.full(len(axes), ASSUMED.mean) - information @ believed
    variance = information + information @ stated_covariance @ information
    together = difference = _standardised(np.ones(len(axes)), score, variance)
    names, faces = [plane.axis_id for plane in axes], np.array([plane.face for plane in axes])
    parts = np.vstack([*(faces == face for face in sorted({*faces} - {""})), np.eye(len(axes), dtype=bool)])
    partial = np.array([_standardised(part, score, variance) for part in parts])
    refuted = np.asarray(np.any(parts[np.abs(partial) > REFUTED_PART_SDS], axis=0))
    compared = np.ones(len(axes), dtype=bool)
    if abs(together) > REFUTED_SDS:
        refuted = compared
    elif refuted.any():
        compared, difference = refuted, max(partial, key=abs)
    share = compared / compared.sum()
    priors = stated_covariance, wide
    grown = _excess(together, information, variance, priors)
    wrong = probability_wrong(score, information, priors, ASSUMED.mean - believed)
    return RadiusCheck(
        float(share @ believed),
        float(np.sqrt(share @ stated_covariance @ share)),
        float(share @ values),
        float(np.sqrt(share @ covariance @ share)),
        float(difference),
        tuple(name for name, each in zip(names, refuted, strict=True) if each),
        grown,
        wrong,
    )


def _standardised(direction: Array, score: Array, variance: Array) -> float:
    """Evidence against the stated radii of n edges in one direction, in sd; 0 if the strikes have none.

    It is the score (slope of the log likelihood) along the direction, over the score's own sd.

    Args:
        direction: (n,) weights of the edges.
        score: (n,) derivative of the log likelihood by the radii at the stated ones [1/m].
        variance: (n, n) covariance of the score if the stated radii are true [1/m^2].
    """
    sd2 = float(direction @ variance @ direction)
    return float(direction @ score) / float(np.sqrt(sd2)) if sd2 > 0 else 0.0


def _excess(difference_sds: float, information: Array, variance: Array, priors: tuple[Array, Array]) -> float:
    """Factor by which the sd of stated radii must grow for their mean to agree with the strikes' to 1 sd.

    It is 1 if it does so already, or if the strikes have no information on the radii. The difference's sd
    counts at most as that of radii that are not given: strikes that hardly determine a radius may be off by
    centimetres, which no statement explains.

    Args:
        difference_sds: difference between the mean radius by the strikes and the stated one, over its sd.
        information: (n, n) the strikes' own information (inverse covariance) on n edges' radii [1/m^2].
        variance: (n, n) covariance, if the stated radii are true, of the score (derivative of the strikes'
            log likelihood by the radii, at the stated ones) [1/m^2].
        priors: (n, n) covariances [m^2] of the stated radii, and of radii that are not given.
    """
    certainty = float(information.sum())
    of_mean, wide = (float(each.sum()) / len(each) ** 2 for each in priors)
    if certainty <= 0 or of_mean <= 0 or abs(difference_sds) <= 1:
        return 1.0
    difference_sd2 = min(float(variance.sum()) / certainty**2, wide)
    return float(np.sqrt(1 + (difference_sds**2 - 1) * difference_sd2 / of_mean))


def _is_stated(plane: EquiPlane) -> bool:
    """True if the user stated the radius of the rounded edge of this plane, by itself or for all edges."""
    if not plane.rounded:
        return False
    return plane.radius_prior is None or plane.radius_prior.source in STATED


def _with_assumed(plane: EquiPlane) -> EquiPlane:
    """Copy of a strike's plane with the edge radius and prior assumed where none is given (`ASSUMED`).

    The point on the plane's line moves with the centre line of the rounding. The balance angle phi and the
    rate constant k change with the radius by their derivatives, `plane.by_radius`.
    """
    more = ASSUMED.mean - plane.edge_radius
    by_phi, by_k = plane.by_radius
    return replace(
        plane,
        phi=plane.phi - by_phi * more,
        k=None if plane.k is None else plane.k - by_k * more,
        point=plane.point + more * centre_line_shift(plane),
        edge_radius=ASSUMED.mean,
        radius_prior=ASSUMED,
    )


def _rounded_axes(solution: JointSolution) -> list[EquiPlane]:
    """Plane of the first strike about each pivot axis whose edge is rounded, in the strikes' order."""
    found: dict[str, EquiPlane] = {}
    for plane in solution.model.planes:
        if plane.rounded:
            found.setdefault(plane.axis_id, plane)
    return list(found.values())


def _radii(solution: JointSolution, axes: Sequence[EquiPlane]) -> tuple[Array, Array]:
    """Estimated radii (n,) [m] of the edges of n pivot axes, and their covariance (n, n) [m^2].

    `axes` holds, for each axis, the equi-plane (through pivot line and centre of mass) of any one strike
    about it.
    """
    rows = solution.model.radius_errors([plane.axis_id for plane in axes])
    values = np.array([plane.edge_radius for plane in axes]) + rows @ solution.x
    return values, rows @ solution.covariance @ rows.T


def _prior_covariance(model: JointModel, axes: Sequence[EquiPlane]) -> Array:
    """Covariance (n, n) [m^2], before any strike is measured, of the radii of the edges of n pivot axes.

    `axes` holds, for each axis, the equi-plane (through pivot line and centre of mass) of any one strike
    about it in `model`.
    """
    rows = model.radius_errors([plane.axis_id for plane in axes])
    return rows @ rows.T
