"""Virtual object filled with contents that move: the convex body in which they do, and the masses.

Frame: O, the object's frame (that of its shape file).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial import ConvexHull

from acquire.errors import ConfigError
from acquire.virtual.contents import Contents
from acquire.virtual.given_contents import ContentsKind

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from acquire.virtual.given_contents import GivenContents
    from acquire.virtual.hidden import HiddenBody
    from acquire.virtual.objects import VirtualObject

DIRECTIONS = 1500
"""number of directions of a liquid's surface for which its centroid is computed"""
CAVITY_POINTS = 20_000
"""number of points in the cavity's bounding box, of which those in the cavity are its volume"""
SMOOTH_M = 1e-5
"""distance over which the facets of a liquid's K are blended [m]"""
DENSITIES = {ContentsKind.LIQUID: 1000.0, ContentsKind.POWDER: 700.0}
"""densities [kg/m3] that give the filled share if it is not given"""
FEWEST_POINTS = 200
"""least number of points of a cavity, and of what fills it"""
CLOSED_SHARE = 0.55
"""least share of the convex hull's volume that the shape takes; a mug or a chair takes less"""
LARGEST_LUMP_M, LUMP_SHARE = 0.03, 0.4
"""usual diameter of a lump: the first, or this share of the cavity's smallest size"""
DOWN = np.array([0.0, 0.0, -1.0])


def with_contents(virtual_object: VirtualObject, given: GivenContents, seed: int = 0) -> VirtualObject:
    """Virtual object with contents that move; its whole mass stays, and what is rigid gets lighter.

    The true mass properties become those of all, with the contents at rest in the object as its file has it.

    Args:
        virtual_object: object without contents.
        given: kind of the contents, their share of the mass, and what else is stated.
        seed: seed of the places of a lump.

    Raises:
        ConfigError: the shape is hollow, or the contents do not fit in.
    """
    rigid = _lighter(virtual_object.body, 1 - given.share)
    mass = given.share * virtual_object.body.mass_kg
    cavity = _cavity(virtual_object)
    if given.kind is ContentsKind.LUMP:
        planes, friction, smooth = _lump_planes(virtual_object, cavity, given), given.lump_friction, 0.0
        depths = np.zeros(0)
    else:
        planes, depths = _level_planes(cavity, _filled(virtual_object, cavity, given, mass))
        friction, smooth = given.surface_friction, SMOOTH_M
    damping, middle = given.liquid_damping_per_s, cavity.points.mean(axis=0)
    contents = Contents(given.kind, mass, friction, damping, planes, depths, smooth, middle, rigid, seed)
    whole = _joined(rigid, mass, contents.lowest(DOWN))
    return replace(virtual_object, body=whole, contents=contents)


@dataclass(frozen=True)
class _Cavity:
    """Inside of a closed container, as points spread uniformly."""

    points: NDArray[np.float64]
    """(n, 3) [m, in O]"""
    volume: float
    """volume [m3]"""
    wall: float
    """thickness of the walls [m]"""


def _cavity(thing: VirtualObject) -> _Cavity:
    wall = thing.body.shell_thickness_m
    low, high = thing.hull_vertices.min(axis=0) + wall, thing.hull_vertices.max(axis=0) - wall
    if np.any(high - low < wall):
        raise _no_room(thing, wall)
    pitch = (float(np.prod(high - low)) / CAVITY_POINTS) ** (1 / 3)
    counts = np.ceil((high - low) / pitch).astype(int)
    cells = np.stack(np.meshgrid(*(np.arange(n) for n in counts), indexing="ij"), axis=-1).reshape(-1, 3)
    points = low + (cells + 0.5) * ((high - low) / counts)
    inside = np.zeros(len(points), dtype=bool)
    for part in thing.convex_parts:
        planes = ConvexHull(part).equations
        inside |= np.all(points @ planes[:, :3].T + planes[:, 3] <= 0, axis=1)
    hull = ConvexHull(thing.hull_vertices)
    to_hull = (points @ hull.equations[:, :3].T + hull.equations[:, 3]).max(axis=1)
    if np.count_nonzero(inside) < CLOSED_SHARE * np.count_nonzero(to_hull <= 0) or not inside.any():
        raise ConfigError(
            f"{thing.spec.name}: its shape is hollow or branched, and contents move in closed containers "
            "only: describe the container by its outer surface"
        )
    inside &= to_hull <= -wall
    volume = float(np.prod(high - low)) * np.count_nonzero(inside) / len(points)
    if np.count_nonzero(inside) < FEWEST_POINTS:
        raise _no_room(thing, wall)
    return _Cavity(points[inside], volume, wall)


