"""How errors go on from one step to the next (paper, section 4.2): angles to c, moments to region masses, the scan to both."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from analyze.estimation.centre_of_mass import centre_of_mass
from analyze.estimation.equiplane import equiplane_normal
from analyze.estimation.paper import paper_centre_of_mass
from analyze.estimation.regions import mass_distribution
from analyze.estimation.stated import ComPrior
from analyze.pipeline.estimate import systematic_errors
from analyze.pipeline.score import tip_truth
from analyze.reproduce.paper.chain import regions_at
from analyze.reproduce.paper.record import Sensitivity
from analyze.types import Array, EquiPlane

if TYPE_CHECKING:
    from analyze.pipeline.estimate import Estimate
    from schemas.proto import percuss_pb2 as pb

PAPER_NOISE_DEG = 1.85
"""scatter of ang(t2), Fig. 9(a)"""
ANGLE_LEVELS_DEG = (0.0, 0.5, 1.0, PAPER_NOISE_DEG, 3.0, 4.0)
MOMENT_LEVELS = (0.0, 0.01, 0.02, 0.05, 0.1)
LEAST_ANGLE_SD = math.radians(0.01)
LEAST_MOMENT_SD = 1e-3
"""relative"""
LEAST_COM_SD = 1e-5
"""m"""
LEAST_MOMENT = 0.05
"""of the true I_c,l, where noise would leave less"""
DRAWS = 4
"""of the noise, at each level"""


def com_over_angles(estimate: Estimate, body: pb.TruthBody, levels_deg: Sequence[float], rng: np.random.Generator) -> list[Sensitivity]:
    """Error of c [m] where every strike's angle is the true one with noise; the noise is all that each method is told (Fig. 9(b)).

    Args:
        estimate: of the session; its planes are used, not their angles.
        body: the truth.
        levels_deg: 1 sigma.
        rng: draws the noise.
    """
    evidence, true = estimate.evidence, np.array(body.com_object)
    model = evidence.model
    planned = {strike.axis_id: strike for strike in evidence.plan.strikes}
    exact = [(plane, tip_truth(planned[plane.axis_id], body).phi) for plane in estimate.planes]
    prior = ComPrior.from_bounds(model.bounds[0], model.bounds[1])
    found: list[Sensitivity] = []
    for level in levels_deg:
        sd = math.radians(level)
        ours: list[float | None] = []
        paper: list[float | None] = []
        for _ in range(DRAWS if sd else 1):
            planes = [_at(plane, phi + float(rng.normal(0.0, sd)), max(sd, LEAST_ANGLE_SD)) for plane, phi in exact]
            ours.append(float(np.linalg.norm(centre_of_mass(planes, systematic_errors(evidence), prior).position - true)))
            paper.append(float(np.linalg.norm(paper_centre_of_mass(planes, estimate.cells).position - true)))
        found.append(Sensitivity(level=level, ours=ours, paper=paper))
    return found


def _at(plane: EquiPlane, phi: float, sd: float) -> EquiPlane:
    """By phi alone."""
    normal = equiplane_normal(plane.direction, plane.up, phi)
    return replace(plane, phi=phi, sd_phi=sd, k=None, sd_k=None, cov_phi_k=0.0, normal=normal)


def masses_over_moments(estimate: Estimate, body: pb.TruthBody, levels: Sequence[float], rng: np.random.Generator) -> list[Sensitivity]:
    """The metric of the region masses where c is the true one, and the moments about the edges are, but for noise (Fig. 9(c)).

    What is left of such a moment once m*R^2 is taken off is I_c,l, so that a tall object's is wrong by some four times as much.

    Args:
        estimate: of the session.
        body: the truth.
        levels: 1 sigma of each moment, relative; it is all that each method is told.
        rng: draws the noise.
    """
    com, tensor = np.array(body.com_object), np.array(body.inertia_com).reshape(3, 3)
    planes = list({plane.axis_id: plane for plane in estimate.planes}.values())
    planned = {strike.axis_id: strike for strike in estimate.evidence.plan.strikes}
    true_edges = {plane.axis_id: tip_truth(planned[plane.axis_id], body).i_edge for plane in planes}
    found: list[Sensitivity] = []
    for level in levels:
        noise = {plane.axis_id: float(rng.normal(0.0, level)) * true_edges[plane.axis_id] for plane in planes}
        about_edges = {name: true_edges[name] + noise[name] for name in noise}
        paper = regions_at(planes, com, about_edges, estimate)
        true_com = {axis.axis_id: float(axis.direction @ tensor @ axis.direction) for axis in estimate.inertial.axes}
        axes = tuple(
            replace(axis, i_com=max(true_com[axis.axis_id] + noise[axis.axis_id], LEAST_MOMENT * true_com[axis.axis_id]))
            for axis in estimate.inertial.axes
        )
        sd = [max(level, LEAST_MOMENT_SD) * true_edges[axis.axis_id] for axis in axes]
        covariance = np.diag(np.square([estimate.scale.mass_sd, *[LEAST_COM_SD] * 3, *sd]))
        told = replace(estimate.inertial, com=replace(estimate.com, position=com), axes=axes, joint_covariance=covariance)
        ours = mass_distribution(told, estimate.cells, np.random.default_rng(0))
        found.append(
            Sensitivity(
                level=level,
                ours=[metric(sided(ours.masses, ours.border_normal, body), body)],
                paper=[None if paper is None else metric(sided(paper.masses, paper.border_normal, body), body)],
            )
        )
    return found


def sided(masses: Array, border_normal: Array, body: pb.TruthBody) -> Array:
    """Region masses (3,) with the truth's names of the two sides."""
    return masses if border_normal @ np.array(body.region_plane[:3]) >= 0 else masses[[0, 2, 1]]


def metric(masses: Array, body: pb.TruthBody) -> float:
    """The paper's: mean over the regions of |dm|, over M."""
    return float(np.abs(masses - np.array(body.region_mass_kg)).mean() / body.mass_kg)
