"""Figures 6 and 9 to 12 of the paper, redrawn from the sessions of the reproduction."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.collections import PatchCollection
from matplotlib.figure import Figure
from matplotlib.patches import Polygon, Rectangle

from analyze.report.style import BLUE, BODY, GREEN, GRID, INK, MUTED, ORANGE, PHASES, RED, SKY, plain, style
from analyze.reproduce.paper import scores
from analyze.reproduce.paper.published import published_centres, published_masses
from analyze.reproduce.paper.record import Condition, Profile, Sensitivity, SessionRecord
from analyze.reproduce.paper.sensitivity import PAPER_NOISE_DEG
from analyze.reproduce.paper.tables import objects_of
from analyze.types import PHASE_NAMES

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from analyze.types import Array

CLOSE_UP_MM = 3.0
"""Largest error [mm] that the close-up of Figure 12 shows; larger ones are drawn on its border."""
MIN_LABELLED_FRAMES = 6
"""Number of frames that a phase must exceed for its name to fit above it."""


def profile_figure(records: Sequence[SessionRecord]) -> Figure | None:
    """Figure 6: tipping angle theta, rate omega and acceleration alpha of one object over time.

    Units are deg, rad/s, rad/s^2 and s. The motion is the first motion stored in a session planned by our
    method; None if there is none.
    """
    profile = next(
        (record.profile for record in scores.with_our_plan(records) if record.profile is not None), None
    )
    if profile is None:
        return None
    seconds = np.array(profile.time_s)
    acceleration = np.array(profile.acceleration_rad_s2)
    rows = (
        (np.degrees(profile.theta_rad), "θ [°]"),
        (np.array(profile.rate_rad_s), "ω [rad/s]"),
        (acceleration, "α [rad/s²]"),
    )
    with style():
        figure = Figure(figsize=(7.4, 5.0), layout="constrained")
        panels = figure.subplots(3, 1, sharex=True)
        _draw_phases(panels, profile, seconds)
        for axes, (values, label) in zip(panels, rows, strict=True):
            axes.plot(seconds, values, "-", color=BLUE, lw=1.1, marker=".", ms=3)
            axes.set_ylabel(label)
        panels[0].axhline(np.degrees(profile.phi_true_rad), color=RED, lw=0.9, ls=(0, (4, 3)))
        text = f"φ = {np.degrees(profile.phi_rad):.2f}°, ground truth {np.degrees(profile.phi_true_rad):.2f}°"
        place = (0.01, np.degrees(profile.phi_true_rad))
        panels[0].annotate(text, place, xycoords=("axes fraction", "data"), color=RED, va="bottom")
        panels[1].axhline(0, color=MUTED, lw=0.7)
        panels[2].axhline(0, color=MUTED, lw=0.7)
        stage_one, stage_two = profile.phases.get("stage_one"), profile.phases.get("stage_two")
        if stage_one is not None and stage_two is not None:
            free = acceleration[stage_one[0] + 2 : stage_two[1] - 4]
            reach = 1.6 * float(np.abs(free).max()) if len(free) else 1.0
            panels[2].set_ylim(-reach, reach)
        panels[2].set_xlabel("time since the fit's first frame [s]")
        figure.align_ylabels()
    return figure


def _draw_phases(panels: Sequence[Axes], profile: Profile, seconds: Array) -> None:
    """Draw the phases as bands in all panels, their names above, and the times t1 to t3 as lines.

    t1 is the end of the strike, t2 the balance and t3 the landing.

    Args:
        panels: panels of the figure, from the top.
        profile: motion with its phases.
        seconds: (n,) times of the frames [s].
    """
    for name in PHASE_NAMES:
        if (span := profile.phases.get(name)) is None:
            continue
        start, end = float(seconds[span[0]]), float(seconds[min(span[1], len(seconds) - 1)])
        for axes in panels:
            axes.axvspan(start, end, color=PHASES[name], lw=0, zorder=0)
        if span[1] - span[0] > MIN_LABELLED_FRAMES:
            place = ((start + end) / 2, 1.02)
            panels[0].annotate(
                name.replace("_", " "), place, xycoords=("data", "axes fraction"), ha="center", color=MUTED
            )
    for name, label in (("stage_one", "t₁"), ("stage_two", "t₂"), ("landing", "t₃")):
        if (span := profile.phases.get(name)) is None or span[0] >= len(seconds):
            continue
        start = float(seconds[span[0]])
        for axes in panels:
            axes.axvline(start, color=INK, lw=0.8)
        panels[0].annotate(
            label,
            (start, 0.04),
            xycoords=("data", "axes fraction"),
            xytext=(3, 0),
            textcoords="offset points",
        )


def angles_figure(records: Sequence[SessionRecord]) -> Figure | None:
    """Figure 9(a) of the paper: balance angle's error [deg] of each good strike on the carton.

    Good is the verdict on a tip without sliding, twisting or rolling. The errors of our method and of the
    paper's are shown. None without such a strike in the sessions planned by our method.
    """
    angles = [
        angle
        for record in scores.with_our_plan(records)
        if record.object == "carton"
        for angle in record.angles
        if angle.paper_rad is not None
    ]
    if not angles:
        return None
    ours = np.degrees([angle.ours_rad - angle.true_rad for angle in angles])
    paper = np.degrees([(angle.paper_rad or 0.0) - angle.true_rad for angle in angles])
    with style():
        figure = Figure(figsize=(7.4, 2.7), layout="constrained")
        axes = figure.subplots()
        number = np.arange(len(angles))
        axes.plot(
            number,
            paper,
            "D",
            color=ORANGE,
            ms=4,
            label=f"sign change of the acceleration: sd {paper.std():.3f}°",
        )
        axes.plot(number, ours, "o", color=BLUE, ms=4, label=f"ours: sd {ours.std():.3f}°")
        axes.axhline(0, color=MUTED, lw=0.7)
        axes.set_xlabel("strike")
        axes.set_ylabel("error of φ [°]")
        figure.legend(loc="outside upper right", ncols=2)
    return figure


def sensitivity_figure(records: Sequence[SessionRecord]) -> Figure | None:
    """Figure 9(b, c): errors of c over noise of angles, and of region masses over noise of moments.

    c is the centre of mass; the regions are shell, upper and lower interior part. Added noise is that of the
    balance angles [deg] and of the moments of inertia about the edges [%]. None if no session planned by our
    method was analysed with both kinds of noise.
    """
    mine = scores.with_our_plan(records)
    com = [row for record in mine if record.moment_noise for row in record.angle_noise]
    masses = [row for record in mine for row in record.moment_noise]
    if not com or not masses:
        return None
    with style():
        figure = _swept_figure(
            (com, 1.0, "noise of the angles, 1 σ [°]", "(b) centre of mass"),
            (masses, 100.0, "noise of I about the edge, 1 σ [%]", "(c) region masses"),
        )
        figure.axes[0].axvline(PAPER_NOISE_DEG, color=MUTED, lw=0.7, ls=":")
    return figure


def scan_figure(records: Sequence[SessionRecord]) -> Figure | None:
    """Figure 10: errors of the centre of mass [mm] and of the region masses [%] over the scan's noise [mm].

    The error of the masses is the paper's metric, one number for shell and two inner parts. Both methods are
    shown. The noise is stated by the largest shift of a scanned point. None if no session planned by our
    method was analysed with a noisy scan.
    """
    mine = scores.with_our_plan(records)
    com = [row for record in mine for row in record.scan_noise_com]
    masses = [row for record in mine for row in record.scan_noise_masses]
    if not com:
        return None
    label = "largest shift of a scanned point [mm]"
    with style():
        return _swept_figure(
            (com, 1e3, label, "(a) centre of mass"), (masses, 1e3, label, "(b) region masses")
        )


def _swept_figure(*panels: tuple[Sequence[Sensitivity], float, str, str]) -> Figure:
    """Figure with two panels over the level of added noise: errors of c [mm] and of region masses [%].

    c is the centre of mass; the regions are shell, upper and lower interior part.

    Args:
        panels: for c, then for the region masses: the errors at each level of the noise, the factor on the
            levels, the label of the x axis, and the title.
    """
    figure = Figure(figsize=(7.4, 3.0), layout="constrained")
    results = ((1e3, "error of c [mm]"), (100.0, "region masses, paper's metric [%]"))
    for axes, (rows, scale_x, label_x, title), (scale_y, label_y) in zip(
        figure.subplots(1, 2), panels, results, strict=True
    ):
        _swept(axes, rows, scale_x, scale_y)
        axes.set(xlabel=label_x, ylabel=label_y, title=title)
    figure.legend(*figure.axes[0].get_legend_handles_labels(), loc="outside upper right", ncols=2)
    return figure


def _swept(axes: Axes, rows: Sequence[Sensitivity], scale_x: float, scale_y: float) -> None:
    """Draw the median and the central two thirds of an error over the noise level, for both methods.

    Args:
        axes: panel to draw in.
        rows: errors of both methods at each noise level, of all sessions.
        scale_x: factor on the levels, for the unit of the axis.
        scale_y: factor on the errors, for the unit of the axis.
    """
    sides: tuple[tuple[str, str, Callable[[Sensitivity], list[float | None]]], ...] = (
        ("the paper's method", ORANGE, lambda row: row.paper),
        ("ours", BLUE, lambda row: row.ours),
    )
    levels = sorted({row.level for row in rows})
    for name, colour, values_of in sides:
        values = [
            [v for row in rows if row.level == level for v in values_of(row) if v is not None]
            for level in levels
        ]
        there = [i for i, each in enumerate(values) if each]
        if not there:
            continue
        x = scale_x * np.array([levels[i] for i in there])
        low, middle, high = (
            scale_y * np.array([np.quantile(values[i], q) for i in there]) for q in (1 / 6, 0.5, 5 / 6)
        )
        axes.fill_between(x, low, high, color=colour, alpha=0.18, lw=0)
        axes.plot(x, middle, "-o", color=colour, ms=3.5, lw=1.3, label=name)
    axes.set_xlim(left=0)
    axes.set_ylim(bottom=0)


def results_figure(records: Sequence[SessionRecord]) -> Figure | None:
    """Figure 11: errors of centre of mass and region masses, with means, next to the published ones.

    Regions are the shell (outer wall) and the interior's two parts. None if no session is on the paper's
    objects and planned by our method.
    """
    mine = scores.on_paper_objects(scores.with_our_plan(records))
    if not mine:
        return None
    centres = [("published", MUTED, [1e3 * each.distance_m for each in published_centres()])]
    masses = [("published", MUTED, [100 * each.metric for each in published_masses()])]
    for name, colour, condition, paper in (
        ("paper's method", ORANGE, Condition.DRAWN, True),
        ("ours", BLUE, Condition.DRAWN, False),
        ("ours, calibration exact", SKY, Condition.EXACT, False),
    ):
        centres.append((name, colour, scores.distances_mm(mine, condition, paper=paper)))
        pairs = scores.region_masses(mine, condition, paper=paper)
        masses.append((name, colour, [100 * scores.metric(found, record) for found, record in pairs]))
    rng = np.random.default_rng(0)
    with style():
        figure = Figure(figsize=(7.4, 3.1), layout="constrained")
        for axes, rows, label in zip(
            figure.subplots(1, 2), (centres, masses), ("error of c [mm]", "paper's metric [%]"), strict=True
        ):
            for i, (_, colour, values) in enumerate(rows):
                if not values:
                    continue
                v = np.maximum(np.array(values), 1e-3)
                axes.plot(i + rng.uniform(-0.22, 0.22, len(v)), v, "o", color=colour, ms=3, alpha=0.6, mew=0)
                axes.plot([i - 0.3, i + 0.3], [v.mean()] * 2, color=INK, lw=1.4)
                axes.annotate(f"{v.mean():.2g}", (i + 0.32, v.mean()), va="center", fontsize=8)
            axes.set_yscale("log")
            axes.yaxis.set_major_formatter("{x:g}")
            axes.yaxis.set_minor_formatter("")
            axes.set_xticks(
                range(len(rows)), [name.replace(" ", "\n", 1).replace(", ", ",\n") for name, *_ in rows]
            )
            axes.grid(visible=False, axis="x")
            axes.set_xlim(-0.6, len(rows) - 0.2)
            axes.set_ylabel(label)
    return figure


def pictures_figure(records: Sequence[SessionRecord]) -> Figure | None:
    """Figure 12: each object's silhouette with true and estimated c, errors of c, and regions.

    c is the centre of mass. None if there is no session planned by our method.
    """
    mine = scores.with_our_plan(records)
    names = objects_of(mine)
    if not names:
        return None
    with style():
        figure = Figure(figsize=(1.55 * len(names) + 0.3, 7.0), layout="constrained")
        panels = figure.subplots(3, len(names), squeeze=False, height_ratios=(1.3, 0.8, 1.3))
        for column, name in enumerate(names):
            of_object = [record for record in mine if record.object == name]
            _picture_of_c(panels[0, column], of_object)
            panels[0, column].set_title(name)
            _errors_of_c(panels[1, column], of_object)
            _picture_of_regions(panels[2, column], of_object[0])
        panels[1, 0].set_ylabel("error of z [mm]")
        handles, labels = panels[0, 0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=min(3, len(names)))
    return figure


def _picture_of_c(axes: Axes, records: Sequence[SessionRecord]) -> None:
    """Draw an object's silhouette with the true and estimated centres of mass of all its sessions.

    The drawing is in x and z of the object frame [mm].

    Args:
        axes: matplotlib axes that receive it.
        records: sessions of the object; the silhouette is the first one's.
    """
    section = records[0].section
    if section is not None:
        axes.add_patch(Polygon(1e3 * np.array(section.outline_m), facecolor=BODY, edgecolor=INK, lw=0.9))
    paper = [a.com_m for a, _ in scores.answers(records, Condition.DRAWN, paper=True)]
    ours = [a.com_m for a, _ in scores.answers(records, Condition.DRAWN, paper=False)]
    true = [record.true_com_m for record in records]
    for points, mark, colour, size, label in (
        (paper, "D", ORANGE, 2.5, "the paper's method"),
        (ours, "o", BLUE, 2.5, "ours"),
        (true, "+", RED, 5, "ground truth, each seed"),
    ):
        if points:
            xz = 1e3 * np.array(points)[:, [0, 2]]
            axes.plot(xz[:, 0], xz[:, 1], mark, color=colour, ms=size, mew=0.8, label=label, alpha=0.85)
    plain(axes)
    axes.margins(0.06)
    axes.set_xticks([])
    axes.set_yticks([])


def _errors_of_c(axes: Axes, records: Sequence[SessionRecord]) -> None:
    """Draw the errors [mm] of the centre of mass in x and z of the object frame, by the paper and by us.

    They are those with drawn errors of calibration, in a close-up; larger ones lie on its border.
    """
    for mark, colour, paper in (("D", ORANGE, True), ("o", BLUE, False)):
        off = [
            np.subtract(a.com_m, r.true_com_m)[[0, 2]]
            for a, r in scores.answers(records, Condition.DRAWN, paper=paper)
        ]
        if off:
            x, z = np.clip(1e3 * np.array(off), -CLOSE_UP_MM, CLOSE_UP_MM).T
            axes.plot(x, z, mark, color=colour, ms=2.5, mew=0, alpha=0.8)
    axes.plot(0, 0, "+", color=RED, ms=7, mew=1.2)
    axes.set_xlim(-1.05 * CLOSE_UP_MM, 1.05 * CLOSE_UP_MM)
    axes.set_ylim(-1.05 * CLOSE_UP_MM, 1.05 * CLOSE_UP_MM)
    axes.set_aspect("equal")
    axes.set_xlabel("error of x [mm]")


def _picture_of_regions(axes: Axes, record: SessionRecord) -> None:
    """Draw a slice of the estimated regions, red where the ground truth differs, with their masses [g].

    The true masses are in brackets. The panel stays empty if the record has no slice.
    """
    section = record.section
    plain(axes)
    axes.set_xticks([])
    axes.set_yticks([])
    if section is None:
        return
    points = 1e3 * np.array(section.points_m)
    side = float(np.median(np.diff(np.unique(np.round(points[np.array(section.ours) > 0, 1], 2)))))
    squares = [Rectangle((x - side / 2, z - side / 2), side, side) for x, z in points]
    colours = np.where(
        np.not_equal(section.ours, section.true), RED, np.array([MUTED, BLUE, GREEN])[section.ours]
    )
    axes.add_collection(PatchCollection(squares, facecolor=list(colours), lw=0))
    axes.add_patch(Polygon(1e3 * np.array(section.outline_m), facecolor="none", edgecolor=GRID, lw=0.8))
    masses = record.ours[Condition.EXACT].masses_kg or []
    text = "\n".join(
        f"{name} {1e3 * found:.1f} ({1e3 * true:.1f})"
        for name, found, true in zip("SUL", masses, record.true_masses_kg, strict=False)
    )
    axes.set_xlabel(text, fontsize=8)
    axes.margins(0.06)
