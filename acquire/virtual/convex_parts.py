"""Division of a body into convex parts by planes, for the striker's contacts and the camera's images.

The planes are perpendicular to the axes of O, the object's frame, and form a binary tree: of two parts on
different sides of a plane, the one on the viewer's side hides the other, never the reverse.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial import ConvexHull, QhullError

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

MAX_PARTS = 20
"""largest number of convex parts; hollows that so many parts still cover are solid in the virtual rig"""
_FILLED = 0.02
"""share of the body's volume up to which hollows may be filled"""
_WORTHWHILE = 0.002
"""smallest gain, as a share of the body's volume, for which a part is divided"""
_CUTS = 7
"""number of equally spaced candidate planes per axis; planes along the largest faces are added"""
_FACE_CUTS = 4
"""largest number of candidate planes per axis along faces"""
CORNER_TOLERANCE_M = 5e-5
"""usual distance by which a body may protrude from the hull of the corners that stand for it [m]"""
_MOST_CORNERS = 240
_MOST_HEIGHTS = 4_000_000
"""number of heights of corners over planes that are held at a time"""
_BLIND_CUTS = 2
"""number of times that a part is halved without a gain: a ring's hulls shrink only from its quarters on"""


@dataclass(frozen=True)
class ConvexParts:
    """Convex parts that together stand for a body, and the tree of planes that separates them."""

    corners: tuple[NDArray[np.float64], ...]
    """corners (c, 3) of each part [m, in O, the object's frame]"""
    tree: NDArray[np.float64]
    """(k, 4) planes: axis (0 to 2), offset [m], and what lies below and above the plane: the number of
    another plane, or -1 - i for the part i; the first plane is the root; empty for a single part"""

    def front_to_back(
        self, viewer: NDArray[np.float64], is_whole: Callable[[int], bool] = lambda _plane: False
    ) -> list[int]:
        """Numbers of the parts in an order in which no part hides one before it.

        Args:
            viewer: (3,) position from which the parts are seen [m, in O, the object's frame].
            is_whole: called with the number of a plane; True if the parts that it divides count as one. In
                the result it then has the plane's number plus the number of parts.
        """
        order: list[int] = []
        waiting = [0 if len(self.tree) else -1]
        while waiting:
            node = waiting.pop()
            if node < 0:
                order.append(-1 - node)
                continue
            if is_whole(node):
                order.append(len(self.corners) + node)
                continue
            axis, offset, below, above = self.tree[node]
            near, far = (below, above) if viewer[int(axis)] < offset else (above, below)
            waiting += [int(far), int(near)]
        return order

    def below(self, plane: int) -> list[int]:
        """Numbers of all parts in the branch of the tree that begins at the plane with the given number."""
        found: list[int] = []
        waiting = [plane]
        while waiting:
            node = waiting.pop()
            if node < 0:
                found.append(-1 - node)
            else:
                waiting += [int(side) for side in self.tree[node][2:]]
        return found


@dataclass(frozen=True)
class _Piece:
    """Part of a body while it is being divided: its surface, and points spread through its inside."""

    triangles: NDArray[np.float64]
    """(n, 3, 3) corners of the pieces of surface [m]"""
    inside: NDArray[np.float64]
    """(m, 3) points spread uniformly inside [m]"""
    hull_volume: float
    """volume of the convex hull [m3]"""
    blind_cuts: int = 0
    """number of cuts before, one after the other, that saved nothing"""


