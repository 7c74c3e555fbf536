"""CSV tables of a report: answer, strikes, motions and more, in SI units."""

from __future__ import annotations

from itertools import combinations_with_replacement
from typing import TYPE_CHECKING

import numpy as np

from analyze.report.csv_table import Cell, CsvTable, table_of
from analyze.report.sensitivity_plot import source_rows
from schemas.quantity import Quantity
from schemas.result import Result

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from analyze.pipeline.estimate import Estimate
    from analyze.result.answer import Answer
    from analyze.types import TipMotion


ANSWER_COLUMNS = ("quantity", "value", "sd", "low95", "high95", "unit", "source", "observed")
"""columns of the rows that `answer_rows` yields"""


def report_tables(answer: Answer) -> list[CsvTable]:
    """CSV tables of one estimate, in SI units.

    Returns:
        Tables named answer, strikes, error_sources, motions, recordings and warnings, and regions if the
        result has region masses.
    """
    estimate, result = answer.estimate, answer.result
    rows = source_rows(estimate.sensitivity, estimate.com.covariance)
    tables = [
        CsvTable("answer", ANSWER_COLUMNS, list(answer_rows(result))),
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
        naive = sorted(result.regions.baselines.items())
        columns = ("mass_kg", "sd_kg", "low95_kg", "high95_kg")
        regions = [
            {
                "region": region.name,
                **dict(zip(columns, _scalar(region.mass), strict=True)),
                **{f"naive_{name}_kg": masses[i] for name, masses in naive},
            }
            for i, region in enumerate(result.regions.regions)
        ]
        tables.append(table_of("regions", regions))
    return tables


def _recordings(estimate: Estimate) -> CsvTable:
    """Table of recordings: ids, start time, frame rate, and source and sd of the frame times.

    An imported recording has the frame rate that its file states, or that a calibration drop measured.
    """
    rows: list[dict[str, Cell]] = []
    for number, head in enumerate(estimate.evidence.recordings, 1):
        manifest, camera = head.manifest, head.manifest.cameras[0]
        rows.append(
            {
                "recording": number,
                "recording_id": manifest.recording_id,
                "created": manifest.created,
                "frame_rate_hz": camera.frame_rate_hz,
                "frame_rate_sd_hz": camera.frame_rate_sd_hz,
                "time_source": manifest.time_source.value,
                "time_sd_s": 1e-9 * manifest.time_source_sd_ns,
            }
        )
    return table_of("recordings", rows)


def answer_rows(result: Result) -> Iterator[Sequence[Cell]]:
    """Yield one row per scalar of a result: name, value, sd, low95, high95, unit, source, observed.

    sd is the standard deviation, low95 and high95 the ends of the 95 % interval, None if not known. source is
    "measured" by the strikes, "prior" (assumed before any strike) or "given" in the object file. observed is
    False if no strike determines the quantity.
    """
    yield _row("mass", result.mass)
    yield from _each("centre_of_mass", "xyz", result.centre_of_mass)
    for moment in result.moments:
        yield _row(f"i_com {moment.axis_id}", moment.i_com)
        yield _row(f"i_edge {moment.axis_id}", moment.i_edge)
    measured = result.inertia_measured or [[result.inertia.observed] * 3] * 3
    values, sd, ends = np.array(result.inertia.value).ravel(), result.inertia.sd, result.inertia.interval95
    for i, j in combinations_with_replacement(range(3), 2):
        n, name = 3 * i + j, f"inertia_{'xyz'[i]}{'xyz'[j]}"
        source = "measured" if measured[i][j] else "prior"
        low, high = np.array(ends[n]).tolist() if isinstance(ends, list) else (None, None)
        spread = sd[n] if isinstance(sd, list) else None
        yield name, float(values[n]), spread, low, high, "kg m^2", source, measured[i][j]
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
    for edge in result.edge_radii or []:
        yield _row(f"edge_radius {edge.axis_id}", edge.radius)


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


def _value_and_sd(name: str, unit: str, quantity: Quantity | None) -> dict[str, Cell]:
    value, sd, _, _ = _scalar(quantity)
    return {f"{name}_{unit}": value, f"{name}_sd_{unit}": sd}


def _strikes(answer: Answer) -> CsvTable:
    influences = {each.strike_id: each.by_phi.tolist() for each in answer.estimate.sensitivity.strikes}
    rows: list[dict[str, Cell]] = []
    for strike in answer.result.strikes:
        com_by_phi = influences.get(strike.id, (None, None, None))
        rows.append(
            {
                "strike": strike.id,
                "axis": strike.axis_id,
                "plane": strike.plane_id,
                "heading_rad": strike.heading_rad,
                "verdict": strike.verdict.value,
                "reason": strike.reason,
                "choice": strike.choice,
                "used": strike.used,
                "information_share": strike.information_share,
                "estimator": strike.estimator,
                **_value_and_sd("phi", "rad", strike.phi),
                **_value_and_sd("k", "rad_s2", strike.k),
                **_value_and_sd("i_edge", "kg_m2", strike.i_edge),
                "energy_ratio": strike.energy_ratio,
                "residual_rms_rad": strike.residual_rms_rad,
                "plane_residual_m": strike.equiplane_residual_m,
                "consistent": None if strike.prediction is None else strike.prediction.consistent,
                **{f"com_{axis}_by_phi_m_rad": by for axis, by in zip("xyz", com_by_phi, strict=True)},
            }
        )
    return table_of("strikes", rows)


def _motions(motions: Sequence[TipMotion]) -> CsvTable:
    """Table of the tipping angle theta(t) of every strike with a tracked marker, one row per frame.

    Columns: id of the strike, log time [ns], time [s], name of the phase, theta with its standard deviation,
    fitted theta, and residual (measured minus fitted), angles in rad. Time 0 is that of the fit's initial
    state, or the first frame if there is no fit. The phase is empty if unknown or for a frame outside all
    phases. Fitted angle and residual are None outside the fit's window.
    """
    rows: list[dict[str, Cell]] = []
    for motion in motions:
        angle, fit = motion.angle, motion.fit
        if angle is None:
            continue
        zero = int(angle.time_ns[0]) if fit is None else fit.time0_ns
        start, stop = (0, 0) if fit is None else fit.window
        for i, moment in enumerate(angle.time_ns.tolist()):
            theta = float(angle.theta[i])
            residual = float(fit.residual[i - start]) if fit is not None and start <= i < stop else None
            rows.append(
                {
                    "strike": motion.strike_id,
                    "log_time_ns": moment,
                    "time_s": round((moment - zero) * 1e-9, 9),
                    "phase": _phase(motion, i),
                    "theta_rad": theta,
                    "sd_rad": float(angle.sd[i]),
                    "fitted_rad": None if residual is None else theta - residual,
                    "residual_rad": residual,
                }
            )
    return table_of("motions", rows)


def _phase(motion: TipMotion, frame: int) -> str:
    if motion.phases is None:
        return ""
    spans = motion.phases.spans().items()
    return next((name for name, (start, stop) in spans if start <= frame < stop), "")
