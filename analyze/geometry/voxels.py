"""Voxels of the body with their partial volumes inside and in the shell (VISAPP 2013, 3.3.1)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from analyze.geometry.object_model import ObjectModel
from analyze.types import Array, IntArray

SUBCELLS = 3
"""Subcells per edge of a cube that the surface or the shell's inner side cuts."""
MIN_FRACTION = 1e-3
"""Fraction of a cube's volume below which a part is dropped; the rest is scaled to the exact volume."""


@dataclass(frozen=True)
class Voxels:
    """Cubes that contain a part of the body, with the volume and centroid of this part.

    The volumes add up to the body's. The shell is the part of the body near its surface.
    """

    pitch: float
    """Edge of the cubes [m]."""
    corner: Array
    """(3,) corner of one of the cubes [m], in the object frame O; their edges are parallel to O's axes."""
    centres: Array
    """(n, 3) centroid of the part of each cube inside the body [m], in the object frame O."""
    volumes: Array
    """(n,) volume of that part [m^3]."""
    shell: Array
    """(n,) fraction of `volumes` within the shell's thickness of the surface, 0 to 1."""
    shell_centres: Array
    """(n, 3) centroid of the part in the shell [m], in O; `centres` where there is none."""
    core_centres: Array
    """(n, 3) centroid of the rest [m], in O; `centres` where there is none."""


def voxelise(model: ObjectModel, pitch: float, shell_thickness: float) -> Voxels:
    """Divide a model's bounding box into cubes, and find the part of each in the body and in its shell.

    Cubes that the surface or the shell's inner side cuts are divided again; each subcell counts by its part
    below the plane through its nearest surface point, so that 4 mm cubes resolve a 2 mm shell. The result is
    cached on the model.

    Args:
        model: Shape of the object.
        pitch: Edge of the cubes [m].
        shell_thickness: Thickness of the shell, inwards from the surface [m].

    Returns:
        The cubes that contain a part of the body. Their volumes add up to the body's exactly; centroid and
        moments of inertia computed from them are the body's to 0.5 %.

    Raises:
        ValueError: pitch or thickness is not above 0.
    """
    if pitch <= 0 or shell_thickness <= 0:
        raise ValueError("pitch and shell_thickness must be above 0")
    return model.cached(
        ("voxels", pitch, shell_thickness), lambda model: _voxelised(model, pitch, shell_thickness)
    )


def _voxelised(model: ObjectModel, pitch: float, shell_thickness: float) -> Voxels:
    counts = np.ceil(model.extent / pitch - 1e-9).astype(int)
    lower = model.bounds.mean(axis=0) - counts * pitch / 2
    index = np.argwhere(np.ones(counts))
    corners = lower + index * pitch
    depths = model.cached(("subcell depths", pitch), lambda model: _SubcellDepths(model, corners, pitch))
    depth = depths.of_cubes
    reach = pitch * np.sqrt(3) / 2
    cut = (np.abs(depth) < reach) | (np.abs(depth - shell_thickness) < reach)
    whole = (depth >= reach) & ~cut
    in_wall = whole & (depth < shell_thickness)
    body, wall, body_moment, wall_moment = _cut(depths, cut, pitch, shell_thickness)
    plain = corners[whole] + pitch / 2
    body = np.concatenate([body, np.ones(len(plain))])
    wall = np.concatenate([wall, in_wall[whole].astype(float)])
    body_moment = np.vstack([body_moment, plain])
    wall_moment = np.vstack([wall_moment, plain * in_wall[whole][:, None]])
    kept = body > MIN_FRACTION
    body, wall, body_moment, wall_moment = body[kept], wall[kept], body_moment[kept], wall_moment[kept]
    core = body - wall
    centres = body_moment / body[:, None]
    return Voxels(
        pitch=pitch,
        corner=lower,
        centres=centres,
        volumes=body * (model.volume / body.sum()),
        shell=wall / body,
        shell_centres=_centroids(wall_moment, wall, centres),
        core_centres=_centroids(body_moment - wall_moment, core, centres),
    )


