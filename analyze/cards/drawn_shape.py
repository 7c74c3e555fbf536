"""Exterior of an object for drawing: a limited number of faces, sortable by depth, and sharp edges."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import ConvexHull

from analyze.geometry.distance import largest_height
from analyze.geometry.even_samples import bisected
from analyze.geometry.object_model import ObjectModel
from analyze.geometry.polyhedron import BoolArray, area_vectors, hull_faces, without_degenerate
from analyze.types import Array, IntArray

MAX_FACES = 4000
"""Number of faces above which a mesh is simplified."""
GRID_CELLS = 30
"""Cells along the longest extent of the grid in which a fine mesh's vertices are merged."""
SHARP_EDGE_COSINE = np.cos(np.radians(25.0))
"""Cosine of 25°: an edge is sharp, and drawn, if its two faces' normals differ by more than this angle."""
HOLLOW_PIECES = 8
"""Longest extent of a body that is not convex, over the longest side of its triangles as drawn."""
MAX_CUTS = 12
"""Greatest number of times that a triangle and its pieces are halved."""


@dataclass(frozen=True)
class DrawnShape:
    """Triangles and edges of an object for drawing, with their normals, in the object frame O [m].

    It also states which edges are sharp, and whether the shape is convex.
    """

    triangles: Array
    """(t, 3, 3) corners [m], counter-clockwise seen from outside."""
    normals: Array
    """(t, 3) outward unit normals of the triangles."""
    edges: Array
    """(e, 2, 3) end points [m]."""
    edge_normals: Array
    """(e, 2, 3) unit normals of the two faces that meet there."""
    creases: tuple[bool, ...]
    """(e,) True for a sharp edge, drawn wherever visible; False for one drawn only as part of the outline."""
    hull: Array
    """(h, 3) corners of the convex hull of the original model [m]."""
    convex: bool
    """True if the shape is convex: faces towards the eye then never hide each other."""
    size: float
    """Longest extent along the axes of O [m]."""


def drawn_shape(model: ObjectModel) -> DrawnShape:
    """Faces and edges for drawing an object's model, in the object frame O [m].

    A convex mesh is drawn as its convex hull if that has fewer faces. A mesh that still has more than
    `MAX_FACES` faces is simplified: its vertices are merged on a grid. A body that is not convex is cut into
    small triangles that can be sorted by depth.
    """
    vertices, faces = model.vertices, model.faces
    hull = ConvexHull(model.hull_vertices)
    # A fine convex mesh is drawn as its hull: the same body, with few triangles per flat face.
    if len(hull.simplices) < len(faces) and model.is_convex:
        vertices, faces = model.hull_vertices, hull_faces(hull)
    if len(faces) > MAX_FACES:
        vertices, faces = simplify_mesh(vertices, faces, float(model.extent.max()) / GRID_CELLS)
    normals, keep = _normals(vertices, faces)
    faces = faces[keep]
    edges, pairs = _edges(faces)
    sides = normals[pairs]
    sharp = np.einsum("ei,ei->e", sides[:, 0], sides[:, 1]) < SHARP_EDGE_COSINE
    size = float(model.extent.max())
    convex = _convex(vertices, faces, normals, size)
    triangles = vertices[faces]
    if not convex:
        # Only small triangles can be sorted by depth.
        triangles, owner = bisected(triangles, size / HOLLOW_PIECES, MAX_CUTS)
        normals = normals[owner]
    return DrawnShape(
        triangles,
        normals,
        vertices[edges],
        sides,
        tuple(bool(each) for each in sharp),
        model.hull_vertices,
        convex,
        size,
    )


def simplify_mesh(vertices: Array, faces: IntArray, cell: float) -> tuple[Array, IntArray]:
    """Merge the vertices of a mesh in the cells of a grid.

    Each cell keeps the point nearest to the planes of its faces, so that edges stay sharp.

    Source: Lindstrom 2000, out-of-core simplification of large polygonal models (quadric error, regularised
    towards the cell's mean).

    Args:
        vertices: (n, 3) vertices [m].
        faces: (f, 3) vertex indices of the faces, counter-clockwise seen from outside.
        cell: Edge of the cubic cells [m].

    Returns:
        Vertices (k, 3) [m], one for each occupied cell, and vertex indices (g, 3) of the faces without those
        that collapsed.
    """
    index = np.floor((vertices - vertices.min(axis=0)) / cell).astype(np.int64)
    _, group = np.unique(index, axis=0, return_inverse=True)
    group = group.ravel()
    many = int(group.max()) + 1
    count = np.bincount(group, minlength=many)
    mean = (
        np.stack([np.bincount(group, weights=vertices[:, i], minlength=many) for i in range(3)], axis=1)
        / count[:, None]
    )
    area = area_vectors(vertices[faces])
    length = np.linalg.norm(area, axis=1)
    unit = area / np.maximum(length, 1e-30)[:, None]
    matrix, right = np.zeros((many, 3, 3)), np.zeros((many, 3))
    for corner in range(3):
        owner = group[faces[:, corner]]
        level = np.einsum("fi,fi->f", unit, vertices[faces[:, 0]] - mean[owner])
        np.add.at(matrix, owner, length[:, None, None] * unit[:, :, None] * unit[:, None, :])
        np.add.at(right, owner, (length * level)[:, None] * unit)
    total = np.maximum(np.trace(matrix, axis1=1, axis2=2), 1e-30)
    shift = np.linalg.solve(matrix + 0.01 * total[:, None, None] * np.eye(3), right[:, :, None])[:, :, 0]
    placed = mean + np.clip(shift, -cell / 2, cell / 2)
    return placed, without_degenerate(group[faces])


def _normals(vertices: Array, faces: IntArray) -> tuple[Array, BoolArray]:
    """Outward unit normals (k, 3) of the faces with a nonzero area, and a mask (f,) of these faces.

    Args:
        vertices: (n, 3) vertices [m].
        faces: (f, 3) vertex indices of the faces, counter-clockwise seen from outside.
    """
    area = area_vectors(vertices[faces])
    length = np.linalg.norm(area, axis=1)
    keep = length > 1e-14
    return area[keep] / length[keep, None], keep


def _edges(faces: IntArray) -> tuple[IntArray, IntArray]:
    """Edges of a mesh with `faces` (f, 3), as vertex indices (e, 2), and their faces' indices (e, 2).

    A boundary edge has its one face twice; an edge with more than two faces has the first and the last of
    them.
    """
    directed = faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    owner = np.repeat(np.arange(len(faces)), 3)
    ends = np.sort(directed, axis=1)
    order = np.lexsort((ends[:, 1], ends[:, 0]))
    ends, owner = ends[order], owner[order]
    first = np.flatnonzero(np.concatenate([[True], np.any(ends[1:] != ends[:-1], axis=1)]))
    last = np.concatenate([first[1:], [len(ends)]]) - 1
    return ends[first], np.stack([owner[first], owner[last]], axis=1)


def _convex(vertices: Array, faces: IntArray, normals: Array, size: float) -> bool:
    """True if the shape is convex, that is if no vertex lies above the plane of any face.

    Args:
        vertices: (n, 3) vertices [m].
        faces: (f, 3) faces, counter-clockwise seen from outside.
        normals: (f, 3) unit normals of the faces.
        size: Longest extent [m]; 1e-4 of it is tolerated.
    """
    level = np.einsum("fi,fi->f", normals, vertices[faces[:, 0]])
    heights = largest_height(np.column_stack([normals, -level]), vertices[np.unique(faces)])
    return bool(heights.max() <= 1e-4 * size)
