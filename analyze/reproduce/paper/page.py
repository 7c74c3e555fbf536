"""HTML page of `analyze reproduce paper` with all tables and figures, and their data as CSV files."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from analyze.report.csv_table import csv_text
from analyze.report.page import figure_element, page_environment
from analyze.reproduce.paper import scores
from analyze.reproduce.paper.figures import (
    angles_figure,
    pictures_figure,
    profile_figure,
    results_figure,
    scan_figure,
    sensitivity_figure,
)
from analyze.reproduce.paper.moments_table import moments_table
from analyze.reproduce.paper.published import published_centres, published_masses
from analyze.reproduce.paper.record import MethodAnswer, SessionRecord
from analyze.reproduce.paper.tables import Table, Value, all_tables
from analyze.reproduce.paper.targets import missed_targets, targets, targets_table
from schemas.output_file import write_text
from schemas.wording import counted

PAGE = "index.html"


_FIGURES: tuple[tuple[Callable[[Sequence[SessionRecord]], Figure | None], str, str], ...] = (
    (
        profile_figure,
        "Fig. 6: profile of one strike",
        (
            "Angle θ, rate ω and acceleration α of a tipping carton. Derivatives are plain differences over "
            "five frames; the sign change of α is found in them. Dashed line: ground truth. t1: the striker "
            "has let go; t2: balance; t3: the next face lands."
        ),
    ),
    (
        angles_figure,
        "Fig. 9(a): angles of the equi-planes",
        (
            "Error of φ for every strike that tipped the carton over, all seeds. The paper's scatter was "
            "1.85°, its worst error about 4°."
        ),
    ),
    (
        sensitivity_figure,
        "Fig. 9(b, c): sensitivity",
        (
            "Errors after noise is added to the true angles and to the true moments about the edges. Lines "
            "are medians, bands the central two thirds. The dotted line marks the paper's own noise."
        ),
    ),
    (
        scan_figure,
        "Fig. 10: noise of the scan",
        (
            "The carton is replaced by a scan of 20 000 points, each shifted in a random direction by up to "
            "the given distance; the shape and its edges are fitted to these points. The strikes are the "
            "same. The paper's method uses our edges."
        ),
    ),
    (
        results_figure,
        "Fig. 11: all results",
        (
            "One dot per result; the line is the mean. Published: the paper's own nine. The two columns in "
            "the middle have calibration errors drawn."
        ),
    ),
    (
        pictures_figure,
        "Fig. 12: centres of mass and regions",
        (
            "Top: centres of mass seen along y, all seeds, calibration errors drawn. Middle: a close-up of "
            "their errors. Bottom: a slice through c for the first seed, with the shell grey, the upper part "
            "blue, the lower part green, and red where the ground truth differs. Masses in g of shell (S), "
            "upper (U) and lower (L) part; ground truth in brackets."
        ),
    ),
)


def write_page(records: Sequence[SessionRecord], folder: Path) -> Path:
    """Write `index.html`, and one CSV file per table and per figure panel with data, into `folder`.

    Args:
        records: results of the sessions.
        folder: existing folder.

    Returns:
        Path of the page.

    Raises:
        OutputError: a file cannot be written.
    """
    tables = [targets_table(records), *all_tables(records)]
    if (moments := moments_table(records)).rows:
        tables.insert(3, moments)
    for table in tables:
        write_text(
            folder / f"{table.name}.csv", csv_text([column.name for column in table.columns], table.rows)
        )
    for name, headings, rows in _series(records):
        write_text(folder / f"{name}.csv", csv_text(headings, rows))
    write_text(folder / PAGE, render_page(records, tables))
    return folder / PAGE


def render_page(records: Sequence[SessionRecord], tables: Sequence[Table]) -> str:
    """Page of the reproduction as HTML text: summary, missed targets, tables and figures.

    A target is the largest value allowed of a quantity, such as the error of the centre of mass.

    Args:
        records: results of the sessions.
        tables: tables in the order of the page.
    """
    environment = page_environment()
    environment.filters["cell"] = _cell
    ours = scores.with_our_plan(records)
    return environment.get_template("paper.html").render(
        lead=summary(records),
        missed=missed_targets(records),
        sources=[
            f"{count} × {source}"
            for source, count in sorted(Counter(record.source.value for record in records).items())
        ],
        seeds=len({record.seed for record in ours}),
        sessions=len(records),
        tables=tables,
        figures=[
            (title, figure_element(figure), caption)
            for make, title, caption in _FIGURES
            if (figure := make(records)) is not None
        ],
    )


def summary(records: Sequence[SessionRecord]) -> str:
    """Summary in three sentences: errors of centre of mass and region masses, accuracy targets missed.

    Without a session on the paper's objects it is one sentence, which states this.
    """
    lines = {each.quantity: each for each in targets(records)}
    not_reached = [each.quantity for each in lines.values() if each.verdict == "missed"]
    exact = next(each for name, each in lines.items() if "calibration exact" in name)
    drawn = lines["the same with calibration errors drawn"]
    masses = lines["region masses, the paper's metric"]
    if not len(exact.values):
        return "No session on the paper's objects yet."
    text = (
        f"The centre of mass is off by {np.median(exact.values):.2f} mm (median of "
        f"{counted(len(exact.values), 'session')}; {np.median(drawn.values):.2f} mm with calibration "
        "errors drawn); the paper reported 12.5 "
        f"mm. The region masses are off by {np.median(masses.values):.1f} %; the paper reported 11.5 %."
    )
    return (
        f"{text} Targets missed: {'; '.join(not_reached)}." if not_reached else f"{text} No target is missed."
    )


def _series(records: Sequence[SessionRecord]) -> list[tuple[str, list[str], Sequence[Sequence[Value]]]]:
    """Data of the figures for CSV files, as (file name without suffix, headings, rows) each."""
    mine = scores.with_our_plan(records)
    found: list[tuple[str, list[str], Sequence[Sequence[Value]]]] = []
    profile = next((record.profile for record in mine if record.profile is not None), None)
    if profile is not None:
        columns = (profile.time_s, profile.theta_rad, profile.rate_rad_s, profile.acceleration_rad_s2)
        headings = ["time [s]", "theta [rad]", "rate [rad/s]", "acceleration [rad/s2]"]
        found.append(("fig6", headings, list(zip(*columns, strict=True))))
    angles = [
        (r.object, r.seed, a.axis_id, a.strike_id, a.true_rad, a.ours_rad, a.ours_sd_rad, a.paper_rad)
        for r in mine
        for a in r.angles
    ]
    headings = [
        "object",
        "seed",
        "axis",
        "strike",
        "true phi [rad]",
        "ours [rad]",
        "sd [rad]",
        "sign change [rad]",
    ]
    found.append(("fig9a", headings, list(angles)))
    for name, level, value, rows_of in (
        ("fig9b", "noise of the angles [deg]", "error of c [m]", lambda r: r.angle_noise),
        ("fig9c", "noise of the moments", "paper's metric", lambda r: r.moment_noise),
        ("fig10a", "largest shift [m]", "error of c [m]", lambda r: r.scan_noise_com),
        ("fig10b", "largest shift [m]", "paper's metric", lambda r: r.scan_noise_masses),
    ):
        rows = [
            (r.object, r.seed, row.level, ours, paper)
            for r in mine
            for row in rows_of(r)
            for ours, paper in zip(row.ours, row.paper, strict=True)
        ]
        if rows:
            found.append(
                (name, ["object", "seed", level, f"{value}, ours", f"{value}, paper's method"], list(rows))
            )
    points = [
        (r.object, r.seed, condition, method, *answer.com_m, *r.true_com_m)
        for r, condition, method, answer in _answers(mine)
    ]
    found.append(
        (
            "fig11",
            ["object", "seed", "calibration", "method", "error of c [m]", "paper's metric"],
            _results(mine),
        )
    )
    axes = ["x [m]", "y [m]", "z [m]"]
    found.append(
        (
            "fig12",
            ["object", "seed", "calibration", "method", *axes, *(f"true {name}" for name in axes)],
            list(points),
        )
    )
    return found


def _results(records: Sequence[SessionRecord]) -> list[tuple[Value, ...]]:
    """Rows of all dots of Fig. 11: object, seed, calibration, method, and two errors of one answer.

    The first error is the distance [m] of the estimated centre of mass from the true one. The second is the
    mean absolute error of the masses of shell, upper and lower part, over the total mass (the paper's
    metric). Published results of the two are separate rows; a value that a row does not have is None.
    """
    rows: list[tuple[Value, ...]] = [
        (each.object, None, None, "published", each.distance_m, None) for each in published_centres()
    ]
    rows += [(each.object, None, None, "published", None, each.metric) for each in published_masses()]
    for record, condition, method, answer in _answers(scores.on_paper_objects(records)):
        metric = None if answer.masses_kg is None else scores.metric(answer.masses_kg, record)
        rows.append((record.object, record.seed, condition, method, scores.distance(answer, record), metric))
    return rows


def _answers(records: Sequence[SessionRecord]) -> Iterator[tuple[SessionRecord, str, str, MethodAnswer]]:
    """Yield all answers as (session, condition of calibration, "ours" or "paper", answer)."""
    for record in records:
        for condition, ours in record.ours.items():
            yield record, condition.value, "ours", ours
            for answer in record.paper.get(condition, []):
                yield record, condition.value, "paper", answer


def _cell(value: Value, digits: int | None) -> str:
    """Text of a table's cell, with `digits` decimals if it is a float and `digits` is not None.

    A value that is None or not finite is "–"; one that would round to 0 is "< 0.01" (with two decimals).
    """
    if value is None:
        return "–"
    if isinstance(value, float) and digits is not None:
        if not np.isfinite(value):
            return "–"
        least = 10.0**-digits
        return f"< {least:.{digits}f}" if 0 < abs(value) < least / 2 else f"{value:.{digits}f}"
    return str(value)
