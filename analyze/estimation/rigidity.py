"""Tests whether the struck body is rigid: contents that move (liquid, powder, a loose lump) show themselves.

A rigid body has one balance angle phi and one rate constant k about each edge, whatever the energy of the
strike, and one centre of mass c in all poses. Contents that move reach their new place in a slow tip and lag
behind a fast one: phi and k depend on the energy. Put down on another face, they lie elsewhere: the planes of
the poses do not meet in one c. Two tests follow; their statistics are independent of each other:

- edges: scatter of (phi, ln k) of the strikes over one edge about their weighted mean, chi^2 with two degrees
  of freedom for every strike but one;
- poses: decrease of chi^2 by a c of its own for each pose, in the directions that the strikes determine, with
  the errors that strikes share integrated out. The strike that explains most of it is left out.

A liquid whose surface stays level in every tip passes the first test, a lump in the middle of the second.
"""

# scipy is only partly typed.
# pyright: reportMissingTypeStubs=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false, reportUnknownMemberType=false

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import Enum

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri, chndtr

from analyze.estimation.joint_model import COM, SECOND, JointModel
from analyze.estimation.priors import ComPrior, SystematicErrors
from analyze.types import Array, EquiPlane

FALSE_ALARM_PROBABILITY = 1e-3
"""False-alarm probability of each kind of test in one session."""
K_SCATTER = 5e-3
"""Relative 1 sigma of k from strike to strike beyond the error of its fit."""
MIN_ENERGIES = 3
"""Fewest strikes over one edge that test it."""
MIN_ENERGY_SPAN = 1.3
"""Least ratio of the largest to the smallest energy ratio of the strikes that test an edge."""
MIN_SHIFT_INFORMATION = 100.0
"""Least information about a shift of c between poses that counts as determined, in units of the inverse
variance of c before any strike."""
DETECTION = 0.9
"""Probability of detection at the stated smallest share of a liquid."""
TURN_PER_WIDTH = 0.12
"""Change of phi [rad] from slow to fast tips by a liquid, per share of the mass, at a width of the body
across the edge equal to the distance of c from it: what nine of ten simulated liquids reach."""
LEVEL_OFFSET = 0.25
"""Distance of a liquid's centre from the middle of a half filled body, over the body's extent upwards."""
MIN_POSES = 2
"""Fewest poses that are compared."""
POSE_STEPS = 4
"""Number of Gauss-Newton steps for the centres of mass of the poses."""
LARGEST_SHARE = 0.5
"""Largest share of the mass that a test must be able to find to count as a test."""


class Answer(Enum):
    """Answer to the question whether the body is rigid; none of them claims that it is."""

    NOT_RIGID = "not_rigid"
    NOTHING_MOVES = "nothing_moves"
    NOT_TESTED = "not_tested"


@dataclass(frozen=True)
class EdgeScatter:
    """Test of the strikes over one edge at several energies: do they share phi and k?"""

    axis_id: str
    """Id of the pivot axis."""
    strike_ids: tuple[str, ...]
    """Ids of the strikes, from the least energy to the greatest."""
    energy_ratios: tuple[float, ...]
    """Their energy ratios: energy of the strike over the energy needed to reach balance."""
    phi_change: float
    """Slope of phi over the energy ratio, times the ratio's range [rad]."""
    k_change: float
    """Slope of ln k over the energy ratio, times the ratio's range."""
    chi_squared: float
    """Scatter of (phi, ln k) about their mean, in units of the variances."""
    freedom: int
    """Its degrees of freedom."""
    limit: float
    """Value that chance exceeds at the false-alarm probability."""
    share: float
    """Smallest share of a liquid in the mass that would exceed it in nine of ten cases."""

    @property
    def moves(self) -> bool:
        """True if the strikes differ as contents that lag behind a fast tip make them differ."""
        return self.chi_squared > self.limit and self.phi_change > 0 > self.k_change

    @property
    def tests(self) -> bool:
        """True if energies were different enough for the test to have power."""
        return (
            len(self.energy_ratios) >= MIN_ENERGIES
            and self.energy_ratios[-1] > MIN_ENERGY_SPAN * self.energy_ratios[0]
        )


