"""Summary of an estimate on the terminal: the answer in numbers first, then how sure, then the strikes."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from rich.box import SIMPLE_HEAD
from rich.table import Table

from analyze.report.toss_rows import TOSS_COLUMNS, toss_lines, toss_rows
from analyze.result.contact import contact_lines
from analyze.result.contents import contents_lines, pose_rows
from analyze.result.digits import ScaledUnit, open_interval, signed, with_interval
from analyze.result.fixture import fixture_lines
from analyze.result.frame_times import frame_time_lines
from analyze.result.headline import Headline, edge_labels, further_warnings, headline
from analyze.result.radius import radius_lines
from analyze.result.tilt import tilt_lines
from schemas.result import Filling, Parts, Result
from schemas.strike_result import FollowedBy
from schemas.terminal import Terminal, styled
from schemas.toss_result import TossVerdict
from schemas.wording import counted

if TYPE_CHECKING:
    from collections.abc import Sequence

    from analyze.result.answer import Answer
    from schemas.robustness import AlternativeResult

DEGREES = 57.29577951308232
"""degrees per radian"""


def render_summary(answer: Answer, console: Terminal | None = None) -> None:
    """Print an estimate: centre of mass and inertia tensor, verdict, table tilt, strikes, masses, warnings.

    Args:
        answer: estimate and its result.
        console: console to print on; None for standard output.
    """
    console = console or Terminal()
    estimate, result = answer.estimate, answer.result
    shown = headline(result)
    recordings = estimate.evidence.recordings
    which = (
        f"recording {result.inputs.recording_id}"
        if len(recordings) == 1
        else f"{counted(len(recordings), 'recording')}:"
    )
    console.print(styled((estimate.evidence.spec.name, "bold"), f", {shown.mass}, {which}"))
    for number, recording in enumerate(recordings, 1):
        if len(recordings) > 1:
            console.print(f"  {number}: {', '.join(recording.files)}, begun {recording.manifest.created}")
        elif len(recording.files) > 1:
            console.print(f"in {counted(len(recording.files), 'file')}: {', '.join(recording.files)}")
    _print_answer(shown, console)
    for line in [*fixture_lines(result), *(result.verdict or [])]:
        console.print(line)
    console.print()
    for line in [
        *contact_lines(result),
        *tilt_lines(result),
        *radius_lines(result),
        *frame_time_lines(result.frame_times, len(recordings) > 1),
        *contents_lines(result),
        *toss_lines(result),
    ]:
        console.print(line)
    console.print()
    _print_tables(result, shown, console)
    for warning in further_warnings(result):
        console.print(styled((warning.code.value, "yellow"), f": {warning.text}"))


def _print_tables(result: Result, shown: Headline, console: Terminal) -> None:
    """Print the tables of poses (if it is not rigid), strikes, tosses, moments, masses and what-ifs."""
    if rows := pose_rows(result):
        console.print(_poses(rows))
    if result.strikes:
        console.print(_strikes(result, shown.unit))
    if rows := toss_rows(result):
        console.print(_tosses(rows))
    if result.moments:
        console.print(_moments(result, shown.unit))
    console.print(_regions(result))
    if result.parts is not None:
        console.print(_parts(result.parts))
    if result.filling is not None:
        console.print(_filling(result.filling))
    if result.robustness:
        console.print(_robustness(result.robustness))


def _print_answer(shown: Headline, console: Terminal) -> None:
    """Print centre of mass, inertia tensor, principal moments, and both as URDF, in the object's frame."""
    com = _narrow_table("Centre of mass, mm, 95 %", "xyz")
    com.add_row(*(entry.text for entry in shown.com))
    console.print(com)
    if shown.com_note:
        console.print(shown.com_note)
    tensor = _narrow_table(f"Inertia tensor about it, {shown.unit.label}, 95 %", ["", *"xyz"])
    for axis, row in zip("xyz", shown.tensor, strict=True):
        tensor.add_row(axis, *(entry.marked for entry in row))
    console.print(tensor)
    principal = _narrow_table("Principal moments and axes", ["moment", "along"])
    for each in shown.principal:
        principal.add_row(each.moment.marked, each.direction)
    console.print(principal)
    if shown.tensor_note:
        console.print(shown.tensor_note)
    console.print()
    if shown.urdf is None:
        console.print("No URDF block: no rigid body can have this mass and tensor.")
    else:
        console.print("For URDF, in kg and m:")
        console.print(shown.urdf, soft_wrap=True)
    console.print()


