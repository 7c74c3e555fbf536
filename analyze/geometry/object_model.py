"""Exterior of an object in its frame, from a shape file or a primitive, with its plausibility checked.

The object frame O is that of the shape file; lengths are in metres.
"""

# scipy is only partly typed.
# pyright: reportMissingTypeStubs=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false, reportUnknownMemberType=false

from __future__ import annotations

from collections.abc import Callable, Hashable
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import PurePath
from typing import Any, TypeVar

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from analyze.errors import ShapeError
from analyze.geometry import cloud_files, distance, mesh_files, polyhedron, scanned_surface
from analyze.geometry.cloud_surface import CloudSurface, cloud_surface, line_sd
from analyze.geometry.held_object import HeldObject, held_object, separate_bodies
from analyze.geometry.mesh_repair import closed_mesh
from analyze.geometry.plane_search import COARSE_PATCH_FRACTION
from analyze.geometry.plausible_size import refuse_implausible, refuse_size
from analyze.geometry.primitives import box_mesh, cylinder_mesh
from analyze.geometry.scanned_hull import scan_note, scanned_hull
from analyze.geometry.scanned_surface import ScannedSurface
from analyze.geometry.surface_error import surface_sd
from analyze.types import Array, IntArray
from schemas.object_spec import Box, Cylinder, LengthUnit, ObjectSpec

MODEL_ERROR = 0.004
"""Relative 1 sigma of each moment of inertia of a body modelled by cells: voxels, non-uniform shells."""
LEVER_ERROR = 1e-4
"""1 sigma of the centre of mass of a body modelled by cells [m]: voxels, non-uniform shells."""
LINE_SD = 5e-5
"""1 sigma of an edge's place across itself in a shape that is taken as exact [m]."""
REPORTED_BARE_SHARE = 0.01
"""Fraction of a cloud's surface without points above which it is reported."""
REPORTED_HOLLOW_SHARE = 0.02
"""Fraction of a cloud's points that lie in hollows above which it is reported to the user."""
MIN_BODY_PLANES = 4
"""Smallest number of planes that can bound a body."""
REPORTED_SCATTER = 3e-4
"""Scatter of a cloud above which its possible bias is reported [m]."""
CONVEX_TOLERANCE = 1e-3
"""Relative difference of the hull's volume up to which a mesh counts as convex."""


_Result = TypeVar("_Result")


