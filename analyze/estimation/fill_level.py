"""Level, mass and density of a filling, and the shell's thickness where it is not given.

The body is a shell of one density, a filling of one density inside it below the plane u.x = h, and empty
above; u is the direction that pointed upwards when the object was filled, h the level. For a given h and
shell thickness, the measured quantities are linear in the masses of shell and filling (as in part_masses.py),
and the masses are integrated out exactly. h and the thickness lie on a grid, refined where the data fit best.
The prior is uniform in the level, in the logarithm of the thickness, and in each mass from zero to that of as
much lead; or the filling's density is given with its sd. The filling is assumed to turn rigidly with the
body: powder that does not flow, or a frozen, set or viscous filling. A free liquid does not.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from analyze.errors import EstimationError
from analyze.estimation.cells import ShellCells
from analyze.estimation.part_masses import MeasuredMoments
from analyze.estimation.truncated_normal import narrowest_intervals
from analyze.geometry.plausible_size import DENSITIES
from analyze.types import Array

LEVEL_GRID_POINTS, THICKNESS_GRID_POINTS = 81, 13
"""Grid points of the level and of the shell's thickness."""
MIN_HALF_HEIGHT_FRACTION = 0.05
"""Lower bound of a cell's half height, as a fraction of the pitch."""
MIN_FILLED_SHARE = 0.01
"""Smallest share of the inside's volume that counts as a filling."""
DRAWS = 4000
"""Number of draws from the posterior."""
DRAWS_PER_KEPT = 4
"""Draws made for each one wanted, so that enough lie within the bounds."""
MIN_DRAWS = 200
"""Number of draws within the bounds below which all draws are clipped to the bounds instead."""
_MAX_REFINEMENTS = 5
"""Largest number of refinements of the level's grid."""
_MAX_CHI2_EXCESS = 30.0
"""Excess of chi^2 over its minimum beyond which a level is dropped from the refined grid."""
_MIN_REDUCTION = 0.7
"""Share of the grid's range above which a refinement no longer pays."""
_UNOBSERVED_WIDTH = 0.5
"""Width of an interval over the widest possible one from which on a quantity counts as not observed."""


@dataclass(frozen=True)
class Container(ShellCells):
    """The body as a container: cells (small pieces) for one thickness of its shell (outer wall), and hull.

    The hull is given by its vertices (n, 3) [m], in the object frame O.
    """

    corners: Array
    """(n, 3) vertices of the body's hull [m], in the object frame O."""

    def heights(self, along: Array) -> tuple[Array, Array]:
        """Heights (n,) and half heights (n,) [m] of all cells along the unit vector `along` (3,).

        A height is that of the cell's centroid above the origin of the object frame O. A half height is half
        the pitch (edge of a cell), or the distance to the nearer end of the inside (the space within the
        shell) where that is less, but at least `MIN_HALF_HEIGHT_FRACTION` of the pitch.
        """
        height = self.cells.points @ along
        low, high = self.ends(along)
        return height, np.clip(
            np.minimum(height - low, high - height),
            MIN_HALF_HEIGHT_FRACTION * self.cells.pitch,
            self.cells.pitch / 2,
        )

    def ends(self, along: Array) -> tuple[float, float]:
        """Lowest and highest place [m] of the inside (the space within the shell) along unit `along` (3,).

        They are the ends of the hull, moved inwards by the shell's thickness, and are measured from the
        origin of the object frame O.
        """
        height = self.corners @ along
        return float(height.min()) + self.thickness, float(height.max()) - self.thickness


@dataclass(frozen=True)
class KnownDensity:
    """Density of the filling as the object file states it, with its standard deviation."""

    value: float
    """Density [kg/m^3]."""
    sd: float
    """1 sigma of the density [kg/m^3]."""


@dataclass(frozen=True)
class Marginal:
    """Marginal posterior of one quantity: mean, sd and 95 % interval, in that quantity's unit."""

    value: float
    """Posterior mean."""
    sd: float
    """Posterior standard deviation."""
    interval: tuple[float, float]
    """Shortest interval that contains 95 % of the posterior."""
    observed: bool
    """False if the interval is at least half as wide as the range of possible values."""


