"""Voxels compared with analytic bodies: volume, centroid, moments and shell."""

from __future__ import annotations

import numpy as np
import pytest

from analyze.geometry.object_model import load_object_model
from analyze.geometry.voxels import voxelise
from tests.analyze.geometry.shapes import box_triangles, spec_of, stl

RELATIVE = 0.005
WALL = 0.002


def moments(points, masses, about, pitch):
    arm = points - about
    second = (arm * masses[:, None]).T @ arm / masses.sum()
    return np.diag((np.trace(second) + pitch**2 / 6) * np.eye(3) - second)


def box_moments(size):
    return np.prod(size) * (np.sum(size**2) - size**2) / 12


def cylinder_moments(radius, height):
    across = (3 * radius**2 + height**2) / 12
    return np.pi * radius**2 * height * np.array([across, across, radius**2 / 2])


@pytest.mark.parametrize("pitch", [0.004, 0.0047])
def test_box_with_a_thin_wall(pitch):
    size = np.array([0.06, 0.05, 0.2])
    model = load_object_model(spec_of({"box": {"size_m": list(size)}}), None, "")
    voxels = voxelise(model, pitch, WALL)
    wall = voxels.volumes * voxels.shell
    exact_wall = np.prod(size) - np.prod(size - 2 * WALL)
    assert np.isclose(voxels.volumes.sum(), np.prod(size))
    assert np.allclose(voxels.volumes @ voxels.centres / voxels.volumes.sum(), 0, atol=RELATIVE * 0.05)
    assert np.allclose(
        moments(voxels.centres, voxels.volumes, 0, pitch), model.unit_inertia.diagonal(), rtol=RELATIVE
    )
    assert np.isclose(wall.sum(), exact_wall, rtol=2 * RELATIVE)
    exact = (box_moments(size) - box_moments(size - 2 * WALL)) / exact_wall
    assert np.allclose(moments(voxels.shell_centres, wall, 0, pitch), exact, rtol=2 * RELATIVE)


def test_cylinder_with_a_thin_wall():
    model = load_object_model(spec_of({"cylinder": {"radius_m": 0.036, "height_m": 0.15}}), None, "")
    voxels = voxelise(model, 0.004, WALL)
    wall = voxels.volumes * voxels.shell
    exact_wall = model.volume - np.pi * 0.034**2 * 0.146
    assert np.isclose(wall.sum(), exact_wall, rtol=2 * RELATIVE)
    exact = (cylinder_moments(0.036, 0.15) - cylinder_moments(0.034, 0.146)) / exact_wall
    assert np.allclose(moments(voxels.shell_centres, wall, 0, 0.004), exact, rtol=2 * RELATIVE)
    assert np.allclose(
        moments(voxels.centres, voxels.volumes, 0, 0.004), model.unit_inertia.diagonal(), rtol=RELATIVE
    )


def test_two_joined_blocks():
    """A T-shaped body is not convex, so that the depth below a mesh is used."""
    low, high = (
        box_triangles(np.array([60.0, 60, 40]), (0, 0, 20)),
        box_triangles(np.array([20.0, 20, 40]), (0, 0, 60)),
    )
    triangles = np.concatenate([low, high])
    model = load_object_model(spec_of({"file": "t.stl", "unit": "mm"}), stl(triangles), "t.stl")
    voxels = voxelise(model, 0.005, 0.004)
    volumes = np.array([60 * 60 * 40, 20 * 20 * 40]) * 1e-9
    centroid = volumes @ [0.02, 0.06] / volumes.sum()
    assert np.isclose(voxels.volumes.sum(), volumes.sum(), rtol=1e-6)
    assert np.allclose(
        voxels.volumes @ voxels.centres / voxels.volumes.sum(), [0, 0, centroid], atol=RELATIVE * 0.06
    )


def test_centroids_lie_inside_the_body():
    model = load_object_model(spec_of({"box": {"size_m": [0.06, 0.05, 0.2]}}), None, "")
    voxels = voxelise(model, 0.0061, WALL)
    assert np.all((voxels.shell > -1e-12) & (voxels.shell < 1 + 1e-12))
    assert np.all(model.depth(voxels.centres) > -1e-9)
    both = voxels.shell[:, None] * voxels.shell_centres + (1 - voxels.shell)[:, None] * voxels.core_centres
    assert np.allclose(both, voxels.centres, atol=2e-6)


def test_pitch_must_be_positive():
    model = load_object_model(spec_of({"box": {"size_m": [0.06, 0.05, 0.2]}}), None, "")
    with pytest.raises(ValueError, match="above 0"):
        voxelise(model, 0.0, WALL)