@dataclass(frozen=True)
class ObjectModel:
    """Closed exterior of an object as a triangle mesh, with its mass properties as a uniform solid.

    Lengths are in metres, in the object frame O.
    """

    name: str
    """Name of the object."""
    vertices: Array
    """(n, 3) vertices [m]."""
    faces: IntArray
    """(f, 3) faces, counter-clockwise from outside."""
    hull_vertices: Array
    """(h, 3) vertices of the convex hull [m]."""
    hull_planes: Array
    """(p, 4) outward unit normal n and d [m] with n.x + d = 0, one per triangle of the convex hull."""
    volume: float
    """Volume [m^3]."""
    centroid: Array
    """(3,) centroid of the uniform solid [m]."""
    bounds: Array
    """(2, 3) smallest and largest coordinates [m]."""
    unit_inertia: Array
    """(3, 3) inertia of the uniform solid about its centroid per kilogram [m^2]."""
    primitive: Box | Cylinder | None
    """Primitive that the shape was given as; None for a shape file."""
    warnings: tuple[str, ...]
    """Notes on repairs made and on doubtful properties of the shape."""
    surface_sd: float = 0.0
    """1 sigma of an error common to the whole surface, outwards or inwards [m]."""
    cloud: CloudSurface | None = None
    """Fit of the exterior to a point cloud; None for other shapes."""
    scanned: ScannedSurface | None = None
    """Parts of the surface that a scan left out; None if all of it is known."""
    held: HeldObject | None = None
    """The fixture in which the object is struck, and its place there; None if it stands by itself."""
    alone: ObjectModel | None = None
    """Exterior of the object without the fixture in which it is struck; None if it stands by itself."""

    @property
    def extent(self) -> Array:
        """Edges (3,) of the bounding box along the object frame's axes [m]."""
        return self.bounds[1] - self.bounds[0]

    @property
    def own(self) -> ObjectModel:
        """Exterior of the object without its fixture; this model itself where there is none."""
        return self if self.alone is None else self.alone

    def depth(self, points: Array, outside: float = np.inf) -> Array:
        """Depth (n,) [m] of points below the object's surface, positive inside.

        For a point outside it is minus the distance; outside a convex mesh it is minus the largest height
        over a face's plane, whose size is less than the distance beside edges and corners.

        Args:
            points: (n, 3) or (3,) points [m], in the object frame.
            outside: distance [m] outside the object from which on points may get minus this distance.
        """
        return self.depth_and_gradient(points, outside).value

    def depth_and_gradient(self, points: Array, outside: float = np.inf) -> distance.Depth:
        """Depth (n,) [m] of points below the object's surface, and its gradient (n, 3).

        The depth is positive inside. For a point outside it is minus the distance; outside a convex mesh it
        is minus the largest height over a face's plane, whose size is less than the distance beside edges and
        corners.

        Args:
            points: (n, 3) or (3,) points [m], in the object frame.
            outside: distance [m] outside the object from which on points may get minus this distance, and a
                gradient of 0.
        """
        points = np.atleast_2d(np.asarray(points, dtype=np.float64))
        if isinstance(self.primitive, Box):
            return distance.box_depth(np.array(self.primitive.size_m) / 2, points)
        if isinstance(self.primitive, Cylinder):
            return distance.cylinder_depth(self.primitive.radius_m, self.primitive.height_m / 2, points)
        if self.is_convex:
            return distance.convex_depth(self.hull_planes, points)
        return distance.mesh_depth(self._index, self.vertices, self.faces, points, outside)

    @property
    def noise_sd(self) -> float | None:
        """1 sigma [m] of a point cloud's points across the surface; None for other shapes."""
        return None if self.cloud is None else self.cloud.noise.sd

    def edge_sd(self, ends: Array) -> float:
        """1 sigma [m] of the place of an edge of the object's hull, perpendicular to the edge.

        It combines the edge's own error, `LINE_SD` or that of a point cloud's fit if larger, with the error
        common to the whole surface.

        Args:
            ends: (2, 3) ends of the edge [m], in the object frame.
        """
        own = LINE_SD if self.cloud is None else line_sd(self.cloud, ends)
        return float(np.hypot(max(own, LINE_SD), self.surface_sd))

    def cached(self, key: Hashable, compute: Callable[[ObjectModel], _Result]) -> _Result:
        """Result of `compute` for this model, computed once for each key and then stored.

        A model is immutable, so the result stays valid.

        Args:
            key: Name of the result, with all parameters that it depends on.
            compute: Function of the model.
        """
        if key not in self._cache:
            self._cache[key] = compute(self)
        result: _Result = self._cache[key]
        return result

    @cached_property
    def _cache(self) -> dict[Hashable, Any]:
        return {}

    @cached_property
    def is_convex(self) -> bool:
        """True if the volume of the convex hull exceeds that of the object by less than a thousandth."""
        return bool(ConvexHull(self.hull_vertices).volume < self.volume * (1 + CONVEX_TOLERANCE))

    @cached_property
    def _index(self) -> distance.SurfaceIndex:
        return distance.surface_index(self.vertices, self.faces)


