"""Linear problem of the mass shares of shell and interior parts, given the measured moments.

The interior is divided by a plane, or by a ball, into an upper and a lower part.
"""

# scipy is only partly typed.
# pyright: reportMissingTypeStubs=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false, reportUnknownMemberType=false

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc

from analyze.estimation.cell_contents import CutPieces, cell_contents, clumped, concentrated
from analyze.estimation.cells import Cells
from analyze.estimation.dividing_surfaces import are_balls, planes
from analyze.estimation.mass_properties import InertialParameters
from analyze.estimation.part_masses import whitening_matrix
from analyze.estimation.truncated_normal import ShareDistribution, share_distribution
from analyze.geometry.object_model import LEVER_ERROR, MODEL_ERROR
from analyze.geometry.plausible_size import DENSITIES
from analyze.types import TENSOR_ENTRIES, Array, IntArray

MIN_PART_SHARE = 0.02
"""Smallest fraction of the interior's volume on either side of the dividing plane."""
MIN_BALL_INSIDE = 0.5
"""Smallest fraction of a ball's volume that is in the interior."""
_PRIOR_PRECISION = 1e-2
"""Prior precision 1 / sd^2 of a share; the bounds are far more informative."""
_EMPTY_PRECISION = 1e6
"""Precision 1 / sd^2 with which the share of an empty part is 0."""
_COARSE_CLUMP = 2
"""Edge, in cells, of the clumps of cells used for a coarse solution."""
_PIECE_CLUMP, _MAX_PIECES = 2, 1000
"""Edge, in cells, of the clumps of cells that `pieces` returns, and number of cells above which there are
such."""
_FITTED_PARAMETERS = 3
"""Effective number of fitted parameters for a given shell: of two shares and three of the dividing plane, or
four of a ball, most meet a bound (simulated: 2 to 4)."""
_TOUCHING = 1e-6
"""Depth, in cells, down to which a plane touches a cell but does not cut it: rounding errors are smaller."""
_MAX_DENSITY = DENSITIES[1]
"""Largest density of a piece [kg/m^3], about that of lead."""


@dataclass(frozen=True)
class SolvedSurfaces:
    """Set of b planes or balls that divide the interior in two, each with its best mass shares.

    The upper part is the one on the side of a plane's normal, or inside the ball. The shares are those of
    shell (outer wall), upper and lower part in the mass that fit the measured moments best.
    """

    surfaces: Array
    """(b, 5) planes and balls, as in `dividing_surfaces`, relative to the body's middle (its centroid)."""
    mean: Array
    """(b, 2) mean shares of shell and upper part, before truncation."""
    precision: Array
    """(b, 2, 2) inverse covariances of these shares."""
    chi_square: Array
    """(b,) chi^2 of the measured moments at the mean shares."""
    both_sides_filled: NDArray[np.bool_]
    """(b,) True where each side of a plane contains at least `MIN_PART_SHARE` of the interior, and where at
    least half of a ball is in the interior."""

    @property
    def shares(self) -> ShareDistribution:
        """Truncated normal distributions of the mass shares of shell, upper and lower part of the interior.

        There is one for each of the b surfaces that divide the interior. No share is negative, and the
        three add up to 1.
        """
        return share_distribution(self.mean, self.precision)

    def misfit(self, shares: Array) -> Array:
        """Chi^2 (b,) of measured less modelled moments, for the mass shares `shares` (b, 3).

        There is one for each of the b surfaces that divide the interior; the surface's row holds the shares
        of the body's mass in shell, upper and lower part.
        """
        off = shares[:, :2] - self.mean
        return self.chi_square + np.einsum("bi,bij,bj->b", off, self.precision, off)

    def replaced_where(self, accept: NDArray[np.bool_], other: SolvedSurfaces) -> SolvedSurfaces:
        """Copy of this set of b dividing surfaces, with those of `other` where `accept` (b,) is True.

        `other` has b surfaces as well; all that is known of a surface (fit, shares) comes along.
        """

        def either(name: str) -> Any:
            mine = getattr(self, name)
            return np.where(accept.reshape(-1, *[1] * (mine.ndim - 1)), getattr(other, name), mine)

        return SolvedSurfaces(*(either(name) for name in self.__dataclass_fields__))

    @classmethod
    def concatenate(cls, sets: Sequence[SolvedSurfaces]) -> SolvedSurfaces:
        """Join several sets of dividing surfaces to one: those of the first set, then of the next, ..."""
        return cls(
            *(np.concatenate([getattr(each, name) for each in sets]) for name in cls.__dataclass_fields__)
        )


