"""Rolling outline of an object, and the angle at which its next face lands, from its shape."""

from __future__ import annotations

import math

import numpy as np
import pytest
import trimesh

from analyze.geometry.object_model import load_object_model
from analyze.motion.settings import MotionSettings
from analyze.motion.strike import analyse_motion
from analyze.pipeline.sections import MeshSections, next_face_angle, rolling_outline, strike_supports
from analyze.planning.hypothesis import hypothesis
from analyze.planning.pivots import pivot_axes
from analyze.planning.stable_planes import resting_planes
from analyze.replay import views
from schemas.object_spec import Box, LengthUnit, MarkerSpec, ObjectSpec, Shape
from schemas.strike_plan import Pivot
from tests.analyze.geometry.shapes import spec_of, stl
from tests.analyze.motion.rolling import RollingBody, as_tracked, draw_rolling
from tests.analyze.motion.test_rolling_until import HANDLE, RADIUS, cup, handle_lands
from tests.analyze.motion.tipping import planned
from tests.analyze.planning.random_bodies import convex_triangles
from tests.analyze.planning.test_planes_and_pivots import hexagon

BODY = RollingBody(0.04, 0.02, (-0.02, 0.06), 0.003)


def an_object(shape):
    return ObjectSpec(
        name="bowl", mass_kg=0.6, mass_sd_kg=1e-4, shape=shape, marker=[MarkerSpec(id=1, size_m=0.03)]
    )


def moulded(body=BODY, width=0.08):
    """Extruded body with an elliptic flank, and a strike over it with the pivot at the ellipse's centre."""
    outline = body.outline(24)
    points = np.concatenate(
        [
            np.column_stack([outline[:, 0], np.full(len(outline), y), outline[:, 1]])
            for y in (-width / 2, width / 2)
        ]
    )
    data = trimesh.PointCloud(points).convex_hull.export(file_type="stl")
    spec = an_object(Shape(file="bowl.stl", unit=LengthUnit.METRE, surface_sd_m=0.0))
    strike = planned(0.0, 0.4)
    strike = strike.model_copy(update={"pivot": strike.pivot.model_copy(update={"point": [0.0, 0.0, 0.0]})})
    return spec, data, strike


def test_mesh_with_a_flank_has_a_rolling_outline():
    spec, data, strike = moulded()
    for section in (
        rolling_outline(load_object_model(spec, data, "bowl.stl"), strike),
        MeshSections(spec, lambda: data).outline(strike),
    ):
        assert section is not None
        theta = np.radians(np.linspace(2, 60, 30))
        height, _, _ = section.evaluate(theta)
        assert np.abs(height - np.hypot(BODY.a * np.sin(theta), BODY.b * np.cos(theta))).max() < 2e-6


def test_box_has_no_rolling_outline():
    spec = an_object(Shape(box=Box(size_m=[0.06, 0.05, 0.2])))
    assert rolling_outline(load_object_model(spec, None, "box"), planned(0.002)) is None
    assert MeshSections(spec, lambda: None).outline(planned(0.002)) is None


def test_unreadable_shape_gives_no_outline_and_no_error():
    spec, _, strike = moulded()
    assert MeshSections(spec, lambda: b"no mesh at all").outline(strike) is None


def test_bevel_has_no_rolling_outline():
    bevel = RollingBody(0.01, 0.01, (-0.02, 0.06), 0.003)
    outline = bevel.outline(1)
    assert len(outline) == 5
    points = np.concatenate(
        [np.column_stack([outline[:, 0], np.full(5, y), outline[:, 1]]) for y in (-0.04, 0.04)]
    )
    data = trimesh.PointCloud(points).convex_hull.export(file_type="stl")
    spec, _, strike = moulded()
    assert rolling_outline(load_object_model(spec, data, "bowl.stl"), strike) is None


def test_replay_poses_roll_as_fitted():
    rng = np.random.default_rng(4)
    body = draw_rolling(rng, 0.04, 0.02)
    spec, data, strike = moulded(body)
    motion, task = as_tracked(body, 1.2, math.radians(0.02), rng)
    found = analyse_motion(motion, task, MotionSettings())
    fitted = views.fitted_curves(found.angle, found.fit)
    assert np.degrees(np.std(fitted.residual)) < 0.03
    model = load_object_model(spec, data, "bowl.stl")
    strike = strike.model_copy(update={"p_world_object": [0.0, 0.0, body.b]})
    R, p = views.object_poses(strike, found.angle, rolling_outline(model, strike))
    lowest = (model.vertices @ R[:, 2].T + p[:, 2]).min(axis=0)
    tipping = (found.angle.theta > math.radians(1)) & (found.angle.theta < math.radians(75))
    assert np.abs(lowest[tipping]).max() < 5e-5, "it stays on the table"
    assert np.ptp(p[tipping, 0]) > 0.01, "and goes along it"


