"""The body as pieces that lie either in the wall or in the interior."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from analyze.geometry.object_model import ObjectModel
from analyze.geometry.voxels import Voxels
from analyze.types import Array
from schemas.object_spec import ObjectSpec

LEAST_PART = 1e-3
THINNEST, THICKEST = 0.004, 0.12
"""of a wall that is not given, over the cube root of the volume"""
THICKNESSES = 5
ASSUMED_WALL = 0.025
"""wall thickness where none is given, over the cube root of the volume"""


@dataclass(frozen=True)
class Cells:
    """Pieces of the body, each in the wall or in the interior."""

    points: Array
    """(n, 3) m, centroids in O"""
    wall: Array
    """(n,) m^3, 0 for pieces of the interior"""
    interior: Array
    """(n,) m^3, 0 for pieces of the wall"""
    own: Array
    """(n,) m^2: a piece's moment about its own centroid, per kilogram, the same about every axis (paper eq. 7: d^2/6 for a cube)"""
    pitch: float
    """m, edge of the cubes they were cut from"""

    @property
    def volumes(self) -> Array:
        """(n,) m^3, of every piece."""
        return self.wall + self.interior

    @property
    def centroid(self) -> Array:
        """(3,) m, of the uniform solid."""
        return self.volumes @ self.points / self.volumes.sum()

    def principal_directions(self) -> Array:
        """(3, 3), rows: unit, along which the body is longest first; largest component positive."""
        values, vectors = np.linalg.eigh(np.cov((self.points - self.centroid).T, aweights=self.volumes))
        rows = vectors.T[np.argsort(-values, kind="stable")]
        largest = np.take_along_axis(rows, np.argmax(np.abs(rows), axis=1)[:, None], axis=1)
        return rows * np.sign(largest)


def cells_from_voxels(voxels: Voxels) -> Cells:
    """Cubes cut by the wall's inner side become two pieces."""
    shell, volumes = voxels.shell, voxels.volumes
    in_wall, inside = shell > LEAST_PART, shell < 1 - LEAST_PART
    wall = np.concatenate([(volumes * shell)[in_wall], np.zeros(int(inside.sum()))])
    interior = np.concatenate([np.zeros(int(in_wall.sum())), (volumes * (1 - shell))[inside]])
    filled = np.clip((wall + interior) / voxels.pitch**3, 0, 1)
    return Cells(
        points=np.concatenate([voxels.shell_centres[in_wall], voxels.core_centres[inside]]),
        wall=wall,
        interior=interior,
        # A slab of thickness f*d, mean over its orientations; d^2/6 for the whole cube.
        own=voxels.pitch**2 * (2 + filled**2) / 18,
        pitch=voxels.pitch,
    )


def moments_about(cells: Cells, masses: Array, about: Array) -> Array:
    """Inertia tensor (3, 3) [kg m^2] about the point `about` (3,) of pieces with `masses` (n,) [kg]."""
    arm = cells.points - about
    second = (arm * masses[:, None]).T @ arm
    return (np.trace(second) + masses @ cells.own) * np.eye(3) - second


def possible_thicknesses(model: ObjectModel) -> Array:
    """Thicknesses of a wall [m] (w,) that is not given, rising by equal factors."""
    size = model.volume ** (1 / 3)
    grown = (THICKEST / THINNEST) ** (np.arange(THICKNESSES) / (THICKNESSES - 1))
    return np.asarray(size * THINNEST * grown, dtype=np.float64)


def wall_thickness(spec: ObjectSpec, model: ObjectModel) -> float:
    """Thickness of the surface region [m]: given, or assumed from the size."""
    return spec.shell_thickness_m or ASSUMED_WALL * model.volume ** (1 / 3)
