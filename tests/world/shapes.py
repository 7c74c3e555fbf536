"""World shapes: a generator's solid with name, category, mass, hidden mass distribution and places of tags.

Generators register themselves with `world_shape` and return a `Built`: a solid in millimetres, as it usually
stands on z = 0, and the parts that its mass consists of. `catalogue.make` calls them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from manifold3d import Manifold
from numpy.typing import NDArray

from tests.world.solids import triangles

Array = NDArray[np.float64]
Category = Literal["food", "container", "kitchen", "fruit", "tool", "toy", "device", "clothing", "furniture"]
HOUSEHOLD: frozenset[str] = frozenset(
    {"food", "container", "kitchen", "device", "clothing", "furniture", "toy"}
)
"""categories that count as household objects in `make bench-world`; balls are left out by name"""
BALLS = frozenset({"tennis_ball", "golf_ball", "football"})


@dataclass(frozen=True)
class MassPart:
    """Part of a mass distribution: share of the object's mass, spread over a solid's volume or surface."""

    name: str
    share: float
    """fraction of the object's mass"""
    solid: Manifold
    """solid over which the share is spread [mm]"""
    on_surface: bool = False
    """True if the mass is spread evenly over the solid's surface, as a thin wall's"""

    def moments(self) -> tuple[Array, Array]:
        """Centroid (3,) [mm] and mean of x x^T (3, 3) [mm2] over volume or surface."""
        corners = triangles(self.solid)
        if self.on_surface:
            weights = np.linalg.norm(
                np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
            )
            middles = (corners + np.roll(corners, 1, axis=1)) / 2  # exact for quadratics
            weights = weights / weights.sum()
            return weights @ corners.mean(axis=1), np.einsum("t,tpi,tpj->ij", weights, middles, middles) / 3
        volumes = np.einsum("ti,ti->t", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6
        weights, total = volumes / volumes.sum(), corners.sum(axis=1)
        second = np.einsum("t,tpi,tpj->ij", weights, corners, corners) + np.einsum(
            "t,ti,tj->ij", weights, total, total
        )
        return weights @ total / 4, second / 20


@dataclass(frozen=True)
class Built:
    """Generated object: its solid [mm], and the parts of its mass; uniform if there are none."""

    solid: Manifold
    parts: Sequence[MassPart] = ()


@dataclass(frozen=True)
class WorldShape:
    """Object of the world: clean solid, mass, hidden mass distribution, and direction in which it stands."""

    name: str
    category: Category
    solid: Manifold
    """clean CAD solid [mm, in O, the object's frame]"""
    mass_kg: float
    parts: tuple[MassPart, ...]
    seed: int
    up: Array
    """(3,) direction in O that is up when the object stands as usual"""

    @property
    def is_household(self) -> bool:
        """Whether the shape counts as a household object; balls do not, because none can tip over an edge."""
        return self.category in HOUSEHOLD and self.name not in BALLS

    @property
    def vertices(self) -> Array:
        """Vertices (n, 3) of the clean mesh [mm]."""
        return np.asarray(self.solid.to_mesh().vert_properties[:, :3], float)

    @property
    def faces(self) -> NDArray[np.int64]:
        """Triangles (m, 3) of the clean mesh, normals outward."""
        return np.asarray(self.solid.to_mesh().tri_verts, np.int64)

    @property
    def size_mm(self) -> Array:
        """Edges (3,) of the bounding box [mm]."""
        box = self.solid.bounding_box()
        return np.array(box[3:]) - box[:3]

    def mass_properties(self) -> tuple[float, Array, Array]:
        """True mass [kg], centre of mass (3,) [m] and inertia about it (3, 3) [kg m2], in O."""
        first, second = np.zeros(3), np.zeros((3, 3))
        for part in self.parts:
            centroid, mean = part.moments()
            first += part.share * centroid
            second += part.share * mean
        central = (second - np.outer(first, first)) * self.mass_kg * 1e-6
        return self.mass_kg, 1e-3 * first, np.trace(central) * np.eye(3) - central

    @property
    def tag_mm(self) -> float:
        """Edge of the tags' black squares that a user would print for an object of this size [mm]."""
        middle = float(np.sort(self.size_mm)[1])
        return max(size for size in (12.0, 16.0, 20.0, 25.0, 30.0, 40.0) if size <= max(0.6 * middle, 12.0))

    def tag_places(self) -> list[Array]:
        """Poses (4, 4) of tags [m, in O]: one per side where a ray towards the body's middle meets it.

        Upright sides come first; a tag lies tangentially there, its y axis as far up as it can be. On a round
        body that is a flat card that touches along a line.
        """
        corners = triangles(self.solid)
        middle = (corners.reshape(-1, 3).min(axis=0) + corners.reshape(-1, 3).max(axis=0)) / 2
        places = []
        for side in ((1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1)):
            met = _first_hit(corners, middle, np.array(side, float))
            if met is not None:
                places.append(_tag_pose(*met))
        return places


def _first_hit(corners: Array, middle: Array, side: Array) -> tuple[Array, Array] | None:
    """Outermost point (3,) of a surface on the ray from `middle` along `side`, and the normal (3,) there.

    None if the ray misses the surface.
    """
    across = [axis for axis in range(3) if not side[axis]]
    a, b, c = (corners[:, i][:, across] - middle[across] - 1e-5 for i in range(3))
    areas = [p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0] for p, q in ((b, c), (c, a), (a, b))]
    total = areas[0] + areas[1] + areas[2]
    with np.errstate(divide="ignore", invalid="ignore"):
        shares = np.stack(areas, axis=1) / total[:, None]
    inside = np.flatnonzero((shares >= 0).all(axis=1) & (np.abs(total) > 1e-9))
    if not len(inside):
        return None
    points = np.einsum("ti,tij->tj", shares[inside], corners[inside])
    best = int(np.argmax(points @ side))
    triangle = corners[inside[best]]
    normal = np.cross(triangle[1] - triangle[0], triangle[2] - triangle[0])
    return points[best], normal / np.linalg.norm(normal)


