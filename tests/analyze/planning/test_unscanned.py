"""Scans with a missing side: no strike rests on the side that closes the gap or tips over its rim."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
import trimesh

from analyze.errors import PlanError
from analyze.geometry.object_model import ObjectModel, load_object_model
from analyze.planning.hypothesis import hypothesis
from analyze.planning.impact import StrikerModel
from analyze.planning.pivots import pivot_axes
from analyze.planning.stable_planes import resting_planes
from analyze.planning.unscanned import scanned_edges, scanned_planes
from analyze.planning.view import refuse_off_surface
from schemas.object_spec import ObjectSpec
from schemas.strike_plan import StrikePlan
from tests.analyze.geometry.shapes import spec_of
from tests.analyze.planning.planned import make_plan, stable_planes
from tests.analyze.planning.random_bodies import FAR_TAG

SIZE = np.array([75.0, 65.0, 130.0])
RADIUS = 0.001
LEVEL, SLOPE = -57.0, 0.15
"""height [mm] of the cut in the middle, 8 mm above the bottom, and slope of the cut along x"""


def spec_of_scan(name: str, mass: float = 0.182) -> ObjectSpec:
    return spec_of(
        {"file": name, "unit": "mm"}, mass, [FAR_TAG], edge_radius_m=RADIUS, edge_radius_sd_m=0.0003
    )


def xyz(points) -> bytes:
    return "\n".join("{:.4f} {:.4f} {:.4f}".format(*point) for point in points).encode()


def cloud(mesh: trimesh.Trimesh, count: int, noise: float = 0.1) -> np.ndarray:
    points = np.asarray(trimesh.sample.sample_surface(mesh, count, seed=1)[0])
    return points + np.random.default_rng(0).normal(0, noise, points.shape)


@cache
def cut_cloud(count: int) -> bytes:
    points = cloud(trimesh.creation.box(SIZE), count)
    return xyz(points[points[:, 2] > LEVEL + SLOPE * points[:, 0]])


@cache
def cut_mesh(ragged: float = 0.0) -> bytes:
    """STL of a box without its bottom, cut at a slant, with a rim ragged by `ragged` [mm] either way."""
    box = trimesh.creation.box(SIZE)
    for _ in range(5):
        box = box.subdivide()
    vertices = np.array(box.vertices)
    bottom = vertices[:, 2] < -SIZE[2] / 2 + 1e-6
    top = SIZE[2] / 2
    vertices[:, 2] = top - (top - vertices[:, 2]) * (top - LEVEL - SLOPE * vertices[:, 0]) / SIZE[2]
    vertices[bottom, 2] += np.random.default_rng(0).uniform(-ragged, ragged, int(bottom.sum()))
    return trimesh.Trimesh(vertices, box.faces[~bottom[box.faces].all(axis=1)], process=False).export(
        file_type="stl"
    )


def holed_mesh(hole: float) -> bytes:
    """STL of a finely meshed box without triangles within `hole` [mm] of the middle of its +x side."""
    box = trimesh.creation.box(SIZE)
    for _ in range(5):
        box = box.subdivide()
    middle = np.linalg.norm(box.triangles_center - [SIZE[0] / 2, 0, 0], axis=1)
    return trimesh.Trimesh(box.vertices, box.faces[middle > hole], process=False).export(file_type="stl")


@cache
def model_of(data: bytes, name: str) -> ObjectModel:
    return load_object_model(spec_of_scan(name), data, name)


def planned(data: bytes, name: str) -> tuple[ObjectModel, StrikePlan]:
    spec, model = spec_of_scan(name), model_of(data, name)
    return model, make_plan(model, spec, "", StrikerModel(fastest_m_s=5.0), friction=1.0)


@cache
def plan_of_a_cut_box(name: str) -> StrikePlan:
    made = {
        "sparse.xyz": lambda: cut_cloud(3000),
        "cut.xyz": lambda: cut_cloud(12_000),
        "dense.xyz": lambda: cut_cloud(25_000),
        "cut.stl": cut_mesh,
        "ragged.stl": lambda: cut_mesh(1.0),
    }
    return planned(made[name](), name)[1]


CUTS = ("sparse.xyz", "cut.xyz", pytest.param("dense.xyz", marks=pytest.mark.slow), "cut.stl", "ragged.stl")


@pytest.mark.parametrize("name", CUTS)
def test_planned_edges_of_a_box_without_bottom_are_edges_of_the_box(name):
    half = SIZE / 2000 - RADIUS
    strikes = plan_of_a_cut_box(name).strikes
    for strike in strikes:
        tip, _, up = np.array(strike.R_world_object)
        for direction in (-up, tip):
            axis = int(np.argmax(np.abs(direction)))
            true = np.sign(direction[axis]) * half[axis]
            assert abs(strike.pivot.point[axis] - true) < 3 * strike.pivot.sd_m
            assert not (axis == 2 and direction[2] < 0)
    assert len({strike.axis_id for strike in strikes}) >= 3


@pytest.mark.parametrize("name", CUTS)
def test_unscanned_faces_and_edges_are_rejected_with_their_share(name):
    unseen = [each for each in plan_of_a_cut_box(name).rejected if each.code == "not_scanned"]
    assert sum("e" in each.axis_id for each in unseen) >= 4
    assert all(each.number > 0.5 for each in unseen)
    assert all("scan that side too" in each.text for each in unseen)


def test_ragged_rim_is_reported():
    notes = plan_of_a_cut_box("ragged.stl").warnings
    assert any("its rim uneven by 2.0 mm" in note for note in notes)


def test_small_hole_does_not_change_the_plan():
    model, plan = planned(holed_mesh(5.0), "holed.stl")
    assert model.scanned is not None
    assert model.scanned.bare_share > 0
    _, whole = planned(holed_mesh(0.0), "holed.stl")
    assert [each.code for each in plan.rejected] == [each.code for each in whole.rejected]
    assert len(plan.strikes) == len(whole.strikes)
    assert np.isclose(plan.predicted_com_sd_m, whole.predicted_com_sd_m, rtol=1e-3)


def test_hollows_of_a_cloud_count_as_scanned():
    """The hull of a stool of three plates spans air between its feet, behind which the scan has points."""
    parts = [(70, 60, 20, 0, 0, 50), (70, 12, 80, 0, 24, 0), (70, 12, 80, 0, -24, 0)]
    bodies = [
        trimesh.creation.box(part[:3], trimesh.transformations.translation_matrix(part[3:])) for part in parts
    ]
    stool = trimesh.boolean.union(bodies)
    spec = spec_of_scan("stool.xyz")
    model = load_object_model(spec, xyz(cloud(stool, 15_000)), "stool.xyz")
    believed = hypothesis(model)
    planes = stable_planes(resting_planes(model), believed.region)
    assert any(plane.up[2] > 0.99 for plane in planes)
    assert scanned_planes(model, planes) == (list(planes), [])
    axes = pivot_axes(model, spec, planes, believed)
    assert scanned_edges(model, axes) == (axes, [])


def refusal(data: bytes, name: str) -> str:
    with pytest.raises(PlanError) as caught:
        planned(data, name)
    line = str(caught.value)
    assert "\n" not in line
    assert len(line) < 400
    return line


@pytest.mark.parametrize("level", [-0.3, pytest.param(-24.0, marks=pytest.mark.slow), -34.0])
def test_ball_without_bottom_is_recognised(level):
    points = cloud(trimesh.creation.icosphere(5, 40.0), 6000)
    line = refusal(xyz(points[points[:, 2] > level]), "ball.xyz")
    assert "part of a ball of 80 mm" in line
    assert "ring stand" in line
    assert "scan that side too" in line


def test_dome_is_refused_with_the_missing_side():
    """A round lid scanned from above: its only resting face is the end of the scan."""
    points = cloud(trimesh.creation.icosphere(5, 40.0), 12_000) * [1.0, 1.0, 1.6]
    line = refusal(xyz(points[points[:, 2] > 5]), "lid.xyz")
    assert "the gaps of the scan leave no usable edge: scan that side too" in line


@pytest.mark.parametrize("name", ["cut.xyz", "cut.stl"])
def test_marker_in_a_gap_may_be_off_by_the_width_of_the_gap(name):
    """A marker on the true bottom, 8 mm below the scan's end, is accepted; one 0.2 m below is refused."""
    model = model_of(cut_cloud(12_000) if name == "cut.xyz" else cut_mesh(), name)

    def at(height: float) -> ObjectSpec:
        tag = {**FAR_TAG, "T_object_marker": [[0, 1, 0, 0], [1, 0, 0, 0], [0, 0, -1, height], [0, 0, 0, 1]]}
        return spec_of({"file": name, "unit": "mm"}, 0.182, [tag])

    refuse_off_surface(model, at(-SIZE[2] / 2000))
    with pytest.raises(PlanError, match="outside the surface"):
        refuse_off_surface(model, at(-SIZE[2] / 2000 - 0.2))


