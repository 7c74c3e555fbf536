"""Virtual objects: the user's description of each (TOML, STL), and its true mass distribution.

The mass distribution is drawn from a seed. Four objects consist, like those of the paper (VISAPP 2013), of a
shell and one or two uniform interior parts; the parcel's shell holds three lumps instead. Lengths are in m,
in O, the object's frame (that of its shape file), unless another unit is given.
"""

from __future__ import annotations

import zlib
from dataclasses import dataclass, replace
from functools import cache
from importlib import resources
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial import ConvexHull

from acquire.errors import AcquireError
from acquire.virtual.bottle_shapes import BOTTLES, convex_parts, read_stl
from acquire.virtual.convex_parts import ConvexParts
from acquire.virtual.hidden import HiddenBody, box_depth, cylinder_depth, hidden_body, mesh_depth, sample_body
from acquire.virtual.packaging import BLANK, Packaging
from acquire.virtual.primitive_meshes import box_mesh, cylinder_mesh
from acquire.virtual.station import ARM_INERTIA_KG_M2, DISTANCE_M, DRAG_COEFFICIENT, TABLE_FRICTION
from schemas.object_spec import ObjectSpec, parse_object_spec

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from acquire.virtual.contents import Contents

OBJECT_NAMES = ("carton", "spray", "juice", "salt", "parcel")


@dataclass(frozen=True)
class _Lump:
    """Ball of mass inside the virtual object "parcel": nominal centre [m], radius [m], share of mass.

    A plane divides the interior; the share is of the interior's mass on the ball's side of it.
    """

    centre_m: tuple[float, float, float]
    """nominal centre in O, the object's frame [m]"""
    radius_m: float
    share: float
    """fraction of the interior's mass on its side of the dividing plane"""


@dataclass(frozen=True)
class _Recipe:
    """Nominal mass distribution of an object: masses [kg] of shell, upper and lower part, dividing plane.

    The plane divides the interior into the two parts. If lumps (balls of mass inside) are given, they hold
    the parts' mass. A seed perturbs all of these. The masses follow Table 2 of the paper (VISAPP 2013), where
    the interior's mass is always in the upper part; carton and parcel have mass in the lower part too.
    """

    masses_kg: tuple[float, float, float]
    """masses of the shell and of the interior's upper and lower part [kg]"""
    normal: tuple[float, float, float]
    """normal of the dividing plane towards the upper part, in O; normalised after perturbation"""
    offset_m: float
    """offset of the dividing plane along its normal [m]"""
    lumps: tuple[_Lump, ...] = ()
    """lumps that hold the interior mass instead of two uniform parts"""


_RECIPES = {
    "carton": _Recipe((0.026, 0.014, 0.004), (0.50, -0.35, 0.79), 0.005),
    "spray": _Recipe((0.035, 0.022, 0.0), (0.30, 0.35, 0.89), 0.055),
    "juice": _Recipe((0.030, 0.026, 0.0), (-0.30, 0.25, 0.92), 0.060),
    "salt": _Recipe((0.032, 0.002, 0.0), (0.10, 0.10, 0.99), 0.010),
    "parcel": _Recipe(
        (0.018, 0.017, 0.020),
        (0.0, 0.0, 1.0),
        0.0,
        (
            _Lump((0.012, -0.010, -0.048), 0.012, 1.0),
            _Lump((-0.016, 0.012, 0.048), 0.010, 0.6),
            _Lump((0.018, 0.010, 0.018), 0.009, 0.4),
        ),
    ),
}
_LUMP_SHIFT_M = 0.003
"""largest shift of a lump by the seed [m], along each axis"""


