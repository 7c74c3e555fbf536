"""Flat chart of an object's surface: around the body and up, and the top and the base from outside.

On upright faces u is the length around the body's outline, and v the height; so print runs on from facet to
facet of a round wall. Shoulders and necks are not charted.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial import ConvexHull

from acquire.virtual.packaging import Panel

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from acquire.virtual.render_mesh import FaceGroup

_UPRIGHT, _LEVEL = 0.1, 0.95
"""largest and least cosine of the angle between the vertical and a wall's and a cap's normal"""
_OUTER = 0.85
"""least distance of a wall from the axis, over that of the outline, at which it is charted"""
_SHARP_COSINE = 0.6
"""cosine of the angle between neighbouring sides of the outline below which a panel ends between them"""
_LABEL_M = 0.11
"""width of the panels around a round body, about [m]"""
_CAP_GAP_M = 1.0
"""distance between the charts of wall, top and base along u [m]"""


@dataclass(frozen=True)
class FaceChart:
    """Flat piece of a surface on the chart."""

    face: int
    """index of a face of the group that lies in the piece's plane"""
    corners: NDArray[np.float64]
    """(n, 2) corners of the convex piece on the chart [m], counter-clockwise"""
    origin: NDArray[np.float64]
    """(3,) point of O at u = v = 0 [m]"""
    axes: NDArray[np.float64]
    """(2, 3) unit vectors of u and v in O"""

    def points(self, uv: NDArray[np.float64]) -> NDArray[np.float64]:
        """Points (n, 3) of O [m] at places (n, 2) of the chart [m]."""
        return self.origin + uv @ self.axes


class BodyChart:
    """Chart of an object's surface, with the panels that are printed.

    Args:
        vertices: (v, 3) vertices of the object [m, in O].
    """

    def __init__(self, vertices: NDArray[np.float64]) -> None:
        self._low, self._high = vertices.min(axis=0), vertices.max(axis=0)
        outline = vertices[ConvexHull(vertices[:, :2]).vertices, :2]
        sides = np.roll(outline, -1, axis=0) - outline
        sides /= np.linalg.norm(sides, axis=1, keepdims=True)
        bend = np.sum(sides * np.roll(sides, 1, axis=0), axis=1)
        first = int(np.argmin(bend))
        self._outline, self._bend = np.roll(outline, -first, axis=0), np.roll(bend, -first)
        after = np.roll(self._outline, -1, axis=0)
        self._along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(after - self._outline, axis=1))])
        self._middle = 0.5 * (self._low + self._high)

    def panels(self, groups: tuple[FaceGroup, ...]) -> tuple[Panel, ...]:
        """Panels of wall, top and base; the wall's reach as high as the charted faces."""
        heights = [
            piece.corners[:, 1]
            for group in groups
            for piece in self.pieces(group)
            if piece.corners[:, 0].max() < self._along[-1] + 1e-6
        ]
        every = np.concatenate(heights) if heights else np.array([self._low[2], self._high[2]])
        corners = np.append(self._along[:-1][self._bend < _SHARP_COSINE], self._along[-1])
        if len(corners) < 3:
            corners = np.linspace(0.0, self._along[-1], max(2, round(self._along[-1] / _LABEL_M)) + 1)
        corners[0] = 0.0
        wall = [
            Panel(float(a), float(every.min()), float(b), float(every.max())) for a, b in pairwise(corners)
        ]
        x, y = 0.36 * (self._high - self._low)[:2]
        return (*wall, *(Panel(at - x, -y, at + x, y) for at in self._cap_places))

    def pieces(self, group: FaceGroup) -> list[FaceChart]:
        """Charted pieces of a group's faces; a face that is not convex is charted triangle by triangle."""
        _, plane = np.unique(
            np.round(np.column_stack([group.face_point, group.face_normal]), 9), axis=0, return_inverse=True
        )
        plane = plane.reshape(-1)
        found: list[FaceChart] = []
        for number in np.unique(plane):
            members = np.flatnonzero(plane == number)
            placed = self._placed(group.corners[members], group.face_normal[members[0]])
            if placed is None:
                continue
            uv, origin, axes = placed
            flat = uv.reshape(-1, 2)
            hull = ConvexHull(flat)
            a, b = uv[:, 1] - uv[:, 0], uv[:, 2] - uv[:, 0]
            area = 0.5 * np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum()
            whole = hull.volume < 1.000001 * area
            corners = [flat[hull.vertices]] if whole else list(uv)
            found += [FaceChart(int(members[0]), each, origin, axes) for each in corners]
        return found

    @property
    def _cap_places(self) -> tuple[float, float]:
        """Places along u of the middle of top and base [m]."""
        return float(self._along[-1]) + _CAP_GAP_M, float(self._along[-1]) + 2 * _CAP_GAP_M

    def _placed(
        self, corners: NDArray[np.float64], normal: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]] | None:
        """Corners (t, 3, 2) of triangles in one plane on the chart, its origin (3,) and axes (2, 3) in O.

        None if the plane is no wall of the body's outline, nor top or base.
        """
        flat = corners.reshape(-1, 3)
        middle = 0.5 * (flat.min(axis=0) + flat.max(axis=0))
        if abs(normal[2]) < _UPRIGHT:
            along, reach = self._around(middle[:2])
            if reach < _OUTER:
                return None
            right = np.array([-normal[1], normal[0], 0.0])
            right /= np.linalg.norm(right)
            at = np.array([along, middle[2]])
        elif abs(normal[2]) > _LEVEL:
            upper = normal[2] > 0
            edge = self._high[2] if upper else self._low[2]
            if abs(middle[2] - edge) > 1e-6:
                return None
            right = np.array([1.0 if upper else -1.0, 0.0, 0.0])
            middle = np.array([*self._middle[:2], edge])
            at = np.array([self._cap_places[0 if upper else 1], 0.0])
        else:
            return None
        axes = np.stack([right, np.cross(normal, right)])
        origin = middle - at @ axes
        return (corners - origin) @ axes.T, origin, axes

    def _around(self, point: NDArray[np.float64]) -> tuple[float, float]:
        """Length around the outline at the ray from its middle through a point (2,), and how far out it is.

        The second number is the point's distance over the outline's.
        """
        a = self._outline - self._middle[:2]
        side = np.roll(a, -1, axis=0) - a
        ray = point - self._middle[:2]
        with np.errstate(divide="ignore", invalid="ignore"):
            cross = ray[0] * side[:, 1] - ray[1] * side[:, 0]
            far = (a[:, 0] * side[:, 1] - a[:, 1] * side[:, 0]) / cross
            share = (a[:, 0] * ray[1] - a[:, 1] * ray[0]) / cross
        met = np.flatnonzero((far > 0) & (share >= -1e-9) & (share < 1 + 1e-9) & np.isfinite(far))
        if not len(met):
            return 0.0, 0.0
        n = int(met[0])
        return float(self._along[n] + share[n] * np.linalg.norm(side[n])), float(1.0 / far[n])
