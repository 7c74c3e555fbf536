"""Result document of an estimate: values with units and 95 % intervals, rounded to stable bytes."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from analyze.pipeline.filling import filling_label
from analyze.result.assessment import assessment
from analyze.result.contact import contact_document
from analyze.result.contents import contents_document
from analyze.result.filling import filling_document, filling_warnings
from analyze.result.fixture import fixture_document
from analyze.result.flight import flight_document
from analyze.result.frame_times import frame_times_documents
from analyze.result.quantities import (
    com_quantity,
    inertia_quantity,
    quantity,
    without_rounding_noise,
)
from analyze.result.radius import radius_documents
from analyze.result.rounding import rounded
from analyze.result.strike_rows import prediction_document, strike_result
from analyze.result.tilt import table_tilts
from analyze.result.trust import robustness_documents
from analyze.result.warnings import result_warnings
from schemas.document import sha256_text
from schemas.edge_names import edge_names
from schemas.quantity import Quantity
from schemas.result import (
    AxisMoment,
    PartResult,
    Parts,
    RegionResult,
    Regions,
    Result,
)
from schemas.result_inputs import JoinedRecording, ResultInputs
from schemas.strike_result import StrikeResult, Verdict

if TYPE_CHECKING:
    from analyze.estimation.mass_properties import InertialParameters, MassDistribution
    from analyze.estimation.paper import PaperRegions
    from analyze.estimation.part_masses import PartMasses
    from analyze.pipeline.estimate import Estimate, EstimateOptions
    from analyze.pipeline.evidence import Evidence


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
            centre_of_mass_paper=(
                None
                if estimate.paper is None
                else Quantity(value=estimate.paper.com.position.tolist(), unit="m", frame="O")
            ),
            moments=axis_moments(inertial),
            inertia=inertia_quantity(inertial),
            inertia_measured=inertial.measured.tolist(),
            regions=regions_document(estimate.distribution),
            regions_paper=(
                None
                if estimate.paper is None
                else _paper_regions(estimate.distribution, estimate.paper.regions)
            ),
            table_tilt=table_tilts(inertial.com, evidence) if estimate.fitted_planes else None,
            edge_radii=radius_documents(estimate.edge_radii),
            verdict=assessment(estimate, frame_times),
            parameters_covariance=inertial.covariance.tolist(),
            parts=None if estimate.parts is None else parts_document(estimate.parts),
            filling=filling,
            frame_times=frame_times or None,
            fixture=fixture_document(estimate.fixture),
            contents=contents_document(estimate.contents, _half_extent(evidence)),
            contact_properties=contact_document(evidence.spec.name, estimate.contact),
            flight=flight_document(estimate),
            robustness=robustness_documents(estimate) or None,
        )
    )


def _half_extent(evidence: Evidence) -> float:
    """Half the largest extent [m] of the body that was struck, along an axis of the object frame O."""
    low, high = evidence.model.bounds
    return 0.5 * float(np.max(np.asarray(high) - low))


def _strike_rows(estimate: Estimate) -> list[StrikeResult]:
    """Entries of all strikes in the Result document, in recording order.

    The entry of a strike used includes its prediction (balance angle, rate constant and motion) from the
    other strikes, if these can check it. An excluded strike has verdict EXCLUDED, and its own verdict in the
    reason.
    """
    evidence, planes = estimate.evidence, estimate.fitted_planes
    index = {plane.strike_id: i for i, plane in enumerate(planes)}
    predictions = {each.left_out.strike_id: prediction_document(each) for each in estimate.predictions}
    names = edge_names(evidence.planned(motion) for motion in evidence.motions)
    rows: list[StrikeResult] = []
    for motion in evidence.motions:
        row = strike_result(
            motion,
            evidence.planned(motion),
            planes,
            index.get(motion.strike_id),
            estimate.com,
            estimate.solved_scale,
            estimate.edge_radii,
        )
        found = {"prediction": predictions.get(row.id), "edge_name": names[row.axis_id]}
        row = row.model_copy(update={**found, "choice": evidence.choices.get(row.id)})
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


def axis_moments(parameters: InertialParameters) -> list[AxisMoment]:
    """Two moments of inertia [kg m²] for each pivot axis, in the order of `parameters.axes`.

    One is about the line of contact at balance, one about its parallel through the centre of mass. Both have
    95 % intervals; that of the second is cut at 0.
    """
    return [
        AxisMoment(
            axis_id=axis.axis_id,
            direction=axis.direction.tolist(),
            i_edge=quantity(axis.i_edge, axis.i_edge_sd, "kg m^2", interval=axis.i_edge_interval),
            i_com=quantity(axis.i_com, axis.i_com_sd, "kg m^2", lowest=0.0, interval=axis.i_com_interval),
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
                observed=distribution.shell.observed,
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
        """Value, sd and 95 % interval, in `unit`, of the mass of labelled part `i` divided by `per`.

        `per` is 1 for the mass [kg], and the part's volume [m³] for the density.
        """
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
        dividing_plane_normal=without_rounding_noise(paper.dividing_plane_normal).tolist(),
        dividing_plane_offset_m=paper.dividing_plane_offset,
    )