def _tag_pose(point: Array, normal: Array) -> Array:
    up = np.array([0, 0, 1.0]) if abs(normal[2]) < 0.9 else np.array([0, 1.0, 0])
    right = np.cross(up, normal)
    right /= np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3, 0], pose[:3, 1], pose[:3, 2] = right, np.cross(normal, right), normal
    pose[:3, 3] = 1e-3 * point
    return pose


Build = Callable[[np.random.Generator], "Built | Manifold"]


@dataclass(frozen=True)
class Recipe:
    """Registered generator with the category and nominal mass of its object."""

    build: Build
    category: Category
    mass_kg: float


RECIPES: dict[str, Recipe] = {}


def world_shape(category: Category, mass_g: float) -> Callable[[Build], Build]:
    """Register a generator under its function's name.

    Args:
        category: category of the object.
        mass_g: nominal mass of the real object [g].
    """

    def register(build: Build) -> Build:
        assert build.__name__ not in RECIPES, build.__name__
        RECIPES[build.__name__] = Recipe(build, category, mass_g / 1000)
        return build

    return register


def filled(solid: Manifold, shell: float, level: float = 1.0, contents: Manifold | None = None) -> Built:
    """Object with a thin wall and contents.

    Args:
        solid: outer solid [mm].
        shell: fraction of the mass that is the wall's.
        level: height of the contents as a fraction of the solid's.
        contents: solid that the contents fill up to the level; None for the whole solid.
    """
    low, high = solid.bounding_box()[2], solid.bounding_box()[5]
    inside = solid if contents is None else contents
    if level < 1:
        inside = inside.trim_by_plane((0, 0, -1), -(low + level * (high - low)))
    return Built(
        solid, (MassPart("wall", shell, solid, on_surface=True), MassPart("contents", 1 - shell, inside))
    )


def made_of(*parts: tuple[str, float, Manifold]) -> Built:
    """Object of several uniform parts, given as (name, share of the mass, solid [mm]); the solids are united.

    The shares are scaled to a sum of 1.
    """
    solid = parts[0][2]
    for _, _, part in parts[1:]:
        solid = solid + part
    total = sum(share for _, share, _ in parts)
    return Built(solid, tuple(MassPart(name, share / total, part) for name, share, part in parts))


def with_insert(solid: Manifold, share: float, insert: Manifold, shell: float = 0.0) -> Built:
    """Uniform solid with a dense insert inside (a battery, a motor) that holds `share` of the mass.

    Args:
        solid: outer solid [mm].
        share: fraction of the mass that is the insert's.
        insert: solid of the insert; what reaches out of the outer solid is cut off.
        shell: fraction of the mass that lies on the surface, as a case's wall.
    """
    parts = [MassPart("insert", share, insert ^ solid), MassPart("body", 1 - share - shell, solid)]
    if shell:
        parts.append(MassPart("case", shell, solid, on_surface=True))
    return Built(solid, tuple(parts))