def load_object_model(spec: ObjectSpec, shape_bytes: bytes | None, shape_name: str) -> ObjectModel:
    """Exterior of an object from its shape file or primitive.

    Args:
        spec: Object, for its shape's unit, and its mass for plausibility.
        shape_bytes: Content of the shape file; None for a primitive.
        shape_name: Name of the shape file, for its format and for messages.

    Returns:
        The model in the object frame [m], with notes on repairs and doubtful properties.

    Raises:
        ShapeError: the shape is missing, not readable, of an unknown format, not closed, without volume, or
            of an implausible size or density, or a scan contains the table.
    """
    shape = spec.shape
    if shape.box is not None:
        size = np.array(shape.box.size_m)
        refuse_implausible(f"{spec.name}: box", size, float(np.prod(size)), spec.mass_kg, None)
        vertices, faces = box_mesh(size)
        return _model(spec, vertices, faces, polyhedron.mass_properties(vertices, faces), shape.box)
    if shape.cylinder is not None:
        radius, height = shape.cylinder.radius_m, shape.cylinder.height_m
        size = np.array([2 * radius, 2 * radius, height])
        across = (3 * radius**2 + height**2) / 12
        properties = polyhedron.MassProperties(
            np.pi * radius**2 * height, np.zeros(3), np.diag([across, across, radius**2 / 2])
        )
        refuse_implausible(f"{spec.name}: cylinder", size, properties.volume, spec.mass_kg, None)
        vertices, faces = cylinder_mesh(radius, height)
        return _model(spec, vertices, faces, properties, shape.cylinder)
    if shape_bytes is None or shape.unit is None:
        raise ShapeError(
            f"{shape_name}: the shape file's content is missing: it belongs beside the object file"
        )
    suffix = PurePath(shape_name).suffix.lower().removeprefix(".")
    known = dict.fromkeys((*mesh_files.FORMATS, *cloud_files.FORMATS))
    if suffix not in known:
        raise ShapeError(
            f"{shape_name}: this format is not read: convert it to one of {', '.join(known).upper()}"
        )
    if not mesh_files.is_mesh(shape_bytes, suffix):
        return _from_cloud(spec, shape_bytes, shape_name, suffix, shape.unit)
    vertices, faces = mesh_files.read_mesh(shape_bytes, shape_name, suffix, shape.unit)
    refuse_size(shape_name, np.ptp(vertices, axis=0) * shape.unit.metres, shape.unit)
    model = _from_mesh(spec, vertices * shape.unit.metres, faces, shape_name)
    if spec.fixture is None:
        return model
    alone, held = _held(spec, shape_bytes, shape_name)
    # That object and fixture are separate bodies is meant; what was repaired in the object is not.
    return replace(model, held=held, alone=alone, warnings=alone.warnings)


def _from_mesh(spec: ObjectSpec, vertices: Array, faces: IntArray, name: str) -> ObjectModel:
    mesh = closed_mesh(vertices, faces, name)
    added = mesh.added
    scanned = scanned_surface.scanned_mesh(mesh.vertices, mesh.faces, added) if added.any() else None
    surface = scanned_hull(mesh.vertices, mesh.faces, added, spec.shape.surface_sd_m)
    notes = mesh.notes if surface is None else (*mesh.notes, scan_note(surface, name))
    return _checked(spec, mesh.vertices, mesh.faces, mesh.properties, name, notes, surface, scanned)


def exterior_model(
    spec: ObjectSpec, vertices: Array, faces: IntArray, alone: ObjectModel, held: HeldObject
) -> ObjectModel:
    """Model of an object in a fixture that is designed, whose closed surface is not read from a file.

    Args:
        spec: Object file, for the name and the error of the surface.
        vertices: (n, 3) vertices [m], in the object frame O.
        faces: (f, 3) faces, counter-clockwise from outside.
        alone: Exterior of the object without the fixture.
        held: The fixture, and the object's place in it.
    """
    properties = polyhedron.mass_properties(vertices, faces)
    return replace(_model(spec, vertices, faces, properties, None), held=held, alone=alone)


def _held(spec: ObjectSpec, shape_bytes: bytes, name: str) -> tuple[ObjectModel, HeldObject]:
    """Exterior of the object without its fixture, and the fixture, from their common shape file."""
    vertices, faces, fixture = separate_bodies(spec, shape_bytes, name)
    mass = spec.mass_kg - sum(body.mass for body in fixture)
    alone = spec.model_copy(update={"mass_kg": mass, "fixture": None, "held": None})
    model = _from_mesh(alone, vertices, faces, name)
    return model, held_object(model.centroid, fixture, spec)


def _from_cloud(spec: ObjectSpec, data: bytes, name: str, suffix: str, unit: LengthUnit) -> ObjectModel:
    points, notes = cloud_files.read_cloud(data, name, suffix)
    points = points * unit.metres
    # Strays lie anywhere: the size is that of the middle 98 %.
    low, high = np.quantile(points, [0.01, 0.99], axis=0)
    refuse_size(name, high - low, unit)
    try:
        surface = cloud_surface(points)
    except (ValueError, ArithmeticError, QhullError) as error:
        reason = str(error).partition("\n")[0]
        raise ShapeError(
            f"{name}: no exterior can be made of it ({reason}): scan the object from all sides"
        ) from None
    if surface.overhang is not None:
        raise ShapeError(f"{name}: {surface.overhang.refusal(surface.noise.sd)}")
    scanned = surface.scanned if surface.scanned.bare.any() else None
    return _checked(
        spec,
        surface.vertices,
        surface.faces,
        polyhedron.mass_properties(surface.vertices, surface.faces),
        name,
        (*notes, *_cloud_notes(surface, spec, name)),
        surface,
        scanned,
    )


