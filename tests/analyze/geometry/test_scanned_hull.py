"""Hulls of scanned meshes: bowed faces become flat, drawings and curved bodies stay as they are."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from scipy.spatial import ConvexHull

from analyze.geometry.scanned_hull import scanned_hull
from analyze.types import Array, IntArray
from tests.world import catalogue

SIZE = np.array([0.08, 0.06, 0.15])


def scanned_box(bow: float, noise: float = 0.0) -> tuple[Array, IntArray]:
    """Box `SIZE` [m] with finely divided faces that bulge by `bow` [m], and white noise [m].

    A bulging face has 2 micrometres of noise at least: the pairs of triangles of an even grid would lie in
    one plane, as no scan's do.
    """
    mesh = trimesh.creation.box(SIZE).subdivide_to_size(0.004)
    vertices, faces = np.array(mesh.vertices), np.array(mesh.faces, dtype=np.int64)
    unit = 2 * vertices / SIZE
    for axis in range(3):
        inner = np.cos(np.pi / 2 * np.delete(unit, axis, axis=1)).prod(axis=1)
        vertices[:, axis] += np.where(
            np.abs(unit[:, axis]) > 1 - 1e-9, np.sign(unit[:, axis]) * bow * inner, 0.0
        )
    if bow or noise:
        vertices += np.random.default_rng(1).normal(0, max(noise, 2e-6), vertices.shape)
    return vertices, faces


def none_added(faces: IntArray) -> Array:
    return np.zeros(len(faces), dtype=np.bool_)


@pytest.mark.parametrize(("bow", "noise"), [(6e-4, 0.0), (1.2e-3, 0.0), (0.0, 3e-4)])
def test_a_scanned_box_has_six_flat_faces_and_eight_corners(bow: float, noise: float) -> None:
    vertices, faces = scanned_box(bow, noise)
    surface = scanned_hull(vertices, faces, none_added(faces), None)
    assert surface is not None
    assert len(surface.planes) == 6
    for plane in surface.planes:
        axis = int(np.argmax(np.abs(plane.normal)))
        assert abs(plane.normal[axis]) > np.cos(np.radians(0.5))
        # The middle of a bulge lies between the edges and its top.
        assert plane.offset == pytest.approx(SIZE[axis] / 2 + bow / 2, abs=bow / 2 + 1e-4)
    corners = np.array(np.meshgrid(*[[-1, 1]] * 3)).reshape(3, 8).T * SIZE / 2
    apart = np.linalg.norm(surface.vertices[:, None] - corners, axis=2).min(axis=0)
    assert apart.max() < 2 * bow + 3e-4


def test_a_drawing_and_a_stated_one_are_taken_as_they_are() -> None:
    vertices, faces = scanned_box(0.0)
    assert scanned_hull(vertices, faces, none_added(faces), None) is None
    vertices, faces = scanned_box(6e-4)
    assert scanned_hull(vertices, faces, none_added(faces), 1e-4) is None


@pytest.mark.parametrize("name", ["tuna_can", "dice", "dinosaur", "lunch_box", "ketchup_bottle"])
def test_drawings_with_small_flat_faces_and_large_curved_ones_are_drawings(name: str) -> None:
    body = catalogue.make(name, 1)
    vertices, faces = body.vertices / 1000, body.faces
    rounded = np.round(vertices, 6)  # as a text file gives them
    for given in (vertices, rounded):
        assert scanned_hull(given, faces, none_added(faces), None) is None


@pytest.mark.parametrize("body", ["ball", "egg", "flank"])
def test_curved_surfaces_are_not_flat_faces(body: str) -> None:
    mesh = trimesh.creation.icosphere(4, 0.04)
    vertices = np.array(mesh.vertices)
    if body == "egg":
        vertices *= [1.0, 1.0, 1.4]
    if body == "flank":
        vertices[:, 2] = np.clip(2 * vertices[:, 2], -0.04, 0.04)
        vertices += np.random.default_rng(2).normal(0, 1e-5, vertices.shape)
    surface = scanned_hull(vertices, np.array(mesh.faces), none_added(np.array(mesh.faces)), None)
    if body == "flank":
        assert surface is not None
        assert all(abs(plane.normal[2]) > 0.99 for plane in surface.planes)
        assert len(surface.planes) == 2
    else:
        assert surface is None or ConvexHull(surface.vertices).volume == pytest.approx(
            ConvexHull(vertices).volume, rel=0.025
        )
        assert surface is None or not surface.planes


@pytest.mark.parametrize("size", [(0.078, 0.051, 0.078), (0.09, 0.04, 0.18)])
def test_faces_stay_whole_under_noise_that_neighbours_share_and_their_sds_hold(
    size: tuple[float, float, float],
) -> None:
    """0.5 mm of noise, most of it in waves of 15 to 80 mm, as of depth fusion; three scans of each box."""
    ratios: list[float] = []
    common = np.diag([2.5e-7, 0.0, 0.0])
    for seed in range(3):
        rng = np.random.default_rng(seed)
        mesh = trimesh.creation.box(size).subdivide_to_size(0.004)
        waves = 2 * np.pi / rng.uniform(0.015, 0.08, 40)
        directions = rng.normal(size=(40, 3))
        directions *= (waves / np.linalg.norm(directions, axis=1))[:, None]
        field = np.cos(mesh.vertices @ directions.T + rng.uniform(0, 2 * np.pi, 40)).sum(axis=1) / np.sqrt(20)
        shift = 4.2e-4 * field + 2.7e-4 * rng.normal(size=len(field))
        vertices = mesh.vertices + shift[:, None] * mesh.vertex_normals
        faces = np.array(mesh.faces, dtype=np.int64)
        surface = scanned_hull(vertices, faces, none_added(faces), 5e-4)
        assert surface is not None
        assert len(surface.planes) == 6
        for plane in surface.planes:
            axis = int(np.argmax(np.abs(plane.normal)))
            true = np.sign(plane.normal[axis]) * np.eye(3)[axis]
            slopes = -(plane.basis @ true) / (plane.normal @ true)
            error = np.array([plane.centre @ true - size[axis] / 2, *slopes])
            ratios += (error / np.sqrt(np.diag(plane.covariance) + np.diag(common))).tolist()
    assert np.mean(np.abs(ratios) < 1.96) > 0.9
    assert np.sqrt(np.mean(np.square(ratios))) > 0.5
