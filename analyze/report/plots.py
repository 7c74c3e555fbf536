"""Plots of an estimate: strikes, views, region masses and moments; no global state of matplotlib."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Ellipse, Polygon
from scipy.spatial import ConvexHull

from analyze.estimation.equiplane import balance_direction
from analyze.least_squares.intervals import SIGMAS_95
from analyze.report.style import BLUE, BODY, CYCLE, GREEN, INK, MUTED, ORANGE, PHASES, RED, plain, style
from analyze.result.digits import ScaledUnit, inertia_unit
from analyze.types import Array, EquiPlane, TipMotion

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from matplotlib.axes import Axes

    from analyze.pipeline.estimate import Estimate

VIEWS = ((0, 2, "front"), (1, 2, "side"), (0, 1, "top"))
"""Horizontal and vertical axis of O, and name, of each projection."""
SIGMAS_95_2D = 2.4477
"""Half axis of a 95 % ellipse in two dimensions, in sd: root of chi squared with 2 degrees of freedom."""


def strike_figure(motion: TipMotion, title: str) -> Figure:
    """Figure of one strike: tipping angle theta, measured and fitted, with residuals below.

    Phases of the motion are shown as bands. Time 0 is that of the fit's initial state; if there is no fit, it
    is the first frame.

    Args:
        motion: motion of the strike.
        title: title of the figure.

    Raises:
        ValueError: the motion has no tipping angle (no marker was tracked).
    """
    if motion.angle is None:
        raise ValueError(f"strike {motion.strike_id} has no angle to plot")
    angle, fit = motion.angle, motion.fit
    zero = angle.time_ns[0] if fit is None else fit.time0_ns
    time: Array = (angle.time_ns - zero).astype(np.float64) * 1e-9
    with style():
        figure = Figure(figsize=(4.2, 3.2), layout="constrained")
        upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=(3.2, 1))
        _bands(upper, motion, time)
        _bands(lower, motion, time)
        upper.plot(time, np.degrees(angle.theta), ".", color=MUTED, ms=3, label="measured")
        if fit is not None:
            start, stop = fit.window
            inside, phi = slice(start, stop), np.degrees(fit.phi)
            fitted = np.degrees(angle.theta[inside] - fit.residual)
            upper.plot(time[inside], fitted, color=BLUE, lw=1.6, label="fitted")
            upper.axhline(phi, color=RED, lw=0.9, ls=(0, (4, 3)))
            place = {"xy": (0.015, phi), "xycoords": ("axes fraction", "data")}
            upper.annotate(f"φ = {phi:.2f}°", **place, color=RED, va="bottom")
            band = 2 * np.degrees(angle.sd[inside])
            lower.fill_between(time[inside], -band, band, color=BLUE, alpha=0.12, lw=0)
            lower.plot(time[inside], np.degrees(fit.residual), ".", color=BLUE, ms=3)
            lower.set_xlim(time[max(0, start - 30)], time[min(len(time) - 1, stop + 30)])
        upper.margins(y=0.12)
        upper.set_title(title)
        upper.set_ylabel("θ [°]")
        lower.set_ylabel("residual [°]")
        lower.set_xlabel("time [s]")
        upper.legend(
            loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2, borderaxespad=0.2, handlelength=1.2
        )
        figure.align_ylabels()
    return figure


def _bands(axes: Axes, motion: TipMotion, time: Array) -> None:
    if motion.phases is None:
        return
    for name, (start, stop) in motion.phases.spans().items():
        if stop > start:
            end = min(stop, len(time) - 1)
            axes.axvspan(float(time[start]), float(time[end]), color=PHASES[name], lw=0, zorder=0)


def projection_figures(estimate: Estimate, com_true: Array | None = None) -> list[Figure]:
    """Figures of front, side and top view, each with a close-up of the centre of mass.

    They show the outline of the object's convex hull, the equi-planes, and the centre of mass with its 95 %
    ellipse; the close-up also shows the centre of mass by the paper's method (VISAPP 2013). An equi-plane
    contains a strike's pivot axis and the centre of mass. It is drawn as a line, and only in a view along its
    pivot axis, to within 26 degrees.

    Args:
        estimate: estimate with the object's shape and the equi-planes.
        com_true: true centre of mass (3,) in O [m]; None if not known.

    Returns:
        Three figures: front (x, z), side (y, z) and top (x, y).
    """
    extent = np.ptp(estimate.evidence.model.vertices, axis=0)
    com, covariance = estimate.com_balanced.position, estimate.com_balanced.covariance
    if com_true is not None and estimate.fixture is not None:
        com_true = estimate.fixture.held.com_struck(com_true)
    # The close-up shows the ellipse, the ground truth, and the planes that pass nearby.
    widest = 3 * float(np.sqrt(np.diag(covariance)).max())
    off = 0.0 if com_true is None else 1.5 * float(np.abs(com_true - com).max())
    near = 1.3 * float(np.abs(estimate.com.residuals).max(initial=0.0))
    reach = min(max(widest, off, near, 5e-4), 0.5 * float(extent.max()))
    return [_projection(estimate, com_true, reach, view, name) for *view, name in VIEWS]


def _projection(
    estimate: Estimate, com_true: Array | None, reach: float, view: Sequence[int], name: str
) -> Figure:
    i, j = view
    vertices = estimate.evidence.model.vertices
    com = estimate.com_balanced.position
    with style():
        # Fixed margins align the close-ups of views that are next to each other on the page.
        figure = Figure(figsize=(3.05, 5.9))
        margins = {"left": 0.21, "right": 0.98, "top": 0.96, "bottom": 0.075, "hspace": 0.27}
        whole, close = figure.subplots(2, 1, height_ratios=(1.2, 1), gridspec_kw=margins)
        outline = vertices[:, view][ConvexHull(vertices[:, view]).vertices]
        whole.add_patch(Polygon(1e3 * outline, facecolor=BODY, edgecolor=INK, lw=1.0))
        for axes in (whole, close):
            _planes(axes, estimate.planes, (i, j))
            _centre(axes, com, estimate.com_balanced.covariance, (i, j))
            if com_true is not None:
                axes.plot(*(1e3 * com_true[list(view)]), "x", color=RED, ms=7, mew=1.8, zorder=6)
            axes.set_xlabel(f"{'xyz'[i]} [mm]")
            axes.set_ylabel(f"{'xyz'[j]} [mm]")
        if estimate.paper is not None:
            by_paper = estimate.paper.com.position
            if estimate.fixture is not None:
                by_paper = estimate.fixture.held.com_struck(by_paper)
            close.plot(*(1e3 * by_paper[list(view)]), "D", color=ORANGE, ms=5, zorder=4)
        _axis_names(whole, estimate.planes, (i, j), com)
        close.set_aspect("equal")
        plain(whole)
        margin = 0.12 * np.ptp(vertices, axis=0).max()
        low, high = vertices.min(axis=0) - margin, vertices.max(axis=0) + margin
        whole.set_xlim(1e3 * low[i], 1e3 * high[i])
        whole.set_ylim(1e3 * low[j], 1e3 * high[j])
        whole.set_title(name)
        close.set_xlim(1e3 * (com[i] - reach), 1e3 * (com[i] + reach))
        close.set_ylim(1e3 * (com[j] - reach), 1e3 * (com[j] + reach))
        close.set_title(f"{name}, close up")
    return figure


def _planes(axes: Axes, planes: tuple[EquiPlane, ...], view: tuple[int, int]) -> None:
    depth = 3 - view[0] - view[1]
    names = sorted({plane.axis_id for plane in planes})
    for plane in planes:
        # Only planes seen nearly edge-on are lines in this view.
        if abs(plane.direction[depth]) < 0.9:
            continue
        along = balance_direction(plane.direction, plane.up, plane.phi)[list(view)]
        start = plane.point[list(view)]
        line = 1e3 * np.array([start, start + 0.6 * along])
        colour = CYCLE[names.index(plane.axis_id) % len(CYCLE)]
        axes.plot(line[:, 0], line[:, 1], color=colour, lw=0.9, alpha=0.75, zorder=2)
        axes.plot(*line[0], "o", color=colour, ms=3.5, zorder=3)


def _axis_names(axes: Axes, planes: tuple[EquiPlane, ...], view: tuple[int, int], com: Array) -> None:
    """Write the names of pivot axes next to their dots, in a view along them to within 26 degrees.

    Args:
        axes: axes of the plot, changed in place.
        planes: equi-planes (through pivot line and centre of mass) of the strikes, with their pivot axes.
        view: horizontal and vertical axis of the object frame O, as indices.
        com: (3,) centre of mass in O [m]; names are written on the far side of the dot.
    """
    depth = 3 - view[0] - view[1]
    named = {plane.axis_id: plane for plane in planes if abs(plane.direction[depth]) >= 0.9}
    taken: list[Array] = []
    for name, plane in sorted(named.items()):
        place = 1e3 * plane.point[list(view)]
        right, up = place - 1e3 * com[list(view)] > 0
        # Edges that lie behind one another share a dot.
        below = sum(float(np.linalg.norm(place - other)) < 4.0 for other in taken)
        taken.append(place)
        axes.annotate(
            name,
            tuple(place),
            (4 if right else -4, (4 if up else -4) + (9 if up else -9) * below),
            textcoords="offset points",
            ha="left" if right else "right",
            va="bottom" if up else "top",
            fontsize=7,
            color=INK,
        )


def _centre(axes: Axes, com: Array, covariance: Array, view: tuple[int, int]) -> None:
    rows = list(view)
    values, vectors = np.linalg.eigh(covariance[np.ix_(rows, rows)])
    width, height = 2 * SIGMAS_95_2D * 1e3 * np.sqrt(values)
    turn = float(np.degrees(np.arctan2(vectors[1, 0], vectors[0, 0])))
    fill, line = (
        {"facecolor": INK, "alpha": 0.18, "lw": 0},
        {"facecolor": "none", "edgecolor": INK, "lw": 0.9},
    )
    for zorder, look in ((4, fill), (5, line)):
        axes.add_patch(Ellipse(tuple(1e3 * com[rows]), width, height, angle=turn, zorder=zorder, **look))
    axes.plot(*(1e3 * com[rows]), "+", color=INK, ms=8, mew=1.6, zorder=6)


def regions_figure(estimate: Estimate, truth: Mapping[str, float] | None = None) -> Figure:
    """Figure of region masses with 95 % intervals, and naive answers (such as uniform density).

    Args:
        estimate: estimate with the masses of shell and interior regions.
        truth: true masses [kg] by name of region; None if not known.
    """
    distribution = estimate.distribution
    masses, (low, high) = 1e3 * distribution.masses, 1e3 * distribution.intervals.T
    place = np.arange(len(masses))
    with style():
        figure = Figure(figsize=(4.2, 3.2), layout="constrained")
        axes = figure.subplots()
        axes.barh(place, masses, height=0.5, color=BLUE, alpha=0.85)
        spread = np.maximum([masses - low, high - masses], 0.0)
        axes.errorbar(masses, place, xerr=spread, fmt="none", ecolor=INK, elinewidth=1.2, capsize=3, zorder=4)
        marks = {"shell": "s", "uniform": "o", "shell_and_uniform": "^"}
        for name, naive in sorted(distribution.baselines.items()):
            label = f"naive: {name.replace('_', ' ')}"
            axes.plot(
                1e3 * naive, place + 0.36, marks.get(name, "v"), color=MUTED, mfc="white", ms=5, label=label
            )
        if estimate.paper is not None and estimate.paper.regions is not None:
            paper = 1e3 * estimate.paper.regions.masses
            axes.plot(paper, place + 0.36, "D", color=ORANGE, ms=5, label="paper's method")
        if truth is not None:
            values = [1e3 * truth[name] for name in distribution.names]
            axes.plot(values, place, "|", color=RED, ms=24, mew=2.4, zorder=5)
            # In the legend no taller than a line.
            axes.plot([], [], "|", color=RED, ms=9, mew=2.4, label="ground truth")
        axes.set_yticks(place, distribution.names)
        axes.set_ylim(len(masses) - 0.45, -0.5)
        axes.set_xlim(left=0)
        axes.set_xlabel("mass [g]")
        axes.grid(visible=False, axis="y")
        figure.legend(loc="outside lower center", ncols=2)
    return figure


def moments_figure(
    estimate: Estimate, truth: Mapping[str, float] | None = None, unit: ScaledUnit | None = None
) -> Figure:
    """Figure of moments of inertia about axes through the centre of mass, with 95 % intervals.

    Each axis is parallel to one pivot axis.

    Args:
        estimate: estimate with moments per pivot axis.
        truth: true moments [kg m²] about these axes by id of the pivot axis; None if not known.
        unit: unit of the axis; None for one in which the tensor's largest entry is from 1 to 10.
    """
    axes_of = estimate.inertial.axes
    unit = unit or inertia_unit(estimate.inertial.inertia)
    place = np.arange(len(axes_of))
    with style():
        figure = Figure(figsize=(4.2, 0.9 + 0.3 * len(axes_of)), layout="constrained")
        axes = figure.subplots()
        value = unit.factor * np.array([axis.i_com for axis in axes_of])
        spread = SIGMAS_95 * unit.factor * np.array([axis.i_com_sd for axis in axes_of])
        axes.errorbar(
            value, place, xerr=spread, fmt="o", color=GREEN, ms=5, elinewidth=1.4, capsize=3, label="estimate"
        )
        if truth is not None:
            true = unit.factor * np.array([truth[axis.axis_id] for axis in axes_of])
            axes.plot(true, place, "|", color=RED, ms=14, mew=2.2)
            axes.plot([], [], "|", color=RED, ms=9, mew=2.2, label="ground truth")
        axes.set_yticks(place, [axis.axis_id for axis in axes_of])
        axes.set_ylim(len(axes_of) - 0.5, -0.5)
        axes.set_xlim(left=0)
        axes.set_xlabel(f"moment about the centre of mass [{unit.label}]")
        if truth is not None:
            figure.legend(loc="outside lower center", ncols=2)
    return figure