def convex_parts(triangles: NDArray[np.float64], inside: NDArray[np.float64], volume: float) -> ConvexParts:
    """Divide a body into at most 20 convex parts that cover as little of its hollows as possible.

    In each step the part with the largest hollows is cut by the plane that leaves the least, among planes
    perpendicular to the axes; if none saves enough, by the one that halves its longest side. The parts are
    the convex hulls of what lies between the planes.

    Args:
        triangles: (n, 3, 3) corners of the surface's triangles [m, in O, the object's frame].
        inside: (m, 3) points spread uniformly inside the body [m].
        volume: volume of the body [m3].
    """
    cell = volume / len(inside)
    pieces = [_Piece(triangles, inside, _hull_volume(triangles.reshape(-1, 3)))]
    tree: list[list[float]] = []
    whole: set[int] = set()
    while len(pieces) < MAX_PARTS:
        hollow = [
            -1.0 if i in whole else each.hull_volume - cell * len(each.inside)
            for i, each in enumerate(pieces)
        ]
        worst = int(np.argmax(hollow))
        if sum(max(each, 0.0) for each in hollow) < _FILLED * volume or hollow[worst] < _WORTHWHILE * volume:
            break
        axis, offset, gain = _best_cut(pieces[worst])
        blind_cuts = 0
        if gain < _WORTHWHILE * volume:
            blind_cuts = pieces[worst].blind_cuts + 1
            axis, offset = _middle_cut(pieces[worst])
        if blind_cuts > _BLIND_CUTS:
            whole.add(worst)
            continue
        for plane in tree:  # where the divided part hung, the new plane hangs
            plane[2:] = [len(tree) if side == -1 - worst else side for side in plane[2:]]
        below, above = (
            replace(_part_beside(pieces[worst], axis, offset, side), blind_cuts=blind_cuts)
            for side in (-1, 1)
        )
        tree.append([axis, offset, -1 - worst, -1 - len(pieces)])
        pieces[worst] = below
        pieces.append(above)
    return ConvexParts(
        tuple(few_corners(each.triangles.reshape(-1, 3)) for each in pieces), np.array(tree).reshape(-1, 4)
    )


