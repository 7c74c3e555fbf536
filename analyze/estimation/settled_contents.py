"""Fill level of a container whose contents move, from the centre of mass of its poses at rest.

The body is a shell of one density with contents that fill the lowest part of its inside, up to a level
surface, in every pose. With v the filled share of the inside and w the contents' share of the mass, the
centre of mass of a pose with the upward direction u is

    c(u) = (1 - w) c_shell + w b(v, u),

b the centroid of the lowest share v of the inside. Both are found on a grid; the prior is uniform in v and w,
or w follows from v by the stated density.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from analyze.estimation.cells import Cells
from analyze.estimation.fill_level import KnownDensity, Marginal
from analyze.estimation.pose_test import PoseCentre
from analyze.least_squares.intervals import TAIL_95
from analyze.types import Array

FILLED_GRID = np.linspace(0.01, 0.99, 99)
"""Filled shares of the inside that are tried."""
SHARE_GRID = np.linspace(0.01, 0.95, 95)
"""Shares of the contents in the mass that are tried."""
DENSITY_FACTORS = np.linspace(-2.0, 2.0, 9)
"""Errors of a stated density that are tried, in its sd."""
UNEVEN_SHELL = 0.02
"""1 sigma of the shell's centre of mass along an axis about its centroid, over the body's extent there."""
OPEN_WIDTH = 0.5
"""Width of an interval, over that of the grid, from which on a quantity counts as not observed."""


@dataclass(frozen=True)
class SettledContents:
    """Filled share of the inside and mass of contents that move, by the poses' centres of mass."""

    filled: Marginal
    """Filled share of the inside's volume, 0 to 1."""
    mass: Marginal
    """Mass of the contents [kg]."""
    misfit: float
    """Rms of the standardised residuals of the poses' centres of mass at the best fit."""


def settled_contents(
    centres: Sequence[PoseCentre], cells: Cells, mass: float, density: KnownDensity | None
) -> SettledContents | None:
    """Fill level of contents that settle on the floor of every pose; None for fewer than two poses.

    Args:
        centres: Centre of mass of each pose, in the object frame O.
        cells: The body divided into cells of its shell and its inside.
        mass: Mass of shell and contents together [kg].
        density: Stated density of the contents; None to leave it open.

    Returns:
        Filled share, mass of the contents and misfit. Errors that the poses share count as each pose's own.
    """
    inside = float(cells.interior.sum())
    if len(centres) < 2 or inside <= 0:
        return None
    shell = cells.shell @ cells.points / cells.shell.sum()
    extent = np.ptp(cells.points, axis=0)
    uneven = np.diag((UNEVEN_SHELL * extent) ** 2)
    filled, share, weight = _grid(mass, inside, density)
    chi_squared = np.zeros(filled.shape)
    for centre in centres:
        lowest = _lowest_centroids(cells, centre.up)
        settled = _columns(filled, FILLED_GRID, lowest)
        off = (1 - share)[:, None] * shell + share[:, None] * settled - centre.position
        precision = np.linalg.inv(centre.covariance + uneven)
        chi_squared += np.einsum("ni,ij,nj->n", off, precision, off)
    probability = weight * np.exp(-0.5 * (chi_squared - chi_squared.min()))
    probability /= probability.sum()
    return SettledContents(
        filled=_marginal(filled, probability, float(np.ptp(FILLED_GRID))),
        mass=_marginal(mass * share, probability, mass),
        misfit=float(np.sqrt(chi_squared.min() / (3 * len(centres)))),
    )


def _grid(mass: float, inside: float, density: KnownDensity | None) -> tuple[Array, Array, Array]:
    """Filled shares, shares of the mass and prior weights of all grid points, each (n,)."""
    if density is None:
        filled, share = (each.ravel() for each in np.meshgrid(FILLED_GRID, SHARE_GRID, indexing="ij"))
        return filled, share, np.ones(len(filled))
    filled, error = (each.ravel() for each in np.meshgrid(FILLED_GRID, DENSITY_FACTORS, indexing="ij"))
    share = (density.value + error * density.sd) * filled * inside / mass
    return filled, np.clip(share, 0.0, 1.0), np.where(share < 1, np.exp(-0.5 * error**2), 0.0)


def _lowest_centroids(cells: Cells, up: Array) -> Array:
    """Centroids (len(FILLED_GRID), 3) [m] of the lowest shares of the inside, with `up` (3,) upwards."""
    order = np.argsort(cells.points @ up)
    volume = cells.interior[order]
    total = np.concatenate([[0.0], np.cumsum(volume)])
    moment = np.concatenate([np.zeros((1, 3)), np.cumsum(volume[:, None] * cells.points[order], axis=0)])
    below = _columns(FILLED_GRID * total[-1], total, moment)
    return below / (FILLED_GRID * total[-1])[:, None]


def _columns(at: Array, places: Array, values: Array) -> Array:
    """Values (n, c) interpolated at `at` (n,) between `places` (m,), where they are `values` (m, c)."""
    found = [np.interp(at, places, values[:, i]) for i in range(values.shape[1])]
    return np.column_stack(found).astype(np.float64)


def _marginal(values: Array, probability: Array, widest: float) -> Marginal:
    """Mean, sd and central 95 % interval of values (n,) with their probabilities; `widest` is their range."""
    order = np.argsort(values)
    total = np.cumsum(probability[order])
    low, high = np.interp([TAIL_95, 1 - TAIL_95], total, values[order])
    mean = float(probability @ values)
    sd = float(np.sqrt(max(probability @ (values - mean) ** 2, 0.0)))
    return Marginal(mean, sd, (float(low), float(high)), bool(high - low < OPEN_WIDTH * widest))
