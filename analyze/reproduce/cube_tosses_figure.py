"""Table and figure of `analyze reproduce cube-tosses`."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Ellipse
from rich.table import Table

from analyze.least_squares.intervals import SIGMAS_95, student_sigmas_95
from analyze.report.plots import SIGMAS_95_2D
from analyze.report.style import BLUE, GREEN, INK, MUTED, ORANGE, style
from analyze.reproduce.cube_tosses import EDGE_M, GRAVITY_M_S2, MASS_KG, CubeAnswer, contact_ratios
from analyze.reproduce.cube_tosses_document import distance_sd
from schemas.terminal import Terminal
from schemas.wording import counted

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from analyze.flight.free_flight import FlightBody
    from analyze.motion.moment_balance import BalancedBody

_VIEWS = ((0, 2, "x", "z"), (0, 1, "x", "y"))


def render_cube(answer: CubeAnswer, console: Terminal | None = None) -> None:
    """Print the results by flight, edge contact and corner contact as a table, and the conclusions.

    Intervals are 95 %.

    Args:
        answer: estimates of the cube.
        console: where to print; None for standard output.

    Raises:
        EstimationError: the centres of mass by edge contact and by flight are exactly equal.
    """
    console = console or Terminal()
    table = Table(
        title=f"{answer.tosses} tosses of a real cube, {1e3 * EDGE_M:.1f} mm, {MASS_KG:g} kg"
        f" ({counted(answer.frames, 'frame')})"
    )
    for heading in ("± is 95 %", "free flight", "edge contact", "corner contact"):
        table.add_column(heading, justify="left" if "±" in heading else "right")
    flight, touching = answer.flight, (answer.edges, answer.corners)
    table.add_row(
        "stretches of motion",
        str(flight.flights),
        *(str(body.contacts) for body in touching),
        end_section=True,
    )
    for axis, name in enumerate("xyz"):
        bodies = [
            _interval(1e3 * body.com[axis], 1e3 * body.half_width[axis]) for body in (flight, *touching)
        ]
        table.add_row(f"centre of mass, {name}, mm", *bodies, end_section=axis == 2)
    for axis, name in enumerate("xyz"):
        moments = [
            _interval(1e3 * body.inertia[axis, axis], 1e3 * body.half_width[3 + axis]) for body in touching
        ]
        table.add_row(f"I_c/m about {name}, 10⁻³ m²", "", *moments, end_section=axis == 2)
    found = [
        (answer.rotation.ratios, answer.rotation.covariance, answer.rotation.freedom),
        *map(contact_ratios, touching),
    ]
    for entry, name in enumerate(("x", "y", "z")):
        shares = [
            _interval(
                ratios[entry],
                float(student_sigmas_95(freedom)[entry] * np.sqrt(covariance[entry, entry])),
                3,
            )
            for ratios, covariance, freedom in found
        ]
        table.add_row(f"I_c about {name} over their mean", *shares, end_section=entry == 2)
    table.add_row(
        "radius of the edges, mm",
        "",
        *(_interval(1e3 * body.rounding, 1e3 * body.half_width[9], 1) for body in touching),
    )
    console.print(table)
    difference, covariance = answer.edge_minus_flight
    distance = 1e3 * float(np.linalg.norm(difference))
    factor = float(student_sigmas_95(answer.edge_minus_flight_freedom).max())
    half = factor * 1e3 * distance_sd(difference, covariance)
    console.print(
        f"The centres of mass by edge contact and by flight are {distance:.2f} mm apart (95 %: ± {half:.2f} "
        "mm)."
    )
    console.print(
        f"g by flight is {flight.gravity:.3f} ± {flight.half_width[3]:.3f} m/s² in the file's unit "
        f"of length; its true value is {GRAVITY_M_S2}. The file's metre is therefore {answer.scale:.4f} m "
        "long; all lengths above are corrected for it."
    )
    moments = MASS_KG * np.diag(answer.edges.inertia)
    console.print(
        f"With m = {MASS_KG:g} kg, I_c = {', '.join(f'{1e3 * value:.3f}' for value in moments)} · 10⁻³ kg m² "
        f"about x, y, z. The edges slid by {1e3 * answer.slides_m[1]:.0f} mm during a contact (median): a "
        "fixed pivot cannot be fitted."
    )


def cube_figure(answer: CubeAnswer) -> Figure:
    """Figure of the cube's centre of mass c by three methods, and of its moments of inertia.

    The methods are free flight, contact of an edge with the table, and contact of a corner. Four panels
    show c [mm] from the side and from above with 95 % ellipses; how far points of the cube deviate from a
    parabola in flight [mm], over their height z in the cube [mm]; and the moments of inertia per mass
    [10⁻³ m²] by edge and corner contact.
    """
    with style():
        figure = Figure(figsize=(10.4, 3.4), layout="constrained")
        front, top, flight, moments = figure.subplots(1, 4, width_ratios=(1, 1, 1.15, 1))
        for axes, view in zip((front, top), _VIEWS, strict=True):
            _centres(axes, answer, view)
        front.set_title("centre of mass, from the side")
        top.set_title("and from above")
        top.legend(loc="upper left")
        _flight(flight, answer)
        _moments(moments, answer)
    return figure


def _interval(value: float, half: float, digits: int = 2) -> str:
    """Text "value ± half-width" of a 95 % interval."""
    return f"{value:.{digits}f} ± {half:.{digits}f}"


def _methods(answer: CubeAnswer) -> tuple[tuple[str, str, FlightBody | BalancedBody], ...]:
    return (
        ("free flight", ORANGE, answer.flight),
        ("edge contact", BLUE, answer.edges),
        ("corner contact", GREEN, answer.corners),
    )


def _centres(axes: Axes, answer: CubeAnswer, view: tuple[int, int, str, str]) -> None:
    across, up, name_across, name_up = view
    reach = 10.0
    axes.set_aspect("equal")
    axes.axhline(0, color=MUTED, lw=0.7, ls=(0, (4, 3)))
    axes.axvline(0, color=MUTED, lw=0.7, ls=(0, (4, 3)))
    for name, colour, body in _methods(answer):
        pair = np.ix_([across, up], [across, up])
        values, vectors = np.linalg.eigh(1e6 * body.covariance[pair])
        # The factor of a normal distribution in two dimensions, widened as in one.
        wider = float(body.half_width[across] / (SIGMAS_95 * body.com_sd[across]))
        width, height = 2 * wider * SIGMAS_95_2D * np.sqrt(np.maximum(values, 0.0))
        angle = float(np.degrees(np.arctan2(vectors[1, 0], vectors[0, 0])))
        centre = (1e3 * float(body.com[across]), 1e3 * float(body.com[up]))
        axes.add_patch(
            Ellipse(centre, float(width), float(height), angle=angle, fc=colour, ec=colour, alpha=0.28)
        )
        axes.plot(*centre, ".", color=colour, ms=5, label=name)
    axes.plot(0, 0, "+", color=INK, ms=7, mew=0.9)
    axes.annotate(
        "middle of the cube", (0, 0), xytext=(5, -10), textcoords="offset points", fontsize=7.5, color=MUTED
    )
    low = -2.0 if name_up == "z" else -reach / 2
    axes.set_xlim(-reach / 2, reach / 2)
    axes.set_ylim(low, low + reach)
    axes.set_xlabel(f"{name_across} [mm]")
    axes.set_ylabel(f"{name_up} [mm]")


def _moments(axes: Axes, answer: CubeAnswer) -> None:
    for number, (name, colour, body) in enumerate(
        (("edges", BLUE, answer.edges), ("corners", GREEN, answer.corners))
    ):
        values, half = 1e3 * np.diag(body.inertia), 1e3 * body.half_width[3:6]
        at = np.arange(3) + (number - 0.5) * 0.24
        axes.errorbar(at, values, half, fmt="o", ms=4, color=colour, lw=1.3, label=name)
    solid, hollow = 1e3 * EDGE_M**2 / 6, 1e3 * EDGE_M**2 * 5 / 18
    for level, text in ((solid, "solid cube"), (hollow, "thin shell")):
        axes.axhline(level, color=MUTED, lw=0.8, ls=(0, (4, 3)))
        axes.annotate(
            text, (-0.45, level), xytext=(0, 2), textcoords="offset points", fontsize=7.5, color=MUTED
        )
    axes.set_xticks(range(3), ["xx", "yy", "zz"])
    axes.set_xlim(-0.5, 2.5)
    axes.set_ylim(1.6, 3.4)
    axes.set_title("I_c / m  [10⁻³ m²]")


def _flight(axes: Axes, answer: CubeAnswer) -> None:
    """Draw how far points of the cube deviate from a parabola in flight, over their z in the cube (mm).

    The deviation is smallest at the centre of mass. A line with a 95 % band marks the z of the centre of mass
    by each of the three methods. `axes` are the matplotlib axes that receive the drawing.
    """
    axes.plot(1e3 * answer.heights, 1e3 * answer.off_parabola, color=ORANGE, lw=1.6)
    for name, colour, body in _methods(answer):
        height, half = 1e3 * float(body.com[2]), 1e3 * float(body.half_width[2])
        axes.axvspan(height - half, height + half, color=colour, alpha=0.16, lw=0)
        axes.axvline(height, color=colour, lw=1.0, label=name)
    axes.set_title("deviation from a parabola in flight [mm]")
    axes.set_xlabel("height of the point in the cube, z [mm]")
    axes.set_ylim(bottom=0)
