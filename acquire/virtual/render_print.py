"""Print of an object's faces as boundary lines with a step in grey level, drawn by exact area coverage."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from acquire.virtual.body_chart import BodyChart
from acquire.virtual.layers import cut_lines
from acquire.virtual.packaging import PrintKind, design

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from acquire.virtual.objects import VirtualObject
    from acquire.virtual.packaging import Patches
    from acquire.virtual.render_mesh import FaceGroup

_PIECE_M = 0.016
"""longest straight piece [m], as of the faces' boundaries"""
_LEAST_AREA_M2 = 1e-9
"""area of a clipped rectangle below which it is left out [m2]"""


@dataclass(frozen=True)
class PrintLines:
    """Boundary lines of the print on one group of faces; the printed side is on the right of a line.

    Right is meant as in the image of the face, from start to end.
    """

    start: NDArray[np.float64]
    """(m, 3) start points [m, in O]"""
    end: NDArray[np.float64]
    """(m, 3) end points [m, in O]"""
    face: NDArray[np.int64]
    """(m,) index of the face of the group with the print on the right of each"""
    other_face: NDArray[np.int64]
    """(m,) index of the face on the left, if the same print runs on there; number of faces if it ends"""
    step: NDArray[np.float64]
    """(m,) grey levels inside minus outside, on a face that has the grey of one towards the camera"""


def printed_groups(
    virtual_object: VirtualObject, groups: tuple[FaceGroup, ...]
) -> tuple[PrintLines | None, ...]:
    """Print of each group of an object's faces; None for a group without print.

    Args:
        virtual_object: the object with its packaging.
        groups: its groups of faces.
    """
    if virtual_object.packaging.kind is PrintKind.BLANK:
        return (None,) * len(groups)
    chart = BodyChart(virtual_object.mesh_vertices)
    patches = design(chart.panels(groups), virtual_object.packaging, virtual_object.spec.name)
    return tuple(_print_lines(chart, group, patches) for group in groups)


def _print_lines(chart: BodyChart, group: FaceGroup, patches: Patches) -> PrintLines | None:
    ends: list[NDArray[np.float64]] = []
    faces: list[list[int]] = []
    step: list[float] = []
    seams: dict[tuple[float, ...], int] = {}
    nowhere = len(group.face_point)
    for piece in chart.pieces(group):
        low, high = piece.corners.min(axis=0), piece.corners.max(axis=0)
        near = np.flatnonzero(np.all((patches.high > low) & (patches.low < high), axis=1))
        for number in near.tolist():
            corners = clipped(_corners(patches.low[number], patches.high[number]), piece.corners)
            if len(corners) < 3 or _area(corners) < _LEAST_AREA_M2:
                continue
            # Counter-clockwise from outside has the inside on the left: the lines run the other way.
            points = piece.points(corners[::-1])
            for line in np.stack([points, np.roll(points, -1, axis=0)], axis=1):
                a, b = (tuple((np.round(point, 7) + 0.0).tolist()) for point in line)
                # Where the print runs on, the neighbour has the same line in the other direction.
                before = seams.pop((number, *b, *a), None)
                if before is not None:
                    faces[before][1] = piece.face
                    continue
                seams[number, *a, *b] = len(ends)
                ends.append(line)
                faces.append([piece.face, nowhere])
                step.append(float(patches.step[number]))
    if not ends:
        return None
    begin, end = np.moveaxis(np.array(ends), 1, 0)
    pieces = np.maximum(1, np.ceil(np.linalg.norm(end - begin, axis=1) / _PIECE_M)).astype(np.int64)
    points, start = cut_lines(begin, end, pieces)
    face, other = np.repeat(np.array(faces), pieces, axis=0).T
    return PrintLines(points[start], points[start + 1], face, other, np.repeat(np.array(step), pieces))


def _corners(low: NDArray[np.float64], high: NDArray[np.float64]) -> NDArray[np.float64]:
    """Corners (4, 2) of a rectangle, counter-clockwise."""
    (left, bottom), (right, top) = low, high
    return np.array([[left, bottom], [right, bottom], [right, top], [left, top]])


def clipped(corners: NDArray[np.float64], convex: NDArray[np.float64]) -> NDArray[np.float64]:
    """Corners (m, 2) of the part of a convex polygon (n, 2) that lies in another one, counter-clockwise.

    The polygon is cut at each side of the other in turn (I. Sutherland and G. Hodgman, 1974). Both run
    counter-clockwise; empty if they do not overlap.
    """
    for a, b in zip(convex, np.roll(convex, -1, axis=0), strict=True):
        if not len(corners):
            break
        side = b - a
        height = side[0] * (corners[:, 1] - a[1]) - side[1] * (corners[:, 0] - a[0])
        if height.min() >= 0:
            continue
        kept: list[NDArray[np.float64]] = []
        for i in range(len(corners)):
            j = (i + 1) % len(corners)
            if height[i] >= 0:
                kept.append(corners[i])
            if (height[i] < 0) != (height[j] < 0):
                share = height[i] / (height[i] - height[j])
                kept.append(corners[i] + share * (corners[j] - corners[i]))
        corners = np.array(kept).reshape(-1, 2)
    return corners


def _area(corners: NDArray[np.float64]) -> float:
    after = np.roll(corners, -1, axis=0)
    return float(0.5 * np.sum(corners[:, 0] * after[:, 1] - corners[:, 1] * after[:, 0]))
