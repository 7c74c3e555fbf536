"""Predicted accuracy of a plan: centre of mass, moments, masses of regions, and what more strikes gain."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from analyze.planning import forecast
from analyze.planning.fillings import region_forecast
from schemas.strike_plan import PredictedMoment, PredictedRegion, Prediction, PredictionStep

if TYPE_CHECKING:
    from analyze.planning.design import Design
    from analyze.planning.fillings import Pieces
    from analyze.planning.information import Information
    from analyze.planning.prepared import PreparedObject


def predicted_accuracy(
    prepared: PreparedObject,
    target_com: float | None,
    chosen: Design,
    missed: str,
    so_far: Information,
    cells: Pieces | None,
) -> Prediction:
    """Entry of the plan with the standard deviations that its strikes are expected to reach.

    Args:
        prepared: Checked axes and what is known of the object.
        target_com: Largest rms error of the centre of mass that the user allows [m]; None without a target.
        chosen: Axes and number of strikes on each.
        missed: Text that the target is missed; "" if it is reached or there is none.
        so_far: Information before the planned strikes, without that of a strike turned by 180 degrees.
        cells: Pieces of the body; without them no region masses are predicted.
    """
    information = prepared.information
    members = [information.candidates[i] for i in chosen.chosen]
    advice = forecast.advice(information, chosen, prepared.made, prepared.model.primitive is not None, so_far)
    reached = ""
    if prepared.made and target_com is not None and forecast.error_so_far(so_far) <= target_com:
        reached = f"{1000 * target_com:g} mm is reached already: stop. "
    inertia_sd, determined = forecast.inertia_forecast(information, chosen)
    regions: list[PredictedRegion] = []
    if cells is not None:
        struck = [*members, *information.belief.struck]
        directions = [each.axis.direction for each in struck]
        regions = region_forecast(cells, prepared.spec.mass_kg, chosen.covariance, directions)
    moments = [
        PredictedMoment(axis_id=each.axis_id, i_com_sd_kg_m2=each.i_com, determined=each.i_com_determined)
        for each in forecast.axis_forecasts(information, chosen)
    ]
    return Prediction(
        com_sd_m=np.sqrt(np.diag(chosen.com_covariance)).tolist(),
        com_rms_m=chosen.com_rms,
        target_com_m=target_com,
        target_reached=None if target_com is None else not missed,
        moments=moments,
        inertia_sd_kg_m2=inertia_sd.tolist(),
        inertia_determined=determined.tolist(),
        regions=regions,
        error_sources_m=advice.sources,
        curve=[PredictionStep(strikes=many, com_rms_m=rms) for many, rms in advice.curve],
        floor_m=advice.floor,
        stop=advice.stop or bool(reached),
        advice=missed or reached + advice.text,
    )
