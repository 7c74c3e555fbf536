"""Rows of strikes in the Result document: fitted values of each, and its prediction by the others."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from analyze.estimation.inertia import edge_inertia
from analyze.least_squares.intervals import SIGMAS_95
from analyze.result.quantities import (
    k_quantity,
    quantity,
)
from schemas.strike_result import AlternativeFit, PredictionResult, StrikeResult

if TYPE_CHECKING:
    from collections.abc import Sequence

    from analyze.estimation.edge_radii import EdgeRadius
    from analyze.estimation.mass_properties import CentreOfMass
    from analyze.estimation.priors import Scale
    from analyze.pipeline.prediction import StrikePrediction
    from analyze.types import EquiPlane, MotionFit, TipMotion
    from schemas.strike_plan import PlannedStrike


def strike_result(
    motion: TipMotion,
    planned: PlannedStrike,
    planes: Sequence[EquiPlane],
    index: int | None,
    com: CentreOfMass,
    scale: Scale,
    radii: Sequence[EdgeRadius],
) -> StrikeResult:
    """Entry of one strike in the Result document: verdict, fitted values, and its part in the estimate.

    Args:
        motion: motion and fits of the strike.
        planned: the planned strike that was carried out.
        planes: equi-planes (through pivot line and centre of mass) of the strikes used.
        index: index of the strike in `planes` and in `com`'s arrays; None if it was not used.
        com: centre of mass, whose residuals and distances belong to the strikes used.
        scale: mass m and gravity g, from which the moment of inertia about the edge, I_edge = m g R / k,
            follows, with R the distance of the centre of mass from the edge.
        radii: estimated radii of the edges; the fit assumed the planned one.

    Returns:
        Entry of the strike. The values of the fit (balance angle, rate constant k, residual rms) are None
        without a fit. The distance [m] of the centre of mass from the strike's equi-plane is None if the
        strike was not used; I_edge [kg m²] is None if the strike or its k was not used.
    """
    fit = None if motion.fit is None else _with_radius_error(motion.fit, planned, radii)
    values: dict[str, Any] = {}
    if fit is not None:
        values["estimator"] = fit.estimator
        values["estimator_note"] = fit.note
        values["phi"] = quantity(fit.phi, math.sqrt(fit.covariance[0, 0]), "rad")
        values["cov_phi_k"] = fit.covariance.tolist()
        values["k"] = k_quantity(fit)
        values["residual_rms_rad"] = float(np.sqrt(np.mean(fit.residual**2)))
        if motion.angle is not None:
            start, stop = fit.window
            values["window_ns"] = [int(motion.angle.time_ns[start]), int(motion.angle.time_ns[stop - 1])]
    if index is not None:
        plane = planes[index]
        values["equiplane_residual_m"] = float(com.residuals[index])
        if plane.k is not None:
            R = float(com.distances[index])
            value = edge_inertia(plane, R, scale)
            relative = math.sqrt(
                ((plane.sd_k or 0) / plane.k) ** 2
                + scale.k_relative_sd**2
                + com.distance_covariance[index, index] / R**2
                + (scale.mass_sd / scale.mass) ** 2
            )
            values["i_edge"] = quantity(value, value * relative, "kg m^2")
    return StrikeResult(
        id=motion.strike_id,
        plan_strike_id=motion.plan_strike_id,
        axis_id=planned.axis_id,
        plane_id=planned.plane_id,
        heading_rad=planned.heading_rad,
        verdict=motion.verdict,
        reason=motion.reason,
        followed_by=motion.followed_by,
        used=index is not None,
        information_share=0.0 if index is None else float(com.weights[index]),
        energy_ratio=motion.energy_ratio,
        alternatives=[_alternative(other) for other in motion.alternatives],
        **values,
    )


def _with_radius_error(fit: MotionFit, planned: PlannedStrike, radii: Sequence[EdgeRadius]) -> MotionFit:
    """Copy of a strike's fit whose covariance of (phi, k) includes the error of the edge's planned radius.

    phi is the balance angle, k the rate constant. The error is the root mean square difference of the
    estimated radius from the planned one; the fit is returned unchanged if its edge has none in `radii`.
    """
    own = next((each for each in radii if each.axis_id == planned.axis_id), None)
    if own is None:
        return fit
    variance = own.sd**2 + (own.value - planned.pivot.radius_m) ** 2
    return replace(fit, covariance=fit.covariance + variance * np.outer(fit.by_radius, fit.by_radius))


def prediction_document(prediction: StrikePrediction) -> PredictionResult:
    """Prediction of a strike from all others, in the Result's form: balance angle, k, tipping angle.

    k is the rate constant of the motion [1/s²], for gravity at the place where the strike was made. Balance
    angle [rad] and k have the sd of the prediction alone, without that of the measurement. Of the tipping
    angle, the offset [rad] from the prediction is given at the frame where it is largest over its sd.
    """
    left_out, motion, worst = prediction.left_out, prediction.motion, prediction.motion.worst
    phi_sd, k_sd = np.sqrt(np.diag(left_out.by_others))
    return PredictionResult(
        phi=quantity(left_out.phi, float(phi_sd), "rad"),
        k=quantity(motion.k, float(motion.k * k_sd), "rad/s^2", lowest=0.0),
        sigmas=left_out.sigmas,
        motion_sigmas=prediction.motion_sigmas,
        consistent=prediction.consistent,
        frames=len(motion.time) - motion.start,
        start_frames=motion.start,
        worst_offset_rad=float(motion.offset[worst]),
        worst_band_rad=float(SIGMAS_95 * motion.sd[worst]),
        outside_share=motion.outside,
    )


def _alternative(fit: MotionFit) -> AlternativeFit:
    """Entry of a strike's fit by a further estimator: name, balance angle phi [rad], k, and remarks.

    k [rad/s²] is the rate constant of theta'' = -k sin(phi - theta), theta the tipping angle; None if the
    estimator does not report it. The remarks are a note and the assumptions that are violated.
    """
    return AlternativeFit(
        estimator=fit.estimator,
        phi=quantity(fit.phi, math.sqrt(fit.covariance[0, 0]), "rad"),
        k=k_quantity(fit),
        note=fit.note,
        violated=list(fit.violated),
    )
