"""Bodies of a mesh file, with mass properties, for labelled parts; bodies that touch are separate."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import PurePath
from typing import NamedTuple

import numpy as np

from analyze.errors import ShapeError
from analyze.geometry import mesh_files, polyhedron
from analyze.geometry.mesh_holes import fill_holes
from analyze.geometry.mesh_repair import low_discrepancy
from analyze.geometry.mesh_shells import shells_of, unmatched_edges
from analyze.geometry.polyhedron import MassProperties
from analyze.types import Array, IntArray
from schemas.object_spec import ObjectSpec

_PROBED_FACES = 25
"""Number of a shell's largest faces from which it is judged whether the shell lies within another one."""
_PROBE_DEPTH = 1e-6
"""Distance of the probed points below their faces, over the extent of the mesh."""
_OVERLAP_PROBES = 4000
"""Number of points at which the common volume of two bodies is sampled."""
_MIN_OVERLAP = 1e-3
"""Common volume of two bodies, over the smaller one's, up to which it is neglected."""
_SAME_VOLUME = 1e-6
"""Relative difference of the volumes of two shells below which neither counts as the larger one."""


@dataclass(frozen=True)
class Body:
    """One body of a mesh file, in the object frame O [m]: mass properties, vertices and faces.

    The mass properties are those of a uniform solid without its cavities and without the bodies that lie
    wholly in its material. The vertices (n, 3) are those of the whole mesh; the faces (f, 3) are the body's
    own.
    """

    properties: MassProperties
    """Mass properties as a uniform solid, in O."""
    vertices: Array
    """(n, 3) vertices of the whole mesh [m], in O."""
    faces: IntArray
    """(f, 3) faces of this body and its cavities, counter-clockwise from outside the material."""
    open_edges: int
    """Number of edges at which the surface is open or wound ambiguously; 0 if the body is closed."""
    filled_edges: int = 0
    """Number of edges around holes that were closed."""


class Overlap(NamedTuple):
    """Volume that two bodies of a mesh file share, which counts in both; with the bodies' numbers."""

    first: int
    """Number of the one body, from 1."""
    second: int
    """Number of the other body, from 1."""
    volume: float
    """Common volume [m^3]."""


