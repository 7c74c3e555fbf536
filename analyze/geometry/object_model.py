"""The object's exterior in O, from a shape file or a primitive, checked and in metres. The only user of trimesh."""

# scipy and trimesh are only partly typed; their unknowns are no mistakes of ours.
# pyright: reportMissingTypeStubs=false, reportUnknownVariableType=false, reportUnknownArgumentType=false, reportUnknownMemberType=false

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from io import BytesIO
from pathlib import PurePath

import numpy as np
import trimesh
from scipy.spatial import ConvexHull, QhullError

from analyze.errors import ShapeError
from analyze.geometry import distance, polyhedron
from analyze.types import Array, IntArray
from schemas.documents import Box, Cylinder, LengthUnit, ObjectSpec

CYLINDER_SIDES = 128
SMALLEST_EXTENT = 0.005
"""m, of the longest edge"""
LARGEST_EXTENT = 1.5
DENSITIES = (2.0, 12_000.0)
"""kg/m^3, between which unit and mass are believed; lead has 11 300"""
FORMATS = ("stl", "obj", "ply")
CONVEX_TOLERANCE = 1e-3
"""relative difference of the hull's volume up to which a mesh counts as convex"""


@dataclass(frozen=True)
class ObjectModel:
    """Closed exterior of an object, in O, in metres."""

    name: str
    vertices: Array
    """(n, 3)"""
    faces: IntArray
    """(f, 3), counter-clockwise from outside"""
    hull_vertices: Array
    """(h, 3)"""
    hull_planes: Array
    """(p, 4) outward unit normal n and d with n.x + d = 0, one per triangle of the convex hull"""
    volume: float
    """m^3"""
    centroid: Array
    """(3,) of the uniform solid"""
    bounds: Array
    """(2, 3) least and greatest coordinates"""
    unit_inertia: Array
    """(3, 3) m^2 about the centroid, of the uniform solid, per kilogram"""
    primitive: Box | Cylinder | None
    warnings: tuple[str, ...]
    """what was repaired, and what looks odd"""

    @property
    def extent(self) -> Array:
        """Edges (3,) of the bounding box [m]."""
        return self.bounds[1] - self.bounds[0]

    def contains(self, points: Array) -> polyhedron.BoolArray:
        """Which of `points` (n, 3) lie inside, as bool (n,)."""
        if self.primitive is None and not self._convex:
            return polyhedron.inside(self.vertices, self.faces, np.atleast_2d(points))
        return np.asarray(self.depth(points) > 0)

    def depth(self, points: Array) -> Array:
        """Depth (n,) of `points` (n, 3) below the surface [m], + inside."""
        return self.depth_and_gradient(points).value

    def signed_distance(self, points: Array) -> Array:
        """Distance (n,) of `points` (n, 3) from the surface [m], + outside; for convex meshes outside: from the farthest face's plane."""
        return -self.depth(points)

    def depth_and_gradient(self, points: Array) -> distance.Depth:
        """Depth (n,) of `points` (n, 3), + inside, and the unit vectors straight inwards (n, 3)."""
        points = np.atleast_2d(np.asarray(points, dtype=np.float64))
        if isinstance(self.primitive, Box):
            return distance.box_depth(np.array(self.primitive.size_m) / 2, points)
        if isinstance(self.primitive, Cylinder):
            return distance.cylinder_depth(self.primitive.radius_m, self.primitive.height_m / 2, points)
        if self._convex:
            return distance.convex_depth(self.hull_planes, points)
        return distance.mesh_depth(self._index, self.vertices, self.faces, points)

    def uniform_inertia(self, mass: float) -> Array:
        """Inertia tensor (3, 3) about the centroid [kg m^2], if `mass` [kg] filled the volume evenly."""
        return mass * self.unit_inertia

    def first_hit(self, origin: Array, direction: Array) -> tuple[float, Array] | None:
        """Distance [m] along the unit `direction` (3,) to the surface, and its outward normal (3,) there; None: the ray misses."""
        hit = polyhedron.first_hit(self.vertices, self.faces, origin, direction)
        if hit is None:
            return None
        a, b, c = self.vertices[self.faces[hit[1]]]
        normal = np.cross(b - a, c - a)
        return hit[0], normal / np.linalg.norm(normal)

    @cached_property
    def _convex(self) -> bool:
        return bool(ConvexHull(self.hull_vertices).volume < self.volume * (1 + CONVEX_TOLERANCE))

    @cached_property
    def _index(self) -> distance.SurfaceIndex:
        return distance.surface_index(self.vertices, self.faces)


