"""Division of the body into small cells, each in its shell (the outer wall) or in its interior."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from analyze.geometry.object_model import ObjectModel
from analyze.geometry.voxels import Voxels
from analyze.types import Array
from schemas.object_spec import ObjectSpec

MIN_CELL_FRACTION = 1e-3
"""Fraction of a voxel below which its part in the shell, or in the interior, makes no cell."""
MIN_HALF_HEIGHT = 1e-3
"""Smallest half height of a cell, over the pitch, that is used where a plane cuts it."""
MIN_SHELL_FRACTION, MAX_SHELL_FRACTION = 0.004, 0.12
"""Range of a shell thickness that is not given, over the cube root of the volume."""
SHELL_THICKNESS_COUNT = 13
"""Number of thicknesses tried in that range."""
ASSUMED_SHELL_FRACTION = 0.025
"""Shell thickness where none is given, over the cube root of the volume."""


@dataclass(frozen=True)
class Cells:
    """Small pieces that fill the body, each in the shell (the outer wall) or in the interior.

    The shell has the thickness with which the body was divided. Each cell has a centroid, a volume and a
    moment of inertia per kilogram about its own centroid.
    """

    points: Array
    """(n, 3) centroids [m], in the object frame O."""
    shell: Array
    """(n,) volumes in the shell [m^3]; 0 for cells of the interior."""
    interior: Array
    """(n,) volumes in the interior [m^3]; 0 for cells of the shell."""
    own_inertia: Array
    """(n,) moment of inertia about the own centroid per kilogram [m^2], about any axis: d^2/6 for a cube
    (VISAPP 2013, eq. 7)."""
    pitch: float
    """Edge d [m] of the cubes (voxels) that the cells were cut from."""
    corner: Array | None = None
    """(3,) corner of one of these cubes [m], in O, whose axes their edges follow; None if all cells are whole
    cubes."""

    @property
    def volumes(self) -> Array:
        """Volume (n,) [m^3] of each of the n cells (pieces of the body), of the shell and of the interior."""
        return self.shell + self.interior

    @property
    def centroid(self) -> Array:
        """Centroid (3,) [m] of the body as a uniform solid, in the object frame O."""
        return self.volumes @ self.points / self.volumes.sum()

    def share_below(self, along: Array, level: float) -> Array:
        """Fraction (n,) of each of the n cells (pieces of the body) below the plane x.along = level.

        Volume is taken to be uniform over a cell's height along the direction. The height of a whole cube is
        the pitch; a cell that is part of a cube reaches from its centroid as far as the nearer end of the
        cube. This is exact for slabs, so that a plane at the body's end leaves nothing beyond it.

        Args:
            along: (3,) unit vector in the object frame O.
            level: Place of the plane along it [m], from O's origin.
        """
        height, half = self.points @ along, np.full(len(self.points), self.pitch / 2)
        if self.corner is not None:
            cubes = np.floor((self.points - self.corner) / self.pitch) + 0.5
            off = np.abs(height - (self.corner + cubes * self.pitch) @ along)
            half = np.maximum(half - off, MIN_HALF_HEIGHT * self.pitch)
        return np.clip((level - height) / (2 * half) + 0.5, 0.0, 1.0)

    def principal_directions(self) -> Array:
        """Principal directions (3, 3) of the body as a uniform solid, as unit rows in the object frame O.

        The direction of largest extent (variance of the volume) is first. The sign of each row is such that
        its largest component is positive.
        """
        values, vectors = np.linalg.eigh(np.cov((self.points - self.centroid).T, aweights=self.volumes))
        rows = vectors.T[np.argsort(-values, kind="stable")]
        largest = np.take_along_axis(rows, np.argmax(np.abs(rows), axis=1)[:, None], axis=1)
        return rows * np.sign(largest)


@dataclass(frozen=True)
class ShellCells:
    """The cells (small pieces) that a body is divided into, for one thickness of its shell (outer wall).

    Each cell belongs to the shell or to the interior. The thickness [m] is held too.
    """

    thickness: float
    """Shell thickness [m]."""
    cells: Cells
    """The body divided into cells of shell and interior."""


def cells_from_voxels(voxels: Voxels) -> Cells:
    """Cells of a body given as cubes (voxels), each cell wholly in the shell (outer wall) or the interior.

    The voxels state how much of each lies in the shell. A voxel that the shell's inner side cuts becomes two
    cells. A cell of at most `MIN_CELL_FRACTION` (0.001) of its voxel is left out.
    """
    shell, volumes = voxels.shell, voxels.volumes
    in_wall, inside = shell > MIN_CELL_FRACTION, shell < 1 - MIN_CELL_FRACTION
    wall = np.concatenate([(volumes * shell)[in_wall], np.zeros(int(inside.sum()))])
    interior = np.concatenate([np.zeros(int(in_wall.sum())), (volumes * (1 - shell))[inside]])
    filled = np.clip((wall + interior) / voxels.pitch**3, 0, 1)
    return Cells(
        points=np.concatenate([voxels.shell_centres[in_wall], voxels.core_centres[inside]]),
        shell=wall,
        interior=interior,
        # Moment of a slab of thickness f*d, mean over its orientations; d^2/6 for a whole cube.
        own_inertia=voxels.pitch**2 * (2 + filled**2) / 18,
        pitch=voxels.pitch,
        corner=voxels.corner,
    )


def moments_about(cells: Cells, masses: Array, about: Array) -> Array:
    """Inertia tensor (3, 3) [kg m^2] of n cells about a given point, axes of the object frame O.

    Args:
        cells: Cells of the body.
        masses: (n,) masses of the cells [kg].
        about: (3,) the given point [m], in O.
    """
    arm = cells.points - about
    second = (arm * masses[:, None]).T @ arm
    return (np.trace(second) + masses @ cells.own_inertia) * np.eye(3) - second


def candidate_shell_thicknesses(model: ObjectModel) -> Array:
    """Thicknesses (13,) [m] to try for a shell (outer wall) whose thickness is not given.

    They have a constant ratio, from 0.004 to 0.12 of the cube root of the body's volume, thinnest first.
    """
    return model.volume ** (1 / 3) * np.geomspace(
        MIN_SHELL_FRACTION, MAX_SHELL_FRACTION, SHELL_THICKNESS_COUNT
    )


def shell_thickness(spec: ObjectSpec, model: ObjectModel) -> float:
    """Thickness [m] of the shell (outer wall): from the object file, otherwise assumed from the size.

    The assumed thickness is `ASSUMED_SHELL_FRACTION` of the cube root of the body's volume.
    """
    return spec.shell_thickness_m or ASSUMED_SHELL_FRACTION * model.volume ** (1 / 3)