def _narrow_table(title: str, headings: Sequence[str]) -> Table:
    """New terminal table, without rows so far, with narrow columns that are aligned to the right."""
    table = Table(title=title, title_justify="left", box=SIMPLE_HEAD, show_edge=False, padding=(0, 1, 0, 1))
    for heading in headings:
        table.add_column(heading, justify="right", no_wrap=True)
    return table


def _poses(rows: Sequence[tuple[str, ...]]) -> Table:
    table = _narrow_table("Centre of mass by pose, mm, 95 %", ["on face", *"xyz", "off"])
    for row in rows:
        table.add_row(*row)
    return table


def _strikes(result: Result, unit: ScaledUnit) -> Table:
    by_print = any(strike.followed_by is FollowedBy.PRINT for strike in result.strikes)
    title = "Strikes, followed by the object's own print, 95 %" if by_print else "Strikes, 95 %"
    table = Table(title=title, title_justify="left", box=SIMPLE_HEAD, pad_edge=False)
    for name in ("strike", "axis", "verdict"):
        table.add_column(name, no_wrap=True)
    for name in ("φ\n(°)", f"I_edge\n({unit.label})", "plane\n(mm)", "share"):
        table.add_column(name, justify="right", no_wrap=True)
    for strike in result.strikes:
        residual = strike.equiplane_residual_m
        table.add_row(
            strike.id,
            strike.axis_id,
            strike.verdict.value,
            with_interval(strike.phi, DEGREES),
            with_interval(strike.i_edge, unit.factor),
            "–" if residual is None else signed(1e3 * residual, 2),
            f"{strike.information_share:.0%}" if strike.used else "–",
            style=None if strike.used else "dim",
        )
    return table


def _tosses(rows: Sequence[tuple[str, ...]]) -> Table:
    table = _narrow_table("Tosses", TOSS_COLUMNS)
    for row in rows:
        table.add_row(*row, style=None if row[1] == TossVerdict.GOOD.value else "dim")
    return table


def _moments(result: Result, unit: ScaledUnit) -> Table:
    labels = edge_labels(result)
    table = Table(
        "edge",
        "about the edge",
        "about the centre of mass",
        title=f"Moments of inertia by edge, {unit.label}, 95 %",
        title_justify="left",
        box=SIMPLE_HEAD,
    )
    for moment in result.moments:
        table.add_row(
            labels[moment.axis_id],
            with_interval(moment.i_edge, unit.factor),
            with_interval(moment.i_com, unit.factor),
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
        estimate = f"{open_interval(region.mass, 1e3)} g"
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
            open_interval(part.mass, 1e3),
            open_interval(part.density, 1e-3),
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
        moments = "–" if changes is None else ", ".join(signed(100 * change, 1) for change in changes)
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
        (f"level along ({up}) from the origin (mm)", open_interval(filling.level, 1e3)),
        ("filled share of the interior (%)", open_interval(filling.filled_share, 100)),
        ("mass (g)", open_interval(filling.mass, 1e3)),
        ("density (g/cm³)", open_interval(filling.density, 1e-3)),
        ("mass of the shell (g)", open_interval(filling.shell, 1e3)),
    ]
    if filling.shell_thickness is not None:
        rows.append(("thickness of the shell (mm)", open_interval(filling.shell_thickness, 1e3)))
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