def load_object_model(spec: ObjectSpec, shape_bytes: bytes | None, shape_name: str) -> ObjectModel:
    """Exterior of `spec`.

    Args:
        spec: the object; its shape's unit and the mass (for plausibility) are used.
        shape_bytes: the shape file's content (STL, OBJ, PLY), None for a primitive.
        shape_name: the file's name, for its format and for messages.

    Raises:
        ShapeError: not readable, not closed, without volume, or of a size or density that no such object has.
    """
    shape = spec.shape
    if shape.box is not None:
        size = np.array(shape.box.size_m)
        _believable(f"{spec.name}: box", size, float(np.prod(size)), spec.mass_kg, None)
        vertices, faces = _box_mesh(size)
        return _model(spec, vertices, faces, shape.box, ())
    if shape.cylinder is not None:
        radius, height = shape.cylinder.radius_m, shape.cylinder.height_m
        size = np.array([2 * radius, 2 * radius, height])
        _believable(f"{spec.name}: cylinder", size, np.pi * radius**2 * height, spec.mass_kg, None)
        vertices, faces = _cylinder_mesh(radius, height)
        return _model(spec, vertices, faces, shape.cylinder, ())
    if shape_bytes is None or shape.unit is None:
        raise ShapeError(f"{shape_name}: the shape file's content is missing: it belongs beside the object file")
    vertices, faces = _read_mesh(shape_bytes, shape_name)
    vertices = vertices * shape.unit.metres
    faces, warnings = _closed_and_outward(vertices, faces, shape_name)
    properties = polyhedron.mass_properties(vertices, faces)
    extent = np.ptp(vertices, axis=0)
    if properties.volume <= 1e-6 * float(extent.max()) ** 3:
        raise ShapeError(
            f"{shape_name}: holds no volume ({properties.volume * 1e6:.3g} cm3): it is flat or folded; export the solid's exterior"
        )
    _believable(shape_name, extent, properties.volume, spec.mass_kg, shape.unit)
    return _model(spec, vertices, faces, None, warnings)


def _model(spec: ObjectSpec, vertices: Array, faces: IntArray, primitive: Box | Cylinder | None, warnings: tuple[str, ...]) -> ObjectModel:
    hull = ConvexHull(vertices)
    if isinstance(primitive, Cylinder):
        r, h = primitive.radius_m, primitive.height_m
        across = (3 * r**2 + h**2) / 12
        properties = polyhedron.MassProperties(np.pi * r**2 * h, np.zeros(3), np.diag([across, across, r**2 / 2]))
    else:
        properties = polyhedron.mass_properties(vertices, faces)
    return ObjectModel(
        name=spec.name,
        vertices=vertices,
        faces=faces,
        hull_vertices=vertices[hull.vertices],
        hull_planes=hull.equations,
        volume=properties.volume,
        centroid=properties.centroid,
        bounds=np.stack([vertices.min(axis=0), vertices.max(axis=0)]),
        unit_inertia=properties.unit_inertia,
        primitive=primitive,
        warnings=warnings,
    )


def _read_mesh(data: bytes, name: str) -> tuple[Array, IntArray]:
    suffix = PurePath(name).suffix.lower().removeprefix(".")
    if suffix not in FORMATS:
        raise ShapeError(f"{name}: shape files are {', '.join(FORMATS).upper()}: convert it")
    try:
        mesh = trimesh.load_mesh(BytesIO(data), file_type=suffix, process=False)
        raw_vertices = np.asarray(mesh.vertices, dtype=np.float64)
        raw_faces = np.asarray(mesh.faces, dtype=np.int64)
    except Exception:  # trimesh's readers raise whatever the damaged byte leads to
        raise ShapeError(f"{name}: cannot be read as {suffix.upper()}: it is damaged or of another format: export it anew") from None
    if raw_faces.ndim != 2 or len(raw_faces) < 4 or raw_faces.max() >= len(raw_vertices):
        raise ShapeError(f"{name}: holds no faces of a closed body: export the solid's exterior as {suffix.upper()} again")
    if not np.isfinite(raw_vertices).all():
        raise ShapeError(f"{name}: holds coordinates that are no numbers: export it anew")
    # STL repeats every vertex per face, OBJ per texture seam: equal to 1e-7 of the size is the same vertex.
    step = float(np.ptp(raw_vertices, axis=0).max()) * 1e-7
    if step == 0:
        raise ShapeError(f"{name}: all vertices coincide: export it anew")
    _, first, inverse = np.unique(np.round(raw_vertices / step), axis=0, return_index=True, return_inverse=True)
    faces = inverse.ravel()[raw_faces].astype(np.int64)
    whole = (faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])
    return raw_vertices[first], faces[whole]


