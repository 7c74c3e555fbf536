"""Split a mesh into its shells (closed surfaces of bodies and cavities), also where bodies touch.

Bodies of an assembly touch at vertices, along edges and over whole faces. Where the file numbers the vertices
of each body apart, these numbers separate the bodies; merging vertices by their place would weld them. Where
it does not (STL has no numbers, other formats repeat vertices along seams), vertices are merged by place, and
at an edge with more than two faces those two belong together that bound one wedge of material.
"""

# scipy is only partly typed.
# pyright: reportMissingTypeStubs=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false, reportUnknownMemberType=false

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from analyze.geometry import polyhedron
from analyze.geometry.polyhedron import BoolArray
from analyze.types import Array, IntArray

SEAM_WIDTHS = (0.0, 1e-7, 1e-5)
"""Distances, over the mesh's extent, within which vertices of seams are merged, tried in this order; 0 merges
equal places only."""
MIN_FACES = 4
"""Smallest number of faces of a shell; fewer are loose faces of a seam."""
ROUNDING = 2.0**-22
"""Error of a coordinate over the largest one: that of single precision, in which files are written."""
MIN_TIE_ANGLE = 1e-9
"""Difference of angle [rad] within which two faces at an edge always count as coincident."""


class Shells(NamedTuple):
    """Shells (connected surfaces) of a mesh: faces of each, wound consistently, vertices merged at seams."""

    closed: list[IntArray]
    """Faces (f, 3) of each closed shell: body or cavity."""
    open: list[IntArray]
    """Faces (f, 3) of each part that is not closed, or whose winding is ambiguous."""


def shells_of(vertices: Array, faces: IntArray, piece: IntArray) -> Shells:
    """Shells of a mesh, found with as little merging of vertices as closes them.

    By the file's own vertex numbers first; then with equal places within a piece merged, then with equal
    places of all pieces, at last with nearly equal ones. A shell that is closed at one step takes no part in
    the next.

    Args:
        vertices: (n, 3) vertices of the file.
        faces: (f, 3) vertex indices of the faces, as the file numbers them.
        piece: (n,) number of the file's piece (node of a scene) that each vertex belongs to.

    Returns:
        Faces of the closed shells, and of what remains open, without parts of fewer than `MIN_FACES` faces if
        there are closed shells; indices refer to `vertices`. Most of the volume is wound counter-clockwise
        from outside.
    """
    faces = _mostly_outward(vertices, faces)
    closed: list[IntArray] = []
    for merged in _vertex_maps(vertices, piece):
        faces = polyhedron.without_degenerate(merged[faces])
        faces, shell, is_closed = separated(vertices, faces)
        closed += _split(faces[is_closed], shell[is_closed])
        faces = faces[~is_closed]
        if not len(faces):
            return Shells(closed, [])
    rest = _split(faces, edge_components(faces))
    return Shells(closed, [each for each in rest if len(each) >= MIN_FACES or not closed])


def unmatched_edges(faces: IntArray) -> int:
    """Number of edges that the adjoining `faces` (f, 3) do not run equally often in both directions.

    It is 0 for a closed, consistently wound surface, also where that touches itself.
    """
    edges = polyhedron.directed_edges(faces)
    key = edges.min(axis=1) * (int(faces.max(initial=0)) + 1) + edges.max(axis=1)
    _, inverse = np.unique(key, return_inverse=True)
    sense = np.where(edges[:, 0] < edges[:, 1], 1, -1)
    return int(np.count_nonzero(np.bincount(inverse.ravel(), sense)))


def _vertex_maps(vertices: Array, piece: IntArray) -> Iterator[IntArray]:
    """Yield, in steps of ever more merging, the index (n,) of the vertex that stands for each vertex.

    Merged are: none; then those at equal places within a piece; all at equal places; those at nearly equal
    ones.

    Args:
        vertices: (n, 3) vertices.
        piece: (n,) number of the file's piece (node of a scene) that each vertex belongs to.
    """
    yield np.arange(len(vertices))
    # Zeros of both signs are one place.
    places = vertices + 0.0
    if piece.any():
        yield _representatives(np.column_stack([piece.astype(np.float64), places]))
    extent = float(np.ptp(vertices, axis=0).max())
    for width in SEAM_WIDTHS:
        yield _representatives(np.round(places / (width * extent)) if width else places)


