"""Hulls over several convex parts of a body: they show the same image where no bridge can be seen.

A hull over several parts also bridges the hollows between them. From where none of its bridges can be seen,
the hull and its parts give the same image, and the hull is drawn in a fraction of the time: a mug seen from
the side takes four surfaces instead of twenty. The tree of dividing planes decides over which parts there is
a hull; `merged_tree` arranges it so that few surfaces show the body from most sides.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial import ConvexHull

from acquire.virtual.convex_parts import few_corners
from acquire.virtual.render_mesh import hull_group, hull_mesh

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from acquire.virtual.render_mesh import FaceGroup

_BRIDGE_M = 4e-4
"""distance from the parts from which on a point of a hull belongs to a bridge [m]: about a pixel"""
_BESIDE_M = 2e-4
"""distance by which a part may reach over a plane that it counts as beside [m]: less than a pixel"""
_SHARES = np.array([(i, j, 4 - i - j) for i in range(5) for j in range(5 - i)]) / 4
"""barycentric coordinates (15, 3) of the points of a triangle that are examined"""
_DIRECTIONS = np.array([each for each in product((-1, 0, 1), repeat=3) if any(each)], dtype=float)
"""directions (26, 3) from which a hull is judged"""


@dataclass(frozen=True)
class PartHull:
    """Hull over some parts of a body: its faces, and which of them bridge hollows."""

    group: FaceGroup
    """the f faces"""
    bridges: NDArray[np.bool_]
    """(f,) True for faces that do not lie on the parts everywhere"""

    def is_like_parts(self, viewer: NDArray[np.float64]) -> bool:
        """True if the hull over several parts shows the same image as these parts, seen from `viewer`.

        Args:
            viewer: (3,) position of the camera in O, the object's frame [m].
        """
        seen = np.sum((viewer - self.group.face_point) * self.group.face_normal, axis=1) > 0
        return not bool((seen & self.bridges).any())

    @property
    def share(self) -> float:
        """Fraction of 26 directions from which, seen from afar, the hull over parts looks like the parts."""
        seen = self.group.face_normal[self.bridges] @ _DIRECTIONS.T > 0
        return float(np.mean(~seen.any(axis=0)))


def hull_over(parts: Sequence[NDArray[np.float64]], members: Sequence[int]) -> PartHull:
    """Convex hull over some of a body's convex parts, with its faces that bridge hollows between them.

    A face bridges a hollow if points of it lie more than 0.4 mm outside all parts of the body.

    Args:
        parts: corners (c, 3) of every part of the body [m].
        members: numbers of the parts to cover.
    """
    corners = parts[members[0]]
    if len(members) > 1:
        corners = few_corners(np.concatenate([parts[i] for i in members]))
    group = hull_group(corners)
    if len(members) == 1:
        return PartHull(group, np.zeros(len(group.face_point), dtype=bool))
    vertices, faces = hull_mesh(corners)
    points = _SHARES @ vertices[faces]
    outside = np.full(points.shape[:2], np.inf)
    for part in parts:
        planes = np.unique(np.round(ConvexHull(part).equations, 7), axis=0)
        outside = np.minimum(outside, (points @ planes[:, :3].T + planes[:, 3]).max(axis=-1))
    return PartHull(group, np.asarray((outside > _BRIDGE_M).any(axis=1)))


def merged_tree(parts: Sequence[NDArray[np.float64]], tree: NDArray[np.float64]) -> NDArray[np.float64]:
    """Tree of dividing planes, rearranged so that hulls over its branches show the body from most sides.

    In each branch the plane is taken after which the fewest surfaces are expected, of those that cut no part.

    Args:
        parts: corners (c, 3) of each part [m].
        tree: (k, 4) planes, like the result: axis (0 to 2), offset [m], and what lies below and above the
            plane: the number of another plane, or -1 - i for part i.
    """
    low, high = (np.array([end(part, axis=0) for part in parts]) for end in (np.min, np.max))
    planes = np.unique(tree[:, :2], axis=0)
    known: dict[tuple[int, ...], float] = {}
    merged: list[list[float]] = []

    def surfaces(members: tuple[int, ...]) -> float:
        if members not in known:
            share = hull_over(parts, members).share
            known[members] = share + (1 - share) * len(members)
        return known[members]

    def branch(members: tuple[int, ...]) -> int:
        if len(members) == 1:
            return -1 - members[0]
        divisions: list[tuple[float, float, float, tuple[int, ...], tuple[int, ...]]] = []
        for axis, offset in planes:
            below = tuple(i for i in members if high[i, int(axis)] <= offset + _BESIDE_M)
            above = tuple(i for i in members if i not in below)
            if below and above and low[list(above), int(axis)].min() >= offset - _BESIDE_M:
                divisions.append((surfaces(below) + surfaces(above), axis, offset, below, above))
        _, axis, offset, below, above = min(divisions)
        plane = len(merged)
        merged.append([axis, offset])
        merged[plane] += [branch(below), branch(above)]
        return plane

    branch(tuple(range(len(parts))))
    return np.array(merged).reshape(-1, 4)
