"""Bevels of a point cloud's edges: found as faces, and never taken for a rounding that is sure."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from analyze.geometry.cloud_surface import CloudSurface, cloud_surface
from tests.analyze.geometry.rounded_cloud import rounded_box_cloud

SIZE = np.array([0.09, 0.07, 0.14])
NOISE, COUNT = 1.5e-4, 6000


def bevelled(leg: float, height: float, seed: int) -> CloudSurface:
    """Cloud of a box whose ends are `leg` narrower all round and `height` high [m]."""
    corners = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)]) * SIZE
    end = np.sign(corners)
    hull = trimesh.PointCloud(
        np.concatenate([corners - end * [0, 0, height], corners - end * [leg, leg, 0]])
    ).convex_hull
    points = np.asarray(trimesh.sample.sample_surface(hull, COUNT, seed=seed)[0])
    return cloud_surface(points + np.random.default_rng(seed).normal(0, NOISE, points.shape))


def rounded(radius: float, seed: int) -> CloudSurface:
    return cloud_surface(rounded_box_cloud(tuple(SIZE), radius, NOISE, COUNT, seed))


@pytest.mark.parametrize(("leg", "height"), [(0.004, 0.001), (0.002, 0.005)])
def test_bevels_of_an_end_are_faces(leg, height):
    found = bevelled(leg, height, 1)
    assert 6 + 6 <= len(found.planes) <= 6 + 8, "one with a dozen points may be left open"
    steep = np.hypot(leg, height)
    for plane in found.planes[6:]:
        side = int(np.argmax(np.abs(plane.normal[:2])))
        true = np.zeros(3)
        true[[side, 2]] = np.sign(plane.normal[[side, 2]]) * [height / steep, leg / steep]
        assert np.arccos(plane.normal @ true) < 3 * np.sqrt(plane.covariance[1:, 1:].max())
        # Its middle lies on the true bevel.
        middle = np.sign(true) * (SIZE / 2 - [leg / 2, leg / 2, height / 2])
        assert abs(float(plane.heights(middle[None])[0])) < 1.2e-4


@pytest.mark.parametrize("radius", [0.0005, 0.004])
def test_roundings_are_no_bevels(radius):
    found = rounded(radius, 1)
    assert len(found.planes) == 6
    large = [each for each in found.roundings if each.radius > radius / 2]
    assert len(large) >= 8
    assert all(abs(each.radius - radius) < 2.5 * each.sd for each in large)


def test_small_bevel_that_may_be_a_rounding_leaves_the_radius_unsure():
    """A bevel of 0.8 mm at 0.15 mm noise: the points hardly decide, and the stated sd covers both."""
    leg, phi = 8e-4, np.radians(30)
    found = bevelled(leg, leg, 2)
    ends = [each for each in found.roundings if abs(each.direction[2]) < 0.5]
    assert len(ends) >= 6
    # At balance the object stands on the bevel's inner end, or above the arc's centre.
    lever = 1 - np.tan(phi)
    off = np.array([(lever * each.radius - leg) / (lever * each.sd) for each in ends])
    assert np.sqrt(np.mean(off**2)) < 2, "4 where every edge counted as rounded"