def _cloud_notes(surface: CloudSurface, spec: ObjectSpec, name: str) -> list[str]:
    """Notes for the user on the quality of an exterior made from a point cloud.

    The first, on how the exterior was made, is always given, the others only where they apply.

    Args:
        surface: Exterior with the quality of its fit.
        spec: Object, for the declared error of its surface.
        name: Name of the shape file.
    """
    scatter = max([surface.noise.sd, *(plane.scatter for plane in surface.planes)])
    notes = [
        (
            f"{name}: a point cloud; its exterior is the hull of {len(surface.planes)} fitted planes and "
            "smoothed curves"
        )
    ]
    extent = float(np.ptp(surface.vertices, axis=0).max())
    if len(surface.planes) < MIN_BODY_PLANES and scatter > COARSE_PATCH_FRACTION * extent:
        notes.append(
            f"{name}: scatters by {1000 * scatter:.1f} mm, too much to distinguish all faces; edges are "
            "uncertain: scan again"
        )
    if surface.strays:
        notes.append(f"{name}: {surface.strays} stray points are left out")
    if surface.hollow_share > REPORTED_HOLLOW_SHARE:
        share, deep = 100 * surface.hollow_share, 1000 * surface.hollow_depth
        notes.append(
            f"{name}: {share:.0f} % of the points lie up to {deep:.0f} mm below the hull: hollows count as "
            "filled; give a mesh to keep them"
        )
    if surface.scanned.bare_share > REPORTED_BARE_SHARE:
        share = 100 * surface.scanned.bare_share
        notes.append(
            f"{name}: {share:.0f} % of the surface has no points and is closed flat: do not stand the object "
            "on it, no strike is planned there; or scan that side too"
        )
    if scatter > REPORTED_SCATTER and spec.shape.surface_sd_m is None:
        notes.append(
            f"{name}: scatters by {1000 * scatter:.1f} mm; the points do not show whether all of them lie "
            "too far out or in: declare shape.surface_sd_m"
        )
    return notes


def _checked(
    spec: ObjectSpec,
    vertices: Array,
    faces: IntArray,
    properties: polyhedron.MassProperties,
    name: str,
    notes: tuple[str, ...],
    cloud: CloudSurface | None,
    scanned: ScannedSurface | None,
) -> ObjectModel:
    extent, content = np.ptp(vertices, axis=0), f"{properties.volume * 1e6:.3g} cm3"
    if properties.volume <= 1e-6 * float(extent.max()) ** 3:
        raise ShapeError(
            f"{name}: encloses no volume ({content}): flat or folded: export the solid's exterior"
        )
    refuse_implausible(name, extent, properties.volume, spec.mass_kg, spec.shape.unit)
    return _model(spec, vertices, faces, properties, None, notes, cloud, scanned)


def _model(
    spec: ObjectSpec,
    vertices: Array,
    faces: IntArray,
    properties: polyhedron.MassProperties,
    primitive: Box | Cylinder | None,
    warnings: tuple[str, ...] = (),
    cloud: CloudSurface | None = None,
    scanned: ScannedSurface | None = None,
) -> ObjectModel:
    hull = ConvexHull(vertices if cloud is None else cloud.vertices)
    return ObjectModel(
        name=spec.name,
        vertices=vertices,
        faces=faces,
        hull_vertices=np.asarray(hull.points)[hull.vertices],
        hull_planes=hull.equations,
        volume=properties.volume,
        centroid=properties.centroid,
        bounds=np.stack([vertices.min(axis=0), vertices.max(axis=0)]),
        unit_inertia=properties.unit_inertia,
        primitive=primitive,
        warnings=warnings,
        surface_sd=surface_sd(spec.shape, None if cloud is None else cloud.noise.sd),
        cloud=cloud,
        scanned=scanned,
    )
