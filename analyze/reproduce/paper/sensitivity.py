"""Propagation of errors: balance angles to centre of mass c, moments to region masses (paper, 4.2)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from analyze.estimation.centre_of_mass import centre_of_mass
from analyze.estimation.equiplane import equiplane_normal
from analyze.estimation.mass_properties import MassDistribution
from analyze.estimation.paper import PaperRegions, paper_centre_of_mass
from analyze.estimation.priors import ComPrior
from analyze.estimation.region_masses import mass_distribution
from analyze.pipeline.equiplanes import systematic_errors
from analyze.reproduce.paper.chain import regions_at
from analyze.reproduce.paper.record import Sensitivity
from analyze.result.score import tip_truth
from analyze.types import Array, EquiPlane

if TYPE_CHECKING:
    from analyze.pipeline.estimate import Estimate
    from schemas.proto import percuss_pb2 as pb

PAPER_NOISE_DEG = 1.85
"""Standard deviation [deg] of the paper's angles ang(t2), which are balance angles, Fig. 9(a)."""
ANGLE_LEVELS_DEG = (0.0, 0.5, 1.0, PAPER_NOISE_DEG, 3.0, 4.0)
"""Standard deviations [deg] of the noise on the balance angles."""
MOMENT_LEVELS = (0.0, 0.01, 0.02, 0.05, 0.1)
"""Relative standard deviations of the moments."""
MIN_ANGLE_SD = math.radians(0.01)
"""Least stated sd of an angle [rad]."""
MIN_MOMENT_SD = 1e-3
"""Least stated sd of a moment, relative."""
COM_SD_M = 1e-5
"""Stated sd [m] of the true c, along each axis."""
MIN_MOMENT_FRACTION = 0.05
"""Lower limit of a noisy moment about the parallel axis through c, as a fraction of its true value."""
DRAWS = 4
"""Draws of the noise at each level."""


def com_over_angles(
    estimate: Estimate, body: pb.TruthBody, levels_deg: Sequence[float], rng: np.random.Generator
) -> list[Sensitivity]:
    """Errors [m] of the centre of mass from true balance angles with noise added (Fig. 9(b)).

    They are distances from the true centre of mass, by our method and by the paper's. Our method is given the
    sd of the noise, and the session's own systematic errors.

    Args:
        estimate: result of the session; the pivot lines of its strikes are used, but not their angles.
        body: ground truth.
        levels_deg: standard deviations of the noise [deg].
        rng: generator that draws the noise.

    Returns:
        One entry per level, with `DRAWS` errors of each method, or one where the level is 0.
    """
    evidence, true = estimate.evidence, np.array(body.com_object)
    planned = {strike.axis_id: strike for strike in evidence.plan.strikes}
    exact = [(plane, tip_truth(planned[plane.axis_id], body).phi) for plane in estimate.planes]
    prior = ComPrior.from_bounds(*evidence.model.bounds)
    found: list[Sensitivity] = []
    for level in levels_deg:
        sd = math.radians(level)
        ours: list[float | None] = []
        paper: list[float | None] = []
        for _ in range(DRAWS if sd else 1):
            planes = [
                _with_phi(plane, phi + float(rng.normal(0.0, sd)), max(sd, MIN_ANGLE_SD))
                for plane, phi in exact
            ]
            own = centre_of_mass(planes, systematic_errors(evidence), prior)
            ours.append(float(np.linalg.norm(own.position - true)))
            paper.append(float(np.linalg.norm(paper_centre_of_mass(planes, estimate.cells).position - true)))
        found.append(Sensitivity(level=level, ours=ours, paper=paper))
    return found


def _with_phi(plane: EquiPlane, phi: float, sd: float) -> EquiPlane:
    """Copy of an equi-plane with another balance angle: `phi` [rad] with standard deviation `sd` [rad].

    An equi-plane, measured by a strike, contains the pivot line and the centre of mass. The copy has the
    normal that follows from `phi`, and no rate constant k of the tip.
    """
    normal = equiplane_normal(plane.direction, plane.up, phi)
    return replace(plane, phi=phi, sd_phi=sd, k=None, sd_k=None, cov_phi_k=0.0, normal=normal)


