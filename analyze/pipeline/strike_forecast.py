"""Predicted covariance of centre of mass and moments after further strikes, linearised at the present answer.

The unknowns are those of the joint estimate of the strikes made, with those of the edges that could be struck
next. A further strike adds the Fisher information of its balance angle phi and of ln k, k the rate constant
of the tip, with the noise of the strikes made over the same edge, or else with the planned one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from analyze.estimation.equiplane import equiplane_from_fit, equiplane_normal, standing_angle
from analyze.estimation.joint import MomentModel, prior_information, prior_start, strikes_information
from analyze.estimation.joint_model import (
    ANGLE,
    COM,
    FIRST_AXIS_TERM,
    RADIUS,
    SCALE_TERM,
    SECOND,
    TILT,
    JointModel,
)
from analyze.estimation.priors import ComPrior, SystematicErrors
from analyze.estimation.strike_data import strike_data, whitened
from analyze.geometry.second_moments import unit_inertia
from analyze.pipeline.equiplanes import equiplanes, with_edge
from analyze.pipeline.evidence import Evidence
from analyze.pipeline.solved import SolvedStrikes, usable_motions
from analyze.types import Array, EquiPlane, MotionFit
from schemas.strike_plan import PlannedStrike

LEAST_PHI_SD, USUAL_PHI_SD = 1e-4, 3e-4
"""least 1 sigma [rad] of the balance angle of a strike that was not made yet, and the one if none is given"""
USUAL_MOMENT_SD = 0.02
"""relative 1 sigma of the moment about an edge that was not struck yet, if none is planned"""


@dataclass(frozen=True)
class Precision:
    """Covariance of the centre of mass, and relative standard deviations of the diagonal moments."""

    com: Array
    """(3, 3) covariance of the centre of mass [m^2]"""
    moments: Array
    """(3,) relative 1 sigma of Ixx, Iyy and Izz about the centre of mass, in the object frame"""


@dataclass(frozen=True)
class StrikeForecast:
    """Linear model of the strikes made and of one further strike over each edge of the plan."""

    strikes: tuple[PlannedStrike, ...]
    """planned strikes that can be made next, one per edge and heading"""
    model: JointModel
    """model of the strikes made, then of one further strike over each edge"""
    x: Array
    """(count,) unknowns at which the model is linearised"""
    before: Array
    """(count, count) information of priors and strikes made"""
    further: Array
    """(strikes, count, count) information of one further strike over each edge"""
    mass_sd: float
    """relative 1 sigma of the mass"""

    def precision(self, counts: Array) -> Precision:
        """Precision after `counts` further strikes over each edge, in the order of `strikes`."""
        P = self._covariance(counts)
        moments, by = unit_inertia(self.x[SECOND])
        diagonal = np.diagonal(by, axis1=1, axis2=2).T
        variance = np.einsum("di,ij,dj->d", diagonal, P[SECOND, SECOND], diagonal)
        relative = np.sqrt(variance) / np.maximum(np.diag(moments), 1e-12)
        return Precision(P[COM, COM], np.hypot(relative, self.mass_sd))

    def sources(self, counts: Array) -> dict[str, float]:
        """Rms error [m] of the centre of mass that each shared error causes, by the name of its remedy.

        The names are those of `planning.forecast.REMEDIES`.

        Args:
            counts: number of further strikes over each edge.
        """
        gain = self._covariance(counts)[COM]
        caused = np.sum(gain**2, axis=0)
        own = np.ones(len(caused), dtype=bool)
        own[:FIRST_AXIS_TERM] = False
        angles = np.zeros(len(caused), dtype=bool)
        angles[self._angle_terms] = True
        parts = {
            "tilt of gravity": caused[TILT].sum(),
            "scale of the shape": caused[SCALE_TERM],
            "radius of the edges": caused[RADIUS],
            "angle error of an axis": caused[own & angles].sum(),
            "place of the edges": caused[own & ~angles].sum(),
        }
        return {name: float(np.sqrt(value)) for name, value in parts.items()}

    @cached_property
    def _angle_terms(self) -> list[int]:
        return [self.model.axis_term(name, ANGLE) for name in {plane.axis_id for plane in self.model.planes}]

    def _covariance(self, counts: Array) -> Array:
        information = self.before + np.tensordot(counts, self.further, axes=1)
        return np.asarray(np.linalg.inv(information), dtype=np.float64)


def strike_forecast(
    evidence: Evidence,
    strikes: Sequence[PlannedStrike],
    problem: tuple[SystematicErrors, ComPrior, MomentModel],
    solved: SolvedStrikes | None,
) -> StrikeForecast:
    """Linear model of the strikes made and of one further strike over each edge of a plan.

    Args:
        evidence: object, shape and plan.
        strikes: planned strikes; of those over one edge at one heading the first counts.
        problem: errors that strikes share, prior of the centre of mass, and mass, gravity and prior of the
            moments, for a problem without any strike.
        solved: solution of the strikes made; None if they are too few, and count as they were fitted.
    """
    systematic, prior, moments = problem
    first = {(each.axis_id, each.heading_rad): each for each in reversed(strikes)}
    chosen = tuple(sorted(first.values(), key=list(strikes).index))
    few = [] if solved is not None else usable_motions(evidence)
    made = equiplanes(evidence, few)
    com = prior.mean if evidence.plan.hypothesis is None else np.array(evidence.plan.hypothesis.com_m)
    inertia = moments.prior(com).mean
    weight: Array = np.ones(len(made))
    if solved is not None:
        systematic, moments, made = solved.solution.model.systematic, solved.moments, solved.planes
        com, inertia = solved.solution.x[COM], unit_inertia(solved.solution.x[SECOND])[0]
        weight = solved.solution.weight / solved.solution.spread
    alike = {(plane.axis_id, plane.heading): plane for plane in made}
    further = [
        _again(plane, each)
        if (plane := alike.get((each.axis_id, each.heading_rad))) is not None
        else _expected(evidence, each, com, systematic)
        for each in chosen
    ]
    planes = [*made, *further]
    model = JointModel(planes, systematic, moments.scale)
    x = model.start(com, inertia)
    _, rows = whitened(model, strike_data(planes, systematic.strike_angle_sd, with_k=True), x)
    _, diagonal = prior_start(model, prior, moments)
    before = prior_information(diagonal, moments.prior(com), x)
    before = before + strikes_information(rows[: len(made)], weight)
    each = np.einsum("spi,spj->sij", rows[len(made) :], rows[len(made) :])
    return StrikeForecast(chosen, model, x, before, each, evidence.spec.mass_sd_kg / evidence.spec.mass_kg)


def _again(plane: EquiPlane, planned: PlannedStrike) -> EquiPlane:
    """Equi-plane of a further strike over an edge that was struck at the same heading."""
    return replace(plane, strike_id=f"{planned.id} again")


def _expected(
    evidence: Evidence, planned: PlannedStrike, com: Array, systematic: SystematicErrors
) -> EquiPlane:
    """Equi-plane of a strike over an edge that was not struck yet, for a centre of mass `com` (3,) [m]."""
    up, pivot = np.array(planned.R_world_object)[2], planned.pivot
    direction = np.array(pivot.direction) / np.linalg.norm(pivot.direction)
    phi = float(standing_angle(com, direction, up, np.array(pivot.point)))
    arm = com - np.array(pivot.point)
    R = float(np.linalg.norm(arm - (arm @ direction) * direction))
    k = evidence.spec.mass_kg * evidence.manifest.g_m_s2 * R / planned.i_edge_predicted_kg_m2
    expected = planned.phi_measured_sd_rad or float(np.hypot(USUAL_PHI_SD, systematic.strike_angle_sd))
    phi_sd = max(expected**2 - systematic.strike_angle_sd**2, LEAST_PHI_SD**2) ** 0.5
    moment_sd = planned.i_edge_measured_sd_kg_m2 or USUAL_MOMENT_SD * planned.i_edge_predicted_kg_m2
    k_sd = k * moment_sd / planned.i_edge_predicted_kg_m2
    fit = MotionFit("predicted", phi, k, np.diag([phi_sd**2, k_sd**2]), 0.0, 0.0, 0, (0, 0), np.zeros(0))
    plane = with_edge(equiplane_from_fit(f"{planned.id} predicted", planned, fit), evidence)
    return replace(plane, normal=equiplane_normal(plane.direction, plane.up, phi))
