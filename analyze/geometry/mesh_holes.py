"""Closing of a mesh's holes: flat ones flat, also with a slightly ragged rim, others by a fan."""

# manifold3d is only partly typed.
# pyright: reportMissingTypeStubs=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false, reportUnknownMemberType=false

from __future__ import annotations

from typing import NamedTuple

import manifold3d
import numpy as np

from analyze.errors import ShapeError
from analyze.geometry import polyhedron
from analyze.types import Array, IntArray

FLAT_HOLE = 0.01
"""Deviation of a hole's rim from a plane, over its width, up to which it is not reported."""
ROUGH_HOLE = 0.05
"""Deviation of a ragged rim, as at a scan's end, up to which the hole is closed over its projection."""
SMALL_HOLE = 0.10
"""Width of an uneven hole, over the mesh's extent, up to which the volume is known in spite of it."""
MAX_HOLES = 2000
"""Largest number of holes that are closed."""
MAX_CLOSED_SHARE = 0.4
"""Largest fraction of the closed surface's area in faces that close holes; of a flat sheet it is 0.5."""
REMEDY = "close the holes in a mesh editor, scan what is missing, or give a primitive (box, cylinder) instead"
"""Remedy for a mesh that cannot be closed."""


class Filled(NamedTuple):
    """Mesh whose holes have been closed."""

    vertices: Array
    """(k, 3) vertices [m]."""
    faces: IntArray
    """(g, 3) faces; those that close holes come last."""
    note: str
    """Note on the holes for the user."""
    doubt: str
    """Reason why the volume is not known, such as a wide uneven hole; empty if it is known."""


def fill_holes(vertices: Array, faces: IntArray, name: str) -> Filled:
    """Mesh with its holes closed: flat ones by a flat polygon, uneven ones by a fan.

    A fan is a ring of triangles between the hole's rim and the centroid of its corners. Over a wide uneven
    hole the surface is unknown, and with it the volume.

    Args:
        vertices: (n, 3) vertices [m].
        faces: (f, 3) faces, consistently wound, whose open edges form simple rings (`mesh_shells.cut_apart`).
        name: Name of the file, for messages.

    Raises:
        ShapeError: open edges do not form simple rings, there are more than `MAX_HOLES` holes, or most of the
            surface is missing.
    """
    holes = polyhedron.open_edges(faces)
    loops = _loops(faces)
    if not loops or len(loops) > MAX_HOLES:
        raise ShapeError(
            f"{name}: not a closed body ({holes} open edges that do not form simple rings): {REMEDY}"
        )
    extent = float(np.ptp(vertices, axis=0).max())
    added: list[IntArray] = []
    middles: list[Array] = []
    widest = uneven = doubtful = 0.0
    for loop in loops:
        ring = vertices[loop]
        centre = ring.mean(axis=0)
        _, _, frame = np.linalg.svd(ring - centre, full_matrices=False)
        width = float(np.ptp((ring - centre) @ frame[0]))
        rough = float(np.ptp((ring - centre) @ frame[-1]))
        flat = (
            _flat_fill(np.ascontiguousarray((ring[::-1] - centre) @ frame[:2].T))
            if rough <= ROUGH_HOLE * width
            else None
        )
        if flat is None and width > SMALL_HOLE * extent:
            doubtful = max(doubtful, width)
        widest = max(widest, width)
        if rough > FLAT_HOLE * width:
            uneven = max(uneven, rough)
        if flat is None:
            middle = np.full(len(loop), len(vertices) + len(middles))
            middles.append(centre)
            added.append(np.stack([np.roll(loop, -1), loop, middle], axis=1))
        else:
            added.append(loop[::-1][flat])
    vertices = np.vstack([vertices, *middles])
    closing = np.vstack(added)
    _refuse_fragment(vertices, faces, closing, f"{name}: not a closed body ({holes} open edges;")
    filled = np.vstack([faces, closing])
    if left := polyhedron.open_edges(filled):
        raise ShapeError(f"{name}: not a closed body ({left} edges stay open): {REMEDY}")
    many = f"{len(loops)} holes were" if len(loops) > 1 else "a hole was"
    border = f", its rim uneven by {1000 * uneven:.1f} mm" if uneven else ""
    what = f"{many} closed (the widest {100 * widest / extent:.0f} % of the size{border})"
    doubt = f"a hole of {100 * doubtful / extent:.0f} % of the size is not flat" if doubtful else ""
    return Filled(
        vertices,
        filled,
        f"{name}: {what}: check that nothing is missing there; no strike is planned on it",
        doubt,
    )