@dataclass(frozen=True)
class PoseCentre:
    """Centre of mass of the body as it rests on one face, by the strikes made there."""

    face: str
    """Id of the face."""
    up: Array
    """(3,) direction that points upwards at rest, in O."""
    position: Array
    """(3,) centre of mass [m], in O."""
    covariance: Array
    """(3, 3) its covariance [m^2], errors that strikes share included."""
    residual: float
    """Rms distance [m] of the centre of mass of all poses together from the planes of this pose."""


@dataclass(frozen=True)
class PoseShift:
    """Test of one centre of mass for all poses against one for each."""

    centres: tuple[PoseCentre, ...]
    """Centre of mass of each pose."""
    largest_shift: float
    """Largest shift of c between two poses along a direction that the strikes determine [m]."""
    chi_squared: float
    """Decrease of chi^2 by a centre of mass of its own for each pose."""
    freedom: int
    """Number of directions of shifts that the strikes determine; 0: no test."""
    limit: float
    """Value that chance exceeds at the false-alarm probability; infinite without a test."""
    share: float
    """Smallest share of a liquid in the mass that would exceed it in nine of ten cases; infinite without a
    test."""

    @property
    def moves(self) -> bool:
        """True if one centre of mass does not explain the strikes of all poses."""
        return self.chi_squared > self.limit


@dataclass(frozen=True)
class Rigidity:
    """Answer of both tests, with their figures."""

    edges: tuple[EdgeScatter, ...]
    """One test per edge that was struck more than once."""
    poses: PoseShift
    """Test of the poses."""

    @property
    def answer(self) -> Answer:
        """Not rigid if a test says so; else that nothing moves that would show, or that nothing was tested."""
        if self.poses.moves or any(edge.moves for edge in self.edges):
            return Answer.NOT_RIGID
        return Answer.NOTHING_MOVES if self.share <= LARGEST_SHARE else Answer.NOT_TESTED

    @property
    def share(self) -> float:
        """Smallest share of a liquid in the mass that one of the tests would have found; inf if there is none."""
        return min([self.poses.share, *(edge.share for edge in self.edges if edge.tests)], default=math.inf)


def test_rigidity(
    planes: Sequence[EquiPlane],
    energy_ratios: Sequence[float],
    com: Array,
    systematic: SystematicErrors,
    prior: ComPrior,
) -> Rigidity:
    """Test whether the strikes are those of a rigid body.

    Args:
        planes: Equi-planes (through pivot line and centre of mass) of the strikes used, in the object frame
            O, with balance angles phi and rate constants k.
        energy_ratios: Energy ratio of each strike.
        com: (3,) centre of mass [m] by all strikes together, in O.
        systematic: Stated standard deviations of errors that strikes share, and of their scatter.
        prior: Prior of c; its sd are half the extents of the body.

    Returns:
        Both tests with their figures, and the centre of mass of each pose.
    """
    return Rigidity(
        _edge_tests(planes, energy_ratios, com, systematic, prior), _pose_test(planes, com, systematic, prior)
    )


def _edge_tests(
    planes: Sequence[EquiPlane],
    energy_ratios: Sequence[float],
    com: Array,
    systematic: SystematicErrors,
    prior: ComPrior,
) -> tuple[EdgeScatter, ...]:
    """Tests of all edges that were struck more than once in one way, in the order of their first strikes."""
    groups: dict[tuple[str, float, int], list[int]] = {}
    for i, plane in enumerate(planes):
        if plane.k is not None and plane.sd_k:
            groups.setdefault((plane.axis_id, plane.heading, plane.level), []).append(i)
    repeated = [members for members in groups.values() if len(members) > 1]
    alarm = FALSE_ALARM_PROBABILITY / max(len(repeated), 1)
    return tuple(
        _edge_test(
            [planes[i] for i in members], [energy_ratios[i] for i in members], com, (systematic, prior), alarm
        )
        for members in repeated
    )