@dataclass(frozen=True)
class BodyPieces:
    """Pieces of the body: of each its region, its largest share of the mass, and its moments.

    A piece's moments are those that the body would have if all its mass were in this piece: k independent
    combinations of centre of mass and moments of inertia about the struck axes, to be compared with the
    measured ones. They are whitened: scaled so that the measurements have independent errors of unit sd.
    """

    region: IntArray
    """(n,) region of each piece: 0 shell, 1 upper, 2 lower."""
    explaining: Array
    """(n, k) whitened combinations of moments that the body would have if all its mass were in the piece."""
    most: Array
    """(n,) largest share of the body's mass, at the density of lead."""


class RegionProblem:
    """Linear problem of the mass shares w of shell and interior parts, per kilogram of the body.

    Motions determine a body up to its mass m, on which the shares do not depend. About the measured centre of
    mass c the problem is linear in w: sum w = 1, sum w (c_r - c) = 0, sum w l.J_r.l = I_c,l / m (VISAPP 2013,
    eqs. 7 and 8), with c_r the centroid of region r, J_r its inertia per kilogram about c, and I_c,l the
    measured moment about the line l through c.

    Args:
        parameters: Measured mass, centre of mass and moments, with their joint covariance.
        cells: Cells of the body, in shell and interior.

    Attributes:
        middle: (3,) centroid of the body as a uniform solid [m], in the object frame O.
        longest: (3,) unit principal direction of largest extent, in O.
        reach: extent of the body along it [m].
        interior_size: cube root of the interior's volume [m].
        target: (k,) whitened measurements (unit sd): centre of mass, and a moment for each struck axis.
    """

    def __init__(self, parameters: InertialParameters, cells: Cells) -> None:
        self.middle = cells.centroid
        self.longest = cells.principal_directions()[0]
        self.reach = float(np.ptp(cells.points @ self.longest))
        contents = cell_contents(cells, parameters.com.position)
        inside = cells.interior > 0
        points, interior = cells.points[inside] - self.middle, cells.interior[inside, None] * contents[inside]
        self._fine = CutPieces.from_cells(points, interior, cells.pitch)
        self._coarse = CutPieces.from_cells(
            *clumped(points, interior, _COARSE_CLUMP * cells.pitch), _COARSE_CLUMP * cells.pitch
        )
        self._points, self._contents = points, interior
        self._interior = interior.sum(axis=0)
        self.interior_size = float(self._interior[0] ** (1 / 3))
        self._shell = cells.shell @ contents
        self._rows, self.target = _measured_system(parameters)
        directions, sizes, _ = np.linalg.svd(self._rows, full_matrices=False)
        self._observable = directions[:, sizes > 1e-6 * float(sizes[0])]
        self._pitch, self._mass = cells.pitch, parameters.mass

    def solve(self, surfaces: Array, *, coarsely: bool = False, empty_below: bool = False) -> SolvedSurfaces:
        """Mass shares of shell, upper and lower part that fit the moments best, for b dividing surfaces.

        Args:
            surfaces: (b, 5) planes and balls. A row holds n (3), h [m] and k [1/m]; the upper part are the
                points x, in m from the body's middle, with n.x - h - k |x|^2 / 2 > 0: the side of a plane's
                normal n, or the inside of a ball.
            coarsely: True to use clumps of `_COARSE_CLUMP` cells per edge instead of single cells.
            empty_below: True if the lower part has no mass.

        Returns:
            The b surfaces, each with mean (2) and inverse covariance (2, 2) of the shares of shell and upper
            part before truncation at zero, chi^2, and whether both its sides hold enough of the interior.
        """
        above = (self._coarse if coarsely else self._fine).above(surfaces)
        part, least = above[:, 0] / self._interior[0], np.full(len(surfaces), MIN_PART_SHARE)
        round_ones = are_balls(surfaces)
        ball = 4 / 3 * np.pi / surfaces[round_ones, 4] ** 3
        least[round_ones] = MIN_BALL_INSIDE * ball / self._interior[0]
        lower = self._explaining(self._interior - above)
        left = self.target - lower
        design = np.stack([self._explaining(self._shell) - lower, self._explaining(above) - lower], axis=2)
        transposed = np.swapaxes(design, 1, 2)
        # The lower part has what shell and upper part leave of 1.
        empty = _EMPTY_PRECISION if empty_below else 0.0
        precision = transposed @ design + _PRIOR_PRECISION * np.eye(2) + empty
        right = np.einsum("bij,bj->bi", transposed, left) + empty
        mean = np.asarray(np.linalg.solve(precision, right[..., None])[..., 0], dtype=np.float64)
        return SolvedSurfaces(
            surfaces=surfaces,
            mean=mean,
            precision=precision,
            chi_square=np.sum(left**2, axis=1) + empty - np.sum(mean * right, axis=1),
            both_sides_filled=(part > least) & (part < 1 - MIN_PART_SHARE),
        )

    def random_points(self, count: int, rng: np.random.Generator) -> Array:
        """Random points (count, 3) [m] of the interior, uniform in its volume, from the body's middle."""
        volumes = self._contents[:, 0]
        chosen = rng.choice(len(volumes), size=count, p=volumes / volumes.sum())
        return self._points[chosen] + self._pitch * rng.uniform(-0.5, 0.5, (count, 3))

    def probability(self, misfit: float, *, thickness_fitted: bool) -> float:
        """Probability that measurement errors give a shell with two uniform parts inside at least this chi^2.

        `misfit` is the smallest chi^2 over all planes (or all balls) that divide the interior in two, and
        over shell thicknesses as well if `thickness_fitted`. The probability is 1 if there are not more
        independent measurements than fitted parameters.
        """
        freedom = len(self.observable_target) - _FITTED_PARAMETERS - int(thickness_fitted)
        return 1.0 if freedom < 1 else float(chdtrc(freedom, max(misfit, 0.0)))

    def pieces(self, normal: Array, height: float) -> BodyPieces:
        """The body cut into pieces: the shell as one, and the interior on either side of a dividing plane.

        Pieces of the interior are single cells; above `_MAX_PIECES`, clumps of cells. Each clump then stands
        twice among the pieces, filled uniformly and with its mass at its centroid: any filling of the clump
        is between the two. Cells that the plane cuts are among the pieces of both sides.

        Args:
            normal: (3,) unit normal of the dividing plane, in the object frame O.
            height: Height of the plane over the body's middle [m].
        """
        over = self._points @ normal - height
        cut = (0.5 - _TOUCHING) * self._pitch
        sides = [over > -cut, over < cut]
        if len(self._points) <= _MAX_PIECES:
            interior = [self._contents[mine] for mine in sides]
        else:
            size = _PIECE_CLUMP * self._pitch
            clumps = [clumped(self._points[mine], self._contents[mine], size)[1] for mine in sides]
            interior = [np.vstack([uniform, concentrated(uniform)]) for uniform in clumps]
        region = np.repeat([0, 1, 2], [1, *(len(side) for side in interior)])
        return self._pieces(region, np.vstack([self._shell, *interior]))

    def walls(self) -> BodyPieces:
        """Two pieces of region 0 (shell): the shell of this thickness, and one that fills the whole body.

        Of both the result holds the largest share of the mass, and the moments with all mass in them.
        """
        contents = np.stack([self._shell, self._shell + self._interior])
        return self._pieces(np.zeros(2, dtype=np.int64), contents)

    @property
    def observable_target(self) -> Array:
        """Measured values of r independent combinations of centre of mass and moments (r,), whitened.

        They are scaled (whitened) so that their errors are independent with unit sd; `pieces` gives the same
        combinations for the mass in each piece. r is below the number of measurements if axes are parallel.
        """
        return np.asarray(self.target @ self._observable, dtype=np.float64)

    def _pieces(self, region: IntArray, contents: Array) -> BodyPieces:
        """Pieces of the body from their regions (n,) (0 shell, 1 upper, 2 lower) and contents (n, 10).

        Contents are volume [m^3] (1), first (3) and second (6) moments about the measured centre of mass, at
        unit density.
        """
        explaining = self._explaining(contents) @ self._observable
        return BodyPieces(region, explaining, _MAX_DENSITY * contents[:, 0] / self._mass)

    def divided(self, surfaces: Array, shares: Array, plane: Array) -> Array:
        """Mass shares (b, 3) of shell, interior above and below one plane, of bodies divided by surfaces.

        Args:
            surfaces: (b, 5) planes and balls that divide the interior. A row holds n (3), h [m] and k [1/m]:
                the points x, in m from the body's middle, with n.x - h - k |x|^2 / 2 = 0.
            shares: (b, 3) mass shares of shell, upper and lower part of these, each part uniform.
            plane: (5,) the plane, in the same form.
        """
        beyond = np.sum(shares[:, 1:] * self._fine.beyond_plane(surfaces, plane), axis=1)
        return np.column_stack([shares[:, 0], beyond, shares[:, 1:].sum(axis=1) - beyond])

    def baselines(self, mass: float, normal: Array, height: float) -> dict[str, Array]:
        """Masses (3,) [kg] of shell, upper and lower part by three naive assumptions, keyed by name.

        "shell": all mass is in the shell. "uniform": shell and interior have one density.
        "shell_and_uniform": each has its own density, by the ratio that fits the moments best.

        Args:
            mass: Mass of the object [kg].
            normal: (3,) unit normal of the dividing plane, in the object frame O.
            height: Height of the plane over the body's middle [m].
        """
        above = self._fine.above(planes(normal[None], np.array([height])))[0, 0]
        volumes = np.array([self._shell[0], above, self._interior[0] - above])
        inside = self._explaining(self._interior)
        across = self._explaining(self._shell) - inside
        share = across @ (self.target - inside) / max(float(across @ across), 1e-30)
        on_surface = mass * float(np.clip(share, 0.0, 1.0))
        return {
            "shell": np.array([mass, 0.0, 0.0]),
            "uniform": mass * volumes / volumes.sum(),
            "shell_and_uniform": np.array(
                [on_surface, *((mass - on_surface) * volumes[1:] / volumes[1:].sum())]
            ),
        }

    def _explaining(self, contents: Array) -> Array:
        """Whitened moments (..., k) that the body would have with all its mass uniformly in one part of it.

        They are the k values to compare with the measured ones: centre of mass (3), and the moment of inertia
        per kilogram about each struck axis. Whitened means that the measurements' errors are independent and
        of unit sd. `contents` (..., 10) are the part's volume (1), first (3) and second (6) moments at unit
        density.
        """
        return (contents[..., 1:] / np.maximum(contents[..., :1], 1e-6 * self._interior[0])) @ self._rows.T