def bodies_of(spec: ObjectSpec, shape_bytes: bytes | None, shape_name: str) -> list[Body]:
    """Bodies of an object's mesh file, largest first.

    Bodies that touch are separate, by the file's own vertex numbers or else by the wedges of material at
    their common edges (`mesh_shells`). A cavity is a shell of the opposite winding inside a body. A body that
    lies wholly in the material of another one displaces it: that volume is subtracted from the outer body.
    Where bodies overlap in part, the common volume counts in both (`overlaps_of`). Small or flat holes are
    closed; a body with others stays open, which `Body.open_edges` reports.

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
    vertices, faces, piece = mesh_files.read_numbered_mesh(shape_bytes, shape_name, suffix, spec.shape.unit)
    vertices = vertices * spec.shape.unit.metres
    shells = shells_of(vertices, faces, piece)
    surfaces, filled = list(shells.closed), [0] * len(shells.closed)
    for each in shells.open:
        vertices, surface, edges = _without_holes(vertices, each, shape_name)
        surfaces.append(surface)
        filled.append(edges)
    bodies = [
        Body(polyhedron.mass_properties(vertices, each), vertices, each, unmatched_edges(each), filled[i])
        for i, each in _solids(vertices, surfaces).items()
    ]
    return sorted(bodies, key=lambda one: -one.properties.volume)


def _without_holes(vertices: Array, faces: IntArray, name: str) -> tuple[Array, IntArray, int]:
    """Close the holes of an open surface of a mesh.

    Args:
        vertices: (n, 3) vertices of the whole mesh [m].
        faces: (f, 3) faces of the open surface.
        name: Name of the file, for messages.

    Returns:
        Vertices (k, 3) [m] with those added at the end, faces (g, 3) of the surface, and number of open edges
        that were closed. If holes are too large, too many or not simple: `vertices` and `faces` as given, and
        0.
    """
    used, local = np.unique(faces, return_inverse=True)
    try:
        filled = fill_holes(vertices[used], local.reshape(-1, 3).astype(np.int64), name)
    except ShapeError:
        return vertices, faces, 0
    if filled.doubt:
        return vertices, faces, 0
    index = np.concatenate([used, len(vertices) + np.arange(len(filled.vertices) - len(used))])
    added = filled.vertices[len(used) :]
    return np.concatenate([vertices, added]), index[filled.faces], unmatched_edges(faces)


def _solids(vertices: Array, surfaces: list[IntArray]) -> dict[int, IntArray]:
    """Faces (f, 3) that bound the material of each body of a mesh.

    They are those of its outer surface and of its cavities, and, wound the other way round, those of the
    bodies that lie in its material.

    Args:
        vertices: (n, 3) vertices of the whole mesh.
        surfaces: Faces (f, 3) of each shell (connected surface), wound consistently.

    Returns:
        Faces of each body, counter-clockwise from outside the material, by the index of its outer surface in
        `surfaces`.
    """
    volumes = np.array([_volume(vertices, each) for each in surfaces])
    # The winding of most of the volume is taken as outwards; a shell of the other winding inside a body is
    # its cavity.
    if volumes.sum() < 0:
        surfaces, volumes = [each[:, ::-1] for each in surfaces], -volumes
    solids = {i: surfaces[i] for i in np.flatnonzero(volumes > 0).tolist()}
    probes = [_probes(vertices, each) for each in surfaces]
    for hole in np.flatnonzero(volumes < 0).tolist():
        larger = np.flatnonzero(volumes > -(1 + _SAME_VOLUME) * volumes[hole]).tolist()
        owner = _smallest_around(vertices, surfaces, larger, volumes, probes[hole])
        if owner is None:
            solids[hole] = surfaces[hole] = surfaces[hole][:, ::-1]
            volumes[hole] = -volumes[hole]
            probes[hole] = _probes(vertices, surfaces[hole])
        else:
            solids[owner] = np.concatenate([solids[owner], surfaces[hole]])
    # Cavities are complete: where a body lies in one, it displaces nothing.
    hollow = dict(solids)
    for inner in sorted(hollow, key=lambda i: volumes[i]):
        larger = [i for i in hollow if volumes[i] > (1 + _SAME_VOLUME) * volumes[inner]]
        owner = _smallest_around(vertices, surfaces, larger, volumes, probes[inner])
        if owner is not None and polyhedron.inside(vertices, hollow[owner], probes[inner]).all():
            solids[owner] = np.concatenate([solids[owner], surfaces[inner][:, ::-1]])
    return solids


def _smallest_around(
    vertices: Array, surfaces: list[IntArray], candidates: list[int], volumes: Array, points: Array
) -> int | None:
    """Index of the shell of least volume among `candidates` that contains most of `points`; None if none.

    A shell is one connected surface of the mesh.

    Args:
        vertices: (n, 3) vertices of the whole mesh [m].
        surfaces: Faces (f, 3) of each of s shells.
        candidates: Indices of the shells to consider.
        volumes: (s,) volumes of the shells [m^3].
        points: (m, 3) points [m].
    """
    for index in sorted(candidates, key=lambda i: volumes[i]):
        corners = vertices[surfaces[index]].reshape(-1, 3)
        if np.any(points.mean(axis=0) < corners.min(axis=0)) or np.any(
            points.mean(axis=0) > corners.max(axis=0)
        ):
            continue
        if polyhedron.inside(vertices, surfaces[index], points).mean() > 0.5:
            return index
    return None


def _probes(vertices: Array, faces: IntArray) -> Array:
    """Points (m, 3) [m] just below the largest faces of a closed surface, in the material that it bounds.

    Args:
        vertices: (n, 3) vertices of the whole mesh [m].
        faces: (f, 3) faces of the surface, counter-clockwise from outside the material.
    """
    corners = vertices[faces]
    normals = polyhedron.area_vectors(corners)
    size = np.linalg.norm(normals, axis=1)
    largest = np.argsort(-size)[:_PROBED_FACES]
    depth = _PROBE_DEPTH * float(np.ptp(vertices, axis=0).max())
    inwards = normals[largest] / np.maximum(size[largest], 1e-300)[:, None]
    return np.asarray(corners[largest].mean(axis=1) - depth * inwards, dtype=np.float64)


def _volume(vertices: Array, faces: IntArray) -> float:
    """Volume [m^3] inside closed `faces` (f, 3); negative if they are clockwise from outside."""
    return float(polyhedron.body_volumes(vertices, faces, np.zeros(len(faces), dtype=np.int64))[0])


def overlaps_of(bodies: Sequence[Body]) -> list[Overlap]:
    """Pairs of bodies with a common volume, largest first, sampled at evenly spread points.

    Volumes below 0.1 % of the smaller body, and below the sampling's resolution, are left out.
    """
    found: list[Overlap] = []
    boxes = [
        (corners.min(axis=0), corners.max(axis=0))
        for corners in (body.vertices[body.faces].reshape(-1, 3) for body in bodies)
    ]
    for i, j in combinations(range(len(bodies)), 2):
        low = np.maximum(boxes[i][0], boxes[j][0])
        size = np.minimum(boxes[i][1], boxes[j][1]) - low
        if np.any(size <= 0):
            continue
        points = low + size * low_discrepancy(_OVERLAP_PROBES)
        within = [polyhedron.inside(one.vertices, one.faces, points) for one in (bodies[i], bodies[j])]
        share = np.count_nonzero(within[0] & within[1]) / _OVERLAP_PROBES
        volume = share * float(size[0] * size[1] * size[2])
        if volume > _MIN_OVERLAP * min(bodies[i].properties.volume, bodies[j].properties.volume):
            found.append(Overlap(i + 1, j + 1, volume))
    return sorted(found, key=lambda one: -one.volume)
