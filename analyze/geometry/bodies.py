"""Closed bodies of a mesh file with volume, centroid and inertia, for labelled parts."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import PurePath

import numpy as np

from analyze.errors import ShapeError
from analyze.geometry import mesh_files, polyhedron
from analyze.geometry.polyhedron import MassProperties
from analyze.types import Array, IntArray
from schemas.object_spec import ObjectSpec

MIN_FACES = 4
"""Smallest number of faces of a body; fewer belong to a seam that the exporter did not merge, and thus to the
body they touch."""


@dataclass(frozen=True)
class Body:
    """One closed body of a mesh file, in the object frame O."""

    properties: MassProperties
    """Mass properties as a uniform solid, in O."""
    vertices: Array
    """(n, 3) vertices of the whole mesh [m], in O."""
    faces: IntArray
    """(f, 3) faces of this body, counter-clockwise from outside."""
    open_edges: int
    """Number of open edges; 0 if the body is closed."""


def bodies_of(spec: ObjectSpec, shape_bytes: bytes | None, shape_name: str) -> list[Body]:
    """Closed bodies of an object's mesh file, largest first, with cavities subtracted from hollow ones.

    A cavity is a body of the opposite winding inside a larger one.

    Args:
        spec: Object, for its shape's unit.
        shape_bytes: Content of the shape file; None for a primitive, which is refused.
        shape_name: Name of the shape file, for its format and for messages.

    Returns:
        At least one body, in the object frame.

    Raises:
        ShapeError: the shape is no mesh file, or cannot be read.
    """
    suffix = PurePath(shape_name).suffix.lower().removeprefix(".")
    is_mesh = (
        suffix in mesh_files.FORMATS
        and shape_bytes is not None
        and (suffix != "ply" or mesh_files.ply_has_faces(shape_bytes))
    )
    if shape_bytes is None or spec.shape.unit is None or not is_mesh:
        raise ShapeError(
            f"{shape_name}: only a mesh file has bodies that can be parts: give an assembly as a mesh, or "
            "label wall and layers"
        )
    # Bodies that touch each other have nearly equal corners, which must not be merged.
    raw = mesh_files.read_mesh(shape_bytes, shape_name, suffix, spec.shape.unit, same=0.0)
    vertices = raw.vertices * spec.shape.unit.metres
    faces, body, _ = polyhedron.consistently_wound(raw.faces)
    labels = _with_seams(faces, body)
    found = [faces[labels == label] for label in range(int(labels.max()) + 1)]
    solid = [(each, polyhedron.mass_properties(vertices, each)) for each in found]
    # The winding of most of the volume is taken as outwards; a body of the other winding inside another is
    # its cavity.
    sign = 1.0 if sum(properties.volume for _, properties in solid) > 0 else -1.0
    outer = [(each, properties) for each, properties in solid if sign * properties.volume > 0]
    holes = [(each, properties) for each, properties in solid if sign * properties.volume <= 0]
    merged = [each for each, _ in outer]
    for faces_of, properties in holes:
        owner = next(
            (
                i
                for i, (each, other) in enumerate(outer)
                if abs(other.volume) > abs(properties.volume)
                and polyhedron.inside(vertices, _outwards(each, sign), _face_centre(vertices, faces_of))[0]
            ),
            None,
        )
        if owner is None:
            merged.append(faces_of[:, ::-1])
        else:
            merged[owner] = np.concatenate([merged[owner], faces_of])
    bodies: list[Body] = []
    for each in merged:
        outwards = _outwards(each, sign)
        bodies.append(
            Body(
                polyhedron.mass_properties(vertices, outwards),
                vertices,
                outwards,
                polyhedron.open_edges(outwards),
            )
        )
    return sorted(bodies, key=lambda one: -one.properties.volume)


def _outwards(faces: IntArray, sign: float) -> IntArray:
    return faces if sign > 0 else faces[:, ::-1]


def _face_centre(vertices: Array, faces: IntArray) -> Array:
    """Centroid (1, 3) [m] of the first of `faces` (f, 3), given the mesh's `vertices` (n, 3) [m]."""
    return vertices[faces[0]].mean(axis=0, keepdims=True)


def _with_seams(faces: IntArray, body: IntArray) -> IntArray:
    """Body (f,) of each face, numbered from 0, with loose faces added to the body that they touch most.

    Loose faces belong to a part of fewer than `MIN_FACES`; they go to the larger part that shares most of
    their corners. If all parts are that small, they count as one body.

    Args:
        faces: (f, 3) indices of the corners of each face.
        body: (f,) connected part of the mesh to which each face belongs.
    """
    sizes = np.bincount(body)
    large = np.flatnonzero(sizes >= MIN_FACES)
    if not len(large):
        return np.zeros(len(faces), dtype=np.int64)
    corners = [np.unique(faces[body == label]) for label in large]
    result = body.copy()
    for label in np.flatnonzero((sizes > 0) & (sizes < MIN_FACES)):
        own = np.unique(faces[body == label])
        shared = [
            (int(np.isin(own, each).sum()), int(sizes[other]))
            for each, other in zip(corners, large, strict=True)
        ]
        result[body == label] = large[shared.index(max(shared))]
    return np.unique(result, return_inverse=True)[1].astype(np.int64)