def _measured_system(parameters: InertialParameters) -> tuple[Array, Array]:
    """Whitened matrix (k, 9) from the body's moments to k measurements, and these measurements (k,).

    Whitened: both are multiplied so that the measurements' errors are independent with unit sd. The body's
    moments are first (3) [m] and second (6: xx, yy, zz, xy, xz, yz) [m^2] moments per kilogram about the
    measured centre of mass. The k = 3 + axes measurements are the centre of mass, given relative to
    itself and thus 0, and the moments of inertia about the struck axes per kilogram. Their covariance also
    holds the error of modelling the body by cells: 0.1 mm (`LEVER_ERROR`) and 0.4 % (`MODEL_ERROR`).
    """
    mass = parameters.mass
    directions = np.array([axis.direction for axis in parameters.axes]).reshape(-1, 3)
    unit = np.array([axis.i_com for axis in parameters.axes]) / mass
    rows = np.zeros((3 + len(unit), 9))
    rows[:3, :3] = np.eye(3)
    # tr S - l.S.l
    for column, (i, j) in enumerate(TENSOR_ENTRIES, 3):
        rows[3:, column] = (i == j) - (1.0 if i == j else 2.0) * directions[:, i] * directions[:, j]
    # d(I / m) = dI / m - I / m^2 dm
    per_kilogram = np.zeros((3 + len(unit), 4 + len(unit)))
    per_kilogram[:3, 1:4] = np.eye(3)
    per_kilogram[3:, 4:] = np.eye(len(unit)) / mass
    per_kilogram[3:, 0] = -unit / mass
    covariance = per_kilogram @ parameters.joint_covariance @ per_kilogram.T
    covariance += np.diag(np.concatenate([np.full(3, LEVER_ERROR), MODEL_ERROR * unit]) ** 2)
    whiten = whitening_matrix(covariance)
    return np.asarray(whiten @ rows, dtype=np.float64), np.asarray(
        whiten @ np.concatenate([np.zeros(3), unit]), dtype=np.float64
    )
