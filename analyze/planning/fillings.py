"""Predicted precision of the region masses from planned strikes, over plausible fillings (method 6).

Unknown together are the masses of shell, upper and lower interior and the dividing plane between the two
interior parts (direction and offset); measured are mass, centre of mass and the moments of inertia about the
struck directions, with the joint covariance that the design predicts.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from analyze.geometry.object_model import LEVER_ERROR, MODEL_ERROR
from analyze.planning.information import COM, INERTIA, MASS, moment_row
from analyze.types import Array
from schemas.strike_plan import PredictedRegion

NAMES = ("shell", "upper", "lower")
"""Names of the regions: shell, interior above and below the dividing plane."""
FILLINGS = 24
"""Number of fillings drawn."""
DETERMINED_FRACTION = 0.5
"""Predicted over prior sd of a mass below which it counts as determined."""
SHARE_SD = 0.2357
"""Sd of one of three shares of a whole, if all divisions are equally likely."""
SAME_MOMENT_COSINE = np.cos(np.radians(15.0))
"""Cosine above which two directions measure the same moment."""


@dataclass(frozen=True)
class Pieces:
    """Pieces of the body, cut from cubes of equal size: centroids, volumes and moments of inertia.

    Each piece lies in the shell (outer wall) or in the interior. O is the object frame.
    """

    points: Array
    """(n, 3) centroids [m], in O."""
    shell: Array
    """(n,) volumes in the shell [m^3]; 0 for pieces of the interior."""
    interior: Array
    """(n,) volumes in the interior [m^3]; 0 for pieces of the shell."""
    own_inertia: Array
    """(n,) moment of inertia of each piece about any axis through its own centroid, per kilogram [m^2]."""
    pitch: float
    """Edge of the cubes that the pieces were cut from [m]."""

    @property
    def centroid(self) -> Array:
        """Centroid (3,) of the uniform solid that the pieces make up [m], in the object frame."""
        volume = self.shell + self.interior
        return volume @ self.points / volume.sum()


def region_forecast(
    cells: Pieces, mass: float, covariance: Array, directions: Sequence[Array]
) -> list[PredictedRegion]:
    """Predicted 1 sigma [kg] of the region masses of a design, and whether the strikes determine each.

    Regions are the shell and the interior above and below a dividing plane. The 1 sigma is the median over
    `FILLINGS` fillings (divisions and densities drawn). A mass counts as determined if its 1 sigma is below
    `DETERMINED_FRACTION` of the prior one.

    Args:
        cells: Pieces of the body.
        mass: Mass of the object [kg].
        covariance: (14, 14) covariance, in SI units, of centre of mass, inertia and the errors that strikes
            share (`Information.covariance`).
        directions: Unit directions (3,) of the struck axes, in the object frame; those less than 15 degrees
            apart count as one.

    Returns:
        Three predictions: for the shell, and the interior above and below the plane.
    """
    distinct: list[Array] = []
    for direction in directions:
        if all(abs(direction @ other) < SAME_MOMENT_COSINE for other in distinct):
            distinct.append(direction)
    lines = np.array([moment_row(direction) for direction in distinct]).reshape(-1, 6)
    pick = np.zeros((4 + len(lines), len(covariance)))
    pick[0, MASS] = mass
    pick[1:4, COM] = np.eye(3)
    pick[4:, INERTIA] = lines
    measured = pick @ covariance @ pick.T
    problem = _Fillings(cells, np.array(distinct).reshape(-1, 3), mass)
    # Low-discrepancy numbers (FILLINGS, 5) from 0 to 1: a Kronecker sequence.
    steps = np.outer(np.arange(1.0, FILLINGS + 1), np.sqrt([2.0, 3.0, 5.0, 7.0, 11.0]))
    sds = [problem.sd(measured, drawn) for drawn in np.remainder(steps + 0.5, 1.0)]
    return [
        PredictedRegion(name=name, mass_sd_kg=sd, determined=sd < DETERMINED_FRACTION * SHARE_SD * mass)
        for name, sd in zip(NAMES, np.median(sds, axis=0).tolist(), strict=True)
    ]


class _Fillings:
    """Predicted 1 sigma [kg] of the masses of three regions of one body, for assumed fillings of it.

    A filling has a uniform density in each region: the shell, and the interior above and below a dividing
    plane. Mass, centre of mass and moments, as functions of region masses and plane, are linearised about
    each filling.

    Args:
        cells: Pieces of the body.
        directions: (a, 3) unit directions of the struck axes, in the object frame.
        mass: Mass of the body [kg].
    """

    def __init__(self, cells: Pieces, directions: Array, mass: float) -> None:
        self._cells, self._mass = cells, mass
        self._centre = cells.centroid
        arm = cells.points - self._centre
        self._reach = float(np.sqrt(np.max(np.sum(arm**2, axis=1))))
        square = np.sum(arm**2, axis=1) + cells.own_inertia
        along = arm @ directions.T
        # About the centroid; moved to c in `_seen`.
        self._features = np.column_stack([np.ones(len(arm)), arm, square[:, None] - along**2])
        self._directions = directions

    def sd(self, measured: Array, drawn: Array) -> Array:
        """1 sigma (3,) of the masses [kg] of shell, upper and lower interior, for one filling.

        Args:
            measured: (4 + a, 4 + a) covariance of mass [kg], centre of mass [m] and the a moments about it
                [kg m^2].
            drawn: (5,) numbers from 0 to 1 that define the filling: share of the shell in the mass, share of
                the upper part in the interior's, two for the direction of the dividing plane, one for its
                place; each is scaled to a plausible range.
        """
        surface, upper = 0.2 + 0.6 * float(drawn[0]), 0.1 + 0.8 * float(drawn[1])
        masses = self._mass * np.array([surface, (1 - surface) * upper, (1 - surface) * (1 - upper)])
        turn, z = 2 * np.pi * float(drawn[2]), 2 * float(drawn[3]) - 1
        normal = np.array([np.sqrt(1 - z**2) * np.cos(turn), np.sqrt(1 - z**2) * np.sin(turn), z])
        inside = self._cells.interior > 0
        heights = (self._cells.points - self._centre)[inside] @ normal
        offset = float(np.quantile(heights, 0.25 + 0.5 * float(drawn[4])))
        unknown = np.append(masses / self._mass, np.array([offset / self._reach, 0.0, 0.0]))
        across = np.linalg.svd(normal[None])[2][1:]
        steps = np.array([1e-3, 1e-3, 1e-3, 0.01, 0.01, 0.01])
        seen = self._seen(unknown, normal, across)
        columns = [
            (self._seen(unknown + step, normal, across) - self._seen(unknown - step, normal, across))
            / (2 * step.sum())
            for step in np.diag(steps)
        ]
        rows = np.stack(columns, axis=1)
        model = np.concatenate([[0.0], np.full(3, LEVER_ERROR), MODEL_ERROR * seen[4:]])
        scale = np.sqrt(np.diag(measured) + model**2 + 1e-30)
        whole = (measured + np.diag(model**2)) / np.outer(scale, scale) + 1e-9 * np.eye(len(scale))
        rows = rows / scale[:, None]
        # Prior: any share of the mass, any direction, an offset within the body.
        prior = np.diag(1 / np.array([SHARE_SD, SHARE_SD, SHARE_SD, 0.3, 1.0, 1.0]) ** 2)
        covariance = np.linalg.inv(rows.T @ np.linalg.solve(whole, rows) + prior)
        return self._mass * np.sqrt(np.diag(covariance)[:3])

    def _seen(self, unknown: Array, normal: Array, across: Array) -> Array:
        """Measured quantities (4 + a,) of a filling: mass, centre of mass c and a moments.

        Mass [kg], c (3,) [m, in the object frame], moments of inertia (a,) about the axes through c along the
        struck directions [kg m^2].

        Args:
            unknown: (6,) shares of shell, upper and lower interior in the mass, offset of the dividing plane
                from the centroid over the body's reach (largest distance of a piece from the centroid), and
                two tilts of the plane [rad].
            normal: (3,) unit normal of the plane before the tilts, in the object frame.
            across: (2, 3) unit vectors perpendicular to `normal`, in the object frame.
        """
        cells = self._cells
        n = normal + unknown[4] * across[0] + unknown[5] * across[1]
        n = n / np.linalg.norm(n)
        heights = (cells.points - self._centre) @ n - unknown[3] * self._reach
        above = np.clip(heights / cells.pitch + 0.5, 0.0, 1.0) * cells.interior
        parts = [cells.shell, above, cells.interior - above]
        total = sum(
            share * self._mass * (part @ self._features) / max(part.sum(), 1e-18)
            for share, part in zip(unknown, parts, strict=False)
        )
        total = np.asarray(total, dtype=np.float64)
        mass, c = float(total[0]), total[1:4] / total[0]
        moved = mass * (c @ c - (self._directions @ c) ** 2)
        return np.concatenate([[mass], self._centre + c, total[4:] - moved])
