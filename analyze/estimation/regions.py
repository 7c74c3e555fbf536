"""Masses of the shell and of the interior on either side of a plane (METHOD section 6, "ours")."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from analyze.estimation.cells import Cells
from analyze.types import Array, InertialParameters, IntArray, MassDistribution

NAMES = ("surface", "upper", "lower")
LEAST_SHARE = 0.02
"""each interior part holds at least this part of the interior's volume"""
MODEL_ERROR = 0.004
"""relative, of each moment: voxels, uneven walls"""
LEVER_ERROR = 1e-4
"""m, of the first moment per kg of body: voxels, uneven walls"""
FIRST_LOOK = 1500
CHAINS = 160
STEPS = 40
KEPT_STEPS = 20


@dataclass(frozen=True)
class Borders:
    """Several places of the border plane n.x = offset, each with the masses that fit best."""

    normals: Array
    """(b, 3) unit"""
    offsets: Array
    """(b,) m"""
    masses: Array
    """(b, 3) kg, none negative"""
    free: Array
    """(b, 3) kg, the same without that bound"""
    covariance: Array
    """(b, 3, 3) kg^2, of `free`"""
    chi_square: Array
    """(b,) of `masses`"""

    def take(self, index: IntArray | NDArray[np.bool_]) -> Borders:
        """Those at `index`, an integer or Boolean array."""
        return Borders(*(getattr(self, name)[index] for name in self.__dataclass_fields__))


def mass_distribution(parameters: InertialParameters, cells: Cells, rng: np.random.Generator) -> MassDistribution:
    """Three masses by non-negative least squares over mass, c and the measured moments, with the border plane free.

    Each region counts as uniform: the shell (R1), the interior where n.x > offset (R2) and elsewhere (R3). About the measured c everything
    is linear in the masses: sum m = M, sum m*(c_r - c) = 0, sum l.I_r.l = I_c,l. The border is drawn in direction and offset by
    Metropolis chains (exp(-chi^2/2)), so that masses, covariance and the border's interval hold what it leaves open. n points to the same
    side as the body's longest direction.

    Args:
        parameters: mass, c, moments with their joint covariance.
        cells: the body.
        rng: for the chains; the same seed gives the same answer.
    """
    problem = RegionProblem(parameters, cells)
    borders = _chains(problem, rng)
    best = int(np.argmin(borders.chi_square))
    normal, offset = borders.normals[best], float(borders.offsets[best])
    # Where each plane crosses the best one's normal through the middle.
    middle = problem.middle
    along = np.maximum(borders.normals @ normal, 0.2)
    crossing = normal @ middle + (borders.offsets - borders.normals @ middle) / along
    draws = _draw(borders, rng)
    low, high = np.quantile(crossing, [0.025, 0.975])
    return MassDistribution(
        names=NAMES,
        masses=draws.mean(axis=0),
        covariance=np.cov(draws.T),
        border_normal=normal,
        border_offset=offset,
        border_offset_interval=(float(min(low, offset)), float(max(high, offset))),
        baselines=problem.baselines(normal, offset),
    )