def _representatives(keys: Array) -> IntArray:
    """Index (n,) of the first row that equals each of the rows `keys` (n, k)."""
    _, first, inverse = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    return np.asarray(first[inverse.ravel()], dtype=np.int64)


def _mostly_outward(vertices: Array, faces: IntArray) -> IntArray:
    """Faces (f, 3), all reversed if they enclose a negative volume."""
    volume = polyhedron.body_volumes(vertices, faces, np.zeros(len(faces), dtype=np.int64))[0]
    return faces[:, ::-1] if volume < 0 else faces


def separated(vertices: Array, faces: IntArray) -> tuple[IntArray, IntArray, BoolArray]:
    """Wind the faces of a mesh consistently, and divide them into shells (connected surfaces).

    Two faces at an edge are neighbours if no other face is there, or if they bound one wedge of material. A
    shell is a set of faces connected by neighbours; it is closed if each face has one at each edge.

    Args:
        vertices: (n, 3) vertices.
        faces: (f, 3) vertex indices; most of the volume must be wound counter-clockwise from outside.

    Returns:
        Faces (f, 3) wound consistently; number (f,) of the shell of each face; (f,) True for the faces of
        closed shells.
    """
    faces, _, _ = polyhedron.consistently_wound(faces)
    count = len(faces)
    owner = np.tile(np.arange(count), 3)
    pairs, shell = _paired_edges(vertices, faces)
    matched = np.bincount(owner[pairs.ravel()], minlength=count)
    is_open = np.bincount(shell, matched < 3, minlength=int(shell.max(initial=-1)) + 1) > 0
    return faces, shell, ~is_open[shell]


def cut_apart(vertices: Array, faces: IntArray) -> tuple[Array, IntArray]:
    """Cut a mesh where more than two faces meet at an edge, or two fans of faces at a vertex.

    Neighbours, by `separated`, stay connected. The open edges of the result form simple rings.

    Args:
        vertices: (n, 3) vertices.
        faces: (f, 3) faces, consistently wound; most of the volume must be wound counter-clockwise from
            outside.

    Returns:
        Vertices (k, 3), some of them at equal places, and faces (f, 3).
    """
    count = len(faces)
    pairs, _ = _paired_edges(vertices, faces)
    # Half edge h runs from corner h // count of face h % count to that face's next corner; corners are
    # numbered as the half edges that start there.
    start, end = pairs, (pairs + count) % (3 * count)
    links = np.concatenate([np.stack([start[:, 0], end[:, 1]], 1), np.stack([end[:, 0], start[:, 1]], 1)])
    corner = _components(links, 3 * count)
    _, first, number = np.unique(corner, return_index=True, return_inverse=True)
    return vertices[faces.T.ravel()[first]], number.reshape(3, count).T.astype(np.int64)


def _paired_edges(vertices: Array, faces: IntArray) -> tuple[IntArray, IntArray]:
    """Pairs of directed edges at which two faces are neighbours, and the shell of each face.

    Args:
        vertices: (n, 3) vertices.
        faces: (f, 3) faces, consistently wound, most of the volume counter-clockwise from outside.

    Returns:
        Indices (l, 2) in the directed edges of `faces` (`polyhedron.directed_edges`), the two of a pair of
        opposite sense; and the number (f,) of the shell (connected surface) of each face.
    """
    count = len(faces)
    edges = polyhedron.directed_edges(faces)
    owner = np.tile(np.arange(count), 3)
    forward = edges[:, 0] < edges[:, 1]
    key = edges.min(axis=1) * (int(faces.max(initial=0)) + 1) + edges.max(axis=1)
    order = np.argsort(key, kind="stable")
    _, start, sizes = np.unique(key[order], return_index=True, return_counts=True)
    pairs = np.column_stack([order[start[sizes == 2]], order[start[sizes == 2] + 1]])
    wedges = [pairs[forward[pairs[:, 0]] != forward[pairs[:, 1]]]]
    ambiguous: list[IntArray] = []
    opposite = faces.sum(axis=1)[owner] - edges.sum(axis=1)
    for at in np.flatnonzero(sizes > 2):
        run = order[start[at] : start[at] + sizes[at]]
        found = _wedges(vertices, edges[run], opposite[run], forward[run])
        if found is None:
            ambiguous.append(run)
        else:
            wedges.append(run[found])
    pairs = np.concatenate(wedges)
    shell = _components(owner[pairs], count)
    # At an edge where angles decide nothing, faces that are connected elsewhere are neighbours.
    more = [run[pair][None] for run in ambiguous for pair in _by_shell(shell[owner[run]], forward[run])]
    return np.concatenate([pairs, *more]).astype(np.int64), shell


