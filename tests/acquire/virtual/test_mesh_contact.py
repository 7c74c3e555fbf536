"""Places where a mesh with a hollow base touches the table: as the mesh itself, within 0.05 mm."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from scipy.spatial import ConvexHull

from acquire.virtual.contact_shape import inset_corners, mesh_centres
from tests.world.catalogue import make

RADIUS = 4e-4


def punted_bottle() -> trimesh.Trimesh:
    """Bottle that stands on the ring around a hollow in its bottom, with a heel rounded by 3 mm [m]."""
    t = np.linspace(0, np.pi / 2, 24)
    heel = np.column_stack([35 - 3 + 3 * np.sin(t), 3 - 3 * np.cos(t)])
    outline = np.vstack(
        [[(0, 9), (20, 7), (30, 0.4), (31, 0)], heel, [(35, 110), (14, 150), (14, 190), (0, 190)]]
    )
    return trimesh.creation.revolve(1e-3 * outline, sections=60)


def stool() -> trimesh.Trimesh:
    """Seat on three slanted round legs, of which one is 1 mm longer than the others [m]."""
    seat = trimesh.creation.cylinder(60, 12, sections=60)
    legs = []
    for number, angle in enumerate((0.3, 2.4, 4.4)):
        leg = trimesh.creation.cylinder(6, 90 + (number == 1), sections=48)
        leg.apply_transform(trimesh.transformations.rotation_matrix(0.15, [-np.sin(angle), np.cos(angle), 0]))
        leg.apply_translation([45 * np.cos(angle), 45 * np.sin(angle), -45])
        legs.append(leg)
    return trimesh.boolean.union([seat, *legs]).apply_scale(1e-3)


def superellipsoid() -> trimesh.Trimesh:
    """Soap with a nearly flat, slightly curved base, finely meshed [m]."""
    ball = trimesh.creation.icosphere(3)
    ball.vertices = np.sign(ball.vertices) * np.abs(ball.vertices) ** 0.6 * [0.045, 0.03, 0.018]
    return ball


@pytest.mark.parametrize("make", [punted_bottle, stool, superellipsoid])
def test_supports_are_those_of_the_mesh(make):
    """Heights over the table, in any attitude, and the places of the lowest points where the body stands."""
    vertices = np.asarray(make().vertices)
    centres = mesh_centres(vertices, RADIUS)
    exact = inset_corners(vertices[np.sort(ConvexHull(vertices).vertices)], RADIUS)
    down = np.random.default_rng(1).standard_normal((500, 3))
    down = np.vstack([down / np.linalg.norm(down, axis=1, keepdims=True), [[0, 0, -1.0]]])
    gap = (exact @ down.T).max(axis=0) - (centres @ down.T).max(axis=0)
    assert gap.min() > -1e-9
    assert gap.max() < 1.1e-5
    assert (vertices @ down.T).max(axis=0)[-1] - (centres @ down.T).max(axis=0)[-1] == pytest.approx(
        RADIUS, abs=5e-5
    )


def test_a_hollow_base_touches_with_its_ring():
    centres = mesh_centres(np.asarray(punted_bottle().vertices), RADIUS)
    lowest = centres[centres[:, 2] < centres[:, 2].min() + 2e-5]
    assert np.linalg.norm(lowest[:, :2], axis=1).min() > 0.029
    reach = lowest[:, :2] @ np.array([[np.cos(a), np.sin(a)] for a in np.linspace(0, 2 * np.pi, 73)]).T
    assert reach.max(axis=0).min() > 0.0299


def test_a_rim_dense_in_corners_does_not_shift_the_search_for_an_inner_point():
    """Most corners crowd on one thin rim, so that their mean is not inside the inset hull."""
    ring = 0.04 * np.column_stack([np.cos(t := np.arange(400) * 2 * np.pi / 400), np.sin(t), 0 * t])
    plate = np.vstack([ring, [[0, 0, 0.02]]])
    assert len(mesh_centres(plate, RADIUS)) > 50


def test_a_hull_of_nearly_coincident_corners_is_inset():
    """Two of 5667 inset corners of a hair dryer lie 0.1 um apart: it was called too thin for its edges."""
    dryer = make("hair_dryer", 1)
    assert len(mesh_centres(1e-3 * dryer.vertices, 0.00034483202447328656)) > 1000
