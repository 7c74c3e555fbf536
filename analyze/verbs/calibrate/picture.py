"""Picture of a camera calibration: corners in the image, uncertainty of the pixels, and residuals."""

from __future__ import annotations

import io
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from analyze.calibration.verdict import GOOD_PIXEL_SD, MAX_PIXEL_SD
from analyze.report.style import BLUE, CYCLE, EMPTY, EMPTY_LINES, GOOD_TO_BAD, INK, MUTED, RED, style
from schemas.output_file import write_bytes
from schemas.wording import counted

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from analyze.calibration.calibrate import Calibration

COLOUR_LEVELS_PX = (0.01, 0.03, 0.1, 0.3, 1.0, 3.0)
"""Ticks of the colour scale [px]."""
_ARROW_FRACTION = 0.06
"""Length of an arrow for the 95 % quantile of the residuals, as a fraction of the image's width."""


def picture(found: Calibration) -> Figure:
    """Matplotlib figure of a calibration, three panels over the image: corners, uncertainty and residuals.

    The panels show the board's corners by view, the standard deviation [px] of the pixel to which a direction
    projects, and the residuals as arrows. If the views do not determine the lens, a red title gives the
    reason.
    """
    lens = found.lens
    ratio = lens.height / lens.width
    with style():
        figure = Figure(
            figsize=(13.2, 4.1 * ratio + (0.95 if found.undetermined else 0.7)), layout="constrained", dpi=130
        )
        covered, uncertain, residual = figure.subplots(1, 3)
        _coverage(covered, found)
        _uncertainty(figure, uncertain, found)
        _residuals(residual, found)
        for axes in (covered, uncertain, residual):
            axes.set_xlim(-0.5, lens.width - 0.5)
            axes.set_ylim(lens.height - 0.5, -0.5)
            axes.set_aspect("equal")
            axes.grid(visible=False)
            axes.spines[["top", "right"]].set_visible(True)
            axes.set_xticks([0, lens.width - 1])
            axes.set_yticks([0, lens.height - 1])
            axes.tick_params(length=2)
        if found.undetermined:
            figure.suptitle(
                f"not determined: {found.undetermined[0].split(':')[0]}",
                color=RED,
                fontsize=10,
                fontweight="bold",
                x=0.01,
                ha="left",
            )
    return figure


def write_picture(found: Calibration, output: Path) -> None:
    """Write the picture of a calibration (corners, uncertainty, residuals) to `output` as PNG.

    The file appears complete or not at all.

    Raises:
        OutputError: the file cannot be written.
    """
    data = io.BytesIO()
    with style():
        FigureCanvasAgg(picture(found)).print_png(data, metadata={"Software": "Percuss"})
    write_bytes(output, data.getvalue())


def _coverage(axes: Axes, found: Calibration) -> None:
    lens, count = found.lens, found.covered.count
    rows, columns = count.shape
    for row, column in np.argwhere(count == 0):
        corner = (column * lens.width / columns - 0.5, row * lens.height / rows - 0.5)
        size = (lens.width / columns, lens.height / rows)
        axes.add_patch(
            Rectangle(corner, *size, facecolor=EMPTY, edgecolor=EMPTY_LINES, hatch="////", linewidth=0)
        )
    for number, shot in enumerate(found.shots):
        axes.plot(*shot.view.place.T, ".", ms=3.8, color=CYCLE[number % len(CYCLE)], alpha=0.75, mew=0)
    axes.set_title(
        f"{counted(sum(len(shot.view.place) for shot in found.shots), 'corner')} in "
        f"{counted(len(found.shots), 'view')}"
    )
    bare = 100 * (1 - found.covered.share)
    axes.set_xlabel(
        "colour: view"
        + (f"; hatched: no corner there ({bare:.0f} %)" if bare > 0.5 else "; corners everywhere")
    )


def _uncertainty(figure: Figure, axes: Axes, found: Calibration) -> None:
    pixels = found.pixels
    value = np.ma.masked_invalid(pixels.value)
    mesh = axes.pcolormesh(
        pixels.column,
        pixels.row,
        np.clip(value, COLOUR_LEVELS_PX[0], COLOUR_LEVELS_PX[-1]),
        norm=LogNorm(COLOUR_LEVELS_PX[0], COLOUR_LEVELS_PX[-1]),
        cmap=GOOD_TO_BAD,
        shading="gouraud",
        rasterized=True,
    )
    drawn = [
        level
        for level in (0.01, 0.02, 0.03, 0.05, 0.1, 0.2, 0.3, 0.5, 1.0, 2.0, 5.0)
        if pixels.value[np.isfinite(pixels.value)].min() < level < pixels.worst
    ]
    if drawn:
        lines = axes.contour(pixels.column, pixels.row, value, levels=drawn, colors=INK, linewidths=0.7)
        axes.clabel(lines, fmt="%g px", fontsize=7)
    at = pixels.worst_at
    axes.plot(*at, "o", ms=7, mfc="none", mec=INK, mew=1.1, clip_on=False)
    axes.set_title(f"largest sd of a pixel: {pixels.worst:.2g} px")
    axes.set_xlabel("sd of the pixel that a direction is imaged to; circle: largest")
    bar = figure.colorbar(mesh, cax=axes.inset_axes((1.025, 0.0, 0.028, 1.0)), ticks=COLOUR_LEVELS_PX)
    bar.ax.set_yticklabels([f"{level:g}" for level in COLOUR_LEVELS_PX])
    bar.ax.minorticks_off()
    bar.outline.set_visible(False)
    bar.ax.set_title("px", fontsize=8, fontweight="normal", loc="center")
    for level, colour in ((GOOD_PIXEL_SD, INK), (MAX_PIXEL_SD, RED)):
        bar.ax.axhline(level, color=colour, lw=1.2)


def _residuals(axes: Axes, found: Calibration) -> None:
    lens = found.lens
    place = np.concatenate([shot.view.place for shot in found.shots])
    residual = np.concatenate(found.bundle.residuals)
    usual = float(np.quantile(np.hypot(*residual.T), 0.95))
    scale = _ARROW_FRACTION * lens.width / max(usual, 1e-6)
    axes.quiver(
        *place.T,
        *residual.T,
        angles="xy",
        scale_units="xy",
        scale=1.0 / scale,
        width=0.0022,
        color=BLUE,
        alpha=0.7,
        headwidth=3.5,
        headlength=4,
    )
    magnified = max(
        step * 10.0**power
        for power in range(-6, 3)
        for step in (1, 2, 5)
        if step * 10.0**power <= 1.5 * max(usual, 1e-6)
    )
    long = magnified * scale
    x, y = 0.03 * lens.width, 0.95 * lens.height
    axes.plot([x, x + long], [y, y], color=INK, lw=2, solid_capstyle="butt")
    axes.annotate(
        f"{magnified:g} px",
        (x + long, y),
        (4, 0),
        textcoords="offset points",
        va="center",
        fontsize=8,
        bbox={"fc": "white", "ec": "none", "pad": 1, "alpha": 0.8},
    )
    axes.set_title(f"residuals: {found.rms_px:.3f} px (rms)")
    axes.set_xlabel("corner minus lens model; directions should show no pattern", color=MUTED)
