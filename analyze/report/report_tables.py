"""CSV tables of a report: answer, strikes, motions and more, in SI units."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from analyze.report.csv_table import Cell, CsvTable
from analyze.report.sensitivity_plot import source_rows
from analyze.types import PHASE_NAMES
from schemas.quantity import Quantity
from schemas.result import Result

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from analyze.pipeline.estimate import Estimate
    from analyze.result.answer import Answer
    from analyze.types import TipMotion


def report_tables(answer: Answer) -> list[CsvTable]:
    """CSV tables of one estimate, in SI units.

    Returns:
        Tables named answer, strikes, error_sources, motions, recordings and warnings, and regions if the
        result has any.
    """
    estimate, result = answer.estimate, answer.result
    columns = ["quantity", "value", "sd", "low95", "high95", "unit", "source", "observed"]
    rows = source_rows(estimate.sensitivity, estimate.com.covariance)
    tables = [
        CsvTable("answer", columns, list(answer_rows(result))),
        _strikes(answer),
        CsvTable(
            "error_sources",
            ["source", "half95_worst_m", "share_of_variance"],
            [(row.source.value, row.half, row.share) for row in rows],
        ),
        _motions(estimate.evidence.motions),
        _recordings(estimate),
        CsvTable("warnings", ["code", "text"], [(each.code.value, each.text) for each in result.warnings]),
    ]
    if result.regions is not None:
        naive = sorted(result.regions.baselines)
        tables.append(
            CsvTable(
                "regions",
                [
                    "region",
                    "mass_kg",
                    "sd_kg",
                    "low95_kg",
                    "high95_kg",
                    *(f"naive_{name}_kg" for name in naive),
                ],
                [
                    (
                        region.name,
                        *_scalar(region.mass),
                        *(result.regions.baselines[name][i] for name in naive),
                    )
                    for i, region in enumerate(result.regions.regions)
                ],
            )
        )
    return tables


def _recordings(estimate: Estimate) -> CsvTable:
    """Table of recordings: ids, start time, frame rate, and source and sd of the frame times.

    An imported recording has the frame rate that its file states, or that a calibration drop measured.
    """
    rows: list[Sequence[Cell]] = []
    for number, head in enumerate(estimate.evidence.recordings, 1):
        manifest, camera = head.manifest, head.manifest.cameras[0]
        times = manifest.time_source.value, 1e-9 * manifest.time_source_sd_ns
        rows.append(
            (
                number,
                manifest.recording_id,
                manifest.created,
                camera.frame_rate_hz,
                camera.frame_rate_sd_hz,
                *times,
            )
        )
    columns = [
        "recording",
        "recording_id",
        "created",
        "frame_rate_hz",
        "frame_rate_sd_hz",
        "time_source",
        "time_sd_s",
    ]
    return CsvTable("recordings", columns, rows)


def answer_rows(result: Result) -> Iterator[Sequence[Cell]]:
    """Yield one row per scalar of a result: name, value, sd, low95, high95, unit, source, observed.

    sd is the standard deviation, low95 and high95 the ends of the 95 % interval, all None if not known;
    source is measured, prior or given.
    """
    yield _row("mass", result.mass)
    yield from _each("centre_of_mass", "xyz", result.centre_of_mass)
    for moment in result.moments:
        yield _row(f"i_com {moment.axis_id}", moment.i_com)
        yield _row(f"i_edge {moment.axis_id}", moment.i_edge)
    measured = result.inertia_measured or [[result.inertia.observed] * 3] * 3
    values, sd, ends = np.array(result.inertia.value).ravel(), result.inertia.sd, result.inertia.interval95
    for i in range(3):
        for j in range(i, 3):
            n = 3 * i + j
            source = "measured" if measured[i][j] else "prior"
            low, high = np.array(ends[n]).tolist() if isinstance(ends, list) else (None, None)
            spread = sd[n] if isinstance(sd, list) else None
            yield (
                f"inertia_{'xyz'[i]}{'xyz'[j]}",
                float(values[n]),
                spread,
                low,
                high,
                "kg m^2",
                source,
                measured[i][j],
            )
    for region in result.regions.regions if result.regions is not None else []:
        yield _row(f"mass {region.name}", region.mass)
    for part in result.parts.parts if result.parts is not None else []:
        yield _row(f"mass {part.name}", part.mass)
        yield _row(f"density {part.name}", part.density)
    if result.filling is not None:
        for name in ("level", "filled_share", "mass", "density", "shell"):
            yield _row(f"filling {name}", getattr(result.filling, name))
    for number, tilt in enumerate(result.table_tilt or [], 1):
        yield _row(f"table_tilt_x {number}", tilt.towards_x)
        yield _row(f"table_tilt_y {number}", tilt.towards_y)


def _row(name: str, quantity: Quantity) -> Sequence[Cell]:
    return name, *_scalar(quantity), quantity.unit, quantity.source, quantity.observed


def _each(name: str, axes: str, vector: Quantity) -> Iterator[Sequence[Cell]]:
    columns = (np.array(each).tolist() for each in (vector.value, vector.sd, vector.interval95))
    for axis, value, sd, (low, high) in zip(axes, *columns, strict=True):
        yield f"{name}_{axis}", value, sd, low, high, vector.unit, vector.source, vector.observed


def _scalar(quantity: Quantity | None) -> tuple[Cell, Cell, Cell, Cell]:
    """Value, sd and both ends of the 95 % interval of a scalar; all None if there is no scalar."""
    if quantity is None or isinstance(quantity.value, list):
        return None, None, None, None
    low, high = quantity.interval_ends() if quantity.interval95 else (None, None)
    sd = quantity.sd
    return quantity.value, None if isinstance(sd, list) else sd, low, high


def _strikes(answer: Answer) -> CsvTable:
    influences = {each.strike_id: each.by_phi.tolist() for each in answer.estimate.sensitivity.strikes}
    rows: list[Sequence[Cell]] = []
    for strike in answer.result.strikes:
        phi, k, i_edge, prediction = strike.phi, strike.k, strike.i_edge, strike.prediction
        rows.append(
            (
                *(
                    strike.id,
                    strike.axis_id,
                    strike.plane_id,
                    strike.heading_rad,
                    strike.verdict.value,
                    strike.reason,
                    strike.used,
                ),
                *(
                    strike.information_share,
                    strike.estimator,
                    *_scalar(phi)[:2],
                    *_scalar(k)[:2],
                    *_scalar(i_edge)[:2],
                    strike.energy_ratio,
                ),
                *(
                    strike.residual_rms_rad,
                    strike.equiplane_residual_m,
                    None if prediction is None else prediction.consistent,
                ),
                *influences.get(strike.id, (None, None, None)),
            )
        )
    return CsvTable(
        "strikes",
        [
            *(
                "strike",
                "axis",
                "plane",
                "heading_rad",
                "verdict",
                "reason",
                "used",
                "information_share",
                "estimator",
                "phi_rad",
                "phi_sd_rad",
            ),
            *(
                "k_rad_s2",
                "k_sd_rad_s2",
                "i_edge_kg_m2",
                "i_edge_sd_kg_m2",
                "energy_ratio",
                "residual_rms_rad",
                "plane_residual_m",
                "consistent",
            ),
            *(f"com_{axis}_by_phi_m_rad" for axis in "xyz"),
        ],
        rows,
    )


def _motions(motions: Sequence[TipMotion]) -> CsvTable:
    """Table of the tipping angle theta(t) of every strike, one row per frame.

    Time 0 is the start of the fit, or the first frame if there is no fit.
    """
    rows: list[Sequence[Cell]] = []
    for motion in motions:
        angle, fit = motion.angle, motion.fit
        if angle is None:
            continue
        zero = int(angle.time_ns[0]) if fit is None else fit.time0_ns
        start, stop = (0, 0) if fit is None else fit.window
        for i, moment in enumerate(angle.time_ns.tolist()):
            theta, inside = float(angle.theta[i]), start <= i < stop
            residual = (
                float(fit.residual[i - start]) if fit is not None and inside and len(fit.residual) else None
            )
            fitted = None if residual is None else theta - residual
            time_s = round((moment - zero) * 1e-9, 9)
            rows.append(
                (
                    motion.strike_id,
                    moment,
                    time_s,
                    _phase(motion, i),
                    theta,
                    float(angle.sd[i]),
                    fitted,
                    residual,
                )
            )
    return CsvTable(
        "motions",
        ["strike", "log_time_ns", "time_s", "phase", "theta_rad", "sd_rad", "fitted_rad", "residual_rad"],
        rows,
    )


def _phase(motion: TipMotion, frame: int) -> str:
    if motion.phases is None:
        return ""
    spans = ((name, getattr(motion.phases, name)) for name in PHASE_NAMES)
    return next((name for name, span in spans if span is not None and span[0] <= frame < span[1]), "")