def _closed_and_outward(vertices: Array, faces: IntArray, name: str) -> tuple[IntArray, tuple[str, ...]]:
    holes = polyhedron.open_edges(faces)
    if holes:
        raise ShapeError(f"{name}: not a closed body ({holes} open edges): close the holes, or give a primitive (box, cylinder) instead")
    faces, body, turned = polyhedron.wound_alike(faces)
    faces, inside_out = polyhedron.outward(vertices, faces, body)
    warnings: list[str] = []
    if turned:
        warnings.append(f"{name}: {turned} faces were wound against their neighbours and have been turned")
    if inside_out:
        warnings.append(f"{name}: the normals pointed inwards and have been turned outwards")
    kept = _exterior_bodies(vertices, faces, body)
    if len(kept) < int(body.max()) + 1:
        warnings.append(f"{name}: inner surfaces are ignored: only the exterior counts")
        faces = faces[np.isin(body, kept)]
    if len(kept) > 1:
        warnings.append(f"{name}: {len(kept)} separate bodies; where they overlap, volume counts twice")
    try:
        ConvexHull(vertices)
    except QhullError:
        raise ShapeError(f"{name}: all vertices lie in one plane: export the solid's exterior") from None
    return faces, tuple(warnings)


def _exterior_bodies(vertices: Array, faces: IntArray, body: IntArray) -> list[int]:
    """Bodies that do not lie inside another one."""
    count = int(body.max()) + 1
    if count == 1:
        return [0]
    probes = np.array([vertices[faces[body == index][0]].mean(axis=0) for index in range(count)])
    buried = np.zeros(count, dtype=bool)
    for index in range(count):
        within = polyhedron.inside(vertices, faces[body == index], probes)
        within[index] = False
        buried |= within
    return [index for index in range(count) if not buried[index]]


def _believable(name: str, extent: Array, volume: float, mass: float, unit: LengthUnit | None) -> None:
    longest = float(extent.max())
    size = " x ".join(f"{edge * 1000:.4g}" for edge in extent)
    given = f' with unit = "{unit.value}"' if unit is not None else ""
    if not SMALLEST_EXTENT <= longest <= LARGEST_EXTENT:
        raise ShapeError(f"{name}: {size} mm{given} is no object to strike: {_other_unit(longest, unit)}")
    density = mass / volume
    if not DENSITIES[0] <= density <= DENSITIES[1]:
        remedy = f"{_other_unit(longest, unit)}, or correct mass_kg (in kilograms)"
        raise ShapeError(f"{name}: {size} mm{given} at {mass:g} kg means {density:.3g} kg/m3: {remedy}")


def _other_unit(longest: float, unit: LengthUnit | None) -> str:
    if unit is None:
        return "give box and cylinder in metres"
    plain = longest / unit.metres
    fits = [other for other in LengthUnit if other is not unit and 0.03 <= plain * other.metres <= 0.6]
    if not fits:
        return "correct shape.unit"
    return f'did you mean unit = "{fits[0].value}"?'


def _box_mesh(size: Array) -> tuple[Array, IntArray]:
    corners = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)]) * size
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return corners, np.array([face for a, b, c, d in quads for face in ((a, b, c), (a, c, d))], dtype=np.int64)


def _cylinder_mesh(radius: float, height: float) -> tuple[Array, IntArray]:
    n = CYLINDER_SIDES
    angle = np.arange(n) * 2 * np.pi / n
    ring = np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)
    vertices = np.vstack(
        [
            np.column_stack([ring, np.full(n, -height / 2)]),
            np.column_stack([ring, np.full(n, height / 2)]),
            [[0.0, 0.0, -height / 2], [0.0, 0.0, height / 2]],
        ],
    )
    i = np.arange(n)
    j = (i + 1) % n
    side = np.vstack([np.column_stack([i, j, j + n]), np.column_stack([i, j + n, i + n])])
    caps = np.vstack([np.column_stack([np.full(n, 2 * n), j, i]), np.column_stack([np.full(n, 2 * n + 1), i + n, j + n])])
    return vertices, np.vstack([side, caps]).astype(np.int64)
