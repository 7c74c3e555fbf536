"""Object surface prepared for drawing: convex groups of faces, and their boundaries in short pieces.

The pieces are short enough for lens distortion to bend the boundaries.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial import ConvexHull

from acquire.virtual.layers import cut_lines

if TYPE_CHECKING:
    from numpy.typing import NDArray

_PIECE_M = 0.016
"""longest straight piece [m]: at 2.6 px/mm the lens bends it by less than 0.03 px"""
_FLAT = 1e-7
"""height of a neighbour's corner over a face up to which both count as one plane [m]"""


@dataclass(frozen=True)
class FaceGroup:
    """Faces of a mesh that are connected across edges that are not concave.

    Seen from outside, none hides another, unless a concave edge lies within the group (`face_groups`).
    A group has f faces (triangles), with corners and normals. The boundaries between faces are cut into m
    short pieces, which connect n points; for each piece the faces on both sides are given.
    """

    vertices: NDArray[np.float64]
    """(v, 3) corners of the faces [m, in O]"""
    corners: NDArray[np.float64]
    """(f, 3, 3) corners of the faces [m], counter-clockwise from outside"""
    face_point: NDArray[np.float64]
    """(f, 3) a point in the plane of each face [m]"""
    face_normal: NDArray[np.float64]
    """(f, 3) outward unit normals"""
    points: NDArray[np.float64]
    """(n, 3) points along the face boundaries [m]"""
    start: NDArray[np.int64]
    """(m,) index of each piece's start point"""
    end: NDArray[np.int64]
    """(m,) index of each piece's end point"""
    left_face: NDArray[np.int64]
    """(m,) index of the face that has the piece in its counter-clockwise direction; f if it is in another
    group"""
    right_face: NDArray[np.int64]
    """(m,) index of the face on the other side of the piece; f if it is in another group"""


def hull_mesh(points: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Convex hull of points (n, 3) [m] as a mesh: vertices (v, 3) and triangles (t, 3), normals outward."""
    hull = ConvexHull(points)
    used, faces = np.unique(hull.simplices, return_inverse=True)
    vertices, faces = points[used], faces.reshape(-1, 3)
    corners = vertices[faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    inward = np.sum(normal * hull.equations[:, :3], axis=1) < 0
    faces[inward] = faces[inward][:, ::-1]
    return vertices, faces


def face_groups(vertices: NDArray[np.float64], faces: NDArray[np.int64]) -> tuple[FaceGroup, ...]:
    """Groups of a closed mesh's faces that are connected across edges that are not concave.

    Concave edges separate two groups where they form a closed loop, as at a bottle's shoulder. Seen from
    outside, no face of a group then hides another of it. That does not hold for a group with a concave edge
    inside, such as an L-shaped block's; the built-in objects have none.

    Args:
        vertices: (n, 3) vertices [m, in O, the object's frame].
        faces: (m, 3) triangles as indices of vertices, normals outward.

    Returns:
        One entry per group, with its boundary lines for drawing; every face is in one group.
    """
    surface = _borders(vertices, faces)
    label = np.arange(len(faces))
    for (_, _, f, g), above in zip(surface.borders, surface.height, strict=True):
        if above <= _FLAT:
            label[label == label[g]] = label[f]
    return tuple(_group(vertices, surface, label == name) for name in np.unique(label))


def hull_group(points: NDArray[np.float64]) -> FaceGroup:
    """Faces of the convex hull of points (n, 3) [m] as one group, in the order of `hull_mesh`."""
    vertices, faces = hull_mesh(points)
    return _group(vertices, _borders(vertices, faces), np.ones(len(faces), dtype=bool))


@dataclass(frozen=True)
class _Borders:
    """Faces of a closed mesh and the edges between them."""

    corners: NDArray[np.float64]
    """(f, 3, 3) corners of the faces [m]"""
    point: NDArray[np.float64]
    """(f, 3) a point in the plane of each face [m]; equal for faces in one plane"""
    normal: NDArray[np.float64]
    """(f, 3) outward unit normals; equal for faces in one plane"""
    borders: list[tuple[int, int, int, int]]
    """two vertices of each edge, and the two faces beside it"""
    height: list[float]
    """height of the second face's third corner over the first face, for each edge [m]: negative at a convex
    edge"""


def _borders(vertices: NDArray[np.float64], faces: NDArray[np.int64]) -> _Borders:
    """Faces of a closed mesh and the edges between them.

    Args:
        vertices: (n, 3) vertices [m].
        faces: (m, 3) triangles as indices of vertices, normals outward.
    """
    corners = vertices[faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    owner = {(int(face[i]), int(face[(i + 1) % 3])): f for f, face in enumerate(faces) for i in range(3)}
    borders = [(a, b, f, owner[b, a]) for (a, b), f in owner.items() if a < b]
    # Two of the neighbour's corners lie on the edge: the sum is the height of its third.
    height = [float(np.sum((corners[g] - corners[f, 0]) @ normal[f])) for _, _, f, g in borders]
    # Faces in one plane are seen alike to the last bit: the lines between them are left out.
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    plane = np.arange(len(faces))
    for (_, _, f, g), above in zip(borders, height, strict=True):
        if abs(above) <= _FLAT and plane[f] != plane[g]:
            kept, lost = (plane[f], plane[g]) if area[plane[f]] >= area[plane[g]] else (plane[g], plane[f])
            plane[plane == lost] = kept
    return _Borders(corners, corners[plane, 0], normal[plane], borders, height)


def _group(vertices: NDArray[np.float64], surface: _Borders, member: NDArray[np.bool_]) -> FaceGroup:
    """Group made of some faces of a mesh.

    Args:
        vertices: (n, 3) vertices [m].
        surface: all faces of the mesh.
        member: (f,) True for the faces of the group.
    """
    number = np.where(member, np.cumsum(member) - 1, int(member.sum()))
    a, b, f, g = np.array(surface.borders).T
    same_plane = member[f] & member[g] & (np.abs(surface.height) <= _FLAT)
    a, b, f, g = (end[(member[f] | member[g]) & ~same_plane] for end in (a, b, f, g))
    pieces = np.ceil(np.linalg.norm(vertices[b] - vertices[a], axis=1) / _PIECE_M).astype(int)
    points, start = cut_lines(vertices[a], vertices[b], pieces)
    left, right = np.repeat(number[f], pieces), np.repeat(number[g], pieces)
    used = np.unique(surface.corners[member].reshape(-1, 3), axis=0)
    point, normal = surface.point[member], surface.normal[member]
    return FaceGroup(used, surface.corners[member], point, normal, points, start, start + 1, left, right)