def few_corners(
    points: NDArray[np.float64], tolerance_m: float = CORNER_TOLERANCE_M, most: int = _MOST_CORNERS
) -> NDArray[np.float64]:
    """Corners (c, 3) among points whose hull contains all of them but for a tolerance.

    The corners farthest outside the hull are added until none is farther out than the tolerance, or there
    are about as many as allowed.

    Args:
        points: (n, 3) points [m].
        tolerance_m: largest distance by which a point may lie outside the hull of those kept [m].
        most: number of corners from which on none are added; finely meshed round bodies reach it.

    Raises:
        QhullError: the points lie in a plane.
    """
    points = points[np.sort(ConvexHull(points).vertices)]
    ends = np.concatenate([points.argmin(axis=0), points.argmax(axis=0)])
    spread = np.linalg.norm(points - points.mean(axis=0), axis=1).argsort()[-2:]
    kept = np.unique(np.concatenate([ends, spread]))
    while len(kept) < min(most, len(points)):
        try:
            planes = ConvexHull(points[kept]).equations
        except QhullError:  # flat so far
            missing = np.setdiff1d(np.arange(len(points)), kept)
            kept = np.union1d(kept, missing[:: max(1, len(missing) // 8)])
            continue
        # The farthest corner over every plane: one after the other would need as many hulls.
        farthest = np.array([], dtype=np.int64)
        for some in np.array_split(planes, 1 + len(planes) * len(points) // _MOST_HEIGHTS):
            height = points @ some[:, :3].T + some[:, 3]
            farthest = np.union1d(farthest, height.argmax(axis=0)[height.max(axis=0) > tolerance_m])
        if not len(farthest):
            break
        kept = np.union1d(kept, farthest)
    return points[kept]


def _best_cut(piece: _Piece) -> tuple[int, float, float]:
    """Axis and offset [m] of the best plane to cut a piece, and the volume [m3] that it saves.

    The volume is that of the piece's hull less those of both parts' hulls. All are 0 if no plane saves any.
    """
    best = (0, 0.0, 0.0)
    points = piece.triangles.reshape(-1, 3)
    low, high = points.min(axis=0), points.max(axis=0)
    for axis in range(3):
        even = low[axis] + (high[axis] - low[axis]) * (np.arange(_CUTS) + 1) / (_CUTS + 1)
        margin = 1e-3 * (high[axis] - low[axis])
        along = _face_offsets(piece.triangles, axis)
        for offset in (*even, *along):
            if not low[axis] + margin < offset < high[axis] - margin:
                continue
            hulls = sum(_hull_volume(_points_beside(piece.triangles, axis, offset, side)) for side in (-1, 1))
            if piece.hull_volume - hulls > best[2]:
                best = (axis, float(offset), piece.hull_volume - hulls)
    return best


def _middle_cut(piece: _Piece) -> tuple[int, float]:
    """Axis and offset [m] of the plane that halves a piece across its longest side."""
    points = piece.triangles.reshape(-1, 3)
    low, high = points.min(axis=0), points.max(axis=0)
    axis = int(np.argmax(high - low))
    return axis, float(low[axis] + high[axis]) / 2


def _face_offsets(triangles: NDArray[np.float64], axis: int) -> NDArray[np.float64]:
    """Offsets [m] along an axis of the largest faces that are perpendicular to it, as candidate planes."""
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    areas = np.linalg.norm(normals, axis=1)
    flat = np.abs(normals[:, axis]) > 0.999 * areas
    offsets, which = np.unique(np.round(triangles[flat, 0, axis], 5), return_inverse=True)
    return offsets[np.argsort(np.bincount(which, areas[flat]))[::-1][:_FACE_CUTS]]


def _hull_volume(points: NDArray[np.float64]) -> float:
    """Volume of the convex hull of points (n, 3) [any length], 0 if they lie in a plane."""
    try:
        return float(ConvexHull(points).volume) if len(points) > 3 else 0.0
    except QhullError:
        return 0.0


def _points_beside(
    triangles: NDArray[np.float64], axis: int, offset: float, side: int
) -> NDArray[np.float64]:
    """Corners (n, 3) of the surface on one side of a plane, and points where its edges cross the plane.

    Args:
        triangles: (t, 3, 3) triangles of the surface [m].
        axis: axis that the plane is perpendicular to.
        offset: offset of the plane along the axis [m].
        side: -1 for below, 1 for above the plane.
    """
    points = triangles.reshape(-1, 3)
    ends = np.roll(triangles, -1, axis=1).reshape(-1, 3)
    height, other = points[:, axis] - offset, ends[:, axis] - offset
    crossing = height * other < 0
    share = (height[crossing] / (height - other)[crossing])[:, None]
    cut = points[crossing] + share * (ends[crossing] - points[crossing])
    return np.concatenate([points[side * height >= 0], cut])


def _part_beside(piece: _Piece, axis: int, offset: float, side: int) -> _Piece:
    """Piece on one side of a plane: what is left of its triangles, and its inside points there.

    Args:
        piece: the piece that is cut.
        axis: axis that the plane is perpendicular to.
        offset: offset of the plane along the axis [m].
        side: -1 for below, 1 for above the plane.
    """
    triangles = piece.triangles
    height = side * (triangles[..., axis] - offset)
    kept = [triangles[height.min(axis=1) >= 0]]
    for triangle, h in zip(
        *(each[(height.min(axis=1) < 0) & (height.max(axis=1) > 0)] for each in (triangles, height)),
        strict=True,
    ):
        outline: list[NDArray[np.float64]] = []
        for i in range(3):
            j = (i + 1) % 3
            if h[i] >= 0:
                outline.append(triangle[i])
            if h[i] * h[j] < 0:
                outline.append(triangle[i] + h[i] / (h[i] - h[j]) * (triangle[j] - triangle[i]))
        kept += [np.array([[outline[0], outline[i], outline[i + 1]]]) for i in range(1, len(outline) - 1)]
    left = np.concatenate(kept)
    inside = piece.inside[side * (piece.inside[:, axis] - offset) > 0]
    return _Piece(left, inside, _hull_volume(left.reshape(-1, 3)))