def stand(thickness: float) -> trimesh.Trimesh:
    """A stem of 30 x 30 x 120 mm on a plate of 100 x 100 mm and `thickness` [mm]."""
    move = trimesh.transformations.translation_matrix
    plate = trimesh.creation.box((100, 100, thickness), move((0, 0, thickness / 2)))
    return trimesh.boolean.union([plate, trimesh.creation.box((30, 30, 120), move((0, 0, 60)))])


@pytest.mark.parametrize(
    ("thickness", "noise"),
    [
        pytest.param(16.0, 0.3, marks=pytest.mark.slow),
        (8.0, 0.3),
        pytest.param(8.0, 0.5, marks=pytest.mark.slow),
        (4.0, 0.3),
    ],
)
def test_edges_of_a_plate_under_a_stem(thickness, noise):
    """Points of the plate's upper side, which is no face of the hull, do not disturb its walls and rim."""
    spec = spec_of_scan("stand.xyz")
    model = load_object_model(spec, xyz(cloud(stand(thickness), 20_000, noise)), "stand.xyz")
    believed = hypothesis(model)
    below = [plane for plane in stable_planes(resting_planes(model), believed.region) if plane.up[2] > 0.99]
    axes = pivot_axes(model, spec, below, believed)
    square = [axis for axis in axes if np.abs(axis.tip[:2]).max() > 0.999]
    assert {tuple(np.round(axis.tip[:2]).astype(int)) for axis in square} == {
        (1, 0),
        (-1, 0),
        (0, 1),
        (0, -1),
    }
    for axis in square:
        off = axis.tip @ axis.point + RADIUS - 0.05
        assert abs(off) < 3 * axis.sd + 5e-5
        assert abs(off) < 5e-4


@pytest.mark.parametrize("noise", [0.1, 0.5])
def test_rim_of_a_round_base_is_extrapolated_from_its_wall(noise):
    """The rim is not limited to the outermost points of the base, which lie inside it."""
    round_body = trimesh.creation.cylinder(36.0, 150.0, sections=256)
    surface = load_object_model(
        spec_of_scan("can.xyz"), xyz(cloud(round_body, 20_000, noise)), "can.xyz"
    ).cloud
    assert surface is not None
    assert not any(surface.unwalled)
    low = surface.vertices[surface.vertices[:, 2] < -0.0745]
    assert abs(np.linalg.norm(low[:, :2], axis=1).max() - 0.036) < 1e-3 * noise
