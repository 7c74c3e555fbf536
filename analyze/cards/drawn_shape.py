"""An object's exterior as it is drawn: few enough faces for a picture, small enough ones to be sorted by depth, and its sharp edges."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import ConvexHull

from analyze.geometry.object_model import ObjectModel
from analyze.geometry.polyhedron import BoolArray
from analyze.types import Array, IntArray

MOST_FACES = 4000
GRID = 30
"""cells along the longest edge into which a fine mesh's vertices are gathered"""
SHARP = np.cos(np.radians(25.0))
"""faces that meet at more than this angle meet in an edge that is drawn"""
PIECES = 8
"""along the longest extent: no triangle of a hollow body is drawn longer than that part"""
MOST_CUTS = 12
CONVEX = 1e-3
"""relative difference of the hull's volume up to which a body has no hollows"""


@dataclass(frozen=True)
class DrawnShape:
    """What pictures are made of, in O [m]."""

    triangles: Array
    """(t, 3, 3) corners, counter-clockwise from outside"""
    normals: Array
    """(t, 3) unit"""
    edges: Array
    """(e, 2, 3) ends"""
    edge_normals: Array
    """(e, 2, 3) of the two faces that meet there"""
    creases: tuple[bool, ...]
    """(e) True: sharp, drawn wherever it is seen; False: drawn only where it is the outline"""
    hull: Array
    """(h, 3) corners of the convex hull, of the model as it is"""
    convex: bool
    size: float
    """m, longest extent"""


def drawn_shape(model: ObjectModel) -> DrawnShape:
    """The model, simplified where it is fine."""
    vertices, faces = model.vertices, model.faces
    hull = ConvexHull(model.hull_vertices)
    # Of a fine mesh without hollows the hull is drawn: the same body, its flat faces in few triangles.
    if len(hull.simplices) < len(faces) and hull.volume < model.volume * (1 + CONVEX):
        vertices, faces = model.hull_vertices, _outward(hull)
    if len(faces) > MOST_FACES:
        vertices, faces = simplified(vertices, faces, float(model.extent.max()) / GRID)
    normals, keep = _normals(vertices, faces)
    faces = faces[keep]
    edges, pairs = _edges(faces)
    sides = normals[pairs]
    sharp = np.einsum("ei,ei->e", sides[:, 0], sides[:, 1]) < SHARP
    size = float(model.extent.max())
    convex = _convex(vertices, faces, normals, size)
    triangles = vertices[faces]
    if not convex:
        triangles, normals = _cut(triangles, normals, size / PIECES)
    return DrawnShape(triangles, normals, vertices[edges], sides, tuple(bool(each) for each in sharp), model.hull_vertices, convex, size)


def _outward(hull: ConvexHull) -> IntArray:
    """The hull's triangles (f, 3), counter-clockwise from outside."""
    faces = hull.simplices.astype(np.int64)
    a, b, c = np.moveaxis(hull.points[faces], 1, 0)
    inward = np.einsum("fi,fi->f", np.cross(b - a, c - a), hull.equations[:, :3]) < 0
    faces[inward] = faces[inward][:, ::-1]
    return faces


def simplified(vertices: Array, faces: IntArray, cell: float) -> tuple[Array, IntArray]:
    """Vertices gathered in cells of a grid; each cell keeps the point nearest to its faces' planes, so that edges stay sharp.

    Source: Lindstrom 2000, out-of-core simplification of large polygonal models (quadric error, regularised towards the cell's mean).
    """
    index = np.floor((vertices - vertices.min(axis=0)) / cell).astype(np.int64)
    _, group = np.unique(index, axis=0, return_inverse=True)
    group = group.ravel()
    many = int(group.max()) + 1
    count = np.bincount(group, minlength=many)
    mean = np.stack([np.bincount(group, weights=vertices[:, i], minlength=many) for i in range(3)], axis=1) / count[:, None]
    a, b, c = np.moveaxis(vertices[faces], 1, 0)
    area = np.cross(b - a, c - a)
    length = np.linalg.norm(area, axis=1)
    unit = area / np.maximum(length, 1e-30)[:, None]
    matrix, right = np.zeros((many, 3, 3)), np.zeros((many, 3))
    for corner in range(3):
        owner = group[faces[:, corner]]
        level = np.einsum("fi,fi->f", unit, a - mean[owner])
        np.add.at(matrix, owner, length[:, None, None] * unit[:, :, None] * unit[:, None, :])
        np.add.at(right, owner, (length * level)[:, None] * unit)
    weight = np.maximum(np.trace(matrix, axis1=1, axis2=2), 1e-30)
    shift = np.linalg.solve(matrix + 0.01 * weight[:, None, None] * np.eye(3), right[:, :, None])[:, :, 0]
    placed = mean + np.clip(shift, -cell / 2, cell / 2)
    joined = group[faces]
    whole = (joined[:, 0] != joined[:, 1]) & (joined[:, 1] != joined[:, 2]) & (joined[:, 2] != joined[:, 0])
    return placed, joined[whole]


def _normals(vertices: Array, faces: IntArray) -> tuple[Array, BoolArray]:
    """Unit normals of the faces that have an area, and which those are."""
    a, b, c = np.moveaxis(vertices[faces], 1, 0)
    area = np.cross(b - a, c - a)
    length = np.linalg.norm(area, axis=1)
    keep = length > 1e-14
    return area[keep] / length[keep, None], keep


def _edges(faces: IntArray) -> tuple[IntArray, IntArray]:
    """Vertex pairs (e, 2) where two faces meet, and the faces (e, 2); where only one is, it stands twice."""
    directed = faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    owner = np.repeat(np.arange(len(faces)), 3)
    ends = np.sort(directed, axis=1)
    order = np.lexsort((ends[:, 1], ends[:, 0]))
    ends, owner = ends[order], owner[order]
    first = np.flatnonzero(np.concatenate([[True], np.any(ends[1:] != ends[:-1], axis=1)]))
    last = np.concatenate([first[1:], [len(ends)]]) - 1
    return ends[first], np.stack([owner[first], owner[last]], axis=1)


def _convex(vertices: Array, faces: IntArray, normals: Array, size: float) -> bool:
    """Whether no vertex lies above any face: then what faces the eye is all that is seen, in any order."""
    used = vertices[np.unique(faces)]
    tolerance = 1e-4 * size
    step = max(1, 2_000_000 // max(len(used), 1))
    corners = vertices[faces[:, 0]]
    for start in range(0, len(faces), step):
        level = np.einsum("fi,fi->f", normals[start : start + step], corners[start : start + step])
        if np.any((normals[start : start + step] @ used.T).max(axis=1) - level > tolerance):
            return False
    return True


def _cut(triangles: Array, normals: Array, longest: float) -> tuple[Array, Array]:
    """Triangles halved across their longest edge until none is longer than `longest`: only small ones can be sorted by depth."""
    for _ in range(MOST_CUTS):
        lengths = np.linalg.norm(np.roll(triangles, -1, axis=1) - triangles, axis=2)
        long = lengths.max(axis=1) > longest
        if not long.any():
            break
        worst = np.argmax(lengths[long], axis=1)
        rows = np.arange(len(worst))
        a, b, c = (triangles[long][rows, (worst + i) % 3] for i in range(3))
        middle = (a + b) / 2
        triangles = np.concatenate([triangles[~long], np.stack([a, middle, c], axis=1), np.stack([middle, b, c], axis=1)])
        normals = np.concatenate([normals[~long], normals[long], normals[long]])
    return triangles, normals
