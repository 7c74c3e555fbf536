"""Object models: shapes read, repaired or refused, and depths compared with analytic bodies."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from analyze.errors import ShapeError
from analyze.geometry import polyhedron
from analyze.geometry.distance import mesh_depth, surface_index
from analyze.geometry.object_model import load_object_model
from tests.analyze.geometry.shapes import box_triangles, obj, spec_of, stl

SIZE = np.array([60.0, 50.0, 200.0])
MICROMETRE = 1e-6


def mesh_of(triangles, unit="mm", mass=0.05, name="thing.stl"):
    return load_object_model(spec_of({"file": name, "unit": unit}, mass), stl(triangles), name)


def notched() -> np.ndarray:
    """Triangles of an L-shaped prism: 40 x 40 x 30 mm without its corner x > 0, y > 0."""
    outline = np.array([[-20, -20], [20, -20], [20, 0], [0, 0], [0, 20], [-20, 20]], dtype=float)
    flat = [(0, 1, 2), (0, 2, 3), (0, 3, 5), (3, 4, 5)]
    triangles = []
    for a, b, c in flat:
        triangles.append([[*outline[a], 15], [*outline[b], 15], [*outline[c], 15]])
        triangles.append([[*outline[a], -15], [*outline[c], -15], [*outline[b], -15]])
    for i in range(6):
        p, q = outline[i], outline[(i + 1) % 6]
        triangles.append([[*p, -15], [*q, -15], [*q, 15]])
        triangles.append([[*p, -15], [*q, 15], [*p, 15]])
    return np.array(triangles)


def test_box_file_and_primitive_are_the_same_body():
    mesh = mesh_of(box_triangles(SIZE))
    box = load_object_model(spec_of({"box": {"size_m": list(SIZE / 1000)}}), None, "")
    assert np.isclose(mesh.volume, box.volume, rtol=1e-6)
    assert np.allclose(mesh.centroid, box.centroid, atol=MICROMETRE)
    assert np.allclose(mesh.unit_inertia, box.unit_inertia, rtol=1e-5, atol=1e-12)
    assert np.allclose(
        np.diag(box.unit_inertia), (np.sum((SIZE / 1000) ** 2) - (SIZE / 1000) ** 2) / 12, atol=1e-8
    )
    points = np.random.default_rng(3).uniform(-0.1, 0.1, (2000, 3))
    within = box.depth(points) > 0
    assert np.array_equal(within, np.all(np.abs(points) < SIZE / 2000, axis=1))
    assert np.array_equal(mesh.depth(points) > 0, within)
    assert np.allclose(mesh.depth(points[within]), box.depth(points[within]), atol=MICROMETRE)


def test_depth_of_a_non_convex_body():
    model = mesh_of(notched(), mass=0.02)
    assert np.isclose(model.volume, 0.75 * 0.04 * 0.04 * 0.03, rtol=1e-6)
    probes = np.array(
        [
            [0.01, 0.01, 0.0],
            [-0.01, -0.01, 0.0],
            [-0.001, -0.001, 0.0],
            [0.0, -0.019, 0.0],
            [0.003, 0.001, 0.0],
            [0.05, 0.0, 0.0],
        ]
    )
    assert np.allclose(
        model.depth(probes),
        [-0.01, 0.01, np.hypot(0.001, 0.001), 0.001, -0.001, -np.hypot(0.03, 0)],
        atol=MICROMETRE,
    )
    assert np.allclose(model.depth_and_gradient(probes[3:4]).gradient, [[0, 1, 0]], atol=1e-6)


def test_needles_are_sampled_along_their_length_only():
    """A tube of 400 strips: as many samples across each as along it would be two million."""
    angle = np.arange(400) * np.pi / 200
    ring = np.column_stack([np.cos(angle), np.sin(angle)])
    vertices = np.vstack(
        [np.column_stack([radius * ring, np.full(400, z)]) for radius in (0.01, 0.008) for z in (0.0, 0.2)]
    )
    here, ahead = np.arange(400), (np.arange(400) + 1) % 400
    quads = [(0, 400, False), (800, 1200, True), (0, 800, True), (400, 1200, False)]
    faces = np.vstack(
        [
            np.stack([[a + here, a + ahead, b + ahead], [a + here, b + ahead, b + here]])
            .transpose(0, 2, 1)
            .reshape(-1, 3)[:, :: -1 if turned else 1]
            for a, b, turned in quads
        ]
    )
    index = surface_index(vertices, faces)
    assert index.tree.n < 250_000
    points = np.array(
        [[0.009, 0, 0.1], [0, 0.0095, 0.05], [0, 0, 0.1], [0.0, -0.02, 0.15], [0.009, 0, 0.1995]]
    )
    expected = [0.001, 0.0005, -0.008, -0.01, 0.0005]
    assert np.allclose(mesh_depth(index, vertices, faces, points).value, expected, atol=5e-6)


def test_mesh_and_convex_depth_agree_inside():
    rng = np.random.default_rng(4)
    turned = Rotation.random(rng=5).apply(box_triangles(SIZE).reshape(-1, 3)).reshape(-1, 3, 3)
    convex = mesh_of(turned)
    # A small body far away makes the shape non-convex without effect on depths inside the first.
    general = mesh_of(np.concatenate([turned, box_triangles(np.full(3, 5.0), centre=(300, 0, 0))]))
    points = rng.uniform(-0.1, 0.1, (1500, 3))
    within = convex.depth(points) > 0
    assert within.sum() > 100
    assert np.array_equal(general.depth(points) > 0, within)
    assert np.allclose(general.depth(points[within]), convex.depth(points[within]), atol=MICROMETRE)
    assert any("2 separate bodies" in warning for warning in general.warnings)


def test_depths_far_outside_are_cut_off_and_the_others_exact():
    rng = np.random.default_rng(6)
    posts = [box_triangles(np.full(3, 20.0), centre=(x, 0, 0)) for x in (0, 300)]
    model = mesh_of(np.concatenate(posts))
    points = rng.uniform([-0.05, -0.05, -0.05], [0.35, 0.05, 0.05], (3000, 3))
    exact, cut = model.depth(points), model.depth(points, outside=5e-3)
    far = exact < -5e-3 - 4e-3
    assert 100 < far.sum() < len(points)
    assert np.all(cut[far] == -5e-3)
    near = exact > -5e-3
    assert np.array_equal(cut[near], exact[near])
    assert np.all(cut[~near & ~far] <= -5e-3)


def test_cylinder_primitive_is_exact():
    model = load_object_model(spec_of({"cylinder": {"radius_m": 0.036, "height_m": 0.15}}), None, "")
    assert np.isclose(model.volume, np.pi * 0.036**2 * 0.15)
    assert np.allclose(
        model.depth(np.array([[0.03, 0, 0], [0, 0, 0.07], [0, 0.04, 0], [0.036 + 3e-3, 0, 0.075 + 4e-3]])),
        [0.006, 0.005, -0.004, -0.005],
    )
    assert np.allclose(model.depth_and_gradient(np.array([[0.0, 0.03, 0.0]])).gradient, [[0, -1, 0]])


def test_wrong_winding_is_repaired_and_reported():
    triangles = box_triangles(SIZE)
    inverted = mesh_of(triangles[:, ::-1])
    assert np.isclose(inverted.volume, np.prod(SIZE) * 1e-9, rtol=1e-6)
    assert any("inwards" in warning for warning in inverted.warnings)
    triangles[[1, 5, 6]] = triangles[[1, 5, 6]][:, ::-1]
    mixed = mesh_of(triangles)
    assert np.isclose(mixed.volume, np.prod(SIZE) * 1e-9, rtol=1e-6)
    assert any("3 faces" in warning for warning in mixed.warnings)


def test_half_of_the_faces_wound_wrongly_is_repaired():
    triangles = box_triangles(SIZE)
    triangles[:6] = triangles[:6][:, ::-1]
    assert np.isclose(mesh_of(triangles).volume, np.prod(SIZE) * 1e-9, rtol=1e-6)


def test_inner_surface_is_ignored():
    hollow = np.concatenate([box_triangles(SIZE), box_triangles(SIZE - 4)[:, ::-1]])
    model = mesh_of(hollow)
    assert np.isclose(model.volume, np.prod(SIZE) * 1e-9, rtol=1e-6)
    assert any("inner" in warning for warning in model.warnings)


def test_obj_file_in_centimetres():
    box = load_object_model(spec_of({"box": {"size_m": [0.06, 0.05, 0.2]}}), None, "")
    data = obj(box.vertices * 100, box.faces)
    model = load_object_model(spec_of({"file": "thing.obj", "unit": "cm"}), data, "thing.obj")
    assert np.allclose(model.extent, [0.06, 0.05, 0.2])


@pytest.mark.parametrize(
    ("triangles", "unit", "expected"),
    [
        (box_triangles(SIZE)[[1, 2, 4, 6]], "mm", "open edges"),
        (box_triangles(SIZE), "m", 'unit = "mm"'),
        (box_triangles(SIZE / 1000), "mm", 'unit = "m"'),
        (box_triangles(SIZE * [1, 1, 0]), "mm", "thing.stl: "),
        (box_triangles(SIZE) * np.nan, "mm", "no numbers"),
    ],
)
def test_unusable_meshes_are_refused_in_one_line(triangles, unit, expected):
    with pytest.raises(ShapeError) as caught:
        mesh_of(triangles, unit=unit)
    assert expected in str(caught.value)
    assert str(caught.value).startswith("thing.stl")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("name", "data"),
    [
        ("thing.stl", b"nothing"),
        ("thing.obj", b"\xff\x00"),
        ("thing.ply", b"ply\nrubbish"),
        ("thing.step", b"x"),
        ("thing.stl", b""),
    ],
)
def test_unreadable_files_are_refused_in_one_line(name, data):
    with pytest.raises(ShapeError, match="thing") as caught:
        load_object_model(spec_of({"file": name, "unit": "mm"}), data, name)
    assert "\n" not in str(caught.value)


def test_box_in_millimetres_is_refused():
    with pytest.raises(ShapeError, match="in metres"):
        load_object_model(spec_of({"box": {"size_m": [60, 50, 200]}}), None, "")


def test_ray_meets_the_near_side():
    model = load_object_model(spec_of({"box": {"size_m": [0.06, 0.05, 0.2]}}), None, "")
    for y, distance in ((0.001, 0.97), (0.1, np.inf)):
        start, along = np.array([-1.0, y, 0.02]), np.array([1.0, 0.0, 0.0])
        assert np.isclose(polyhedron.first_hit(model.vertices, model.faces, start, along), distance)