def _wedges(vertices: Array, edges: IntArray, opposite: IntArray, forward: BoolArray) -> IntArray | None:
    """Pairs (h / 2, 2) of those of the h faces at one edge that bound a wedge of material, or None.

    A pair holds two indices, 0 to h - 1. None if it is ambiguous which faces belong together. A face runs the
    edge in the order of its own vertices. Going round the edge by increasing angle, a face that runs it
    forwards ends the material of a body, one that runs it backwards begins it. Where faces of touching bodies
    coincide, one body ends before the other begins.

    Args:
        vertices: (n, 3) vertices.
        edges: (h, 2) vertex indices of the edge in the order in which each face runs it.
        opposite: (h,) the third vertex of each face.
        forward: (h,) True where the face runs the edge from the smaller to the larger index.
    """
    start, end = vertices[edges[0].min()], vertices[edges[0].max()]
    span = float(np.linalg.norm(end - start))
    if span == 0:
        return None
    axis = (end - start) / span
    arm = vertices[opposite] - start
    arm = arm - np.outer(arm @ axis, axis)
    length = np.linalg.norm(arm, axis=1)
    if len(forward) % 2 or forward.sum() * 2 != len(forward) or length.min() == 0:
        return None
    first = arm[0] / length[0]
    angle = np.arctan2(arm @ np.cross(axis, first), arm @ first)
    tie = ROUNDING * float(np.abs(vertices[[*edges[0], *opposite]]).max()) / length + MIN_TIE_ANGLE
    order = np.argsort(angle)
    gaps = np.diff(angle[order], append=angle[order[0]] + 2 * np.pi)
    # Cut the circle at its widest gap, so that no group of coincident faces is cut.
    order = np.roll(order, -(int(np.argmax(gaps)) + 1))
    turned = np.mod(angle[order] - angle[order[0]] + 0.5 * gaps.max(), 2 * np.pi)
    apart = np.diff(turned) > tie[order[1:]] + tie[order[:-1]]
    group = np.concatenate([[0], np.cumsum(apart)])
    order = order[np.lexsort((~forward[order], group))]
    ends = forward[order]
    if np.any(ends == np.roll(ends, 1)):
        return None
    if ends[0]:
        order = np.roll(order, -1)
    return np.asarray(order.reshape(-1, 2), dtype=np.int64)


def _by_shell(shell: IntArray, forward: BoolArray) -> list[IntArray]:
    """Pairs of faces at an edge of h faces: one pair for each shell with just two faces there.

    The two must run the edge in opposite senses. A pair holds their indices (2,), 0 to h - 1.

    Args:
        shell: (h,) number of the shell of each face.
        forward: (h,) True where the face runs the edge from the smaller to the larger index.
    """
    alike = [np.flatnonzero(shell == number) for number in np.unique(shell)]
    return [each for each in alike if len(each) == 2 and forward[each].sum() == 1]


def edge_components(faces: IntArray) -> IntArray:
    """Number (f,) of the connected part of each of `faces` (f, 3), connected by any common edge."""
    edges = polyhedron.directed_edges(faces)
    key = edges.min(axis=1) * (int(faces.max(initial=0)) + 1) + edges.max(axis=1)
    order = np.argsort(key, kind="stable")
    same = np.diff(key[order]) == 0
    owner = np.tile(np.arange(len(faces)), 3)[order]
    return _components(np.column_stack([owner[:-1][same], owner[1:][same]]), len(faces))


def _components(links: IntArray, count: int) -> IntArray:
    """Number (count,) of the connected component of each item, by `links` (l, 2) of pairs of items."""
    graph = coo_array((np.ones(len(links)), (links[:, 0], links[:, 1])), shape=(count, count))
    return connected_components(graph, directed=False)[1].astype(np.int64)


def _split(faces: IntArray, label: IntArray) -> list[IntArray]:
    """Faces (g, 3) of each label in ascending order, as a list; `faces` (f, 3) have labels (f,)."""
    order = np.argsort(label, kind="stable")
    cuts = np.flatnonzero(np.diff(label[order])) + 1
    return [each for each in np.split(faces[order], cuts) if len(each)]