@dataclass(frozen=True)
class FillLevel:
    """Posterior of a filling (level, filled share, mass, density) and of the shell (wall) around it.

    Each quantity has mean, sd and 95 % interval, in SI units.
    """

    along: Array
    """(3,) unit vector u in the object frame O that pointed upwards when the object was filled."""
    level: Marginal
    """Level h along u from O's origin [m]."""
    filled: Marginal
    """Filled share of the inside's volume, 0 to 1."""
    mass: Marginal
    """Mass of the filling [kg]."""
    density: Marginal
    """Density of the filling [kg/m^3]."""
    shell_mass: Marginal
    """Mass of the shell [kg]."""
    thickness: Marginal | None
    """Thickness of the shell [m]; None if it was given."""
    misfit: float
    """Rms of the standardised residuals of mass, first moment and moments of inertia at the maximum
    likelihood."""


def fill_level(
    moments: MeasuredMoments,
    shells: Sequence[Container],
    along: Array,
    density: KnownDensity | None,
    rng: np.random.Generator,
) -> FillLevel:
    """Posterior of level, mass and density of an object's filling (method.md, section 6).

    Args:
        moments: Measured mass, centre of mass and moments of the whole object.
        shells: The body with its shell (outer wall): one entry if the shell's thickness is given; otherwise
            one for each of several thicknesses, thinnest first, to interpolate between.
        along: (3,) vector in the object frame O that pointed upwards when the object was filled; need not be
            of unit length.
        density: Density of the filling; None if it is not known.
        rng: Random generator of the draws; the same seed gives the same result.

    Returns:
        Mean, sd and 95 % interval of each quantity; the level is measured from O's origin along `along`. The
        shell's thickness is included only if several shells are given.

    Raises:
        EstimationError: one of the shells leaves no inside.
    """
    u = along / np.linalg.norm(along)
    if not all(shell.cells.interior.any() for shell in shells):
        raise EstimationError("the shell leaves no inside that could be filled: check shell_thickness_m")
    whole = shells[0].ends(u)
    grid = _refined_grid(moments, shells, u, density, whole, moments.com)
    # Moments of inertia are measured about the true c; the model's c estimates it better than the measured
    # one.
    grid = _refined_grid(moments, shells, u, density, whole, grid.best()[0])
    return grid.posterior(whole, rng)


def _refined_grid(
    moments: MeasuredMoments,
    shells: Sequence[Container],
    along: Array,
    density: KnownDensity | None,
    whole: tuple[float, float],
    about: Array,
) -> _Grid:
    """Posterior on a grid of shell thicknesses and fill levels, its levels narrowed to the likely ones.

    The range of levels is narrowed at most `_MAX_REFINEMENTS` times; the number of levels stays the same.

    Args:
        moments: Measured mass, centre of mass and moments of the whole object.
        shells: Cells (small pieces) of the body for one or more shell thicknesses, thinnest first; the shell
            is the outer wall.
        along: (3,) unit vector in the object frame O, along which levels are measured.
        density: Density of the filling; None if it is not known.
        whole: Lowest and highest possible level [m].
        about: (3,) point about which the model's moments of inertia are taken [m], in O.
    """
    grid = _Grid(moments, shells, along, density, np.linspace(*whole, LEVEL_GRID_POINTS), about)
    for _ in range(_MAX_REFINEMENTS):
        low, high = grid.near()
        if high - low > _MIN_REDUCTION * (grid.levels[-1] - grid.levels[0]):
            break
        grid = _Grid(moments, shells, along, density, np.linspace(low, high, LEVEL_GRID_POINTS), about)
    return grid


