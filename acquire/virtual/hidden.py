"""Mass distribution of a virtual object, a shell and two interior parts, and its mass properties.

The body is sampled (jittered grid, fixed seed). Each sample belongs to the shell or to one side of the plane
that divides the interior, and each region's mass is spread uniformly over its samples, or in the interior
with a given density. The material that rounded edges lack is not subtracted. No code is shared with the
estimators of `analyze`.
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
    """True mass properties of one object, in O (the object's frame, that of its shape file).

    They are mass [kg], centre of mass [m], inertia about it [kg m2], the masses of the three regions [kg]
    (shell, upper and lower part of the interior), and the plane and shell thickness [m] that divide these.
    """

    mass_kg: float
    """total mass [kg]"""
    com_object: NDArray[np.float64]
    """(3,) centre of mass [m]"""
    inertia_com: NDArray[np.float64]
    """(3, 3) inertia about the centre of mass, axes of O [kg m2]"""
    region_masses: tuple[float, float, float]
    """masses of shell (R1), upper (R2) and lower part (R3) [kg]"""
    region_plane: tuple[NDArray[np.float64], float]
    """dividing plane: unit normal n (3,) towards R2, and offset [m]; R2 is the interior where n.x > offset"""
    shell_thickness_m: float
    """depth below the surface down to which the material belongs to the shell [m]"""


def sample_body(
    low: NDArray[np.float64], high: NDArray[np.float64], depth: Depth
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Points spread uniformly inside a body (n, 3) [m], and their depths below its surface (n,) [m].

    About 400 000 points of a jittered grid fill the bounding box; those outside the body are dropped. The
    seed is fixed, so that equal arguments give equal points.

    Args:
        low: (3,) lower corner of the bounding box [m, in O, the object's frame].
        high: (3,) upper corner of the bounding box [m, in O].
        depth: function of points (n, 3) [m, in O]: their depths (n,) [m] below the surface, negative outside.
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
    """Mass, centre of mass and inertia about it [kg, m, kg m2, in O], as sums over points in the body.

    Args:
        points: (n, 3) points spread uniformly inside the body [m, in O, the object's frame].
        depths: (n,) depths below the surface [m].
        region_masses: masses of the shell and of the interior's upper and lower part [kg].
        region_plane: unit normal n (3,) and offset d [m] of the plane that divides the interior; the upper
            part is where n.x > d.
        shell_thickness_m: the shell is where the depth is less than this [m].
        density: (n,) relative density at the points, used within upper and lower part; None if each is
            uniform. The shell is always uniform.

    Returns:
        The mass properties, together with the given region masses, plane and shell thickness.
    """
    normal, offset = region_plane
    shell = depths < shell_thickness_m
    upper = ~shell & (points @ normal > offset)
    weights = np.zeros(len(points))
    spread = np.ones(len(points)) if density is None else np.where(shell, 1.0, density)
    for region, mass in zip((shell, upper, ~shell & ~upper), region_masses, strict=True):
        if mass > 0:
            weights[region] = mass * spread[region] / spread[region].sum()
    return weighted_body(points, weights, region_masses, region_plane, shell_thickness_m)


def weighted_body(
    points: NDArray[np.float64],
    weights: NDArray[np.float64],
    region_masses: tuple[float, float, float],
    region_plane: tuple[NDArray[np.float64], float],
    shell_thickness_m: float,
) -> HiddenBody:
    """Mass, centre of mass and inertia about it [kg, m, kg m2, in O] of point masses, with given regions.

    Args:
        points: (n, 3) places of the point masses [m, in O, the object's frame].
        weights: (n,) masses [kg].
        region_masses: masses of the shell and of the interior's upper and lower part [kg].
        region_plane: unit normal n (3,) and offset d [m] of the plane that divides the interior; the upper
            part is where n.x > d.
        shell_thickness_m: depth down to which the material belongs to the shell [m].
    """
    normal, offset = region_plane
    total = float(weights.sum())
    com = weights @ points / total
    arm = points - com
    second = (arm * weights[:, None]).T @ arm
    inertia = np.trace(second) * np.eye(3) - second
    return HiddenBody(total, com, inertia, region_masses, (normal, offset), shell_thickness_m)


def box_depth(half: NDArray[np.float64]) -> Depth:
    """Depth function of a box centred on the origin, with half edge lengths `half` (3,) [m].

    It maps points (n, 3) [m] to their depths (n,) [m] below the nearest face plane, negative outside.
    """
    return lambda points: np.min(half - np.abs(points), axis=1)


def cylinder_depth(radius: float, half_height: float) -> Depth:
    """Depth function of a cylinder about z, centred on the origin; `radius` and `half_height` in m.

    It maps points (n, 3) [m] to their depths (n,) [m] below lateral surface or end plane, whichever is
    nearer; negative outside.
    """
    return lambda points: np.minimum(
        radius - np.hypot(points[:, 0], points[:, 1]), half_height - np.abs(points[:, 2])
    )


def mesh_depth(
    triangles: NDArray[np.float64],
    inside: Callable[[NDArray[np.float64]], NDArray[np.bool_]],
    reach: float,
) -> Depth:
    """Depth function of a closed mesh: exact up to `reach`, equal to `reach` deeper inside, -1 outside.

    Args:
        triangles: (m, 3, 3) corners of the triangles [m].
        inside: function of points (n, 3) [m] that is True (n,) where they lie in the body.
        reach: largest depth that is computed [m].

    Returns:
        Function that maps points (n, 3) [m] to their depths (n,) [m] below the surface.
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

    It is the distance to the triangle's plane if the foot of the perpendicular lies inside the triangle, else
    the distance to the nearest edge.
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
