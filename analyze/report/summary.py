"""Summary of an estimate on the terminal, and text of quantities with 95 % intervals."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from rich.box import SIMPLE_HEAD
from rich.table import Table

from analyze.least_squares.intervals import SIGMAS_95
from analyze.result.frame_times import frame_time_lines
from analyze.result.radius import radius_lines
from analyze.result.tilt import tilt_lines
from schemas.quantity import Quantity
from schemas.result import Filling, Parts, Result
from schemas.terminal import Terminal, styled
from schemas.wording import counted

if TYPE_CHECKING:
    from collections.abc import Sequence

    from analyze.result.answer import Answer
    from schemas.robustness import AlternativeResult

DEGREES = 57.29577951308232
"""degrees per radian"""
GRAM_CM2 = 1e7
"""g cm² per kg m²"""


def render_summary(answer: Answer, console: Terminal | None = None) -> None:
    """Print an estimate: centre of mass, table tilt, strikes, moments, masses, verdict and warnings.

    Args:
        answer: estimate and its result.
        console: console to print on; None for standard output.
    """
    console = console or Terminal()
    estimate, result = answer.estimate, answer.result
    recordings = estimate.evidence.recordings
    which = (
        f"recording {result.inputs.recording_id}"
        if len(recordings) == 1
        else f"{counted(len(recordings), 'recording')}:"
    )
    console.print(
        styled((estimate.evidence.spec.name, "bold"), f", {1e3 * estimate.inertial.mass:.1f} g, {which}")
    )
    for number, recording in enumerate(recordings, 1):
        if len(recordings) > 1:
            console.print(f"  {number}: {', '.join(recording.files)}, begun {recording.manifest.created}")
        elif len(recording.files) > 1:
            console.print(f"in {counted(len(recording.files), 'file')}: {', '.join(recording.files)}")
    console.print(f"centre of mass (x, y, z) = {com_text(result.centre_of_mass)}")
    for line in [
        *tilt_lines(result),
        *radius_lines(result),
        *frame_time_lines(result.frame_times, len(recordings) > 1),
    ]:
        console.print(line)
    console.print()
    console.print(_strikes(result))
    console.print(_moments(result))
    console.print(_regions(result))
    if result.parts is not None:
        console.print(_parts(result.parts))
    if result.filling is not None:
        console.print(_filling(result.filling))
    if result.robustness:
        console.print(_robustness(result.robustness))
    for sentence in result.verdict or []:
        console.print(sentence)
    for warning in result.warnings:
        console.print(styled((warning.code.value, "yellow"), f": {warning.text}"))


def com_text(com: Quantity) -> str:
    """Text of the centre of mass (x, y, z) in O with half widths of its 95 % intervals, in mm.

    O is the object frame. The text ends with "one direction not observed" if that is so.
    """
    half = SIGMAS_95 * 1e3 * np.array(com.sd)
    millimetres = 1e3 * np.array(com.value)
    values = [f"{v:.1f} ± {h:.1f}" for v, h in zip(millimetres, half, strict=True)]
    return f"({', '.join(values)}) mm, 95 % interval" + (
        "" if com.observed else ", one direction not observed"
    )


def with_interval(quantity: Quantity | None, factor: float, digits: int, unit: str = "") -> str:
    """Text of a scalar with the half width of its 95 % interval (1.96 sd); "–" if there is no value.

    Args:
        quantity: quantity in SI units.
        factor: conversion from SI to `unit`.
        digits: digits after the point.
        unit: unit to print; "" for none.
    """
    if quantity is None or not isinstance(quantity.value, float):
        return "–"
    spread = f" ± {SIGMAS_95 * factor * quantity.sd:.{digits}f}" if isinstance(quantity.sd, float) else ""
    return f"{factor * quantity.value:.{digits}f}{spread} {unit}".rstrip()


def _strikes(result: Result) -> Table:
    table = Table(title="Strikes, 95 %", title_justify="left", box=SIMPLE_HEAD, pad_edge=False)
    for name in ("strike", "axis", "verdict"):
        table.add_column(name, no_wrap=True)
    for name in ("φ\n(°)", "I_edge\n(g cm²)", "plane\n(mm)", "share"):
        table.add_column(name, justify="right", no_wrap=True)
    for strike in result.strikes:
        residual = strike.equiplane_residual_m
        table.add_row(
            strike.id,
            strike.axis_id,
            strike.verdict.value,
            with_interval(strike.phi, DEGREES, 3),
            with_interval(strike.i_edge, GRAM_CM2, 0),
            "–" if residual is None else f"{1e3 * residual:+.2f}",
            f"{strike.information_share:.0%}" if strike.used else "–",
            style=None if strike.used else "dim",
        )
    return table


def _moments(result: Result) -> Table:
    table = Table(
        "axis",
        "about the edge",
        "about the centre of mass",
        title="Moments of inertia, 95 %",
        title_justify="left",
        box=SIMPLE_HEAD,
    )
    for moment in result.moments:
        table.add_row(
            moment.axis_id,
            with_interval(moment.i_edge, GRAM_CM2, 0, "g cm²"),
            with_interval(moment.i_com, GRAM_CM2, 0, "g cm²"),
        )
    return table


def _regions(result: Result) -> Table:
    table = Table(title="Region masses, 95 %", title_justify="left", box=SIMPLE_HEAD)
    if result.regions is None:
        return table
    naive = sorted(result.regions.baselines)
    for name in ("region", "estimate", *(item.replace("_", " ") for item in naive)):
        table.add_column(name, justify="left" if name == "region" else "right")
    for i, region in enumerate(result.regions.regions):
        estimate = f"{open_interval(region.mass, 1e3, 1)} g"
        table.add_row(
            region.name, estimate, *(f"{1e3 * result.regions.baselines[item][i]:.1f} g" for item in naive)
        )
    return table


def _parts(parts: Parts) -> Table:
    table = Table(title="Labelled parts, 95 %", title_justify="left", box=SIMPLE_HEAD)
    for name in ("part", "mass (g)", "density (g/cm³)", "if uniform (g)"):
        table.add_column(name, justify="left" if name == "part" else "right")
    for part, uniform in zip(parts.parts, parts.uniform, strict=True):
        table.add_row(
            part.name,
            open_interval(part.mass, 1e3, 1),
            open_interval(part.density, 1e-3, 2),
            f"{1e3 * uniform:.1f}",
        )
    return table


def robustness_rows(rows: Sequence[AlternativeResult]) -> list[tuple[str, str, str, str]]:
    """Rows of the table of how the answer changes if an assumption, a strike or an estimator differs.

    Columns, as text: the alternative; shift of the centre of mass [mm]; relative changes of the principal
    moments [%], "–" if there are none; whether the answer holds under it.
    """
    found: list[tuple[str, str, str, str]] = []
    for row in rows:
        name = row.what_if if row.strike is None else f"{row.what_if}: {row.strike} (the worst)"
        shift = 1e3 * float(np.linalg.norm(row.com_shift_m))
        changes = row.moment_changes
        moments = "–" if changes is None else ", ".join(f"{100 * change:+.1f}" for change in changes)
        broken = [
            text
            for text, holds in (("centre of mass", row.com_holds), ("moments", row.moments_hold))
            if not holds
        ]
        found.append(
            (name, f"{shift:.2f}", moments, "holds" if not broken else f"not the {' and '.join(broken)}")
        )
    return found


def _robustness(rows: Sequence[AlternativeResult]) -> Table:
    table = Table(title="What if: change of the answer", title_justify="left", box=SIMPLE_HEAD)
    for name in ("what if", "centre of mass (mm)", "principal moments (%)", "answer"):
        table.add_column(name, justify="left" if name in {"what if", "answer"} else "right")
    for row in robustness_rows(rows):
        table.add_row(*row)
    return table


def filling_rows(filling: Filling) -> list[tuple[str, str]]:
    """Rows of a table on a filling (contents of a container): name with unit, value with 95 % interval."""
    up = ", ".join(f"{value:.2f}" for value in filling.along)
    rows = [
        (f"level along ({up}) from the origin (mm)", open_interval(filling.level, 1e3, 1)),
        ("filled share of the interior (%)", open_interval(filling.filled_share, 100, 0)),
        ("mass (g)", open_interval(filling.mass, 1e3, 1)),
        ("density (g/cm³)", open_interval(filling.density, 1e-3, 2)),
        ("mass of the shell (g)", open_interval(filling.shell, 1e3, 1)),
    ]
    if filling.shell_thickness is not None:
        rows.append(("thickness of the shell (mm)", open_interval(filling.shell_thickness, 1e3, 1)))
    return rows


def _filling(filling: Filling) -> Table:
    table = Table(
        title=f"Filled with {filling.name}, 95 %", title_justify="left", box=SIMPLE_HEAD, show_header=False
    )
    table.add_column()
    table.add_column(justify="right")
    for row in filling_rows(filling):
        table.add_row(*row)
    return table


def open_interval(quantity: Quantity, factor: float, digits: int) -> str:
    """Text of a scalar with both ends of its 95 % interval, as "12.0 (11.5 to 12.5)".

    A quantity that is not observed gives "not observed" in place of its value.

    Args:
        quantity: scalar in SI units, with an interval.
        factor: conversion from SI to the unit shown.
        digits: digits after the point.

    Raises:
        TypeError: the quantity is no scalar, or has no interval.
    """
    low, high = (factor * end for end in quantity.interval_ends())
    between = f"{low:.{digits}f} to {high:.{digits}f}"
    if not quantity.observed:
        return f"not observed ({between})"
    return f"{factor * quantity.as_scalar():.{digits}f} ({between})"
