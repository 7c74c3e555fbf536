"""Radii of edges by the outermost points of a mesh, against arcs of known radius."""

from __future__ import annotations

import numpy as np
import pytest

from analyze.geometry.cloud_roundings import EdgeRounding
from analyze.geometry.hull_planes import FittedPlane
from analyze.geometry.outermost_radius import LARGEST_RADIUS, outermost_radius

LENGTH = 0.08


def face(normal: np.ndarray) -> FittedPlane:
    """Plane through O with the outward unit `normal` (3,); it models no points."""
    basis = np.linalg.svd(normal[None])[2][1:]
    return FittedPlane(normal, 0.0, np.zeros(3), basis, np.zeros((3, 3)), 1e-4, 100, 0.0, 1e-5)


def rounded(radius: float, lean: float) -> tuple[EdgeRounding, np.ndarray, tuple[FittedPlane, ...]]:
    """Edge along y between the top of a body and a side that leans by `lean` [rad], rounded by an arc."""
    top, side = np.array([0.0, 0, 1]), np.array([np.cos(lean), 0, np.sin(lean)])
    planes = (face(top), face(side))
    centre = np.linalg.solve(np.stack([top, side, [0, 1.0, 0]]), [-radius, -radius, 0.0])
    angles = np.linspace(lean, np.pi / 2, 60)
    arc = centre + radius * np.column_stack([np.cos(angles), np.zeros(60), np.sin(angles)])
    places = np.linspace(0, LENGTH, 41)
    points = np.concatenate([arc + np.array([0, y, 0]) for y in places])
    edge = EdgeRounding(np.zeros(3), np.array([0, LENGTH, 0]), 3e-3, 2.8e-3, 1e-3)
    return edge, points, planes


@pytest.mark.parametrize("radius", [1e-3, 4e-3, 0.011])
@pytest.mark.parametrize("lean", [0.0, 0.3, -0.2])
def test_radius_of_an_arc_is_found_however_large(radius: float, lean: float) -> None:
    """A bottle's base, rounded by 11 mm, passed for an edge of at most 3 mm: c was 5 mm off within 2."""
    assert outermost_radius(*rounded(radius, lean)) == pytest.approx(radius, rel=0.02)


def test_radius_is_bounded_and_needs_two_faces() -> None:
    edge, points, planes = rounded(0.03, 0.0)
    assert outermost_radius(edge, points, planes) == LARGEST_RADIUS
    assert outermost_radius(edge, points, planes[:1]) == 0.0
    assert outermost_radius(edge, points[:0], planes) == 0.0