class RegionProblem:
    """What the masses must explain, and what a kilogram in each region adds to it."""

    def __init__(self, parameters: InertialParameters, cells: Cells) -> None:
        self._parameters = parameters
        self._cells = cells
        self._interior = cells.interior
        self._features = _cell_features(parameters, cells)
        self._target, self._whiten = _target(parameters)
        self.middle = cells.centroid
        self.longest = cells.principal_directions()[0]
        self.reach = float(np.ptp(cells.points @ self.longest))

    def shares(self, normals: Array, offsets: Array) -> Array:
        """Part (b, cells) of each cell above the planes; cells that a plane cuts count in part, so that nothing jumps."""
        height = normals @ self._cells.points.T - offsets[:, None]
        return np.clip(height / self._cells.pitch + 0.5, 0.0, 1.0)

    def solve(self, normals: Array, offsets: Array) -> tuple[Borders, NDArray[np.bool_]]:
        """Best masses for each plane (b, 3), (b,); and which planes leave enough on both sides (b,)."""
        upper = self.shares(normals, offsets) * self._interior
        volume = upper.sum(axis=1)
        share = volume / self._interior.sum()
        valid = (share > LEAST_SHARE) & (share < 1 - LEAST_SHARE)
        volume = np.maximum(volume, 1e-6 * self._interior.sum())
        total = self._interior @ self._features
        above = upper @ self._features
        below = (total - above) / np.maximum(self._interior.sum() - volume, 1e-6 * self._interior.sum())[:, None]
        shell = np.broadcast_to(self._mean(self._cells.wall), above.shape)
        design = np.stack([shell, above / volume[:, None], below], axis=-1)
        return self._fit(normals, offsets, self._whiten @ design), valid

    def _fit(self, normals: Array, offsets: Array, design: Array) -> Borders:
        """Non-negative least squares of three unknowns (Lawson & Hanson 1974), all seven sets of positive masses tried at once."""
        target = self._whiten @ self._target
        normal_matrix = np.swapaxes(design, 1, 2) @ design
        right = np.swapaxes(design, 1, 2) @ target
        ridge = 1e-12 * np.trace(normal_matrix, axis1=1, axis2=2)[:, None, None] * np.eye(3)
        best = np.zeros_like(right)
        misfit = np.full(len(right), np.inf)
        free = np.zeros_like(right)
        for bits in range(1, 8):
            kept = [i for i in range(3) if bits >> i & 1]
            trial = np.zeros_like(right)
            trial[:, kept] = np.linalg.solve((normal_matrix + ridge)[:, kept][:, :, kept], right[:, kept, None])[..., 0]
            chi = np.sum((np.einsum("brm,bm->br", design, trial) - target) ** 2, axis=1)
            better = np.all(trial >= 0, axis=1) & (chi < misfit)
            best[better], misfit[better] = trial[better], chi[better]
            free = trial
        covariance = np.asarray(np.linalg.inv(np.asarray(normal_matrix + ridge, dtype=np.float64)), dtype=np.float64)
        return Borders(normals, offsets, best, free, covariance, misfit)

    def _mean(self, part: Array) -> Array:
        return part @ self._features / part.sum()

    def baselines(self, normal: Array, offset: float) -> dict[str, Array]:
        """Naive answers (3,) each: all on the surface, uniform, and the best mix of surface and uniform interior."""
        upper = self.shares(normal[None], np.array([offset]))[0] * self._interior
        volumes = np.array([self._cells.wall.sum(), upper.sum(), self._interior.sum() - upper.sum()])
        mass = self._parameters.mass
        two = self._whiten @ np.column_stack([self._mean(self._cells.wall), self._mean(self._interior)])
        on_surface, inside = np.linalg.lstsq(two, self._whiten @ self._target, rcond=None)[0]
        on_surface = float(np.clip(on_surface / max(on_surface + inside, 1e-9), 0.0, 1.0)) * mass
        return {
            "surface": np.array([mass, 0.0, 0.0]),
            "uniform": mass * volumes / volumes.sum(),
            "surface_and_uniform": np.array([on_surface, *((mass - on_surface) * volumes[1:] / volumes[1:].sum())]),
        }


