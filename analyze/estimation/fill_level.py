"""What fills an object's inside up to a level that nobody knows: its mass, its level, and the wall's thickness where that is open too.

The body is a wall of one density, a filling of one density inside it below the plane u.x = h, and nothing above. With h and the wall's
thickness given, everything that was measured is linear in the two masses (as in part_masses.py): those are integrated out exactly, h and
the thickness on a grid that closes in on where the data put them. Before anything is measured every level is as likely, every thickness
in its logarithm, and every mass between nothing and lead; or the filling's density is known, as stated.
It is taken to turn with the body as one: powder that does not run, or what is frozen, set or viscous. A free liquid is no such thing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from analyze.errors import EstimationError
from analyze.estimation.cells import Cells
from analyze.estimation.part_masses import MeasuredMoments
from analyze.geometry.object_model import DENSITIES
from analyze.types import Array

LEVELS, THICKNESSES = 81, 13
"""of the grid"""
THINNEST = 0.05
"""of the cells' pitch, that a cell is tall at least"""
LEAST_FILLED = 0.01
"""of the inside, that counts as a filling"""
DRAWS = 4000
TRIES = 4
"""times as many are drawn, so that enough lie within the bounds"""
LEAST_DRAWS = 200
_CLOSINGS = 5
_FAR = 30.0
"""of chi^2 above the least, where nothing is left"""
_CLOSED = 0.7
"""of a grid, that the next one would still be: then it is close enough"""
_OPEN = 0.5
"""width of an interval over what it could be at most, from which on nothing was observed"""


@dataclass(frozen=True)
class Shell:
    """The body cut into wall and inside, for one thickness of the wall."""

    thickness: float
    """m"""
    cells: Cells
    corners: Array
    """(n, 3) m, of the body's hull"""

    def heights(self, along: Array) -> tuple[Array, Array]:
        """Of each cell (n,), along `along`, and half of how tall it is there (n,): one at an end reaches no farther than that."""
        height = self.cells.points @ along
        low, high = self.ends(along)
        return height, np.clip(np.minimum(height - low, high - height), THINNEST * self.cells.pitch, self.cells.pitch / 2)

    def ends(self, along: Array) -> tuple[float, float]:
        """Of the inside [m]: where the wall at the body's ends leaves off."""
        height = self.corners @ along
        return float(height.min()) + self.thickness, float(height.max()) - self.thickness


@dataclass(frozen=True)
class KnownDensity:
    """Of the filling, kg/m^3, with its 1 sigma."""

    value: float
    sd: float


@dataclass(frozen=True)
class Marginal:
    """One number's posterior."""

    value: float
    """mean"""
    sd: float
    interval: tuple[float, float]
    """the shortest that holds 95 %"""
    observed: bool
    """False: it leaves open at least half of what could be"""


@dataclass(frozen=True)
class FillLevel:
    """Posterior of a filling."""

    along: Array
    """(3,) unit, u"""
    level: Marginal
    """m, h along u from O"""
    filled: Marginal
    """0 to 1, of the inside's volume"""
    mass: Marginal
    """kg"""
    density: Marginal
    """kg/m^3"""
    wall_mass: Marginal
    """kg"""
    thickness: Marginal | None
    """m, of the wall; None where it was given"""
    misfit: float
    """rms of what the likeliest leaves of the moments, over its sd"""


def fill_level(
    moments: MeasuredMoments, shells: Sequence[Shell], along: Array, density: KnownDensity | None, rng: np.random.Generator
) -> FillLevel:
    """Level, mass and density of what fills the inside.

    Args:
        moments: of the whole.
        shells: one for a thickness that is known; else several, thinnest first, between which is interpolated.
        along: (3,) what was up when it was filled, in O.
        density: of the filling, if it is known.
        rng: for the draws; the same seed gives the same answer.

    Raises:
        EstimationError: the object has no inside.
    """
    u = along / np.linalg.norm(along)
    if not all(shell.cells.interior.any() for shell in shells):
        raise EstimationError("its wall leaves nothing inside that could be filled: look at shell_thickness_m")
    low, high = shells[0].ends(u)
    whole = (low, high)
    grid = _closed_in(moments, shells, u, density, whole, moments.com)
    # Moments of inertia were measured about the true c, of which the model's own is the better guess.
    grid = _closed_in(moments, shells, u, density, whole, grid.best().centre)
    return grid.posterior(whole, rng)