def _no_room(thing: VirtualObject, wall: float) -> ConfigError:
    return ConfigError(
        f"{thing.spec.name}: walls of {1e3 * wall:.1f} mm leave no room for contents: state a smaller "
        "shell_thickness_m"
    )


def _filled(thing: VirtualObject, cavity: _Cavity, given: GivenContents, mass: float) -> float:
    filled = given.filled
    if filled is None:
        filled = mass / DENSITIES[given.kind] / cavity.volume
    fewest = FEWEST_POINTS / len(cavity.points)
    if not fewest <= filled <= 0.95:
        raise ConfigError(
            f"{thing.spec.name}: {1e3 * mass:.0f} g of {given.kind.value} fill {100 * filled:.1f} % of the "
            f"cavity of {1e6 * cavity.volume:.0f} ml: give a filled share from {fewest:.2f} to 0.95"
        )
    return filled


def _level_planes(cavity: _Cavity, filled: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Planes (n, 4) of the convex body of a liquid's centroids, one for each direction, and depths (n,)."""
    normals = _sphere(DIRECTIONS)
    count = max(1, round(filled * len(cavity.points)))
    offsets, depths = np.empty(len(normals)), np.empty(len(normals))
    for i, normal in enumerate(normals):
        deep = cavity.points @ normal
        # The deepest points are the liquid's; the mean of their depths is the support of their centroid.
        lowest = np.partition(deep, len(deep) - count)[len(deep) - count :]
        offsets[i], depths[i] = lowest.mean(), np.ptp(lowest)
    return np.column_stack([normals, offsets]), depths


def _lump_planes(thing: VirtualObject, cavity: _Cavity, given: GivenContents) -> NDArray[np.float64]:
    """Planes (n, 4) between which the middle of a ball moves: those of the hull, less wall and radius."""
    size = np.ptp(cavity.points, axis=0)
    diameter = given.size_m or min(LARGEST_LUMP_M, LUMP_SHARE * float(size.min()))
    if diameter > 0.9 * float(size.min()):
        raise ConfigError(
            f"{thing.spec.name}: a lump of {1e3 * diameter:.0f} mm does not fit in a cavity "
            f"{1e3 * float(size.min()):.0f} mm wide: give a smaller size_m"
        )
    equations = np.unique(np.round(ConvexHull(thing.hull_vertices).equations, 9), axis=0)
    return np.column_stack([equations[:, :3], -equations[:, 3] - cavity.wall - diameter / 2])


def _sphere(count: int) -> NDArray[np.float64]:
    """Unit vectors (count, 3) spread evenly over the sphere, on Fibonacci's spiral."""
    step = np.arange(count) + 0.5
    z = 1 - 2 * step / count
    turn = step * math.pi * (3 - math.sqrt(5))
    across = np.sqrt(1 - z * z)
    return np.column_stack([across * np.cos(turn), across * np.sin(turn), z])


def _lighter(body: HiddenBody, share: float) -> HiddenBody:
    shell, upper, lower = (share * mass for mass in body.region_masses)
    return replace(
        body,
        mass_kg=share * body.mass_kg,
        inertia_com=share * body.inertia_com,
        region_masses=(shell, upper, lower),
    )


def _joined(rigid: HiddenBody, mass: float, place: NDArray[np.float64]) -> HiddenBody:
    """Mass properties of a rigid body together with a point mass [kg] at a place (3,) in O [m]."""
    total = rigid.mass_kg + mass
    com = (rigid.mass_kg * rigid.com_object + mass * place) / total
    inertia = np.array(rigid.inertia_com)
    for each, at in ((rigid.mass_kg, rigid.com_object), (mass, place)):
        arm = at - com
        inertia = inertia + each * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    return replace(rigid, mass_kg=total, com_object=com, inertia_com=inertia)
