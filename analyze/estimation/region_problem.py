"""What wall and interior on either side of a plane add to the body's moments, and which shares of the mass explain those measured."""

# scipy is only partly typed; its unknowns are no mistakes of ours.
# pyright: reportMissingTypeStubs=false, reportUnknownVariableType=false, reportUnknownArgumentType=false, reportUnknownMemberType=false

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc

from analyze.estimation.cells import Cells
from analyze.estimation.cut_normal import Shares, shares
from analyze.geometry.object_model import DENSITIES, LEVER_ERROR, MODEL_ERROR
from analyze.types import Array, InertialParameters, IntArray

LEAST_SHARE = 0.02
"""each interior part holds at least this part of the interior's volume"""
_LOOSE = 1e-2
"""information on a share, 1 / sd^2, before anything is measured: bounds say far more"""
_CLUMP = 2
"""edge of the larger pieces, in cells"""
_LARGE = 3
"""the same, of those of `pieces`"""
_FITTED = 3
"""numbers that the fit takes from the moments: two shares and three of the border, most of which soon meet a bound (simulated: 2 to 4)"""
_DENSEST = DENSITIES[1]
_PAIRS = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))


@dataclass(frozen=True)
class Borders:
    """Places of the border plane n.(x - middle) = height, each with the shares of mass that fit it."""

    normals: Array
    """(b, 3) unit"""
    heights: Array
    """(b,) m, over the body's middle"""
    mean: Array
    """(b, 2) of the shares of wall and upper part, without bounds"""
    precision: Array
    """(b, 2, 2) of these"""
    chi_square: Array
    """(b,) of what was measured, there"""
    enough: NDArray[np.bool_]
    """(b,) whether there is enough of the interior on both sides"""

    @property
    def shares(self) -> Shares:
        """Of wall, upper and lower part, none negative."""
        return shares(self.mean, self.precision)

    def misfit(self, shares: Array) -> Array:
        """Chi^2 (b,) of what was measured at one set of shares (b, 3) each."""
        off = shares[:, :2] - self.mean
        return self.chi_square + np.einsum("bi,bij,bj->b", off, self.precision, off)

    def exchanged(self, accept: NDArray[np.bool_], other: Borders) -> Borders:
        """These, and `other`'s where `accept` (b,)."""

        def either(name: str) -> Any:
            mine = getattr(self, name)
            return np.where(accept.reshape(-1, *[1] * (mine.ndim - 1)), getattr(other, name), mine)

        return Borders(*(either(name) for name in self.__dataclass_fields__))

    @classmethod
    def joined(cls, all_of_them: Sequence[Borders]) -> Borders:
        """One after the other."""
        return cls(*(np.concatenate([getattr(each, name) for each in all_of_them]) for name in cls.__dataclass_fields__))


@dataclass(frozen=True)
class Pieces:
    """The body in few pieces."""

    region: IntArray
    """(n,) 0 wall, 1 upper, 2 lower"""
    explaining: Array
    """(n, k) what a kilogram in each, per kilogram of the whole, adds to the target"""
    most: Array
    """(n,) share of the whole's mass if it were as dense as anything is"""


class RegionProblem:
    """All of it per kilogram of the whole: motions tell everything of a body but its mass, so that shares do not depend on that.

    About the measured c everything is linear in the shares w: sum w = 1, sum w (c_r - c) = 0, sum w l.J_r.l = I_c,l / m; eqs. (7), (8).
    """

    def __init__(self, parameters: InertialParameters, cells: Cells) -> None:
        self.middle = cells.centroid
        self.longest = cells.principal_directions()[0]
        self.reach = float(np.ptp(cells.points @ self.longest))
        contents = _contents(cells, parameters.com.position)
        inside = cells.interior > 0
        points, interior = cells.points[inside] - self.middle, cells.interior[inside, None] * contents[inside]
        self._fine = _Pieces.of(points, interior, cells.pitch)
        self._coarse = _Pieces.of(*_clumped(points, interior, _CLUMP * cells.pitch), _CLUMP * cells.pitch)
        self._points, self._contents = points, interior
        self._interior = interior.sum(axis=0)
        self._wall = cells.wall @ contents
        self._rows, self.target = _explained(parameters)
        self._pitch, self._mass = cells.pitch, parameters.mass

    def solve(self, normals: Array, heights: Array, *, coarsely: bool = False) -> Borders:
        """Shares for each plane (b, 3), (b,); `coarsely` with pieces of twice the size."""
        above = (self._coarse if coarsely else self._fine).above(normals, heights)
        part = above[:, 0] / self._interior[0]
        lower = self._explaining(self._interior - above)
        left = self.target - lower
        design = np.stack([self._explaining(self._wall) - lower, self._explaining(above) - lower], axis=2)
        transposed = np.swapaxes(design, 1, 2)
        precision = transposed @ design + _LOOSE * np.eye(2)
        right = np.einsum("bij,bj->bi", transposed, left)
        mean = np.asarray(np.linalg.solve(precision, right[..., None])[..., 0], dtype=np.float64)
        return Borders(
            normals=normals,
            heights=heights,
            mean=mean,
            precision=precision,
            chi_square=np.sum(left**2, axis=1) - np.sum(mean * right, axis=1),
            enough=(part > LEAST_SHARE) & (part < 1 - LEAST_SHARE),
        )

    def probability(self, misfit: float) -> float:
        """That the best border of a wall with two even parts leaves as great a chi^2."""
        freedom = int(np.linalg.matrix_rank(self._rows, tol=1e-6 * float(np.linalg.norm(self._rows)))) - _FITTED
        return 1.0 if freedom < 1 else float(chdtrc(freedom, max(misfit, 0.0)))

    def pieces(self, normal: Array, height: float) -> Pieces:
        """The wall as one piece, and the interior on either side of that border in larger ones."""
        above = self._points @ normal > height
        contents, region = [self._wall[None]], [0]
        for part, mine in enumerate((above, ~above), 1):
            clumps = _clumped(self._points[mine], self._contents[mine], _LARGE * self._pitch)[1]
            contents.append(clumps)
            region += [part] * len(clumps)
        together = np.vstack(contents)
        return Pieces(np.array(region), self._explaining(together), _DENSEST * together[:, 0] / self._mass)

    def baselines(self, mass: float, normal: Array, height: float) -> dict[str, Array]:
        """Naive answers (3,) each [kg]: all on the surface, uniform, and the best mix of surface and uniform interior."""
        above = self._fine.above(normal[None], np.array([height]))[0, 0]
        volumes = np.array([self._wall[0], above, self._interior[0] - above])
        inside = self._explaining(self._interior)
        across = self._explaining(self._wall) - inside
        on_surface = float(np.clip(across @ (self.target - inside) / max(float(across @ across), 1e-30), 0.0, 1.0)) * mass
        return {
            "surface": np.array([mass, 0.0, 0.0]),
            "uniform": mass * volumes / volumes.sum(),
            "surface_and_uniform": np.array([on_surface, *((mass - on_surface) * volumes[1:] / volumes[1:].sum())]),
        }

    def _explaining(self, contents: Array) -> Array:
        """What a kilogram spread evenly over `contents` (..., 10) adds to the target (..., k)."""
        return (contents[..., 1:] / np.maximum(contents[..., :1], 1e-6 * self._interior[0])) @ self._rows.T


