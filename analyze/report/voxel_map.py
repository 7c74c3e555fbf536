"""Voxel map (density per cell) as figure, text and CSV file, with its prior and the measured share."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from analyze.report.plots import VIEWS
from analyze.report.style import DENSITY_MAP, style
from schemas.output_file import write_text
from schemas.wording import counted

if TYPE_CHECKING:
    from pathlib import Path

    from analyze.estimation.voxel_map import VoxelMap

_BINS = 24
"""Bins of the figure along the longest side."""
_SPREAD = np.stack(np.meshgrid((-0.375, -0.125, 0.125, 0.375), (-0.375, -0.125, 0.125, 0.375))).reshape(
    2, -1, 1
)
"""Sample places (2, 16, 1) across a cell, horizontal and vertical, as fractions of its edge length."""
_MAX_MISFIT = 3.0
"""Rms of residuals over their sd above which the map does not fit the moments."""


def voxel_figures(voxels: VoxelMap) -> list[Figure]:
    """Figures of mean density [g/cm³] along the line of sight: front, side, top; then the colour scale.

    `voxels` are cells of the body with their volumes and estimated densities; axes are in mm. Where there is
    next to no volume, the figure is blank.
    """
    masses = voxels.density * voxels.volumes
    low, high = 1e3 * voxels.points.min(axis=0), 1e3 * voxels.points.max(axis=0)
    step = float((high - low).max()) / _BINS
    size = np.cbrt(voxels.volumes)
    images = []
    for across, up, _ in VIEWS:
        edges = [np.arange(low[i] - step / 2, high[i] + step, step) for i in (across, up)]
        # A cell is drawn as wide as its cube: drawn as a point, it would leave empty bins between cells.
        places = [
            (1e3 * (voxels.points[:, i] + _SPREAD[j] * size)).ravel() for j, i in enumerate((across, up))
        ]
        mass, *_ = np.histogram2d(*places, bins=edges, weights=np.tile(masses, len(_SPREAD[0])))
        volume, *_ = np.histogram2d(*places, bins=edges, weights=np.tile(voxels.volumes, len(_SPREAD[0])))
        with np.errstate(invalid="ignore", divide="ignore"):
            images.append((edges, np.where(volume > 0.02 * volume.max(), 1e-3 * mass / volume, np.nan)))
    most = max(float(np.nanmax(image)) for _, image in images)
    found: list[Figure] = []
    with style():
        for (across, up, name), (edges, image) in zip(VIEWS, images, strict=True):
            figure = Figure(figsize=(3.05, 3.2), layout="constrained")
            axes = figure.subplots()
            axes.pcolormesh(*edges, image.T, cmap=DENSITY_MAP, vmin=0.0, vmax=most, linewidth=0)
            axes.set_title(name)
            axes.set_aspect("equal")
            axes.set_xlabel(f"{'xyz'[across]} [mm]")
            axes.set_ylabel(f"{'xyz'[up]} [mm]")
            axes.grid(visible=False)
            found.append(figure)
        scale = Figure(figsize=(3.6, 0.55), layout="constrained")
        colours = ScalarMappable(Normalize(0.0, most), DENSITY_MAP)
        bar = scale.colorbar(colours, cax=scale.subplots(), orientation="horizontal", ticks=MaxNLocator(5))
        bar.set_label("mean density [g/cm³]")
    return [*found, scale]


def voxel_map_text(voxels: VoxelMap) -> str:
    """Sentences on a voxel map (density per cell): what is assumed, what measured, and a misfit.

    Assumed is a uniform density. Measured is stated as the number of independent combinations of the
    cells' masses that the moments determine, and as the least and the largest share [%] by which they reduce
    the variance of an octant's mass (one of the eight parts of the body about its centroid). The misfit to
    the moments is named if it exceeds `_MAX_MISFIT` sd.
    """
    low, high = 100 * float(voxels.determined.min()), 100 * float(voxels.determined.max())
    text = (
        "The most uniform distribution with the measured moments, one of many that fit (bounded maximum "
        f"entropy around {1e-3 * voxels.prior:.2g} g/cm³ everywhere). {voxels.directions} of its "
        f"{counted(len(voxels.points), 'number', 'was')} measured: of the prior variance of each octant's "
        f"mass, the moments remove {low:.0f} to {high:.0f} %. The rest of the picture is the prior."
    )
    if voxels.misfit > _MAX_MISFIT:
        text += (
            f" It misses the moments by {voxels.misfit:.1f} times their sd: no such body has these moments."
        )
    return text


def write_voxels(voxels: VoxelMap, output: Path) -> None:
    """Write a CSV file of a voxel map: position in O, volume and density of each cell, in SI units.

    Two lines of comment (#) on its meaning and units come first.

    Raises:
        OutputError: the file cannot be written.
    """
    text = io.StringIO()
    text.write(
        f"# {voxel_map_text(voxels)}\n# position in the object's frame [m], volume [m^3], density "
        "[kg/m^3]\nx,y,z,volume,density\n"
    )
    np.savetxt(
        text, np.column_stack([voxels.points, voxels.volumes, voxels.density]), fmt="%.9g", delimiter=","
    )
    write_text(output, text.getvalue())
