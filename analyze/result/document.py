"""Result document of an estimate: values with units and 95 % intervals, rounded to stable bytes."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from analyze.estimation.inertia import edge_inertia
from analyze.least_squares.intervals import SIGMAS_95
from analyze.pipeline.filling import filling_label
from analyze.result.assessment import assessment
from analyze.result.filling import filling_document, filling_warnings
from analyze.result.frame_times import frame_times_documents
from analyze.result.rounding import rounded
from analyze.result.tilt import table_tilts
from analyze.result.warnings import result_warnings
from schemas.document import sha256_text
from schemas.quantity import Quantity
from schemas.result import (
    AxisMoment,
    JoinedRecording,
    PartResult,
    Parts,
    RegionResult,
    Regions,
    Result,
    ResultInputs,
)
from schemas.strike_result import AlternativeFit, PredictionResult, StrikeResult, Verdict

if TYPE_CHECKING:
    from collections.abc import Sequence

    from analyze.estimation.paper import PaperRegions
    from analyze.estimation.part_masses import PartMasses
    from analyze.estimation.priors import Scale
    from analyze.pipeline.estimate import Estimate, EstimateOptions
    from analyze.pipeline.evidence import Evidence
    from analyze.pipeline.prediction import StrikePrediction
    from analyze.types import (
        Array,
        CentreOfMass,
        EquiPlane,
        InertialParameters,
        MassDistribution,
        MotionFit,
        TipMotion,
    )
    from schemas.strike_plan import PlannedStrike


def result_document(estimate: Estimate) -> Result:
    """Result document of an estimate: its values with units and 95 % intervals, warnings and a verdict.

    The values are rounded, so that the same estimate gives the same bytes.
    """
    evidence, inertial = estimate.evidence, estimate.inertial
    frame_times = frame_times_documents(estimate.frame_rates)
    label = filling_label(evidence)
    filling = (
        None if estimate.filling is None or label is None else filling_document(label.name, estimate.filling)
    )
    return rounded(
        Result(
            inputs=_inputs(evidence, estimate.options),
            warnings=[*result_warnings(estimate, frame_times), *filling_warnings(filling)],
            strikes=_strike_rows(estimate),
            mass=quantity(inertial.mass, inertial.mass_sd, "kg").model_copy(update={"source": "given"}),
            centre_of_mass=com_quantity(inertial.com),
            centre_of_mass_paper=Quantity(value=estimate.paper.com.position.tolist(), unit="m", frame="O"),
            moments=axis_moments(inertial),
            inertia=inertia_quantity(inertial),
            inertia_measured=inertial.measured.tolist(),
            regions=regions_document(estimate.distribution),
            regions_paper=_paper_regions(estimate.distribution, estimate.paper.regions),
            table_tilt=table_tilts(inertial.com, evidence),
            verdict=assessment(estimate, frame_times),
            parameters_covariance=inertial.covariance.tolist(),
            parts=None if estimate.parts is None else parts_document(estimate.parts),
            filling=filling,
            frame_times=frame_times or None,
        )
    )


def _strike_rows(estimate: Estimate) -> list[StrikeResult]:
    """Entries of all strikes in the Result document, in recording order.

    The entry of a strike used includes its prediction from the other strikes. An excluded strike has verdict
    EXCLUDED, and its own verdict in the reason.
    """
    evidence, planes = estimate.evidence, estimate.fitted_planes
    index = {plane.strike_id: i for i, plane in enumerate(planes)}
    predictions = {each.left_out.strike_id: prediction_document(each) for each in estimate.predictions}
    rows: list[StrikeResult] = []
    for motion in evidence.motions:
        row = strike_result(
            motion,
            evidence.planned(motion),
            planes,
            index.get(motion.strike_id),
            estimate.com,
            estimate.solved_scale,
        )
        row = row.model_copy(update={"prediction": predictions.get(row.id)})
        if row.id in estimate.options.exclude:
            row = row.model_copy(
                update={"verdict": Verdict.EXCLUDED, "reason": f"left out on request ({row.verdict.value})"}
            )
        rows.append(row)
    return rows


def _inputs(evidence: Evidence, options: EstimateOptions) -> ResultInputs:
    """Identity of the inputs of a result: ids and hashes of recordings, object, plan and settings."""
    recordings = evidence.recordings
    plans = sorted({each.manifest.plan_sha256 for each in recordings})
    return ResultInputs(
        recording_id=" + ".join(each.manifest.recording_id for each in recordings),
        content_id=(
            recordings[0].content_id
            if len(recordings) == 1
            else sha256_text("\n".join(sorted(each.content_id for each in recordings)))
        ),
        object_sha256=evidence.object_sha256,
        plan_sha256=plans[0] if len(plans) == 1 else sha256_text("\n".join(plans)),
        configuration_sha256=sha256_text(f"{sorted(options.exclude)} {options.estimator} {options.seed}"),
        software=evidence.software,
        recordings=(
            None
            if len(recordings) == 1
            else [
                JoinedRecording(
                    number=number,
                    recording_id=each.manifest.recording_id,
                    content_id=each.content_id,
                    created=each.manifest.created,
                    plan_sha256=each.manifest.plan_sha256,
                )
                for number, each in enumerate(recordings, 1)
            ]
        ),
    )


def quantity(value: float, sd: float, unit: str, lowest: float | None = None) -> Quantity:
    """Scalar in the Result's form, marked as observed, with its 95 % interval, value ± 1.96 sd.

    Args:
        value: value in `unit`.
        sd: standard deviation of the value.
        unit: name of the unit.
        lowest: bound below which the interval is cut, as 0 for a moment of inertia; None for no bound.
    """
    low = value - SIGMAS_95 * sd
    return Quantity(
        value=value,
        sd=sd,
        unit=unit,
        interval95=[low if lowest is None else max(low, lowest), value + SIGMAS_95 * sd],
        observed=True,
    )


def com_quantity(com: CentreOfMass) -> Quantity:
    """Centre of mass (3,) [m] in the Result's form, with 95 % intervals and covariance (3, 3) [m²].

    The frame is the object frame O. The entry for the unobserved direction is None if the strikes determine
    all three coordinates.
    """
    sd = np.sqrt(np.diag(com.covariance))
    return Quantity(
        value=com.position.tolist(),
        unit="m",
        sd=sd.tolist(),
        covariance=com.covariance.tolist(),
        interval95=_intervals(com.position, sd),
        frame="O",
        observed=com.observed,
        unobserved_direction=(
            None if com.unobserved_direction is None else com.unobserved_direction.tolist()
        ),
    )


def inertia_quantity(parameters: InertialParameters) -> Quantity:
    """Inertia tensor (3, 3) [kg m²] in the Result's form, with standard deviations and 95 % intervals.

    It is about the centre of mass, with the axes of the object frame O. Standard deviations and intervals are
    listed by rows, nine each. The tensor counts as observed, with source "measured", only if strikes
    determine every entry; otherwise its source is "prior".
    """
    value, sd = _clean(parameters.inertia), parameters.inertia_sd
    every = bool(parameters.measured.all())
    return Quantity(
        value=value.tolist(),
        unit="kg m^2",
        sd=sd.ravel().tolist(),
        interval95=_intervals(value.ravel(), sd.ravel()),
        frame="O",
        observed=every,
        source="measured" if every else "prior",
    )


def _intervals(values: Array, sd: Array) -> list[list[float]]:
    """95 % intervals [low, high] of n values (n,) with standard deviations `sd` (n,), one per value."""
    return np.stack([values - SIGMAS_95 * sd, values + SIGMAS_95 * sd], axis=1).tolist()


def axis_moments(parameters: InertialParameters) -> list[AxisMoment]:
    """Two moments of inertia [kg m²] for each pivot axis, in the order of `parameters.axes`.

    One is about the line of contact at balance, one about its parallel through the centre of mass. Both have
    95 % intervals; that of the second is cut at 0.
    """
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
    """Masses [kg] of the shell and the two interior parts with 95 % intervals, in the Result's form.

    The entry also holds the plane that divides the interior, in the object frame O, naive answers for
    comparison, and the shell's thickness [m], None where it was not estimated.
    """
    sd = np.sqrt(np.diag(distribution.covariance))
    return Regions(
        regions=[
            RegionResult(
                name=name,
                mass=Quantity(
                    value=float(distribution.masses[i]),
                    sd=float(sd[i]),
                    unit="kg",
                    interval95=distribution.intervals[i].tolist(),
                ),
                limits_kg=distribution.limits[i].tolist(),
            )
            for i, name in enumerate(distribution.names)
        ],
        dividing_plane_normal=distribution.dividing_plane_normal.tolist(),
        dividing_plane_offset_m=distribution.dividing_plane_offset,
        dividing_plane_offset_interval95_m=list(distribution.dividing_plane_offset_interval),
        baselines={name: masses.tolist() for name, masses in distribution.baselines.items()},
        explained=distribution.explained,
        shell_thickness=(
            None
            if distribution.shell is None
            else Quantity(
                value=distribution.shell.value,
                sd=distribution.shell.sd,
                unit="m",
                interval95=list(distribution.shell.interval),
            )
        ),
    )


def parts_document(found: PartMasses) -> Parts:
    """Masses [kg] and densities [kg/m³] of the object's labelled parts with 95 % intervals.

    The entry also holds the parts' volumes [m³], the naive answer (masses [kg] with one density for all
    parts), and the misfit: rms of the moments' residuals over their sd.
    """
    sd = np.sqrt(np.diag(found.covariance))

    def quantities(i: int, unit: str, per: float) -> Quantity:
        """Mass of part `i` divided by `per`: 1 for the mass [kg], the volume [m³] for the density."""
        return Quantity(
            value=float(found.masses[i] / per),
            sd=float(sd[i] / per),
            unit=unit,
            interval95=[float(end / per) for end in found.intervals[i]],
            observed=found.observed[i],
        )

    rows = [
        PartResult(
            name=name,
            mass=quantities(i, "kg", 1.0),
            volume_m3=float(volume),
            density=quantities(i, "kg/m^3", float(volume)),
        )
        for i, (name, volume) in enumerate(zip(found.names, found.volumes, strict=True))
    ]
    return Parts(parts=rows, uniform=found.uniform.tolist(), misfit=found.misfit)


def _paper_regions(distribution: MassDistribution, paper: PaperRegions | None) -> Regions | None:
    """Masses [kg] of shell and interior parts, and dividing plane, by the paper's method (VISAPP 2013).

    The masses have no sd and no intervals; the plane is in the object frame O. None if the method found no
    masses. `distribution` gives the regions' names.
    """
    if paper is None:
        return None
    return Regions(
        regions=[
            RegionResult(name=name, mass=Quantity(value=float(mass), unit="kg"))
            for name, mass in zip(distribution.names, paper.masses, strict=True)
        ],
        dividing_plane_normal=_clean(paper.dividing_plane_normal).tolist(),
        dividing_plane_offset_m=paper.dividing_plane_offset,
    )


def strike_result(
    motion: TipMotion,
    planned: PlannedStrike,
    planes: Sequence[EquiPlane],
    index: int | None,
    com: CentreOfMass,
    scale: Scale,
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

    Returns:
        Entry of the strike. The values of the fit (balance angle, rate constant k, residual rms) are None
        without a fit. The distance [m] of the centre of mass from the strike's equi-plane is None if the
        strike was not used; I_edge [kg m²] is None if the strike or its k was not used.
    """
    fit = motion.fit
    values: dict[str, Any] = {}
    if fit is not None:
        values["estimator"] = fit.estimator
        values["estimator_note"] = fit.note
        values["phi"] = quantity(fit.phi, math.sqrt(fit.covariance[0, 0]), "rad")
        values["cov_phi_k"] = fit.covariance.tolist()
        values["k"] = _k_quantity(fit)
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
        used=index is not None,
        information_share=0.0 if index is None else float(com.weights[index]),
        energy_ratio=motion.energy_ratio,
        alternatives=[_alternative(other) for other in motion.alternatives],
        **values,
    )