class _SubcellDepths:
    """Depths below a model's surface of cubes' centres and of their subcells, each computed only once.

    Outer walls of several thicknesses cut mostly the same cubes, and computing depths takes most of the time
    of dividing a body into cubes.

    Args:
        model: Shape of the object.
        corners: (n, 3) lowest corner of each cube [m], in the object frame O.
        pitch: Edge of the cubes [m].

    Attributes:
        of_cubes: (n,) depths of the cubes' centres [m], positive inside; outside, half a cube's diagonal at
            most.
    """

    def __init__(self, model: ObjectModel, corners: Array, pitch: float) -> None:
        self._model, self._corners = model, corners
        self._offsets = (np.argwhere(np.ones((SUBCELLS,) * 3)) + 0.5) * (pitch / SUBCELLS)
        self.of_cubes = model.depth(corners + pitch / 2, outside=pitch * np.sqrt(3) / 2)
        # Place of a cube's subcells in the arrays below; -1 if they are not yet computed.
        self._place: IntArray = np.full(len(corners), -1)
        self._value, self._gradient = np.zeros((0, len(self._offsets))), np.zeros((0, len(self._offsets), 3))

    def of_subcells(self, cubes: NDArray[np.bool_]) -> tuple[Array, Array, Array]:
        """Centres (m, 3) [m], depths (m,) [m] and gradients (m, 3) of the depth, of all subcells of cubes.

        They are in the object frame O. `cubes` (n,) is True for these cubes; the subcells of each are
        consecutive.
        """
        new = np.flatnonzero(cubes & (self._place < 0))
        if len(new):
            found = self._model.depth_and_gradient(self._centres(new))
            shape = (len(new), len(self._offsets))
            self._place[new] = len(self._value) + np.arange(len(new))
            self._value = np.concatenate([self._value, found.value.reshape(shape)])
            self._gradient = np.concatenate([self._gradient, found.gradient.reshape(*shape, 3)])
        place = self._place[cubes]
        return (
            self._centres(np.flatnonzero(cubes)),
            self._value[place].ravel(),
            self._gradient[place].reshape(-1, 3),
        )

    def _centres(self, cubes: IntArray) -> Array:
        """Centres (m, 3) [m] of the subcells of the cubes with these indices, in the object frame O."""
        return (self._corners[cubes, None] + self._offsets).reshape(-1, 3)


def _cut(
    depths: _SubcellDepths, cubes: NDArray[np.bool_], pitch: float, shell_thickness: float
) -> tuple[Array, Array, Array, Array]:
    """Fraction of each cube in the body and in its shell (outer wall), with first moments.

    It is meant for cubes that the surface or the shell's inner side cuts. Each is divided into subcells.

    Args:
        depths: Depths of all cubes and their subcells.
        cubes: True for each of the n cubes to be divided.
        pitch: Edge of the cubes [m].
        shell_thickness: Thickness of the shell [m].

    Returns:
        Fraction (n,) of each cube's volume in the body, fraction (n,) in the shell, then for the body and for
        the shell: the part's first moment about the origin of the object frame, divided by the cube's volume,
        (n, 3) [m].
    """
    step = pitch / SUBCELLS
    points, value, gradient = depths.of_subcells(cubes)
    # Width of a subcell along the surface's normal: exact for a plane normal to an axis, unbiased for an
    # oblique one.
    width = step * np.abs(gradient).sum(axis=1)
    body = np.clip(value / width + 0.5, 0, 1)
    core = np.clip((value - shell_thickness) / width + 0.5, 0, 1)
    # The part of a subcell on one side of a plane has its centroid off the subcell's centre.
    lean = (step**2 / 12 * 6 / width)[:, None] * gradient
    body_point = points + lean * (body * (1 - body))[:, None] / np.where(body > 0, body, 1)[:, None]
    core_point = points + lean * (core * (1 - core))[:, None] / np.where(core > 0, core, 1)[:, None]
    shape = (int(cubes.sum()), SUBCELLS**3)
    body_moment = (body_point * body[:, None]).reshape(*shape, 3).mean(axis=1)
    core_moment = (core_point * core[:, None]).reshape(*shape, 3).mean(axis=1)
    body, core = body.reshape(shape).mean(axis=1), core.reshape(shape).mean(axis=1)
    return body, body - core, body_moment, body_moment - core_moment


def _centroids(moment: Array, volume: Array, otherwise: Array) -> Array:
    """Centroids (n, 3) [m] of n parts of cubes: first moments `moment` (n, 3) over volumes `volume` (n,).

    Both are divided by the cube's volume: the moments are in m, the volumes fractions of the cube. Where a
    part's fraction is at most `MIN_FRACTION`, its row of the points `otherwise` (n, 3) [m] is returned.
    """
    usable = volume > MIN_FRACTION
    return np.where(usable[:, None], moment / np.where(usable, volume, 1.0)[:, None], otherwise)
