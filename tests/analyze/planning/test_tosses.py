"""Planned tosses: spin axes, place of the flight, hold, and refusals with a remedy that works."""

from __future__ import annotations

import dataclasses
from functools import cache

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from analyze.errors import PlanError
from analyze.geometry.object_model import ObjectModel, load_object_model
from analyze.geometry.rotations import apply, inverse_transform
from analyze.planning import view
from analyze.planning.examine import Bench
from analyze.planning.followed_squares import side_squares, tag_squares
from analyze.planning.hypothesis import hypothesis
from analyze.planning.impact import GRAVITY, StrikerModel
from analyze.planning.toss_hold import SPIN_WORLD, best_hold
from analyze.planning.tosses import (
    LEAST_TAG_PX,
    LONGEST_S,
    MARGIN_M,
    SHORTEST_S,
    plan_tosses,
    principal_angles,
    spin_axes,
    squares_reach,
    toss_notes,
)
from analyze.reading.object_file import read_object_files
from analyze.tracking.camera_model import project
from schemas.object_spec import ObjectSpec
from tests.places import OBJECTS

BENCH = Bench(StrikerModel(), view.default_camera(), 0.6)


@cache
def thing(name: str = "carton") -> tuple[ObjectModel, ObjectSpec]:
    files = read_object_files(OBJECTS / f"{name}.toml")
    return load_object_model(files.spec, files.shape_bytes, files.shape_name), files.spec


def with_tags(spec: ObjectSpec, size_m: float, count: int = 6) -> ObjectSpec:
    tags = [marker.model_copy(update={"size_m": size_m}) for marker in spec.marker[:count]]
    return spec.model_copy(update={"marker": tags})


def degrees_between(axes: list[np.ndarray]) -> np.ndarray:
    along = np.abs(np.array(axes) @ np.array(axes).T)
    return np.degrees(np.arccos(np.clip(along[np.triu_indices(len(axes), 1)], 0, 1)))


def test_axes_of_a_box_are_the_diagonals_of_its_principal_axes():
    turned = Rotation.from_rotvec([0.3, -0.2, 0.5]).as_matrix()
    inertia = turned @ np.diag([1.0, 1.6, 2.1]) @ turned.T
    axes = spin_axes(inertia, 4)
    assert np.degrees(principal_angles(inertia, np.array(axes))) == pytest.approx([54.74] * 4, abs=0.01)
    assert degrees_between(axes) == pytest.approx([70.53] * 6, abs=0.01)


def test_axes_of_a_can_are_between_its_axis_and_its_equator():
    inertia = np.diag([2.0, 2.0, 1.0])
    axes = spin_axes(inertia, 3)
    assert np.degrees(principal_angles(inertia, np.array(axes))).min() > 40
    assert degrees_between(axes).min() > 45
    assert np.degrees(principal_angles(inertia, np.array([[1.0, 1.0, 0.0]]) / np.sqrt(2))) == pytest.approx(
        [0]
    )


def test_every_axis_of_a_cube_is_a_principal_axis():
    assert principal_angles(np.eye(3), np.array([[0.6, 0.0, 0.8]])) == pytest.approx([0.0])


@pytest.mark.parametrize("name", ["carton", "spray", "juice", "salt", "parcel"])
def test_the_image_shows_the_whole_flight_with_readable_tags(name):
    model, spec = thing(name)
    com = hypothesis(model).region.centre
    tosses = plan_tosses(spec, hypothesis(model), BENCH, 3)
    assert [toss.id for toss in tosses] == ["t1", "t2", "t3"]
    camera, reach = BENCH.camera, squares_reach(tag_squares(spec), com)
    for toss in tosses:
        assert SHORTEST_S <= toss.flight_s.target <= LONGEST_S
        rise = GRAVITY * toss.flight_s.target**2 / 8
        apex = np.array(toss.p_world_apex)
        beside = reach + 0.9 * MARGIN_M
        ends = apex + np.array([[0, 0, beside], [0, 0, -rise - beside]])
        in_camera = apply(inverse_transform(camera.T_world_camera), ends)
        pixels = project(camera, in_camera)
        assert (pixels > 0).all()
        assert (pixels < [camera.width, camera.height]).all()
        # The line of sight passes over the table's far edge.
        eye = camera.T_world_camera[:3, 3]
        share = (BENCH.table_far_edge - eye[1]) / (ends[:, 1] - eye[1])
        assert (eye[2] + share * (ends[:, 2] - eye[2]) > 0).all()
        smallest = min(marker.size_m for marker in spec.marker)
        assert smallest * camera.K[0, 0] / in_camera[0, 2] == pytest.approx(toss.smallest_tag_px, rel=1e-6)
        assert toss.smallest_tag_px >= LEAST_TAG_PX