def _edge_test(
    planes: Sequence[EquiPlane],
    energy_ratios: Sequence[float],
    com: Array,
    priors: tuple[SystematicErrors, ComPrior],
    alarm: float,
) -> EdgeScatter:
    """Test of the strikes over one edge, with the probability of a false `alarm`."""
    systematic, prior = priors
    order = np.argsort(energy_ratios)
    planes = [planes[i] for i in order]
    energy = np.array(energy_ratios, dtype=np.float64)[order]
    values = np.array([[plane.phi, math.log(plane.k or 1.0)] for plane in planes])
    precision = np.array([_precision(plane, systematic.strike_angle_sd) for plane in planes])
    mean = _weighted_mean(precision, values)
    chi_squared = float(np.einsum("ni,nij,nj->", values - mean, precision, values - mean))
    freedom = 2 * (len(planes) - 1)
    limit = float(chdtri(freedom, alarm))
    run = energy - energy.mean()
    change = run @ values / max(float(run @ run), 1e-12) * float(np.ptp(energy))
    # A liquid's effect grows from the slowest tip to the fastest; k's is left out, which is cautious.
    plane = planes[0]
    arm = com - plane.point
    across = np.cross(plane.direction, plane.up)
    distance = float(np.linalg.norm(arm - plane.direction * (arm @ plane.direction)))
    effect = np.zeros_like(values)
    effect[:, 0] = TURN_PER_WIDTH * 2 * float(np.abs(across) @ prior.sd) / max(distance, 1e-3)
    effect[:, 0] *= (energy - energy[0]) / max(float(np.ptp(energy)), 1e-12)
    effect -= _weighted_mean(precision, effect)
    power = float(np.einsum("ni,nij,nj->", effect, precision, effect))
    return EdgeScatter(
        axis_id=plane.axis_id,
        strike_ids=tuple(each.strike_id for each in planes),
        energy_ratios=tuple(energy.tolist()),
        phi_change=float(change[0]),
        k_change=float(change[1]),
        chi_squared=chi_squared,
        freedom=freedom,
        limit=limit,
        share=math.sqrt(_noncentrality(limit, freedom) / max(power, 1e-12)),
    )


def _precision(plane: EquiPlane, scatter_sd: float) -> Array:
    """Inverse covariance (2, 2) of a strike's own errors of (phi [rad], ln k), with the usual scatter."""
    k, sd_k = plane.k or 1.0, plane.sd_k or 0.0
    mixed = plane.cov_phi_k / k
    own = np.array([[plane.sd_phi**2 + scatter_sd**2, mixed], [mixed, (sd_k / k) ** 2 + K_SCATTER**2]])
    return np.asarray(np.linalg.inv(own), dtype=np.float64)


def _weighted_mean(precision: Array, values: Array) -> Array:
    """Mean (2,) of values (n, 2) with inverse covariances (n, 2, 2)."""
    weighted = np.einsum("nij,nj->i", precision, values)
    return np.asarray(np.linalg.solve(precision.sum(axis=0), weighted), dtype=np.float64)


def _noncentrality(limit: float, freedom: int) -> float:
    """Noncentrality at which chi^2 exceeds `limit` with the probability `DETECTION`, by bisection."""
    low, high = 0.0, 10.0 * (limit + 10.0)
    for _ in range(60):
        middle = 0.5 * (low + high)
        found = 1.0 - float(chndtr(limit, freedom, middle)) > DETECTION
        low, high = (low, middle) if found else (middle, high)
    return high


def _pose_test(
    planes: Sequence[EquiPlane], com: Array, systematic: SystematicErrors, prior: ComPrior
) -> PoseShift:
    """Test of one centre of mass for all poses, without the strike that explains most of a difference."""
    centres = _pose_centres(planes, com, systematic, prior)
    faces = np.array([plane.face for plane in planes])
    found = _shift_test(planes, faces, com, systematic, prior)
    for i in range(len(planes)):
        kept = np.arange(len(planes)) != i
        other = _shift_test([planes[j] for j in np.flatnonzero(kept)], faces[kept], com, systematic, prior)
        if other.chi_squared - other.limit < found.chi_squared - found.limit:
            found = other
    return replace(found, centres=centres)