@dataclass(frozen=True)
class VirtualObject:
    """Object of the virtual rig: object file, surface mesh, convex parts, friction, true mass properties.

    Lengths are in m, in O (the object's frame, that of its shape file); only the shape file itself is in mm.
    """

    spec: ObjectSpec
    """parsed object file"""
    spec_toml: str
    """text of the object file (TOML), as a user would write it"""
    shape_file: tuple[str, bytes] | None
    """name and bytes of the STL (in mm); None for a primitive"""
    mesh_vertices: NDArray[np.float64]
    """(n, 3) vertices of the surface"""
    mesh_faces: NDArray[np.int64]
    """(m, 3) triangles, normals outward"""
    hull_vertices: NDArray[np.float64]
    """(h, 3) corners of the convex hull"""
    convex_parts: tuple[NDArray[np.float64], ...]
    """corners (c, 3) of the convex parts whose union is the shape"""
    edge_radius_m: float
    """radius of the rounding of all edges [m]"""
    friction: float
    """coefficient of friction between object and table"""
    body: HiddenBody
    """true mass properties, hidden from the estimators; of an object with contents that move, those of all,
    with the contents at rest in the object as its file has it"""
    drawn_parts: ConvexParts | None = None
    """parts that the camera's images show; None to draw the surface mesh, split along its concave edges"""
    camera_distance_m: float = DISTANCE_M
    """distance of the camera from the pivot line [m]"""
    arm_inertia_kg_m2: float = ARM_INERTIA_KG_M2
    """moment of inertia of the striker's arm about its hinge [kg m2]"""
    drag_coefficient: float = 1.1
    """coefficient of the air's pressure on the object's faces in a toss"""
    packaging: Packaging = BLANK
    """print on the faces; in the camera's images only"""
    contents: Contents | None = None
    """what moves inside; None for a rigid object"""

    @property
    def rigid_body(self) -> HiddenBody:
        """Mass properties of all that does not move inside the object."""
        return self.body if self.contents is None else self.contents.rigid


def load_object(name: str, seed: int) -> VirtualObject:
    """Virtual object of the given name, with a mass distribution and friction drawn from a seed.

    The seed changes each region's mass by up to 5 % (all are then scaled to the fixed total mass), shifts the
    plane that divides the interior by up to 3 mm and turns it by 2.4 degrees (rms), shifts the parcel's balls
    of mass by up to 3 mm along each axis, and draws the coefficients of friction from TABLE_FRICTION (0.6 to
    0.8) and of the air's drag from DRAG_COEFFICIENT (1.0 to 1.2).

    Args:
        name: one of OBJECT_NAMES.
        seed: seed of the mass distribution and friction.

    Raises:
        AcquireError: there is no object of that name.
    """
    if name not in OBJECT_NAMES:
        raise AcquireError(f"no virtual object '{name}': choose one of {', '.join(OBJECT_NAMES)}")
    spec = _spec(name)
    shape_file = None if spec.shape.file is None else (spec.shape.file, _data(spec.shape.file))
    vertices, faces = _mesh(name)
    parts = tuple(0.001 * part for part in convex_parts(BOTTLES[name])) if name in BOTTLES else (vertices,)
    rng = np.random.default_rng((seed, zlib.crc32(name.encode())))
    body = _fill(name, spec, rng)
    friction = float(rng.uniform(*TABLE_FRICTION))
    drag_coefficient = float(rng.uniform(*DRAG_COEFFICIENT))
    return VirtualObject(
        spec=spec,
        spec_toml=_data(f"{name}.toml").decode(),
        shape_file=shape_file,
        mesh_vertices=vertices,
        mesh_faces=faces,
        hull_vertices=hull_corners(vertices),
        convex_parts=parts,
        edge_radius_m=spec.edge_radius_m or 0.0,
        friction=friction,
        body=body,
        drag_coefficient=drag_coefficient,
    )


def without_tags(virtual_object: VirtualObject) -> VirtualObject:
    """Object without its tags, in object file and images; its mass is unchanged."""
    text = virtual_object.spec_toml.partition("\n[[marker]]")[0].rstrip() + "\n"
    spec = virtual_object.spec.model_copy(update={"marker": []})
    return replace(virtual_object, spec=spec, spec_toml=text)


