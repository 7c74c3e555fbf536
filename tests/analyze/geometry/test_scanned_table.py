"""Clouds with a part of the table, which are refused, and with a foot about as thin as their noise."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from analyze.errors import ShapeError
from tests.analyze.geometry.test_shape_files import SIZE, box_cloud, box_mesh, cloud_bytes, load


@pytest.mark.parametrize(("thickness", "noise"), [(1.0, 0.3), (1.0, 0.5), (2.0, 0.9)])
def test_foot_within_the_noise_is_not_taken_for_a_table(thickness, noise):
    lamp = trimesh.boolean.union([box_mesh(), box_mesh([180, 160, thickness], (0, 0, -100 + thickness / 2))])
    points, face = trimesh.sample.sample_surface(lamp, 15_000, seed=1)
    off = np.clip(np.random.default_rng(1).normal(0, noise, len(points)), -2 * noise, 2 * noise)
    with pytest.raises(ShapeError, match=r"has a foot or flange that extends \d+ mm .* or give a mesh"):
        load(*cloud_bytes("xyz", points + off[:, None] * lamp.face_normals[face]), mass=0.2)


@pytest.mark.parametrize("table_noise", [0.3, 0.5])
def test_a_table_that_the_object_hides_is_refused(table_noise):
    """The table is not seen beneath the object, whose underside is missing; it may scatter more."""
    rng = np.random.default_rng(1)
    table = rng.uniform(-150, 150, (8000, 3)) * [1, 1, 0]
    table = table[(np.abs(table[:, 0]) > SIZE[0] / 2) | (np.abs(table[:, 1]) > SIZE[1] / 2)]
    table[:, 2] = rng.normal(-SIZE[2] / 2, table_noise, len(table))
    box = box_cloud(noise=0.3, count=8000)
    with pytest.raises(ShapeError, match="seems to contain the table"):
        load(*cloud_bytes("xyz", np.vstack([box[box[:, 2] > 1 - SIZE[2] / 2], table])))
