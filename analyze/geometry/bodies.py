"""Bodies (connected parts) of a mesh file with volume, centroid and inertia, for labelled parts."""

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
    """One connected part of a mesh file, in the object frame O [m]: mass properties, vertices and faces.

    The mass properties are those of a uniform solid. The vertices (n, 3) are those of
    the whole mesh; the faces (f, 3) are the part's own. The part is closed if its number of open edges is 0.
    """

    properties: MassProperties
    """Mass properties as a uniform solid, in O."""
    vertices: Array
    """(n, 3) vertices of the whole mesh [m], in O."""
    faces: IntArray
    """(f, 3) faces of this body and its cavities, counter-clockwise from outside the material."""
    open_edges: int
    """Number of open edges; 0 if the body is closed."""


def bodies_of(spec: ObjectSpec, shape_bytes: bytes | None, shape_name: str) -> list[Body]:
    """Bodies of an object's mesh file, largest first, with cavities subtracted from hollow ones.

    A body is a connected part of the mesh; whether it is closed is not checked, but reported as
    `Body.open_edges`. A cavity is a body of the opposite winding inside a larger one.

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
    if shape_bytes is None or spec.shape.unit is None or not mesh_files.is_mesh(shape_bytes, suffix):
        raise ShapeError(
            f"{shape_name}: only a mesh file has bodies that can be parts: give an assembly as a mesh, or "
            "label wall and layers"
        )
    # Bodies that touch each other have nearly equal corners, which must not be merged.
    vertices, faces = mesh_files.read_mesh(shape_bytes, shape_name, suffix, spec.shape.unit, same=0.0)
    vertices = vertices * spec.shape.unit.metres
    faces, body, _ = polyhedron.consistently_wound(faces)
    labels = _with_seams(faces, body)
    volumes = polyhedron.body_volumes(vertices, faces, labels)
    # The winding of most of the volume is taken as outwards; a body of the other winding inside another is
    # its cavity.
    if volumes.sum() <= 0:
        faces, volumes = faces[:, ::-1], -volumes
    found = [faces[labels == label] for label in range(len(volumes))]
    outer = np.flatnonzero(volumes > 0)
    merged = {int(label): found[label] for label in outer}
    for hole in np.flatnonzero(volumes <= 0):
        corner = vertices[found[hole][0]].mean(axis=0, keepdims=True)
        owner = next(
            (
                int(label)
                for label in outer
                if volumes[label] > -volumes[hole] and polyhedron.inside(vertices, found[label], corner)[0]
            ),
            None,
        )
        if owner is None:
            merged[int(hole)] = found[hole][:, ::-1]
        else:
            merged[owner] = np.concatenate([merged[owner], found[hole]])
    bodies = [
        Body(polyhedron.mass_properties(vertices, each), vertices, each, polyhedron.open_edges(each))
        for each in merged.values()
    ]
    return sorted(bodies, key=lambda one: -one.properties.volume)


def _with_seams(faces: IntArray, body: IntArray) -> IntArray:
    """Number (f,) of the body of each face, from 0, with loose faces joined to larger parts.

    Loose faces belong to a connected part of fewer than `MIN_FACES`; they go to the larger part that shares
    most of their corners. If all parts are that small, they count as one body.

    Args:
        faces: (f, 3) indices of the corners of each face.
        body: (f,) number of the connected part of the mesh to which each face belongs.
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