def _shift_test(
    planes: Sequence[EquiPlane],
    faces: NDArray[np.str_],
    com: Array,
    systematic: SystematicErrors,
    prior: ComPrior,
) -> PoseShift:
    """Test of the poses with all `planes`, linear about `com`; `faces` (strikes,) are their resting faces.

    The centres of mass of the poses are left out.
    """
    names = np.unique(faces)
    none = PoseShift((), 0.0, 0.0, 0, math.inf, math.inf)
    if len(names) < MIN_POSES:
        return none
    model = JointModel(planes, systematic)
    residual, by_com, shared = _phi_rows(model, com, np.zeros(model.count - SECOND.stop))
    by_com = by_com * prior.sd
    covariance = np.diag(_phi_variance(planes, systematic)) + shared @ shared.T + by_com @ by_com.T
    mine = np.array([faces == name for name in names[1:]], dtype=np.float64)
    shifts = np.einsum("os,sc->soc", mine, by_com).reshape(len(planes), -1)
    weighted = np.linalg.solve(covariance, np.column_stack([shifts, -residual]))
    values, vectors = np.linalg.eigh(shifts.T @ weighted[:, :-1])
    determined = values > MIN_SHIFT_INFORMATION
    if not np.any(determined):
        return none
    values, vectors = values[determined], vectors[:, determined]
    along = vectors.T @ (shifts.T @ weighted[:, -1]) / values
    freedom = len(values)
    limit = float(chdtri(freedom, FALSE_ALARM_PROBABILITY))
    ups = np.array([planes[int(np.argmax(faces == name))].up for name in names])
    lowered = -LEVEL_OFFSET * 2 * (np.abs(ups) @ prior.sd)[:, None] * ups / prior.sd
    power = float(values @ (vectors.T @ (lowered[1:] - lowered[0]).ravel()) ** 2)
    moved = (vectors @ along).reshape(-1, 3) * prior.sd
    return PoseShift(
        centres=(),
        largest_shift=float(np.linalg.norm(moved, axis=1).max()),
        chi_squared=float(values @ along**2),
        freedom=freedom,
        limit=limit,
        share=math.sqrt(_noncentrality(limit, freedom) / max(power, 1e-12)),
    )


def _phi_rows(model: JointModel, com: Array, errors: Array) -> tuple[Array, Array, Array]:
    """Residuals (strikes,) of phi, modelled less measured [rad], and their derivatives.

    The derivatives are by the centre of mass (strikes, 3) [rad/m] and by the errors that strikes share
    (strikes, errors), in units of their sd.

    Args:
        model: Model of the strikes' phi.
        com: (3,) centre of mass [m] about which it is linearised, in the object frame O.
        errors: (errors,) shared errors there.
    """
    at = np.concatenate([com, np.zeros(SECOND.stop - COM.stop), errors])
    design = model.design(at)
    return model.residual(at), design[:, COM], design[:, SECOND.stop :]


def _phi_variance(planes: Sequence[EquiPlane], systematic: SystematicErrors) -> Array:
    """Variances (strikes,) [rad^2] of the strikes' own errors of phi, with the usual scatter."""
    return np.array([plane.sd_phi**2 + systematic.strike_angle_sd**2 for plane in planes])


def _pose_centres(
    planes: Sequence[EquiPlane], com: Array, systematic: SystematicErrors, prior: ComPrior
) -> tuple[PoseCentre, ...]:
    """Centre of mass of each pose, in the order of the strikes; Gauss-Newton from `com`, that of all poses.

    The errors that strikes share are common to all poses.
    """
    model = JointModel(planes, systematic)
    variance, count = _phi_variance(planes, systematic), model.count - SECOND.stop
    names = list(dict.fromkeys(plane.face for plane in planes))
    pose = np.array([names.index(plane.face) for plane in planes])
    centres, errors = np.tile(com, (len(names), 1)), np.zeros(count)
    precision = np.concatenate([np.tile(prior.sd**-2, len(names)), np.ones(count)])
    covariance = np.diag(1 / precision)
    for _ in range(POSE_STEPS):
        rows, residual = np.zeros((len(planes), len(precision))), np.zeros(len(planes))
        for number, centre in enumerate(centres):
            mine = pose == number
            off, by_com, shared = _phi_rows(model, centre, errors)
            residual[mine] = off[mine]
            rows[mine, 3 * number : 3 * number + 3] = by_com[mine]
            rows[mine, 3 * len(names) :] = shared[mine]
        weighted = rows / variance[:, None]
        covariance = np.asarray(np.linalg.inv(rows.T @ weighted + np.diag(precision)), dtype=np.float64)
        away = np.concatenate([(centres - prior.mean).ravel(), errors])
        step = -covariance @ (weighted.T @ residual + precision * away)
        centres, errors = centres + step[: centres.size].reshape(-1, 3), errors + step[centres.size :]
    off = np.array([plane.normal @ (com - plane.point) for plane in planes])
    found: list[PoseCentre] = []
    for number, name in enumerate(names):
        own = slice(3 * number, 3 * number + 3)
        up = planes[int(np.argmax(pose == number))].up
        rms = float(np.sqrt(np.mean(off[pose == number] ** 2)))
        found.append(PoseCentre(name, up, centres[number], covariance[own, own], rms))
    return tuple(found)
