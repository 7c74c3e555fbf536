"""Ground truth in the report of a virtual recording, for comparison with the estimates."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from analyze.types import Array

if TYPE_CHECKING:
    from analyze.pipeline.estimate import Estimate
    from analyze.result.answer import Answer


@dataclass(frozen=True)
class ShownTruth:
    """True centre of mass, balance angles, moments and region masses; SI units, object's frame O."""

    com: Array
    """(3,) centre of mass [m]"""
    phi: Mapping[str, float]
    """balance angle [rad] by id of the strike, for strikes used"""
    i_edge: Mapping[str, float]
    """moment about the edge [kg m²] by id of the strike, for strikes used"""
    i_edge_axis: Mapping[str, float]
    """moment about the edge [kg m²] by id of the pivot axis"""
    i_com: Mapping[str, float]
    """moment about the parallel axis through the centre of mass [kg m²] by id of the pivot axis"""
    regions: Mapping[str, float]
    """masses [kg] under the estimate's region names; empty where the body has no such regions"""


def shown_truth(score: Mapping[str, Any], answer: Answer) -> ShownTruth:
    """True values of the quantities that the report of a virtual recording shows.

    Args:
        score: errors and true values by name, from `score_answer`.
        answer: the answer (estimate and result) whose errors they are.

    Returns:
        Centre of mass [m] in the object's frame, balance angles [rad] of strikes, moments of inertia [kg m^2]
        of strikes and pivot axes, and masses [kg] of regions, empty if the truth has none.
    """
    estimate = answer.estimate
    axis_of = {strike.id: strike.axis_id for strike in answer.result.strikes}
    i_edge = dict(zip(score["strike_ids"], score["i_edge_true_kg_m2"], strict=True))
    return ShownTruth(
        com=np.array(score["centre_of_mass_true_m"], dtype=np.float64),
        phi=dict(zip(score["strike_ids"], score["phi_true_rad"], strict=True)),
        i_edge=i_edge,
        i_edge_axis={axis_of[name]: value for name, value in i_edge.items()},
        i_com={
            axis.axis_id: axis.i_com / (1 + score["i_com_relative_error"][axis.axis_id])
            for axis in estimate.inertial.axes
        },
        regions=_regions(score, estimate),
    )


def _regions(score: Mapping[str, Any], estimate: Estimate) -> dict[str, float]:
    if score.get("region_mass_true_kg") is None:
        return {}
    shell, upper, lower = score["region_mass_true_kg"]
    # The score names the interior by the true dividing plane; the two names swap where the estimate's plane
    # points to the other side.
    if not np.allclose(score["region_mass_kg"], estimate.distribution.masses, rtol=1e-9, atol=0):
        upper, lower = lower, upper
    return dict(zip(estimate.distribution.names, (shell, upper, lower), strict=True))