def _chains(problem: RegionProblem, rng: np.random.Generator) -> Borders:
    """Border planes drawn from their posterior: a first look everywhere, then Metropolis chains from where it fits best."""
    normals = rng.standard_normal((FIRST_LOOK, 3))
    normals = _upward(normals / np.linalg.norm(normals, axis=1, keepdims=True), problem.longest)
    offsets = normals @ problem.middle + rng.uniform(-0.5, 0.5, FIRST_LOOK) * problem.reach
    borders, valid = problem.solve(normals, offsets)
    borders = borders.take(valid)
    borders = borders.take(np.argsort(borders.chi_square, kind="stable")[:CHAINS])
    kept: list[Borders] = []
    for step in range(STEPS):
        # Cooling: wide steps at a tolerant temperature first, so that the chains find the valley.
        cooling = max(0.0, 1 - step / (STEPS - KEPT_STEPS))
        size = rng.choice([0.02, 0.1, 0.3], size=len(borders.offsets))
        normals = borders.normals + size[:, None] * rng.standard_normal(borders.normals.shape)
        normals = _upward(normals / np.linalg.norm(normals, axis=1, keepdims=True), problem.longest)
        # The plane turns about the middle of the body and shifts along itself.
        height = borders.offsets - borders.normals @ problem.middle
        offsets = normals @ problem.middle + height + 0.3 * size * problem.reach * rng.standard_normal(len(size))
        moved, valid = problem.solve(normals, offsets)
        gain = (borders.chi_square - moved.chi_square) / 2 / (1 + 30 * cooling**2)
        accept = valid & (np.log(rng.uniform(size=len(gain))) < gain)
        borders = Borders(*(_either(accept, getattr(moved, name), getattr(borders, name)) for name in borders.__dataclass_fields__))
        if step >= STEPS - KEPT_STEPS:
            kept.append(borders)
    return Borders(*(np.concatenate([getattr(b, name) for b in kept]) for name in borders.__dataclass_fields__))


def _either(accept: NDArray[np.bool_], new: Array, old: Array) -> Array:
    return np.where(accept.reshape(-1, *[1] * (new.ndim - 1)), new, old)


def _upward(normals: Array, longest: Array) -> Array:
    return normals * np.where(normals @ longest < 0, -1.0, 1.0)[:, None]


def _target(parameters: InertialParameters) -> tuple[Array, Array]:
    """Measured (mass, 0, 0, 0, I_c,l ...) (4 + axes,) and the matrix that whitens their errors."""
    mass = parameters.mass
    moments = np.array([axis.i_com for axis in parameters.axes])
    covariance = parameters.joint_covariance.copy()
    covariance[1:4] *= mass
    covariance[:, 1:4] *= mass
    model = np.concatenate([[0.0], np.full(3, mass * LEVER_ERROR), MODEL_ERROR * moments])
    covariance += np.diag(model**2)
    size = np.concatenate([[mass], np.full(3, mass * 1e-2), np.abs(moments)])
    values, vectors = np.linalg.eigh(covariance / np.outer(size, size))
    whiten = (vectors / np.sqrt(np.maximum(values, 1e-12 * values.max()))).T / size
    return np.concatenate([[mass], np.zeros(3), moments]), whiten


def _cell_features(parameters: InertialParameters, cells: Cells) -> Array:
    """What 1 kg in each cell adds to (mass, first moment about c, moments about the axes through c), (n, 4 + axes); eq. (7), (8)."""
    arm = cells.points - parameters.com.position
    square = np.sum(arm**2, axis=1) + cells.own
    lines = [square - (arm @ axis.direction) ** 2 for axis in parameters.axes]
    return np.column_stack([np.ones(len(arm)), arm, *lines])


def _draw(borders: Borders, rng: np.random.Generator, tries: int = 24) -> Array:
    """One draw (b, 3) of the masses per border: the normal distribution cut off at zero."""
    values, vectors = np.linalg.eigh(borders.covariance)
    spread = vectors * np.sqrt(np.maximum(values, 0.0))[:, None, :]
    draws = borders.masses.copy()
    open_ones = np.ones(len(draws), dtype=bool)
    for _ in range(tries):
        trial = borders.free + np.einsum("bij,bj->bi", spread, rng.standard_normal(draws.shape))
        good = open_ones & np.all(trial >= 0, axis=1)
        draws[good] = trial[good]
        open_ones &= ~good
    return draws