def _closed_in(
    moments: MeasuredMoments, shells: Sequence[Shell], along: Array, density: KnownDensity | None, whole: tuple[float, float], about: Array
) -> _Grid:
    levels = np.linspace(*whole, LEVELS)
    grid = _Grid(moments, shells, along, density, levels, about)
    for _ in range(_CLOSINGS):
        reach = grid.near(levels)
        if reach[1] - reach[0] > _CLOSED * (levels[-1] - levels[0]):
            break
        levels = np.linspace(*reach, LEVELS)
        grid = _Grid(moments, shells, along, density, levels, about)
    return grid


@dataclass(frozen=True)
class _Best:
    centre: Array
    """(3,) m, of the model's c"""
    misfit: float


class _Grid:
    """All levels (h) times all thicknesses (t), with the masses of wall and filling integrated out."""

    def __init__(
        self,
        moments: MeasuredMoments,
        shells: Sequence[Shell],
        along: Array,
        density: KnownDensity | None,
        levels: Array,
        about: Array,
    ) -> None:
        self._moments, self._along, self.levels = moments, along, levels
        nodes = np.array([shell.thickness for shell in shells])
        self.swept = len(nodes) > 1
        self.thickness: Array = np.asarray(np.geomspace(nodes[0], nodes[-1], THICKNESSES) if self.swept else nodes, dtype=np.float64)
        whiten, self._target = moments.whitening()
        held = [_held(shell, along, levels, moments, about) for shell in shells]
        wall, below, whole = (_between(nodes, self.thickness, np.array([each[i] for each in held])) for i in range(3))
        self.wall_volume = np.broadcast_to(wall[:, None, 0], below.shape[:2])
        self.volume = below[..., 0]
        self.filled = self.volume / whole[:, None, 0]
        per_wall = np.broadcast_to((wall / wall[:, :1])[:, None], below.shape)
        self._per_kilogram = np.stack([per_wall, below / np.maximum(self.volume, 1e-30)[..., None]], axis=-1)
        design = whiten @ self._per_kilogram
        normal = np.swapaxes(design, -1, -2) @ design
        right = np.einsum("thrc,r->thc", design, self._target)
        squares = np.full(self.volume.shape, float(self._target @ self._target))
        prior = np.zeros_like(self.volume)
        if density is not None:
            # Stated of the density: one more observation of the filling's mass, whose weight goes with its volume.
            spread = np.maximum(density.sd * self.volume, 1e-30)
            normal[..., 1, 1] += 1.0 / spread**2
            right[..., 1] += density.value * self.volume / spread**2
            squares += (density.value / density.sd) ** 2
            prior = -np.log(spread)
        self.precision = normal + 1e-12 * np.trace(normal, axis1=-2, axis2=-1)[..., None, None] * np.eye(2)
        self.masses: Array = np.asarray(np.linalg.solve(self.precision, right[..., None]), dtype=np.float64)[..., 0]
        self.chi2 = squares - np.sum(right * self.masses, axis=-1)
        # Masses below nothing would explain anything: what must be clipped counts as misfit.
        off = np.clip(self.masses, 0.0, self._most()) - self.masses
        self.chi2 = self.chi2 + np.einsum("thi,thij,thj->th", off, self.precision, off)
        self.chi2 = np.where(self.filled > LEAST_FILLED, self.chi2, np.inf)
        self.log = prior - 0.5 * self.chi2 - 0.5 * np.linalg.slogdet(self.precision)[1]

    def near(self, levels: Array) -> tuple[float, float]:
        """Where a finer grid of levels should reach from and to."""
        least = np.min(self.chi2, axis=0)
        inner = np.isfinite(least)
        padded = np.concatenate([[np.inf], least, [np.inf]])
        valley = inner & (least <= padded[:-2]) & (least <= padded[2:])
        # Between two neighbours it may be lower by a part of what it changes from one to the next.
        change = np.maximum(np.where(np.isfinite(padded[:-2]), padded[:-2], least), np.where(np.isfinite(padded[2:]), padded[2:], least))
        lowest = np.where(inner, least, 0.0) - np.where(valley & inner, 0.5 * (change - np.where(inner, least, 0.0)), 0.0)
        kept = np.flatnonzero(inner & (lowest < float(np.min(least)) + _FAR))
        first, last = max(int(kept[0]) - 1, 0), min(int(kept[-1]) + 1, len(levels) - 1)
        return float(levels[first]), float(levels[last])

    def best(self) -> _Best:
        """The likeliest."""
        t, h = np.unravel_index(int(np.argmin(self.chi2)), self.chi2.shape)
        masses = np.clip(self.masses[t, h], 0.0, None)
        first = self._per_kilogram[t, h, 1:4] @ masses / max(float(masses.sum()), 1e-12)
        return _Best(self._moments.com + first, float(np.sqrt(max(self.chi2[t, h], 0.0) / len(self._target))))

    def posterior(self, whole: tuple[float, float], rng: np.random.Generator) -> FillLevel:
        """Draws of everything, and what they say."""
        weight = np.exp(self.log - np.max(self.log)).ravel()
        place = rng.choice(len(weight), DRAWS * TRIES, p=weight / weight.sum())
        t, h = np.unravel_index(place, self.log.shape)
        step = float(self.levels[1] - self.levels[0])
        level = self.levels[h] + step * rng.uniform(-0.5, 0.5, len(h))
        values, vectors = np.linalg.eigh(self.precision[t, h])
        spread = vectors / np.sqrt(values)[:, None, :]
        masses = self.masses[t, h] + np.einsum("nij,nj->ni", spread, rng.standard_normal((len(h), 2)))
        most = self._most()[t, h]
        allowed = np.flatnonzero(np.all((masses >= 0.0) & (masses <= most), axis=1))[:DRAWS]
        if len(allowed) < LEAST_DRAWS:
            masses, allowed = np.clip(masses, 0.0, most), np.arange(DRAWS)
        t, h, level, masses = t[allowed], h[allowed], level[allowed], masses[allowed]
        densities = masses[:, 1] / self.volume[t, h]
        ratio = np.log(self.thickness[-1] / self.thickness[0]) / (THICKNESSES - 1)
        thickness = self.thickness[t] * np.exp(ratio * rng.uniform(-0.5, 0.5, len(t)))
        total = self._moments.mass
        return FillLevel(
            along=self._along,
            level=_marginal(np.clip(level, *whole), whole[1] - whole[0]),
            filled=_marginal(self.filled[t, h], 1.0),
            mass=_marginal(masses[:, 1], total),
            density=_marginal(densities, float(DENSITIES[1])),
            wall_mass=_marginal(masses[:, 0], total),
            thickness=_marginal(thickness, float(self.thickness[-1] - self.thickness[0])) if self.swept else None,
            misfit=self.best().misfit,
        )

    def _most(self) -> Array:
        """(t, h, 2) kg, of wall and filling if they were lead."""
        return DENSITIES[1] * np.stack([self.wall_volume, self.volume], axis=-1)


