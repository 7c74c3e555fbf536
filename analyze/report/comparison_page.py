"""Comparison of repeated sessions of one object as one HTML page, as JSON and as CSV tables.

A session is one recording of the object; `analyze report --compare` writes the page.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from analyze.report.comparison_document import comparison_document
from analyze.report.comparison_plots import angles_figures, forest_figure
from analyze.report.csv_table import Cell, CsvTable, table_of
from analyze.report.page import figure_element, manifest_time, page_environment, sentence
from analyze.report.summary import DEGREES
from analyze.result.digits import inertia_unit
from analyze.result.headline import edge_labels
from schemas.document import canonical_json
from schemas.output_file import write_text
from schemas.wording import counted

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence
    from pathlib import Path

    from analyze.result.comparison import SessionComparison
    from schemas.comparison import Comparison, QuantityPrecision, SessionAnswer


@dataclass(frozen=True)
class _Shown:
    """Title, unit and digits of one kind of quantity on the comparison page, such as the centre of mass."""

    title: str
    unit: str
    """unit shown"""
    factor: float
    """conversion from SI to `unit`"""
    digits: int
    """digits after the point"""


def shown_kinds(document: Comparison) -> dict[str, _Shown]:
    """Title, unit and digits of each kind of quantity, in the page's order; moments share one unit."""
    unit = inertia_unit([abs(each.mean) for each in document.precision if each.kind == "moment"])
    title = "Moments of inertia about the centre of mass"
    return {
        "centre_of_mass": _Shown("Centre of mass", "mm", 1e3, 3),
        "moment": _Shown(title, unit.label, unit.factor, 4),
        "region": _Shown("Region masses", "g", 1e3, 2),
        "phi": _Shown("Balance angle φ, by planned strike", "°", DEGREES, 3),
    }


def comparison_json(compared: SessionComparison) -> str:
    """Comparison document of repeated sessions as one line of JSON."""
    return canonical_json(comparison_document(compared))


def write_comparison(compared: SessionComparison, output: Path) -> None:
    """Write the comparison page as one HTML file, which appears when it is complete.

    Raises:
        OutputError: the file cannot be written.
    """
    write_text(output, render_comparison(compared))


def render_comparison(compared: SessionComparison) -> str:
    """Comparison page of repeated sessions as HTML text."""
    document = comparison_document(compared)
    odd = compared.outlier
    names = [f"session {number}" for number in range(1, len(document.sessions) + 1)]
    shown = shown_kinds(document)
    labels = edge_labels(compared.joint.result)
    rows_of = {kind: [each for each in document.precision if each.kind == kind] for kind in shown}
    by_kind = {kind: [_named(row, labels) for row in rows] for kind, rows in rows_of.items()}
    titles = {axis_id: label.removesuffix(f" ({axis_id})") for axis_id, label in labels.items()}
    drawn = {kind: [_named(row, titles) for row in rows] for kind, rows in rows_of.items()}
    forests = {
        kind: [
            figure_element(forest_figure(row, names, shown[kind].factor, shown[kind].unit, odd))
            for row in rows
        ]
        for kind, rows in drawn.items()
        if rows and kind != "phi"
    }
    return (
        page_environment()
        .get_template("comparison.html")
        .render(
            document=document,
            shown=shown,
            by_kind=by_kind,
            forests=forests,
            angles=[figure_element(figure) for figure in angles_figures(drawn["phi"], names, odd)],
            setups=max(session.setup for session in document.sessions),
            created=[manifest_time(session.recording.created) for session in document.sessions],
            lead=comparison_summary(document),
            distance_r=_distance([each.s_r for each in by_kind["centre_of_mass"]]),
            distance_R=_distance([each.s_R for each in by_kind["centre_of_mass"]]),
        )
    )


def _named(row: QuantityPrecision, edges: Mapping[str, str]) -> QuantityPrecision:
    """Copy of a row whose name begins with a capital letter, and has the name of its edge, if it has one.

    Args:
        row: row of a moment ("I p2e0"), a balance angle ("φ p2e0 at 180°") or another quantity.
        edges: names of the edges by id of the pivot axis.
    """
    name = row.name
    if row.kind in {"moment", "phi"}:
        axis_id, at, heading = name.split(" ", 1)[1].partition(" at ")
        name = f"{edges.get(axis_id, axis_id)}{at}{heading}"
    return row.model_copy(update={"name": sentence(name)})


def comparison_summary(document: Comparison) -> str:
    """Summary of a comparison in two sentences: agreement, and repeatability [mm] of the centre of mass.

    Repeatability is the standard deviation within one set-up, across set-ups, or both, where known.
    """
    of_c = [each for each in document.precision if each.kind == "centre_of_mass"]
    s_r, s_R = _distance([each.s_r for each in of_c]), _distance([each.s_R for each in of_c])
    parts = [
        f"{1e3 * value:.2g}\u00a0mm {under}"
        for value, under in ((s_r, "in one set-up (s_r)"), (s_R, "across set-ups (s_R)"))
        if value is not None
    ]
    odd = next((number for number, session in enumerate(document.sessions, 1) if session.stands_out), None)
    agree = "agree" if document.may_join else "do not agree"
    text = f"The {counted(len(document.sessions), 'session')} {agree}" + (
        f"; session {odd} stands out" if odd is not None else ""
    )
    return f"{text}. The centre of mass repeats to {' and '.join(parts)}."


def comparison_tables(compared: SessionComparison) -> list[CsvTable]:
    """Three CSV tables of a comparison of sessions, in SI units: "sessions", "precision", "results".

    "sessions" has a row per session; "precision" a row per quantity, with the standard deviations of its
    repeated results; "results" a row per single result from which these were computed.
    """
    document = comparison_document(compared)
    return [
        table_of("sessions", [_session_record(session) for session in document.sessions]),
        table_of("precision", [_precision_record(each) for each in document.precision]),
        table_of("results", [record for each in document.precision for record in _result_records(each)]),
    ]


def _session_record(session: SessionAnswer) -> dict[str, Cell]:
    recording, com = session.recording, session.centre_of_mass
    values, sd = np.array(com.value).tolist(), np.array(com.sd).tolist()
    return {
        "session": recording.number,
        "files": " ".join(recording.files),
        "recording_id": recording.recording_id,
        "created": recording.created,
        "setup": session.setup,
        "strikes": session.strikes,
        "strikes_used": session.strikes_used,
        **{f"c_{axis}_m": value for axis, value in zip("xyz", values, strict=True)},
        **{f"c_{axis}_sd_m": value for axis, value in zip("xyz", sd, strict=True)},
        **session.against_others.model_dump(),
        "stands_out": session.stands_out,
    }


def _precision_record(quantity: QuantityPrecision) -> dict[str, Cell]:
    return {
        "quantity": quantity.name,
        **quantity.model_dump(exclude={"name", "sessions", "together", "mandel_h"}),
    }


def _result_records(quantity: QuantityPrecision) -> Iterator[dict[str, Cell]]:
    for i, row in enumerate(quantity.sessions):
        low, high = row.interval95 or (None, None)
        for result in row.results:
            yield {
                "quantity": quantity.name,
                "kind": quantity.kind,
                "unit": quantity.unit,
                "session": row.session,
                "result": result,
                "low95": low,
                "high95": high,
                "mandel_h": None if quantity.mandel_h is None else quantity.mandel_h[i],
            }


def _distance(parts: Sequence[float | None]) -> float | None:
    """Standard deviation [m] of a position from those along x, y, z: their norm; None if one is None."""
    known = [part for part in parts if part is not None]
    return float(np.linalg.norm(known)) if len(known) == len(parts) else None
