"""From estimates to the Result document: units, intervals, what was not observed, and the same bytes for the same file."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from typing import Any, TypeVar

import numpy as np

from analyze.estimation.inertia import edge_inertia
from analyze.estimation.paper import PaperCentre, PaperRegions
from analyze.estimation.part_masses import PartMasses
from analyze.estimation.stated import Scale
from analyze.pipeline.prediction import ForetoldStrike
from analyze.types import Array, CentreOfMass, EquiPlane, InertialParameters, MassDistribution, MotionFit, TipMotion
from schemas.document import Document, canonical_json
from schemas.result import (
    AlternativeFit,
    AxisMoment,
    Filling,
    ForetoldResult,
    FrameTimes,
    PartResult,
    Parts,
    Quantity,
    RegionResult,
    Regions,
    Result,
    ResultInputs,
    ResultWarning,
    StrikeResult,
    TableTilt,
    Verdict,
)
from schemas.strike_plan import PlannedStrike

D = TypeVar("D", bound=Document)
SIGMAS95 = 1.96
SIGNIFICANT_DIGITS = 10
"""Of every number in a Result: the same on every run, whatever order the linear algebra library adds in."""


def quantity(value: float, sd: float, unit: str, lowest: float | None = None) -> Quantity:
    """A scalar with its 95 % interval; `lowest` cuts the interval off where the quantity cannot lie (a mass below 0)."""
    low = value - SIGMAS95 * sd
    return Quantity(
        value=value, sd=sd, unit=unit, interval95=[low if lowest is None else max(low, lowest), value + SIGMAS95 * sd], observed=True
    )


def com_quantity(com: CentreOfMass) -> Quantity:
    """Centre of mass in O with covariance; an unobserved direction is named."""
    sd = np.sqrt(np.diag(com.covariance))
    direction = com.unobserved_direction
    return Quantity(
        value=com.position.tolist(),
        unit="m",
        sd=sd.tolist(),
        covariance=com.covariance.tolist(),
        interval95=[[c - SIGMAS95 * s, c + SIGMAS95 * s] for c, s in zip(com.position.tolist(), sd.tolist(), strict=True)],
        frame="O",
        observed=com.observed,
        unobserved_direction=None if direction is None else direction.tolist(),
    )


def inertia_quantity(parameters: InertialParameters) -> Quantity:
    """Tensor about c, axes of O. `observed`, and measured by its source, only if every entry was; the sd is per entry, rows joined."""
    sd = parameters.inertia_sd
    every = bool(parameters.measured.all())
    return Quantity(
        value=_clean(parameters.inertia).tolist(),
        unit="kg m^2",
        sd=sd.ravel().tolist(),
        interval95=[
            [v - SIGMAS95 * s, v + SIGMAS95 * s]
            for v, s in zip(_clean(parameters.inertia).ravel().tolist(), sd.ravel().tolist(), strict=True)
        ],
        frame="O",
        observed=every,
        source="measured" if every else "prior",
    )


def axis_moments(parameters: InertialParameters) -> list[AxisMoment]:
    """Per pivot axis, in the order of their names."""
    return [
        AxisMoment(
            axis_id=axis.axis_id,
            direction=axis.direction.tolist(),
            i_edge=quantity(axis.i_edge, axis.i_edge_sd, "kg m^2"),
            i_com=quantity(axis.i_com, axis.i_com_sd, "kg m^2", lowest=0.0),
        )
        for axis in parameters.axes
    ]


def regions_document(distribution: MassDistribution) -> Regions:
    """Region masses with intervals, border plane and naive answers."""
    sd = np.sqrt(np.diag(distribution.covariance))
    return Regions(
        regions=[
            RegionResult(
                name=name,
                mass=Quantity(
                    value=float(distribution.masses[i]), sd=float(sd[i]), unit="kg", interval95=distribution.intervals[i].tolist()
                ),
                limits_kg=distribution.limits[i].tolist(),
            )
            for i, name in enumerate(distribution.names)
        ],
        border_normal=distribution.border_normal.tolist(),
        border_offset_m=distribution.border_offset,
        border_offset_interval95_m=list(distribution.border_offset_interval),
        baselines={name: masses.tolist() for name, masses in distribution.baselines.items()},
        explained=distribution.explained,
        shell_thickness=None
        if distribution.wall is None
        else Quantity(value=distribution.wall.value, sd=distribution.wall.sd, unit="m", interval95=list(distribution.wall.interval)),
    )


def parts_document(found: PartMasses) -> Parts:
    """Masses and densities of the labelled parts."""
    sd = np.sqrt(np.diag(found.covariance))

    def quantities(i: int, unit: str, per: float) -> Quantity:
        return Quantity(
            value=float(found.masses[i] / per),
            sd=float(sd[i] / per),
            unit=unit,
            interval95=[float(end / per) for end in found.intervals[i]],
            observed=found.observed[i],
        )

    rows = [
        PartResult(name=name, mass=quantities(i, "kg", 1.0), volume_m3=float(volume), density=quantities(i, "kg/m^3", float(volume)))
        for i, (name, volume) in enumerate(zip(found.names, found.volumes, strict=True))
    ]
    return Parts(parts=rows, uniform=found.uniform.tolist(), misfit=found.misfit)


def build_result(
    inputs: ResultInputs,
    motions: Sequence[TipMotion],
    planned: Sequence[PlannedStrike],
    excluded: frozenset[str],
    planes: Sequence[EquiPlane],
    inertial: InertialParameters,
    scale: Scale,
    distribution: MassDistribution,
    com_paper: PaperCentre,
    distribution_paper: PaperRegions | None,
    warnings: Sequence[ResultWarning],
    table_tilt: list[TableTilt] | None = None,
    verdict: list[str] | None = None,
    parts: PartMasses | None = None,
    foretold: Sequence[ForetoldStrike] = (),
    filling: Filling | None = None,
    frame_times: list[FrameTimes] | None = None,
) -> Result:
    """The Result document. `planned` goes with `motions`; `planes` are of the strikes used, in the same order."""
    place = {plane.strike_id: index for index, plane in enumerate(planes)}
    rows = [
        strike_result(motion, strike, planes, place.get(motion.strike_id), inertial.com, scale)
        for motion, strike in zip(motions, planned, strict=True)
    ]
    by_others = {each.told.strike_id: foretold_result(each) for each in foretold}
    rows = [row.model_copy(update={"foretold": by_others.get(row.id)}) for row in rows]
    rows = [
        row.model_copy(update={"verdict": Verdict.EXCLUDED, "reason": f"left out on request ({row.verdict.value})"})
        if row.id in excluded
        else row
        for row in rows
    ]
    return rounded(
        Result(
            inputs=inputs,
            warnings=list(warnings),
            strikes=rows,
            mass=Quantity(
                value=inertial.mass,
                sd=inertial.mass_sd,
                unit="kg",
                interval95=[inertial.mass - SIGMAS95 * inertial.mass_sd, inertial.mass + SIGMAS95 * inertial.mass_sd],
                source="given",
            ),
            centre_of_mass=com_quantity(inertial.com),
            centre_of_mass_paper=Quantity(value=com_paper.position.tolist(), unit="m", frame="O"),
            moments=axis_moments(inertial),
            inertia=inertia_quantity(inertial),
            inertia_measured=inertial.measured.tolist(),
            regions=regions_document(distribution),
            regions_paper=None if distribution_paper is None else _paper_regions(distribution, distribution_paper),
            table_tilt=table_tilt,
            verdict=verdict,
            parameters_covariance=inertial.covariance.tolist(),
            parts=None if parts is None else parts_document(parts),
            filling=filling,
            frame_times=frame_times,
        )
    )


def _paper_regions(distribution: MassDistribution, paper: PaperRegions) -> Regions:
    return Regions(
        regions=[
            RegionResult(name=name, mass=Quantity(value=float(mass), unit="kg"))
            for name, mass in zip(distribution.names, paper.masses, strict=True)
        ],
        border_normal=_clean(paper.border_normal).tolist(),
        border_offset_m=paper.border_offset,
    )


def strike_result(
    motion: TipMotion, planned: PlannedStrike, planes: Sequence[EquiPlane], index: int | None, com: CentreOfMass, scale: Scale
) -> StrikeResult:
    """One row of the table. `index` is the strike's place in `com`'s arrays, None where it was not used."""
    fit = motion.fit
    values: dict[str, Any] = {}
    if fit is not None:
        values["estimator"] = fit.estimator
        values["estimator_note"] = fit.note
        values["phi"] = quantity(fit.phi, math.sqrt(fit.covariance[0, 0]), "rad")
        values["cov_phi_k"] = fit.covariance.tolist()
        values["k"] = _k_quantity(fit)
        values["residual_rms_rad"] = float(np.sqrt(np.mean(fit.residual**2))) if len(fit.residual) else None
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
        used=index is not None,
        weight=0.0 if index is None else float(com.weights[index]),
        energy_ratio=motion.energy_ratio,
        alternatives=[_alternative(other) for other in motion.alternatives],
        **values,
    )


def foretold_result(strike: ForetoldStrike) -> ForetoldResult:
    """What the others foretell of a strike; k as it is where the strike was made."""
    told, motion, worst = strike.told, strike.motion, strike.motion.worst
    phi_sd, k_sd = np.sqrt(np.diag(told.by_others))
    return ForetoldResult(
        phi=quantity(told.phi, float(phi_sd), "rad"),
        k=quantity(motion.k, float(motion.k * k_sd), "rad/s^2", lowest=0.0),
        sigmas=told.sigmas,
        motion_sigmas=strike.motion_sigmas,
        foretold=strike.holds,
        frames=len(motion.time) - motion.start,
        start_frames=motion.start,
        worst_offset_rad=float(motion.offset[worst]),
        worst_band_rad=float(SIGMAS95 * motion.sd[worst]),
        outside_share=motion.outside,
    )


def _k_quantity(fit: MotionFit) -> Quantity | None:
    return None if fit.k is None else quantity(fit.k, math.sqrt(fit.covariance[1, 1]), "rad/s^2")


def _alternative(fit: MotionFit) -> AlternativeFit:
    return AlternativeFit(
        estimator=fit.estimator,
        phi=quantity(fit.phi, math.sqrt(fit.covariance[0, 0]), "rad"),
        k=_k_quantity(fit),
        note=fit.note,
        violated=list(fit.violated),
    )


def rounded(document: D) -> D:
    """The same document with every number cut to SIGNIFICANT_DIGITS."""
    return type(document).model_validate(_round(json.loads(canonical_json(document))))


def result_json(result: Result) -> str:
    """What `analyze estimate --json` prints: one line, sorted keys, the same bytes for the same recording."""
    return canonical_json(result)


def _round(value: Any) -> Any:
    if isinstance(value, float):
        return float(f"{value:.{SIGNIFICANT_DIGITS}g}")
    if isinstance(value, dict):
        return {key: _round(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_round(item) for item in value]
    return value


def _clean(matrix: Array, fraction: float = 1e-9) -> Array:
    """Rounding noise off: entries below `fraction` of the largest become 0."""
    return np.where(np.abs(matrix) < fraction * np.abs(matrix).max(), 0.0, matrix)
