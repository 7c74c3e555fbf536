"""Radii of edges before any strike: stated, named, seen on a cloud, or not given."""

from __future__ import annotations

import io

import numpy as np
import pytest

from analyze.geometry.edge_radius import ASSUMED, edge_radius, stated_radius
from analyze.geometry.object_model import ObjectModel, load_object_model
from analyze.planning.hypothesis import hypothesis
from analyze.planning.pivots import pivot_axes
from analyze.planning.stable_planes import resting_planes
from analyze.types import RadiusSource
from schemas.object_spec import ObjectSpec
from tests.analyze.geometry.rounded_cloud import rounded_box_cloud
from tests.analyze.geometry.shapes import spec_of

SIZE = (0.06, 0.05, 0.15)
BOX = {"box": {"size_m": list(SIZE)}}
BOTTOM, ALONG = np.array([0.03, 0.0, -0.075]), np.array([0.0, 1.0, 0.0])


def cloud(noise: float, count: int, **more) -> tuple[ObjectSpec, ObjectModel]:
    """Box with 2 mm horizontal and 0.3 mm upright edges, as a point cloud."""
    points = rounded_box_cloud(SIZE, 2e-3, noise, count, 1, vertical_radius=3e-4)
    text = io.BytesIO()
    np.savetxt(text, 1e3 * points, fmt="%.6f")
    spec = spec_of({"file": "c.xyz", "unit": "mm"}, 0.1, **more)
    return spec, load_object_model(spec, text.getvalue(), "c.xyz")


@pytest.fixture(scope="module")
def scanned() -> tuple[ObjectSpec, ObjectModel]:
    return cloud(1e-4, 20_000)


def test_radius_left_out_is_not_given_and_never_exact():
    assert stated_radius(spec_of(BOX)) == ASSUMED
    as_older_recordings = spec_of(BOX, edge_radius_m=0.0, edge_radius_sd_m=0.0)
    assert stated_radius(as_older_recordings) == ASSUMED
    without_sd = stated_radius(spec_of(BOX, edge_radius_m=0.001))
    assert without_sd.common_sd == pytest.approx(3e-4)
    assert stated_radius(spec_of(BOX, edge_radius_m=0.0)).sd >= 1e-4


def test_wide_statement_holds_for_each_edge_and_a_precise_one_for_all():
    """1.15 ± 0.85 mm cannot be an error of measurement: such edges differ, most of all from face to face."""
    wide = stated_radius(spec_of(BOX, edge_radius_m=1.15e-3, edge_radius_sd_m=8.5e-4))
    assert wide.own_sd > 0.6 * wide.common_sd
    assert wide.face_sd > 1.2 * wide.common_sd
    precise = stated_radius(spec_of(BOX, edge_radius_m=1e-3, edge_radius_sd_m=2e-4))
    assert precise.own_sd == precise.face_sd == pytest.approx(0.64e-4)


def test_edge_named_in_the_object_file_has_its_own_radius():
    spec = spec_of(BOX, edge_radius_m=0.001, edge=[{"id": "p4e0", "radius_m": 0.003}])
    model = load_object_model(spec, None, "")
    for name in ("p4e0", "2:p4e0"):
        own = edge_radius(spec, model, name, BOTTOM, ALONG)
        assert (own.mean, own.source, own.common_sd) == (0.003, RadiusSource.EDGE, 0.0)
    assert edge_radius(spec, model, "p4e1", BOTTOM, ALONG).source is RadiusSource.STATED
    axes = {axis.id: axis for axis in pivot_axes(model, spec, resting_planes(model), hypothesis(model))}
    assert axes["p4e0"].radius == 0.003
    assert {axis.radius for name, axis in axes.items() if name != "p4e0"} == {0.001}


def test_cloud_shows_the_radius_of_each_edge(scanned):
    spec, model = scanned
    axes = pivot_axes(model, spec, resting_planes(model), hypothesis(model))
    assert len(axes) >= 20
    for axis in axes:
        upright = abs(axis.direction[2]) > 0.9
        found = edge_radius(spec, model, axis.id, axis.edge[0], axis.direction)
        assert found.source is RadiusSource.SCAN
        assert abs(found.mean - (3e-4 if upright else 2e-3)) < 2.5 * found.sd
        assert found.sd < 3e-4
        assert axis.radius == found.mean


def test_sparse_cloud_shows_no_radius():
    spec, model = cloud(5e-4, 400)
    for axis in pivot_axes(model, spec, resting_planes(model), hypothesis(model)):
        assert edge_radius(spec, model, axis.id, axis.edge[0], axis.direction).sd >= 3e-4


def test_statement_of_a_smaller_radius_than_the_cloud_shows_does_not_count(scanned):
    _, model = scanned
    wrong = spec_of({"file": "c.xyz", "unit": "mm"}, edge_radius_m=3e-4, edge_radius_sd_m=5e-5)
    right = spec_of({"file": "c.xyz", "unit": "mm"}, edge_radius_m=2e-3, edge_radius_sd_m=5e-5)
    assert edge_radius(wrong, model, "p0e0", BOTTOM, ALONG).source is RadiusSource.SCAN
    larger = spec_of({"file": "c.xyz", "unit": "mm"}, edge_radius_m=4e-3, edge_radius_sd_m=5e-5)
    assert edge_radius(right, model, "p0e0", BOTTOM, ALONG).source is RadiusSource.STATED
    assert edge_radius(larger, model, "p0e0", BOTTOM, ALONG).source is RadiusSource.STATED