def prediction_document(prediction: StrikePrediction) -> PredictionResult:
    """Prediction of a strike from all others, in the Result's form: balance angle, k, tipping angle.

    k is the rate constant of the motion [rad/s²], for gravity at the place where the strike was made. Balance
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


def _k_quantity(fit: MotionFit) -> Quantity | None:
    """Fitted rate constant k [rad/s²] with its 95 % interval; None if the estimator does not report k."""
    return None if fit.k is None else quantity(fit.k, math.sqrt(fit.covariance[1, 1]), "rad/s^2")


def _alternative(fit: MotionFit) -> AlternativeFit:
    """Entry of a strike's fit by a further estimator: balance angle [rad], k, violated assumptions.

    k is the rate constant of the motion [rad/s²], None if the estimator does not report it.
    """
    return AlternativeFit(
        estimator=fit.estimator,
        phi=quantity(fit.phi, math.sqrt(fit.covariance[0, 0]), "rad"),
        k=_k_quantity(fit),
        note=fit.note,
        violated=list(fit.violated),
    )


def _clean(matrix: Array) -> Array:
    """Copy of an array without rounding noise: entries of a size below 1e-9 of the largest are set to 0."""
    return np.where(np.abs(matrix) < 1e-9 * np.abs(matrix).max(), 0.0, matrix)