class _Grid:
    """Posterior of shell thickness and fill level on a grid of t thicknesses times h levels.

    The masses of shell and filling are integrated out. The inside is the space within the shell.

    Args:
        moments: measured mass, centre of mass and moments of the whole object.
        shells: the body cut into cells (small cubes), for one or more shell thicknesses, thinnest first.
        along: (3,) unit vector in the object frame O, along which levels are measured.
        density: density of the filling; None if it is not known.
        levels: (h,) levels of the grid [m].
        about: (3,) point about which the model's moments of inertia are taken [m], in O.

    Attributes:
        levels: (h,) levels from the origin of the object frame O [m].
        swept: True if the shell's thickness is unknown (several shells given).
        thickness: (t,) thicknesses of the shell [m].
        volume: (t, h) volume of the inside below the level [m^3].
        filled: (t, h) filled share of the inside's volume.
        precision: (t, h, 2, 2) inverse covariance of the masses of shell and filling [1/kg^2].
        masses: (t, h, 2) likeliest masses of shell and filling [kg], not bounded.
        chi2: (t, h) chi^2 at the masses within their bounds; infinite for next to no filling.
        log: (t, h) log posterior up to a constant.
    """

    def __init__(
        self,
        moments: MeasuredMoments,
        shells: Sequence[Container],
        along: Array,
        density: KnownDensity | None,
        levels: Array,
        about: Array,
    ) -> None:
        self._moments, self._along, self.levels = moments, along, levels
        nodes = np.array([shell.thickness for shell in shells])
        self.swept = len(nodes) > 1
        self.thickness: Array = np.asarray(
            np.geomspace(nodes[0], nodes[-1], THICKNESS_GRID_POINTS) if self.swept else nodes,
            dtype=np.float64,
        )
        whiten, self._target = moments.whitening()
        held = [_contents(shell, along, levels, moments, about) for shell in shells]
        shell, below, whole = (
            _interpolated(nodes, self.thickness, np.array([each[i] for each in held])) for i in range(3)
        )
        self.volume = below[..., 0]
        # Bounds of the masses [kg], at the density of lead.
        self._most = DENSITIES[1] * np.stack(
            [np.broadcast_to(shell[:, None, 0], below.shape[:2]), self.volume], axis=-1
        )
        self.filled = self.volume / whole[:, None, 0]
        per_shell = np.broadcast_to((shell / shell[:, :1])[:, None], below.shape)
        self._per_kilogram = np.stack([per_shell, below / np.maximum(self.volume, 1e-30)[..., None]], axis=-1)
        design = whiten @ self._per_kilogram
        normal = np.swapaxes(design, -1, -2) @ design
        right = np.einsum("thrc,r->thc", design, self._target)
        squares = np.full(self.volume.shape, float(self._target @ self._target))
        prior = np.zeros_like(self.volume)
        if density is not None:
            # A stated density is one more observation of the filling's mass, with an sd proportional to its
            # volume.
            spread = np.maximum(density.sd * self.volume, 1e-30)
            normal[..., 1, 1] += 1.0 / spread**2
            right[..., 1] += density.value * self.volume / spread**2
            squares += (density.value / density.sd) ** 2
            prior = -np.log(spread)
        self.precision = normal + 1e-12 * np.trace(normal, axis1=-2, axis2=-1)[..., None, None] * np.eye(2)
        self.masses: Array = np.asarray(np.linalg.solve(self.precision, right[..., None]), dtype=np.float64)[
            ..., 0
        ]
        self.chi2 = squares - np.sum(right * self.masses, axis=-1)
        # Negative masses would explain anything: clipping them counts as misfit.
        off = np.clip(self.masses, 0.0, self._most) - self.masses
        self.chi2 = self.chi2 + np.einsum("thi,thij,thj->th", off, self.precision, off)
        self.chi2 = np.where(self.filled > MIN_FILLED_SHARE, self.chi2, np.inf)
        self.log = prior - 0.5 * self.chi2 - 0.5 * np.linalg.slogdet(self.precision)[1]

    def near(self) -> tuple[float, float]:
        """Lowest and highest fill level [m] that a finer grid of levels must cover, from this grid's chi^2.

        They enclose the levels whose chi^2, with the best shell thickness, is within `_MAX_CHI2_EXCESS` of
        the smallest or may be so between two levels of the grid, and the next level on either side.
        """
        least = np.min(self.chi2, axis=0)
        padded = np.concatenate([[np.inf], least, [np.inf]])
        sides = np.stack([padded[:-2], padded[2:]])
        valley = np.isfinite(least) & np.all(least <= sides, axis=0)
        # Between two grid points chi^2 may be lower by half of its change from one to the next.
        change = np.max(np.where(np.isfinite(sides), sides, least), axis=0)
        lowest = least.copy()
        lowest[valley] -= 0.5 * (change[valley] - least[valley])
        kept = np.flatnonzero(lowest < float(np.min(least)) + _MAX_CHI2_EXCESS)
        first, last = max(int(kept[0]) - 1, 0), min(int(kept[-1]) + 1, len(least) - 1)
        return float(self.levels[first]), float(self.levels[last])

    def best(self) -> tuple[Array, float]:
        """Centre of mass (3,) [m] and misfit of the model at the grid's smallest chi^2.

        The centre of mass is in the object frame O. The misfit is the rms of the standardised residuals.
        """
        t, h = np.unravel_index(int(np.argmin(self.chi2)), self.chi2.shape)
        masses = np.clip(self.masses[t, h], 0.0, None)
        first = self._per_kilogram[t, h, 1:4] @ masses / max(float(masses.sum()), 1e-12)
        return self._moments.com + first, float(np.sqrt(max(self.chi2[t, h], 0.0) / len(self._target)))

    def posterior(self, whole: tuple[float, float], rng: np.random.Generator) -> FillLevel:
        """Fill level [m], filled share, masses [kg] of shell and filling, its density, and shell thickness.

        Each has mean, sd and 95 % interval in SI units, from up to `DRAWS` random draws; the thickness is
        None if it was given. The level is the height of the filling's surface over the origin of the object
        frame O, along the direction that was up when the object was filled. Draws of masses outside their
        bounds are rejected; if fewer than `MIN_DRAWS` remain, masses are clipped to the bounds instead.

        Args:
            whole: lowest and highest possible level [m], to which drawn levels are clipped.
            rng: generator of the draws.
        """
        weight = np.exp(self.log - np.max(self.log)).ravel()
        place = rng.choice(len(weight), DRAWS * DRAWS_PER_KEPT, p=weight / weight.sum())
        t, h = np.unravel_index(place, self.log.shape)
        step = float(self.levels[1] - self.levels[0])
        level = self.levels[h] + step * rng.uniform(-0.5, 0.5, len(h))
        values, vectors = np.linalg.eigh(self.precision[t, h])
        spread = vectors / np.sqrt(values)[:, None, :]
        masses = self.masses[t, h] + np.einsum("nij,nj->ni", spread, rng.standard_normal((len(h), 2)))
        most = self._most[t, h]
        allowed = np.flatnonzero(np.all((masses >= 0.0) & (masses <= most), axis=1))[:DRAWS]
        if len(allowed) < MIN_DRAWS:
            masses, allowed = np.clip(masses, 0.0, most), np.arange(DRAWS)
        t, h, level, masses = t[allowed], h[allowed], level[allowed], masses[allowed]
        densities = masses[:, 1] / self.volume[t, h]
        ratio = np.log(self.thickness[-1] / self.thickness[0]) / (THICKNESS_GRID_POINTS - 1)
        thickness = self.thickness[t] * np.exp(ratio * rng.uniform(-0.5, 0.5, len(t)))
        total = self._moments.mass
        return FillLevel(
            along=self._along,
            level=_marginal(np.clip(level, *whole), whole[1] - whole[0]),
            filled=_marginal(self.filled[t, h], 1.0),
            mass=_marginal(masses[:, 1], total),
            density=_marginal(densities, float(DENSITIES[1])),
            shell_mass=_marginal(masses[:, 0], total),
            thickness=_marginal(thickness, float(self.thickness[-1] - self.thickness[0]))
            if self.swept
            else None,
            misfit=self.best()[1],
        )


