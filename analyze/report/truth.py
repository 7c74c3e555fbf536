"""The true values as the report shows them beside the estimates; virtual recordings only."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from analyze.types import Array

if TYPE_CHECKING:
    from analyze.pipeline.estimate import Estimate


@dataclass(frozen=True)
class ShownTruth:
    """What a perfect estimate would say. SI, in O."""

    com: Array
    """(3,) m"""
    phi: Mapping[str, float]
    """rad, by strike used"""
    i_edge: Mapping[str, float]
    """kg m^2, by strike used"""
    i_edge_axis: Mapping[str, float]
    """kg m^2, by pivot axis"""
    i_com: Mapping[str, float]
    """kg m^2, by pivot axis"""
    regions: Mapping[str, float]
    """kg, by the estimate's names; empty where the body has no such regions"""


def shown_truth(score: Mapping[str, Any], estimate: Estimate) -> ShownTruth:
    """From what `score_estimate` says of this estimate."""
    axis_of = {strike.id: strike.axis_id for strike in estimate.result.strikes}
    i_edge = dict(zip(score["strike_ids"], score["i_edge_true_kg_m2"], strict=True))
    return ShownTruth(
        com=np.array(score["centre_of_mass_true_m"], dtype=np.float64),
        phi=dict(zip(score["strike_ids"], score["phi_true_rad"], strict=True)),
        i_edge=i_edge,
        i_edge_axis={axis_of[name]: value for name, value in i_edge.items()},
        i_com={axis.axis_id: axis.i_com / (1 + score["i_com_relative_error"][axis.axis_id]) for axis in estimate.inertial.axes},
        regions=_regions(score, estimate),
    )


def _regions(score: Mapping[str, Any], estimate: Estimate) -> dict[str, float]:
    if score.get("region_mass_true_kg") is None:
        return {}
    wall, upper, lower = score["region_mass_true_kg"]
    # The score names the interior by the truth's border plane; where the estimate's points to the other side, the two names change places.
    if not np.allclose(score["region_mass_kg"], estimate.distribution.masses, rtol=1e-9, atol=0):
        upper, lower = lower, upper
    return dict(zip(estimate.distribution.names, (wall, upper, lower), strict=True))