def masses_over_moments(
    estimate: Estimate, body: pb.TruthBody, levels: Sequence[float], rng: np.random.Generator
) -> list[Sensitivity]:
    """Errors of region masses that are estimated from the true c and noisy true moments (Fig. 9(c)).

    c is the centre of mass. The error is the paper's metric: the mean absolute error of a region's mass over
    the total mass. The noise is drawn for the moment about the edge. Subtracting m R^2 (R: distance of c from
    the edge) gives I_c,l, the moment about the parallel axis through c. It has the same absolute error; for a
    tall object its relative error is about four times as large.

    Args:
        estimate: result of the session.
        body: ground truth.
        levels: standard deviations of the noise, relative to the moments about the edges. Our method is given
            them, with the sd of the mass and a small one of c.
        rng: generator that draws the noise.

    Returns:
        One entry per level, with one error of each method; the paper's is None where it has no solution.
    """
    com, tensor = np.array(body.com_object), np.array(body.inertia_com).reshape(3, 3)
    planes = list({plane.axis_id: plane for plane in estimate.planes}.values())
    planned = {strike.axis_id: strike for strike in estimate.evidence.plan.strikes}
    true_edges = {plane.axis_id: tip_truth(planned[plane.axis_id], body).i_edge for plane in planes}
    true_com = {
        axis.axis_id: float(axis.direction @ tensor @ axis.direction) for axis in estimate.inertial.axes
    }
    found: list[Sensitivity] = []
    for level in levels:
        noise = {plane.axis_id: float(rng.normal(0.0, level)) * true_edges[plane.axis_id] for plane in planes}
        about_edges = {name: true_edges[name] + noise[name] for name in noise}
        paper = regions_at(planes, com, about_edges, estimate)
        axes = tuple(
            replace(
                axis,
                i_com=max(
                    true_com[axis.axis_id] + noise[axis.axis_id], MIN_MOMENT_FRACTION * true_com[axis.axis_id]
                ),
            )
            for axis in estimate.inertial.axes
        )
        sd = [max(level, MIN_MOMENT_SD) * true_edges[axis.axis_id] for axis in axes]
        covariance = np.diag(np.square([estimate.scale.mass_sd, *[COM_SD_M] * 3, *sd]))
        inertial = replace(
            estimate.inertial, com=replace(estimate.com, position=com), axes=axes, joint_covariance=covariance
        )
        ours = mass_distribution(inertial, estimate.cells, np.random.default_rng(0))
        found.append(
            Sensitivity(
                level=level,
                ours=[masses_error(ours, body)],
                paper=[None if paper is None else masses_error(paper, body)],
            )
        )
    return found


def true_order(dividing_plane_normal: Array, body: pb.TruthBody) -> list[int]:
    """Indices that put estimated region masses into the true order: shell, upper, lower part.

    They swap upper and lower part if the estimated and the true dividing plane have opposite upper sides.

    Args:
        dividing_plane_normal: (3,) estimated unit normal in the object frame O, towards the upper part.
        body: ground truth, with its own dividing plane.
    """
    return [0, 1, 2] if dividing_plane_normal @ np.array(body.region_plane[:3]) >= 0 else [0, 2, 1]


def masses_error(found: MassDistribution | PaperRegions, body: pb.TruthBody) -> float:
    """The paper's metric of region masses: mean absolute error of a region's mass, over the total mass.

    Args:
        found: estimated masses of shell, upper and lower part, with the dividing plane.
        body: ground truth.
    """
    masses = found.masses[true_order(found.dividing_plane_normal, body)]
    return float(np.abs(masses - np.array(body.region_mass_kg)).mean() / body.mass_kg)
