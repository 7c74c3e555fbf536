"""Mass distribution of a virtual object, a shell and two interior parts, and its mass properties.

The body is sampled (jittered grid, seeded). Each sample belongs to the shell or to one side of the dividing
plane, and each region's mass is spread uniformly over its samples, or inside with a given density. Rounded
edges are not cut off the mass. No code is shared with the estimators.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

SAMPLES = 400_000
"""samples of the bounding box: a shell's centre of mass is then within 0.1 mm and its moments within 0.2 % of
the exact integral"""

Depth = Callable[["NDArray[np.float64]"], "NDArray[np.float64]"]
"""depth (n,) [m] of points (n, 3) [m, in O] below the surface, negative outside; exact near the surface, a
bound deeper inside"""


@dataclass(frozen=True)
class HiddenBody:
    """True mass properties of one object, in O."""

    mass_kg: float
    com_object: NDArray[np.float64]
    """(3,) centre of mass [m]"""
    inertia_com: NDArray[np.float64]
    """(3, 3) inertia about the centre of mass, axes of O [kg m2]"""
    region_masses: tuple[float, float, float]
    """masses of shell (R1), upper (R2) and lower part (R3) [kg]"""
    region_plane: tuple[NDArray[np.float64], float]
    """dividing plane: unit normal n towards R2, and offset [m]; R2 is the interior where n.x > offset"""
    shell_thickness_m: float


def sample_body(
    low: NDArray[np.float64], high: NDArray[np.float64], depth: Depth
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Points inside the body (n, 3) [m] and their depth (n,) [m], spread uniformly.

    Args:
        low: (3,) lower corner of the bounding box [m].
        high: (3,) upper corner of the bounding box [m].
        depth: depth of points below the body's surface.
    """
    rng = np.random.default_rng(20070601)
    pitch = (np.prod(high - low) / SAMPLES) ** (1 / 3)
    counts = np.ceil((high - low) / pitch).astype(int)
    cells = np.stack(np.meshgrid(*(np.arange(n) for n in counts), indexing="ij"), axis=-1).reshape(-1, 3)
    points = low + (cells + rng.random(cells.shape)) * ((high - low) / counts)
    depths = depth(points)
    inside = depths >= 0
    return points[inside], depths[inside]


def hidden_body(
    points: NDArray[np.float64],
    depths: NDArray[np.float64],
    region_masses: tuple[float, float, float],
    region_plane: tuple[NDArray[np.float64], float],
    shell_thickness_m: float,
    density: NDArray[np.float64] | None = None,
) -> HiddenBody:
    """Mass, centre of mass and inertia integrated over sampled points.

    Args:
        points: (n, 3) points spread uniformly inside the body [m, in O].
        depths: (n,) depths below the surface [m].
        region_masses: masses of shell, upper and lower part [kg].
        region_plane: unit normal (3,) and offset [m] of the dividing plane.
        shell_thickness_m: the shell is where the depth is less than this.
        density: (n,) relative density of the interior; None if uniform in each part.
    """
    normal, offset = region_plane
    shell = depths < shell_thickness_m
    upper = ~shell & (points @ normal > offset)
    weights = np.zeros(len(points))
    spread = np.ones(len(points)) if density is None else np.where(shell, 1.0, density)
    for region, mass in zip((shell, upper, ~shell & ~upper), region_masses, strict=True):
        if mass > 0:
            weights[region] = mass * spread[region] / spread[region].sum()
    total = float(weights.sum())
    com = weights @ points / total
    arm = points - com
    second = (arm * weights[:, None]).T @ arm
    inertia = np.trace(second) * np.eye(3) - second
    return HiddenBody(total, com, inertia, region_masses, (normal, offset), shell_thickness_m)


def box_depth(half: NDArray[np.float64]) -> Depth:
    """Depth in a box with half edges (3,) [m], centred on O's origin."""
    return lambda points: np.min(half - np.abs(points), axis=1)


def cylinder_depth(radius: float, half_height: float) -> Depth:
    """Depth in a cylinder about O's z axis, centred on O's origin."""
    return lambda points: np.minimum(
        radius - np.hypot(points[:, 0], points[:, 1]), half_height - np.abs(points[:, 2])
    )


def mesh_depth(
    triangles: NDArray[np.float64],
    inside: Callable[[NDArray[np.float64]], NDArray[np.bool_]],
    reach: float,
) -> Depth:
    """Depth in a closed mesh, exact up to `reach`, and `reach` deeper inside; -1 outside.

    Args:
        triangles: (m, 3, 3) corners [m].
        inside: function of points (n, 3) [m] that is True (n,) where they lie in the body.
        reach: largest depth that is computed [m].
    """

    def depth(points: NDArray[np.float64]) -> NDArray[np.float64]:
        result = np.full(len(points), -1.0)
        index = np.flatnonzero(inside(points))
        index = index[np.argsort(points[index, 2])]
        within = points[index]
        distance = np.full(len(within), reach)
        for corners in triangles:
            low, high = corners.min(axis=0) - reach, corners.max(axis=0) + reach
            # Only points at the triangle's height can be near it.
            first, last = np.searchsorted(within[:, 2], (low[2], high[2]))
            x, y = within[first:last, 0], within[first:last, 1]
            near = first + np.flatnonzero((x > low[0]) & (x < high[0]) & (y > low[1]) & (y < high[1]))
            distance[near] = np.minimum(distance[near], _distance_to_triangle(within[near], corners))
        result[index] = distance
        return result

    return depth


def _distance_to_triangle(points: NDArray[np.float64], corners: NDArray[np.float64]) -> NDArray[np.float64]:
    """Distance (n,) [m] of points (n, 3) [m] to a triangle with corners (3, 3) [m].

    The distance to its plane if the foot lies inside, else to the nearest edge.
    """
    normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
    normal /= np.linalg.norm(normal)
    above = np.ones(len(points), dtype=bool)
    to_edge = np.full(len(points), np.inf)
    for start, end in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        edge = end - start
        offset = points - start
        above &= offset @ np.cross(normal, edge) >= 0
        share = np.clip(offset @ edge / (edge @ edge), 0.0, 1.0)
        to_edge = np.minimum(to_edge, np.linalg.norm(offset - share[:, None] * edge, axis=1))
    return np.where(above, np.abs((points - corners[0]) @ normal), to_edge)
