"""Meshes with holes, cracks, inner walls, crossings and several bodies: repaired with a note, or refused."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from analyze.errors import ShapeError
from analyze.geometry.mesh_holes import fill_holes
from tests.analyze.geometry.shapes import SIZE, box_mesh, box_triangles, load, mesh_bytes, stl


def test_missing_bottom_is_closed_flat_and_reported():
    cup = trimesh.creation.cylinder(30, 150, sections=64)
    scan = trimesh.Trimesh(cup.vertices, cup.faces[cup.triangles_center[:, 2] > -74.9], process=False)
    model = load(mesh_bytes("stl", scan), "cup.stl")
    assert np.isclose(model.volume, cup.volume * 1e-9, rtol=1e-6)
    assert "a hole was closed (the widest 40 % of the size)" in model.warnings[0]


def test_large_uneven_hole_is_closed_and_its_volume_called_unknown():
    cup = trimesh.creation.cylinder(30, 150, sections=64)
    bent = cup.vertices + np.outer(cup.vertices[:, 0] ** 2 / 60, [0, 0, 1])
    scan = trimesh.Trimesh(bent, cup.faces[cup.triangles_center[:, 2] > -74.9], process=False)
    notes = load(mesh_bytes("stl", scan), "cup.stl").warnings
    assert any(
        "not flat: its volume, and masses of inner parts with it, are not known" in note for note in notes
    )


def test_holes_whose_rims_touch_are_closed():
    ball = trimesh.creation.icosphere(4, 40)
    corner = np.flatnonzero(np.any(ball.faces == 0, axis=1))
    # Two of the faces round a vertex are missing that share this vertex only.
    gone = [
        corner[0],
        next(i for i in corner if len(np.intersect1d(ball.faces[i], ball.faces[corner[0]])) == 1),
    ]
    torn = trimesh.Trimesh(ball.vertices, np.delete(ball.faces, gone, axis=0), process=False)
    model = load(mesh_bytes("ply", torn), "ball.ply")
    assert np.isclose(model.volume, ball.volume * 1e-9, rtol=1e-3)
    assert "closed" in model.warnings[0]


def test_an_inner_wall_on_an_edge_leaves_the_body_closed():
    wall = trimesh.Trimesh(
        [[-30, 0, -50], [30, 0, -50], [30, 0, 50], [-30, 0, 50]], [[0, 1, 2], [0, 2, 3]], process=False
    )
    halves = [box_mesh([60, 25, 100], (0, 12.5 * side, 0)) for side in (-1, 1)]
    outer = trimesh.util.concatenate(
        [each.submesh([np.abs(each.triangles_center[:, 1]) > 1e-9], append=True) for each in halves]
    )
    model = load(mesh_bytes("stl", trimesh.util.concatenate([outer, wall])), "box.stl")
    assert np.isclose(model.volume, 60 * 50 * 100 * 1e-9, rtol=1e-6)


def test_a_scan_without_the_floor_of_a_thin_shell_is_not_turned_inside_out():
    pan = trimesh.boolean.difference(
        [trimesh.creation.cylinder(100, 50), trimesh.creation.cylinder(97, 50, transform=None)]
    )
    assert pan.is_volume
    closed = trimesh.boolean.union(
        [
            pan,
            trimesh.creation.cylinder(
                100, 3, transform=trimesh.transformations.translation_matrix([0, 0, -23.5])
            ),
        ]
    )
    scan = trimesh.Trimesh(
        closed.vertices, closed.faces[closed.triangles_center[:, 2] > -24.9], process=False
    )
    model = load(mesh_bytes("ply", scan), "pan.ply")
    assert np.isclose(model.volume, closed.volume * 1e-9, rtol=1e-6)
    assert not any("normals" in note for note in model.warnings)


def test_a_surface_with_each_triangle_on_both_sides_is_read_as_one():
    box = box_mesh()
    both = trimesh.Trimesh(box.vertices, np.vstack([box.faces, box.faces[:, ::-1]]), process=False)
    assert np.isclose(load(mesh_bytes("stl", both), "box.stl").volume, np.prod(SIZE) * 1e-9, rtol=1e-6)


def test_a_cavity_is_not_called_wrong_normals():
    hollow = box_mesh([40, 30, 80])
    hollow.invert()
    notes = load(mesh_bytes("stl", trimesh.util.concatenate([box_mesh(), hollow])), "box.stl").warnings
    assert any("inner surfaces are ignored" in note for note in notes)
    assert not any("normals" in note for note in notes)


def test_bodies_that_touch_stay_apart_by_the_files_numbers():
    first, second = box_mesh([60, 50, 50], (0, 0, 25)), box_mesh([60, 50, 50], (0, 0, -25))
    model = load(mesh_bytes("ply", trimesh.util.concatenate([first, second])), "two.ply")
    assert np.isclose(model.volume, 60 * 50 * 100 * 1e-9, rtol=1e-6)


def test_small_uneven_hole_is_closed():
    ball = trimesh.creation.icosphere(4, 40)
    torn = trimesh.Trimesh(ball.vertices, np.delete(ball.faces, [10, 11, 12], axis=0), process=False)
    model = load(mesh_bytes("ply", torn), "ball.ply")
    assert np.isclose(model.volume, ball.volume * 1e-9, rtol=1e-3)
    assert "closed" in model.warnings[0]


def test_cracks_from_rounded_coordinates_are_closed():
    triangles = box_triangles(SIZE) + np.random.default_rng(1).uniform(-2e-4, 2e-4, (12, 3, 3))
    assert np.isclose(load(stl(triangles), "box.stl").volume, np.prod(SIZE) * 1e-9, rtol=1e-4)


def test_overlapping_bodies_are_united():
    post = box_mesh([20, 20, 120], (0, 0, 100))
    model = load(
        mesh_bytes("stl", trimesh.util.concatenate([box_mesh([60, 60, 100]), post])), "two.stl", mass=0.2
    )
    assert np.isclose(model.volume, (60 * 60 * 100 + 20 * 20 * 110) * 1e-9, rtol=1e-6)
    assert any("2 bodies overlapped" in note for note in model.warnings)


def test_separate_bodies_and_specks_are_reported():
    far = box_mesh([20, 20, 20], (100, 0, 0))
    dust = box_mesh([0.5, 0.5, 0.5], (300, 0, 0))
    model = load(mesh_bytes("stl", trimesh.util.concatenate([box_mesh(), far, dust])), "count.stl", mass=0.2)
    assert np.isclose(model.extent[0], 0.14)
    assert any("2 separate bodies" in note for note in model.warnings)
    assert any("1 specks" in note for note in model.warnings)


def test_self_intersecting_surface_counts_once():
    rod = trimesh.creation.cylinder(20, 200, sections=8).copy()
    for _ in range(4):
        rod = rod.subdivide()
    x, y, z = rod.vertices.T
    # Bent by more than a whole turn, so that the ends intersect.
    turn = z / 200 * 2.4 * np.pi
    bent = np.stack([(40 + x) * np.cos(turn), (40 + x) * np.sin(turn), y], axis=1)
    model = load(mesh_bytes("stl", trimesh.Trimesh(bent, rod.faces, process=False)), "rod.stl", mass=0.2)
    # A ring of 1.2 turns: the overlapping ends count once.
    once = abs(trimesh.Trimesh(bent, rod.faces, process=False).volume) / 1.2 * 1e-9
    assert np.isclose(model.volume, once, rtol=0.03)
    assert any("intersects itself" in note for note in model.warnings)


def test_a_surface_without_area_is_refused():
    along = np.outer(np.arange(3.0), [1.0, 2.0, 3.0])
    with pytest.raises(ShapeError, match="100 % of its surface is missing"):
        fill_holes(along, np.array([[0, 1, 2]]), "thing.stl")