def _held(shell: Shell, along: Array, levels: Array, moments: MeasuredMoments, about: Array) -> tuple[Array, Array, Array]:
    """Volume, first moment about c, moments about `about`, of unit density: of wall (f,), inside below each level (h, f), inside (f,)."""
    cells = shell.cells
    arm = cells.points - about
    across = np.sum(arm**2, axis=1)[:, None] - (arm @ moments.directions.T) ** 2 + cells.own[:, None]
    features = np.column_stack([np.ones(len(arm)), cells.points - moments.com, across])
    height, half = shell.heights(along)
    below = np.clip((levels[:, None] - height) / (2.0 * half) + 0.5, 0.0, 1.0) * cells.interior
    return cells.wall @ features, below @ features, cells.interior @ features


def _between(nodes: Array, at: Array, values: Array) -> Array:
    """Values (n, ...) at nodes (n,), straight between them, at `at` (t,)."""
    if len(nodes) == 1:
        return values
    above = np.clip(np.searchsorted(nodes, at), 1, len(nodes) - 1)
    share = ((at - nodes[above - 1]) / (nodes[above] - nodes[above - 1])).reshape(-1, *[1] * (values.ndim - 1))
    return (1.0 - share) * values[above - 1] + share * values[above]


def _marginal(draws: Array, widest: float) -> Marginal:
    ordered = np.sort(draws)
    held = int(np.ceil(0.95 * len(ordered)))
    first = int(np.argmin(ordered[held - 1 :] - ordered[: len(ordered) - held + 1]))
    low, high = float(ordered[first]), float(ordered[first + held - 1])
    return Marginal(float(draws.mean()), float(draws.std()), (low, high), high - low < _OPEN * widest)