def test_nearer_tags_are_larger_where_the_longest_flight_fits():
    model, spec = thing()
    small = plan_tosses(with_tags(spec, 0.036), hypothesis(model), BENCH, 1)[0]
    large = plan_tosses(with_tags(spec, 0.05), hypothesis(model), BENCH, 1)[0]
    assert small.flight_s.target == large.flight_s.target == LONGEST_S
    assert large.smallest_tag_px > 1.3 * LEAST_TAG_PX


def test_a_short_table_hides_less():
    model, spec = thing()
    deep = plan_tosses(spec, hypothesis(model), BENCH, 1)[0]
    short = plan_tosses(spec, hypothesis(model), dataclasses.replace(BENCH, table_far_edge=0.2), 1)[0]
    assert short.flight_s.target > deep.flight_s.target
    assert short.p_world_apex[1] - 0.01 <= deep.p_world_apex[1]


def test_a_camera_sees_a_tag_in_every_phase_of_a_turn():
    _, spec = thing()
    for axis in spin_axes(hypothesis(thing()[0]).unit_inertia, 4):
        hold = best_hold(tag_squares(spec), axis)
        assert hold.seen == 1.0
        assert hold.R_world_object @ axis == pytest.approx(SPIN_WORLD, abs=1e-9)
        marker = next(each for each in spec.marker if f"tag {each.name}" == hold.facing)
        assert (hold.R_world_object @ np.array(marker.T_object_marker)[:3, 2])[1] < -0.7


@pytest.mark.parametrize("axis", [[1.0, 0, 0], [-1.0, 0, 0], [0, 0, 1.0]])
def test_an_axis_along_or_against_the_spin_can_be_held(axis):
    hold = best_hold(tag_squares(thing()[1]), np.array(axis))
    assert hold.R_world_object @ axis == pytest.approx(SPIN_WORLD, abs=1e-9)


def test_small_tags_are_refused_and_tags_of_the_stated_size_are_planned():
    model, spec = thing()
    with pytest.raises(PlanError, match=r"no toss fits the image: 0\.3 s in the air need") as caught:
        plan_tosses(with_tags(spec, 0.015), hypothesis(model), BENCH, 3)
    size = float(str(caught.value).split("glue tags of ")[1].split(" mm")[0])
    plan_tosses(with_tags(spec, size / 1000), hypothesis(model), BENCH, 3)


def test_tags_on_few_sides_are_refused():
    model, spec = thing()
    with pytest.raises(PlanError, match="of each turn: glue tags on more sides of the object"):
        plan_tosses(with_tags(spec, 0.03, 1), hypothesis(model), BENCH, 1)


def test_tags_without_places_are_refused():
    model, spec = thing()
    bare = [marker.model_copy(update={"T_object_marker": None}) for marker in spec.marker]
    with pytest.raises(PlanError, match="no marker has a T_object_marker"):
        plan_tosses(spec.model_copy(update={"marker": bare}), hypothesis(model), BENCH, 1)


def test_an_untagged_object_is_followed_by_its_sides():
    model, spec = thing()
    spec = spec.model_copy(update={"marker": []})
    tosses = plan_tosses(spec, hypothesis(model), BENCH, 3, side_squares(model))
    for toss in tosses:
        assert toss.smallest_tag_px is None
        assert SHORTEST_S <= toss.flight_s.target <= LONGEST_S
        assert "side towards the camera" in toss.card
    with pytest.raises(
        PlanError, match="has no tags: tosses alone need them at known places, or strikes in the"
    ):
        plan_tosses(spec, hypothesis(model), BENCH, 3)


def test_narrow_sides_are_not_counted_on():
    model, _ = thing()
    flat = dataclasses.replace(model, bounds=model.bounds * [1.0, 1.0, 0.02])
    names = {square.name for square in side_squares(flat)}
    assert names == {"the +z side", "the −z side"}
    for square in side_squares(model):
        inside = square.corners - square.T_object_square[:3, 3]
        assert np.abs(inside @ square.T_object_square[:3, 2]).max() < 1e-12


def test_a_body_whose_every_axis_is_principal_is_noted():
    model, spec = thing()
    believed = dataclasses.replace(hypothesis(model), unit_inertia=np.eye(3) * 1e-3)
    assert "every axis is a principal axis" in toss_notes(plan_tosses(spec, believed, BENCH, 2))[0]
    assert toss_notes(plan_tosses(spec, hypothesis(model), BENCH, 2)) == []