def _refuse_fragment(vertices: Array, faces: IntArray, closing: IntArray, what: str) -> None:
    """Raise `ShapeError` if most of a closed mesh's area is that of the faces that close its holes.

    Args:
        vertices: (n, 3) vertices [m].
        faces: (f, 3) faces of the mesh.
        closing: (g, 3) faces that close its holes.
        what: Start of the message.
    """
    given, missing = (
        float(np.linalg.norm(polyhedron.area_vectors(vertices[each]), axis=1).sum())
        for each in (faces, closing)
    )
    share = missing / (given + missing) if given else 1.0
    if share > MAX_CLOSED_SHARE:
        raise ShapeError(f"{what} {100 * share:.0f} % of its surface is missing): {REMEDY}")


def _flat_fill(outline: Array) -> IntArray | None:
    """Triangles (n - 2, 3) that fill a polygon, as indices of its corners; None if it intersects itself.

    Args:
        outline: (n, 2) corners of the polygon, in either sense.
    """
    if _signed_area(outline) < 0:
        outline = outline * [1.0, -1.0]
    try:
        triangles = np.asarray(manifold3d.triangulate([outline]), dtype=np.int64).reshape(-1, 3)
    except RuntimeError:
        return None
    # A fill that folds over has more area than its outline.
    area = np.array([_signed_area(outline[each]) for each in triangles])
    whole = len(triangles) == len(outline) - 2 and float(np.abs(area).sum()) <= (1 + 1e-6) * _signed_area(
        outline
    )
    return triangles if whole else None


def _loops(faces: IntArray) -> list[IntArray] | None:
    """Rims of a mesh's holes: for each, its vertex indices (k,) in order round the hole.

    The order follows the open edges of the adjoining `faces` (f, 3): those that more of them run in one sense
    than in the other. None if these form no simple rings.
    """
    edges = polyhedron.directed_edges(faces)
    key = edges.min(axis=1) * (int(faces.max(initial=0)) + 1) + edges.max(axis=1)
    _, inverse = np.unique(key, return_inverse=True)
    sense = np.where(edges[:, 0] < edges[:, 1], 1, -1)
    excess = np.bincount(inverse.ravel(), sense).astype(np.int64)[inverse.ravel()]
    if np.any(np.abs(excess) > 1):
        return None
    # Of several faces that run an edge alike, one is at the hole.
    open_ones = np.flatnonzero(excess * sense > 0)
    border = edges[open_ones[np.unique(key[open_ones], return_index=True)[1]]]
    following = dict(zip(border[:, 0].tolist(), border[:, 1].tolist(), strict=True))
    if len(following) != len(border):
        return None
    loops: list[IntArray] = []
    while following:
        start, at = following.popitem()
        loop = [start]
        while at != start:
            loop.append(at)
            if at not in following:
                return None
            at = following.pop(at)
        loops.append(np.array(loop, dtype=np.int64))
    return loops


def _signed_area(flat: Array) -> float:
    """Twice the area of the polygon `flat` (n, 2), positive if its corners are anticlockwise."""
    following = np.roll(flat, -1, axis=0)
    return float(np.sum(flat[:, 0] * following[:, 1] - flat[:, 1] * following[:, 0]))
