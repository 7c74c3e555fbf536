"""The striker meets the object where nothing of it is, or comes, in the way of tip and arm."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from analyze.geometry.object_model import load_object_model
from analyze.planning import impact
from analyze.planning.clearance import HEIGHT_STEP, LANES, Section, meets_squarely, without_noise
from analyze.planning.hypothesis import hypothesis
from analyze.planning.impact import StrikerModel, impact_points
from analyze.planning.pivots import pivot_axes, swing
from analyze.planning.stable_planes import resting_planes
from tests.analyze.geometry.shapes import box_triangles, spec_of, stl
from tests.analyze.planning.random_bodies import FAR_TAG

POST = ((60.0, 60.0, 150.0), (0.0, 0.0, 75.0))


def points_towards_plus_x(*more):
    """Impact points of a post with more boxes (size, centre) [mm], struck upright in its +x direction."""
    triangles = np.concatenate([box_triangles(np.array(size), at) for size, at in (POST, *more)])
    return struck_points(stl(triangles))


def struck_points(file):
    """Impact points of an object (STL) [mm], struck upright in its +x direction."""
    spec = spec_of({"file": "p.stl", "unit": "mm"}, markers=[FAR_TAG])
    model = load_object_model(spec, file, "p.stl")
    believed = hypothesis(model)
    axis = next(
        each
        for each in pivot_axes(model, spec, resting_planes(model), believed)
        if each.plane.up[2] > 0.99 and each.tip[0] > 0.99
    )
    expected = swing(axis, believed.region.centre, spec.mass_kg, believed.unit_inertia, 9.81)
    return impact_points(model, axis, [expected], [], StrikerModel())


def heights(*more):
    return np.array([point.height for point in points_towards_plus_x(*more)])


def test_plain_post_is_struck_anywhere():
    assert 0.015 <= heights().min() < 0.017
    assert 0.138 < heights().max() < 0.141


def test_jug_is_not_struck_above_its_handle():
    """The handle, 15 to 45 mm behind the wall, rises by 7 to 11 mm in the first 8 degrees."""
    handle = (
        ((30.0, 14.0, 10.0), (-45.0, 0.0, 110.0)),
        ((30.0, 14.0, 10.0), (-45.0, 0.0, 40.0)),
        ((10.0, 14.0, 80.0), (-65.0, 0.0, 75.0)),
    )
    points = points_towards_plus_x(*handle)
    found = np.array([point.height for point in points])
    assert not np.any((found > 0.115) & (found < 0.130))
    on_handle = [point for point in points if 0.045 < point.height < 0.105]
    assert on_handle
    assert all(abs(point.point[0] + 0.070) < 1e-6 for point in on_handle)


def test_rib_beside_the_path_is_in_the_way():
    """A rib from 5 to 12 mm beside the path stands before the lower half of the wall."""
    rib = ((10.0, 7.0, 60.0), (-35.0, 8.5, 30.0))
    assert heights(rib).min() > 0.065


def test_tip_does_not_meet_a_narrow_rail():
    """A rail of 3 mm: the tip, 2 mm off its path, glances off the rail's corner."""
    assert not len(heights(((20.0, 3.0, 150.0), (-40.0, 0.0, 75.0))))


def test_arm_keeps_clear_of_a_lid_that_juts_out():
    """The arm, 120 mm long, would meet a lid 150 mm up, 12 mm proud of the wall; the lid can be struck."""
    lid = ((84.0, 84.0, 30.0), (0.0, 0.0, 165.0))
    points = points_towards_plus_x(lid)
    on_lid = [point for point in points if abs(point.point[0] + 0.042) < 1e-6]
    assert on_lid
    assert all(point.height < 0.031 for point in points if point not in on_lid)


def test_places_to_strike_are_computed_once_for_all_strikers_with_one_reach(monkeypatch):
    """Mats and masses are tried in turn where an object is refused: 16 times for some."""
    spec = spec_of({"file": "p.stl", "unit": "mm"}, markers=[FAR_TAG])
    model = load_object_model(spec, stl(box_triangles(np.array(POST[0]), POST[1])), "p.stl")
    believed = hypothesis(model)
    axis = pivot_axes(model, spec, resting_planes(model), believed)[0]
    expected = swing(axis, believed.region.centre, spec.mass_kg, believed.unit_inertia, 9.81)
    first = impact_points(model, axis, [expected], [], StrikerModel())
    lower = impact_points(model, axis, [expected], [], StrikerModel(highest_m=0.02))
    monkeypatch.setattr(impact, "section", lambda *_: pytest.fail("computed again"))
    again = impact_points(model, axis, [expected], [], StrikerModel(effective_mass_kg=1.2))
    assert [each.height for each in again] == [each.height for each in first]
    assert max((each.height for each in lower), default=0.0) <= 0.02 < first[-1].height


def cut_of_a_wall(step_m: float = 0.0, noise: float = 5e-4) -> tuple[list[Section], np.ndarray]:
    """Cuts through a noisy upright wall, whose part above 60 mm stands back by `step_m`."""
    rng, wall = np.random.default_rng(1), np.arange(0.0005, 0.12, HEIGHT_STEP)
    distance = np.where(wall > 0.06, 0.1 + step_m, 0.1)
    glance = np.full(len(wall), np.radians(35.0))  # of a face 1 mm wide, tilted by the noise
    return [Section(beside, distance + rng.normal(0, noise, len(wall)), glance) for beside in LANES], wall


def test_noise_of_a_scan_tilts_no_wall():
    """By its single faces no place on it could be struck; its points lie within 0.2 mm of the wall."""
    noisy, wall = cut_of_a_wall()
    middle = np.arange(20, 100)
    assert not np.any(meets_squarely(noisy, wall, middle))
    smooth = without_noise(noisy, wall, 5e-4)
    assert np.all(meets_squarely(smooth, wall, middle))
    assert np.abs(smooth[3].distance[middle] - 0.1).max() < 2.5e-4
    assert np.degrees(smooth[3].glance[middle]).max() < 6


def test_step_of_a_noisy_wall_stays():
    noisy, wall = cut_of_a_wall(step_m=0.008)
    smooth = without_noise(noisy, wall, 5e-4)
    assert np.abs(smooth[3].distance - np.where(wall > 0.06, 0.108, 0.1)).max() < 5e-4
    near_step = np.flatnonzero(np.abs(wall - 0.06) < 0.003)
    assert not np.any(meets_squarely(smooth, wall, near_step))


@pytest.mark.parametrize("sd_mm", [0.2, 0.5])
def test_scanned_post_is_struck_nearly_anywhere(sd_mm):
    """Scanned with triangles of 2.5 mm: the planner found no place at 0.5 mm of noise."""
    box = trimesh.creation.box(POST[0], transform=trimesh.transformations.translation_matrix(POST[1]))
    mesh = box.subdivide_to_size(2.5)
    vertices = mesh.vertices + np.random.default_rng(2).normal(0, sd_mm, mesh.vertices.shape)
    found = np.array([point.height for point in struck_points(stl(vertices[mesh.faces]))])
    assert len(found) > 80
    assert found.min() < 0.03
    assert found.max() > 0.12