def hull_corners(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Corners (h, 3) of the convex hull of points (n, 3) [any unit of length].

    Neighbouring triangles of the hull whose normals differ by less than 0.5 degrees count as one face; a
    point on no edge between two faces is no corner.
    """
    hull = ConvexHull(points)
    normals = hull.equations[:, :3]
    bent = np.einsum("fi,fki->fk", normals, normals[hull.neighbors]) < np.cos(np.radians(0.5))
    once = hull.neighbors > np.arange(len(normals))[:, None]
    edges = [np.delete(hull.simplices[facet], opposite) for facet, opposite in np.argwhere(bent & once)]
    return points[np.unique(edges)]


def _data(file: str) -> bytes:
    return (resources.files("acquire.virtual") / "object_data" / file).read_bytes()


def _fill(name: str, spec: ObjectSpec, rng: np.random.Generator) -> HiddenBody:
    """True mass properties of the object called `name`, with a mass distribution perturbed by `rng`.

    `rng` perturbs the masses of shell, upper and lower part, the plane that divides the interior, and the
    centres of the balls of mass, if the object has such. `spec` is the parsed object file, which gives total
    mass and shell thickness.
    """
    recipe = _RECIPES[name]
    masses = np.array(recipe.masses_kg) * (1 + rng.uniform(-0.05, 0.05, 3))
    masses *= spec.mass_kg / masses.sum()
    normal = np.array(recipe.normal) + rng.normal(0, 0.03, 3)
    normal /= np.linalg.norm(normal)
    offset = recipe.offset_m + float(rng.uniform(-0.003, 0.003))
    thickness = spec.shell_thickness_m
    assert thickness is not None  # noqa: S101 - the package's own file
    points, depths = _samples(name)
    lumps = [
        replace(lump, centre_m=tuple(np.array(lump.centre_m) + rng.uniform(-1, 1, 3) * _LUMP_SHIFT_M))
        for lump in recipe.lumps
    ]
    density = _lump_density(points, lumps) if lumps else None
    shell, upper, lower = (float(mass) for mass in masses)
    return hidden_body(points, depths, (shell, upper, lower), (normal, offset), thickness, density)


def _lump_density(points: NDArray[np.float64], lumps: list[_Lump]) -> NDArray[np.float64]:
    """Relative density (n,) at points (n, 3) [m]: zero outside the lumps (balls of mass).

    Each lump's share of the mass is divided equally among the points in its ball.
    """
    density = np.zeros(len(points))
    for lump in lumps:
        inside = np.linalg.norm(points - lump.centre_m, axis=1) < lump.radius_m
        density[inside] += lump.share / np.count_nonzero(inside)
    return density


@cache
def _spec(name: str) -> ObjectSpec:
    return parse_object_spec(_data(f"{name}.toml").decode(), f"{name}.toml")


@cache
def _mesh(name: str) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Surface of the object called `name`: vertices (n, 3) [m, in O] and triangles (m, 3).

    O is the object's frame. Triangles are indices of vertices, with normals outward.
    """
    shape = _spec(name).shape
    if shape.box is not None:
        return box_mesh(np.array(shape.box.size_m) / 2)
    if shape.cylinder is not None:
        return cylinder_mesh(shape.cylinder.radius_m, shape.cylinder.height_m / 2)
    assert shape.file is not None  # noqa: S101 - the document allows exactly one of three
    vertices, faces = read_stl(_data(shape.file))
    return vertices * 0.001, faces


@cache
def _samples(name: str) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Points (n, 3) [m] spread over the body of the object called `name`, and their depths (n,) [m].

    Points are in O, the object's frame; depths are below its surface, for a bottle cut off at twice the
    shell's thickness.
    """
    spec = _spec(name)
    vertices, faces = _mesh(name)
    if spec.shape.box is not None:
        depth = box_depth(np.array(spec.shape.box.size_m) / 2)
    elif spec.shape.cylinder is not None:
        depth = cylinder_depth(spec.shape.cylinder.radius_m, spec.shape.cylinder.height_m / 2)
    else:
        parts = [0.001 * part for part in convex_parts(BOTTLES[name])]
        reach = 2 * (spec.shell_thickness_m or 0.0)
        depth = mesh_depth(vertices[faces], lambda points: _in_convex_parts(points, parts), reach=reach)
    return sample_body(vertices.min(axis=0), vertices.max(axis=0), depth)


def _in_convex_parts(points: NDArray[np.float64], parts: list[NDArray[np.float64]]) -> NDArray[np.bool_]:
    """True (n,) where points (n, 3) [m] lie in one of the convex parts, each given by its corners (k, 3)."""
    found = np.zeros(len(points), dtype=bool)
    for part in parts:
        planes = ConvexHull(part).equations
        # A part is a horizontal slice of the body: only points at its height are tested.
        z, low, high = points[:, 2], part[:, 2].min() - 1e-9, part[:, 2].max() + 1e-9
        near = np.flatnonzero((z >= low) & (z <= high) & ~found)
        found[near] = np.all(points[near] @ planes[:, :3].T + planes[:, 3] <= 0, axis=1)
    return found