@dataclass(frozen=True)
class _Pieces:
    """Pieces of the interior, to be cut by many planes. Single precision: 1e-6 of a moment."""

    places: NDArray[np.float32]
    """(4, n): in pitches from the body's middle, and 1"""
    contents: NDArray[np.float32]
    """(n, 10): volume, its first moments and second ones"""
    pitch: float
    """m, width of the layer in which a piece is cut"""

    @classmethod
    def of(cls, points: Array, contents: Array, pitch: float) -> _Pieces:
        """At `points` (n, 3) from the middle."""
        return cls(np.vstack([points.T / pitch, np.ones(len(points))]).astype(np.float32), contents.astype(np.float32), pitch)

    def above(self, normals: Array, heights: Array) -> Array:
        """Contents (b, 10) above each plane; pieces that it cuts count in part, so that nothing jumps."""
        share = np.column_stack([normals, 0.5 - heights / self.pitch]).astype(np.float32) @ self.places
        np.clip(share, 0.0, 1.0, out=share)
        return np.asarray(share @ self.contents, dtype=np.float64)


def _contents(cells: Cells, about: Array) -> Array:
    """(n, 10) of each cell per volume: 1, first moments, second moments (own ones, the same about every axis, among them)."""
    arm = cells.points - about
    second = np.stack([arm[:, i] * arm[:, j] + (cells.own / 2 if i == j else 0.0) for i, j in _PAIRS], axis=1)
    return np.column_stack([np.ones(len(arm)), arm, second])


def _clumped(points: Array, contents: Array, pitch: float) -> tuple[Array, Array]:
    """Those in the same cube of edge `pitch` taken together: centroids (m, 3) and contents (m, 10)."""
    cube = np.floor(points / pitch).astype(np.int64)
    cube -= cube.min(axis=0)
    size = cube.max(axis=0) + 1
    _, clump = np.unique((cube[:, 0] * size[1] + cube[:, 1]) * size[2] + cube[:, 2], return_inverse=True)
    weights = np.column_stack([contents, contents[:, :1] * points])
    sums: Array = np.stack([np.asarray(np.bincount(clump, column), dtype=np.float64) for column in weights.T], axis=1)
    together, moments = sums[:, : contents.shape[1]], sums[:, contents.shape[1] :]
    centroids = moments / together[:, :1]
    return centroids, together


def _explained(parameters: InertialParameters) -> tuple[Array, Array]:
    """Matrix (k, 9) from a body's first and second moments about the measured c to what was measured, and that (k,), in units of its sd."""
    mass = parameters.mass
    directions = np.array([axis.direction for axis in parameters.axes]).reshape(-1, 3)
    unit = np.array([axis.i_com for axis in parameters.axes]) / mass
    rows = np.zeros((3 + len(unit), 9))
    rows[:3, :3] = np.eye(3)
    # tr S - l.S.l
    for column, (i, j) in enumerate(_PAIRS, 3):
        rows[3:, column] = (i == j) - (1.0 if i == j else 2.0) * directions[:, i] * directions[:, j]
    # d(I / m) = dI / m - I / m^2 dm
    per_kilogram = np.zeros((3 + len(unit), 4 + len(unit)))
    per_kilogram[:3, 1:4] = np.eye(3)
    per_kilogram[3:, 4:] = np.eye(len(unit)) / mass
    per_kilogram[3:, 0] = -unit / mass
    covariance = per_kilogram @ parameters.joint_covariance @ per_kilogram.T
    covariance += np.diag(np.concatenate([np.full(3, LEVER_ERROR), MODEL_ERROR * unit]) ** 2)
    size = np.sqrt(np.diag(covariance))
    values, vectors = np.linalg.eigh(covariance / np.outer(size, size))
    whiten = (vectors / np.sqrt(np.maximum(values, 1e-9 * values.max()))).T / size
    return np.asarray(whiten @ rows, dtype=np.float64), np.asarray(whiten @ np.concatenate([np.zeros(3), unit]), dtype=np.float64)
