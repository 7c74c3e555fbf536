"""Resting planes, Q, pivots and centre lines of bodies with known results."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from analyze.geometry.even_samples import even_samples
from analyze.geometry.object_model import load_object_model
from analyze.planning.hypothesis import hypothesis, paper_hypothesis
from analyze.planning.pivots import pivot_axes, swing
from analyze.planning.stable_planes import paper_stable_planes, resting_planes
from tests.analyze.geometry.shapes import box_triangles, spec_of, stl
from tests.analyze.planning.planned import stable_planes

SIZE = np.array([0.06, 0.05, 0.2])
MICROMETRE = 1e-6


def box_axes(**more):
    spec = spec_of({"box": {"size_m": list(SIZE)}}, **more)
    model = load_object_model(spec, None, "")
    believed = hypothesis(model)
    planes = stable_planes(resting_planes(model), believed.region)
    return spec, believed, planes, pivot_axes(model, spec, planes, believed)


def frustum(low: float, high: float, height: float) -> np.ndarray:
    """Triangles of a square frustum, half edges `low` at z = 0 and `high` at `height` [mm]."""
    triangles = box_triangles(np.full(3, 2.0)).copy()
    z = triangles[..., 2]
    half = np.where(z < 0, low, high)
    return np.stack([triangles[..., 0] * half, triangles[..., 1] * half, (z + 1) / 2 * height], axis=-1)


def hexagon(radius: float, height: float) -> np.ndarray:
    """Triangles of an upright prism on a regular hexagon [mm]."""
    turn = np.arange(6) * np.pi / 3
    ring = np.column_stack([radius * np.cos(turn), radius * np.sin(turn), np.zeros(6)])
    after, up = np.roll(ring, -1, axis=0), np.array([0.0, 0.0, height])
    middle = np.zeros((6, 3))
    sides = [np.stack([ring, after, after + up], axis=1), np.stack([ring, after + up, ring + up], axis=1)]
    return np.concatenate(
        [
            *sides,
            np.stack([middle, after, ring], axis=1),
            np.stack([middle + up, ring + up, after + up], axis=1),
        ]
    )


def test_box_has_six_planes_and_twenty_four_axes():
    _, _, planes, axes = box_axes()
    assert len(planes) == 6
    assert np.isclose(
        sum(plane.area for plane in planes), 2 * (SIZE[0] * SIZE[1] + SIZE[0] * SIZE[2] + SIZE[1] * SIZE[2])
    )
    assert len(axes) == 24
    for axis in axes:
        R = axis.R_world_object
        assert np.allclose(R @ R.T, np.eye(3), atol=1e-12)
        assert np.isclose(np.linalg.det(R), 1.0)


def test_centre_line_lies_inside_both_faces_by_the_radius():
    _, _, _, axes = box_axes(edge_radius_m=0.002)
    for axis in axes:
        depth = SIZE / 2 - np.abs(axis.point)
        assert np.allclose(np.sort(depth)[:2], 0.002, atol=MICROMETRE)
        world = np.array(axis.p_world_object) + axis.R_world_object @ axis.point
        assert np.allclose(world, [0, 0, 0.002], atol=MICROMETRE)


def test_object_stands_on_the_table_and_tips_over_its_far_edge():
    spec = spec_of({"box": {"size_m": list(SIZE)}}, edge_radius_m=0.002)
    model = load_object_model(spec, None, "")
    for axis in box_axes(edge_radius_m=0.002)[3]:
        world = model.vertices @ axis.R_world_object.T + axis.p_world_object
        assert np.isclose(world[:, 2].min(), 0, atol=MICROMETRE)
        assert np.isclose(world[:, 0].max(), 0.002, atol=MICROMETRE)


def test_swing_of_a_uniform_box_is_analytic():
    _, believed, _, axes = box_axes(edge_radius_m=0.0)
    upright = [axis for axis in axes if abs(axis.plane.up[2]) > 0.9 and abs(axis.tip[0]) > 0.9]
    solid = np.diag(np.sum(SIZE**2) - SIZE**2) / 12
    for axis in upright:
        expected = swing(axis, np.zeros(3), 0.05, solid, 9.81)
        distance = np.hypot(0.03, 0.1)
        assert np.isclose(expected.phi, np.arctan2(0.03, 0.1))
        assert np.isclose(expected.distance, distance)
        assert np.isclose(expected.i_edge, 0.05 * (0.06**2 + 0.2**2) / 3)
        assert np.isclose(expected.k, 9.81 * distance / ((0.06**2 + 0.2**2) / 3))
    assert np.allclose(believed.region.centre, 0, atol=MICROMETRE)
    assert len(upright) == 4


def test_leaning_walls_move_the_centre_line():
    spec = spec_of({"file": "f.stl", "unit": "mm"}, edge_radius_m=0.002)
    model = load_object_model(spec, stl(frustum(30, 20, 60)), "f.stl")
    believed = hypothesis(model)
    planes = stable_planes(resting_planes(model), believed.region)
    base = [axis for axis in pivot_axes(model, spec, planes, believed) if axis.plane.up[2] > 0.99]
    assert len(base) == 4
    for axis in base:
        assert np.isclose(axis.point[2], 0.002, atol=MICROMETRE)
        assert np.isclose(model.depth(axis.point[None])[0], 0.002, atol=2 * MICROMETRE)
        assert np.isclose(
            -np.max(model.hull_planes[np.abs(model.hull_planes[:, 2]) < 0.9] @ [*axis.point, 1]),
            0.002,
            atol=2 * MICROMETRE,
        )


def test_narrow_base_is_not_stable():
    spec = spec_of({"file": "f.stl", "unit": "mm"})
    model = load_object_model(spec, stl(frustum(3, 25, 60)), "f.stl")
    region = hypothesis(model).region
    ups = [plane.up[2] for plane in stable_planes(resting_planes(model), region)]
    assert all(up < 0.99 for up in ups)
    assert min(ups) < -0.99


def marker(marker_id, normal, up, centre):
    z, y = np.array(normal, float), np.array(up, float)
    matrix = np.eye(4)
    matrix[:3, :3] = np.stack([np.cross(y, z), y, z], axis=1)
    matrix[:3, 3] = centre
    return {"id": marker_id, "size_m": 0.03, "T_object_marker": matrix.tolist()}


def test_cylinder_rests_on_its_ends_and_rolls_over_its_rim():
    markers = [
        marker(i, [np.cos(a), np.sin(a), 0], [0, 0, 1], [0.036 * np.cos(a), 0.036 * np.sin(a), 0])
        for i, a in enumerate([0.0, 1.0, 4.0])
    ]
    spec = spec_of({"cylinder": {"radius_m": 0.036, "height_m": 0.15}}, markers=markers, edge_radius_m=0.001)
    model = load_object_model(spec, None, "")
    believed = hypothesis(model)
    planes = stable_planes(resting_planes(model), believed.region)
    assert [abs(plane.up[2]) > 0.999 for plane in planes] == [True, True]
    axes = pivot_axes(model, spec, planes, believed)
    assert len(axes) == 12, "three markers, each seen from either end, on two faces"
    for axis in axes:
        assert axis.rolls
        assert np.isclose(np.hypot(*axis.point[:2]), 0.035, atol=2e-5)
        assert np.isclose(abs(axis.point[2]), 0.074, atol=MICROMETRE)
    facing = {
        (int(np.argmax(np.abs(along))), bool(np.max(np.abs(along)) > np.max(along)))
        for axis in axes
        for along in [[axis.direction @ np.array(m["T_object_marker"])[:3, 2] for m in markers]]
    }
    assert facing == {(number, end) for number in range(3) for end in (True, False)}


def test_paper_drops_one_of_two_parallel_planes():
    spec = spec_of({"box": {"size_m": list(SIZE)}})
    model = load_object_model(spec, None, "")
    kept = paper_stable_planes(resting_planes(model), hypothesis(model).region)
    assert [round(plane.area, 6) for plane in kept] == [0.012, 0.01]


def test_papers_region_grows_with_the_number_of_points_and_ours_does_not():
    spec = spec_of({"file": "f.stl", "unit": "mm"})
    model = load_object_model(spec, stl(frustum(30, 20, 120)), "f.stl")
    few, many = (even_samples(model.vertices, model.faces, count)[0] for count in (12, 3000))
    extent = np.ptp(model.hull_vertices, axis=0).max()
    assert paper_hypothesis(few).half.max() < paper_hypothesis(many).half.max() <= extent
    assert hypothesis(model).region.half.max() < extent / 3


def test_region_turns_with_the_object():
    turn = Rotation.from_euler("xyz", [0.3, -1.0, 2.0])
    triangles = frustum(30, 20, 120) * [1.0, 0.8, 1.0]
    spec = spec_of({"file": "f.stl", "unit": "mm"})
    plain = hypothesis(load_object_model(spec, stl(triangles), "f.stl"))
    turned = hypothesis(
        load_object_model(spec, stl(turn.apply(triangles.reshape(-1, 3)).reshape(-1, 3, 3)), "f.stl")
    )
    assert np.allclose(turned.region.centre, turn.apply(plain.region.centre), atol=MICROMETRE)
    assert np.allclose(np.sort(turned.region.half), np.sort(plain.region.half), atol=2e-4)


@pytest.mark.parametrize("shape", ["square frustum", "square box", "prism of six"])
@pytest.mark.parametrize("angle_deg", [15, 30, 45])
def test_bodies_without_principal_axes_do_not_depend_on_the_frame(shape, angle_deg):
    """A regular base has no principal axes: Q is round, and the stable faces do not depend on the frame."""
    triangles = {
        "square frustum": frustum(44, 100, 120),
        "square box": frustum(60, 60, 150),
        "prism of six": hexagon(30, 120),
    }[shape]
    turn = Rotation.from_euler("xyz", [angle_deg, 0.5 * angle_deg, angle_deg], degrees=True)
    spec = spec_of({"file": "f.stl", "unit": "mm"}, 0.2)
    plain, turned = (
        load_object_model(spec, stl(r.apply(triangles.reshape(-1, 3)).reshape(-1, 3, 3)), "f.stl")
        for r in (Rotation.identity(), turn)
    )
    before, after = hypothesis(plain).region, hypothesis(turned).region
    R = turn.as_matrix()
    assert np.allclose(R.T @ after.covariance() @ R, before.covariance(), atol=1e-8)
    margins = [
        sorted(plane.margin_of(region) for plane in resting_planes(model))
        for model, region in ((plain, before), (turned, after))
    ]
    assert np.allclose(*margins, atol=2e-5)


def test_nearly_square_base_is_treated_as_square():
    spec = spec_of({"box": {"size_m": [0.06, 0.06, 0.15]}})
    near = spec_of({"box": {"size_m": [0.06, 0.0603, 0.15]}})
    square, other = (hypothesis(load_object_model(each, None, "")).region for each in (spec, near))
    assert np.allclose(square.half, other.half, rtol=0.01)
    assert square.groups == other.groups == (0, 1, 1)


@pytest.mark.parametrize("mass", [0.02, 0.2])
def test_phi_and_k_do_not_depend_on_the_mass(mass):
    _, believed, _, axes = box_axes(mass=mass)
    light, heavy = (
        swing(axes[0], believed.region.centre, m, believed.unit_inertia, 9.81) for m in (0.05, mass)
    )
    assert np.isclose(light.k, heavy.k)
    assert np.isclose(light.phi, heavy.phi)