def _contents(
    shell: Container, along: Array, levels: Array, moments: MeasuredMoments, about: Array
) -> tuple[Array, Array, Array]:
    """Volume and moments of the shell, of the inside below each level, and of the whole inside.

    The inside is the space within the shell. Each has f = 4 + a numbers at unit density: volume [m^3], first
    moment about the measured centre of mass [m^4], and moments of inertia about the a measured directions
    through `about` [m^5].

    Args:
        shell: Cells for one thickness of the shell.
        along: (3,) unit vector in the object frame O, along which levels are measured.
        levels: (h,) levels from O's origin [m].
        moments: Measured centre of mass and directions of the moments.
        about: (3,) point [m], in O.

    Returns:
        Arrays of the shell (f,), of the inside below each level (h, f), and of the whole inside (f,).
    """
    cells = shell.cells
    features = moments.by_cell(cells, about)
    height, half = shell.heights(along)
    below = np.clip((levels[:, None] - height) / (2.0 * half) + 0.5, 0.0, 1.0) * cells.interior
    return cells.shell @ features, below @ features, cells.interior @ features


def _interpolated(nodes: Array, at: Array, values: Array) -> Array:
    """Values (t, ...) at `at` (t,) by linear interpolation of `values` (n, ...) at ascending `nodes` (n,).

    If there is a single node, its `values` are returned unchanged.
    """
    if len(nodes) == 1:
        return values
    above = np.clip(np.searchsorted(nodes, at), 1, len(nodes) - 1)
    share = ((at - nodes[above - 1]) / (nodes[above] - nodes[above - 1])).reshape(
        -1, *[1] * (values.ndim - 1)
    )
    return (1.0 - share) * values[above - 1] + share * values[above]


def _marginal(draws: Array, widest: float) -> Marginal:
    """Mean, sd and shortest 95 % interval of `draws` (n,) of a quantity, and whether it is determined.

    It counts as determined (`observed`) if the interval is narrower than `_UNOBSERVED_WIDTH` of `widest`, the
    width of the range of possible values.
    """
    low, high = (float(end[0]) for end in narrowest_intervals(np.sort(draws)[:, None]))
    return Marginal(
        float(draws.mean()), float(draws.std()), (low, high), high - low < _UNOBSERVED_WIDTH * widest
    )
