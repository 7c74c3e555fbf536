"""Closing of a mesh's holes: flat ones flat, also with a slightly ragged rim, small ones by a fan."""

# manifold3d is only partly typed.
# pyright: reportMissingTypeStubs=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false, reportUnknownMemberType=false

from __future__ import annotations

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
"""Width of a hole, over the mesh's extent, up to which it is closed whatever its shape."""
MAX_HOLES = 200
"""Largest number of holes that are closed."""


def fill_holes(vertices: Array, faces: IntArray, name: str) -> tuple[Array, IntArray, str]:
    """Mesh with its holes closed: flat ones by a flat polygon, small uneven ones by a fan.

    A fan is a ring of triangles between the hole's rim and the centroid of its corners.

    Args:
        vertices: (n, 3) vertices [m].
        faces: (f, 3) faces, consistently wound.
        name: Name of the file, for messages.

    Returns:
        Vertices (k, 3) [m], faces (g, 3) (those that close holes come last), and a note on the holes for the
        user.

    Raises:
        ShapeError: open edges do not form simple rings, there are more than `MAX_HOLES` holes, one is too
            large and uneven, or edges stay open.
    """
    holes = polyhedron.open_edges(faces)
    remedy = (
        "close the holes in a mesh editor, scan what is missing, or give a primitive (box, cylinder) instead"
    )
    loops = _loops(faces)
    if loops is None or len(loops) > MAX_HOLES:
        raise ShapeError(
            f"{name}: not a closed body ({holes} open edges that do not form simple rings): {remedy}"
        )
    extent = float(np.ptp(vertices, axis=0).max())
    added: list[IntArray] = [faces]
    widest = uneven = 0.0
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
            part = 100 * width / extent
            raise ShapeError(
                f"{name}: not a closed body ({holes} open edges; one hole is {part:.0f} % of the size and "
                f"not flat): {remedy}"
            )
        widest = max(widest, width)
        if rough > FLAT_HOLE * width:
            uneven = max(uneven, rough)
        if flat is None:
            vertices = np.vstack([vertices, centre])
            middle = np.full(len(loop), len(vertices) - 1)
            added.append(np.stack([np.roll(loop, -1), loop, middle], axis=1))
        else:
            added.append(loop[::-1][flat])
    filled = np.vstack(added)
    left = polyhedron.open_edges(filled)
    if left:
        raise ShapeError(f"{name}: not a closed body ({left} edges stay open): {remedy}")
    part = 100 * widest / extent
    many = f"{len(loops)} holes were" if len(loops) > 1 else "a hole was"
    border = f", its rim uneven by {1000 * uneven:.1f} mm" if uneven else ""
    what = f"{many} closed (the widest {part:.0f} % of the size{border})"
    return (
        vertices,
        filled,
        f"{name}: {what}: check that nothing is missing there; no strike is planned on it",
    )


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

    The order follows the open edges of the adjoining faces. None if the open edges form no simple rings, or
    an edge has more than two of `faces` (f, 3).
    """
    edges = polyhedron.directed_edges(faces)
    key = np.sort(edges, axis=1)
    _, inverse, count = np.unique(key, axis=0, return_inverse=True, return_counts=True)
    border = edges[count[inverse.ravel()] == 1]
    if np.any(count > 2):
        return None
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