def test_rounding_in_both_mesh_and_object_file_is_taken_from_the_mesh():
    """The rounding's centre is above the end of the bottom face; the planned pivot point is farther in."""
    body = RollingBody(0.006, 0.006, (-0.02, 0.06), 0.003, 0.15)
    spec, data, strike = moulded(body)
    pivot = strike.pivot.model_copy(update={"point": [-body.a, 0.0, 0.0], "radius_m": body.a})
    section = rolling_outline(
        load_object_model(spec, data, "bowl.stl"), strike.model_copy(update={"pivot": pivot})
    )
    assert section is not None
    along, over, radius = section.centre(0.4)
    np.testing.assert_allclose((along, over, radius), (body.a, 0.0, body.a), atol=5e-5)
    assert section.touches_curve(0.4)
    assert section.sd < 1e-4, "the sd is the mesh's, not that of the plan's edge"


def test_next_side_of_a_hexagon_lands_at_60_degrees_and_its_end_at_90():
    spec, data = (
        spec_of({"file": "b.stl", "unit": "mm", "surface_sd_m": 0.0}, edge_radius_m=0.001),
        stl(hexagon(35, 80)),
    )
    model, live = load_object_model(spec, data, "b.stl"), MeshSections(spec, lambda: data)
    found = set()
    for axis in pivot_axes(model, spec, resting_planes(model), hypothesis(model)):
        pivot = Pivot(
            point=axis.point.tolist(), direction=axis.direction.tolist(), radius_m=axis.radius, sd_m=axis.sd
        )
        strike = planned(0.001, 0.5).model_copy(
            update={"pivot": pivot, "R_world_object": axis.R_world_object.tolist()}
        )
        lands = next_face_angle(model, strike)
        assert live.landing_angle_rad(strike) == lands
        lengthwise = abs(float(axis.direction[2])) > 0.99
        assert math.degrees(lands) == pytest.approx(58.9 if lengthwise else 88.9, abs=0.2), (
            "a degree early, and what the surface may be off"
        )
        found.add(lengthwise)
    assert found == {True, False}


def test_body_on_a_flank_has_no_landing_angle():
    spec, data, strike = moulded()
    assert next_face_angle(load_object_model(spec, data, "bowl.stl"), strike) is None


def test_body_rolls_on_its_foot_until_its_handle_lands():
    outline = cup(HANDLE)
    points = np.concatenate(
        [np.column_stack([outline[:, 0], np.full(len(outline), y), outline[:, 1]]) for y in (-0.04, 0.04)]
    )
    data = trimesh.PointCloud(points).convex_hull.export(file_type="stl")
    spec, _, strike = moulded()
    strike = strike.model_copy(update={"phi_predicted_rad": math.radians(34)})
    model, live = load_object_model(spec, data, "bowl.stl"), MeshSections(spec, lambda: data)
    lands = next_face_angle(model, strike)
    assert lands == pytest.approx(handle_lands() - math.radians(1), abs=math.radians(1.5))
    assert live.landing_angle_rad(strike) == lands
    assert strike_supports(model, strike) is None
    section = rolling_outline(model, strike)
    assert section is not None
    assert section.centre(math.radians(30))[2] == pytest.approx(RADIUS, rel=0.1)


def test_neighbour_that_lands_before_balance_is_in_the_supports_and_the_face_after_it_lands():
    """The chamfer's outer edge carries at balance; from there on the object falls until its side lands."""
    turn, width = math.radians(15.0), 6.0
    corners, half = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]), np.array([30.0, 25.0])
    levels = [(0.0, width * math.cos(turn)), (width * math.sin(turn), 0.0), (120.0, 0.0)]
    points = np.vstack([np.column_stack([corners * (half - less), np.full(4, z)]) for z, less in levels])
    spec = spec_of({"file": "b.stl", "unit": "mm"}, edge_radius_m=1e-7, edge_radius_sd_m=1e-6)
    data = stl(convex_triangles(points))
    model, live = load_object_model(spec, data, "b.stl"), MeshSections(spec, lambda: data)
    for axis in pivot_axes(model, spec, resting_planes(model), hypothesis(model)):
        if axis.plane.up[2] < 0.999:
            continue
        pivot = Pivot(
            point=axis.point.tolist(), direction=axis.direction.tolist(), radius_m=axis.radius, sd_m=axis.sd
        )
        strike = planned(0.0, 0.5).model_copy(
            update={"pivot": pivot, "R_world_object": axis.R_world_object.tolist()}
        )
        supports = strike_supports(model, strike)
        assert supports == live.supports(strike)
        assert [math.degrees(line.takes_over_rad) for line in supports] == pytest.approx(
            [0, 15, 90], abs=0.01
        )
        assert 1e3 * supports[1].along_m == pytest.approx(width * math.cos(turn), abs=0.01)
        assert 1e3 * supports[1].up_m == pytest.approx(width * math.sin(turn), abs=0.01)
        assert math.degrees(next_face_angle(model, strike)) == pytest.approx(88.9, abs=0.2)


def test_body_on_a_flank_has_no_supports():
    spec, data, strike = moulded()
    assert strike_supports(load_object_model(spec, data, "bowl.stl"), strike) is None
