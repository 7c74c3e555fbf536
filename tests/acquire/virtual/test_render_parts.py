"""Convex parts of a mesh drawn as few surfaces, with the image that all of them give."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from acquire.virtual.convex_parts import ConvexParts, convex_parts
from acquire.virtual.mesh_samples import sample_mesh
from acquire.virtual.objects import VirtualObject, load_object
from acquire.virtual.part_hulls import merged_tree
from acquire.virtual.render import Renderer
from acquire.virtual.render_mesh import hull_group
from acquire.virtual.render_object import ObjectPainter
from acquire.virtual.render_parts import PartGroups
from acquire.virtual.station import station

PLACE = station(1, 0.4)
UPSIDE_DOWN = Rotation.from_rotvec([np.pi, 0, 0])


@pytest.fixture(scope="module")
def mug() -> VirtualObject:
    """Cup, 80 mm wide and 90 mm tall, with a handle at +x."""
    line = [(0, 0), (40, 0), (40, 90), (34, 90), (34, 6), (0, 6)]
    cup = trimesh.creation.revolve(line, sections=16)
    bars = [((20, 10, 8), (45, 0, 20)), ((20, 10, 8), (45, 0, 70)), ((8, 10, 58), (59, 0, 45))]
    handle = [trimesh.creation.box(size).apply_translation(place) for size, place in bars]
    mesh = trimesh.boolean.union([cup, *handle])
    mesh.apply_scale(0.001)
    triangles = np.asarray(mesh.triangles)
    parts = convex_parts(triangles, sample_mesh(triangles, 10_000), float(mesh.volume))
    return replace(
        load_object("carton", 1),
        mesh_vertices=np.asarray(mesh.vertices),
        mesh_faces=np.asarray(mesh.faces),
        convex_parts=parts.corners,
        drawn_parts=replace(parts, tree=merged_tree(parts.corners, parts.tree)),
    )


@pytest.fixture(scope="module")
def painter(mug: VirtualObject) -> ObjectPainter:
    return Renderer(mug, PLACE, 1)._object


@pytest.fixture(scope="module")
def surfaces(painter: ObjectPainter) -> PartGroups:
    assert painter._parts is not None
    return painter._parts


def test_a_mug_takes_few_surfaces_and_looks_the_same(
    mug: VirtualObject, painter: ObjectPainter, surfaces: PartGroups, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert surfaces.count > 12
    for turn in (Rotation.identity(), UPSIDE_DOWN, Rotation.from_rotvec([0, 0.4, 0]) * UPSIDE_DOWN):
        R = turn.as_matrix()
        p = np.array([0.0, 0.0, -(mug.mesh_vertices @ R.T)[:, 2].min()])
        assert len(surfaces.front_to_back((PLACE.T_world_camera[:3, 3] - p) @ R)) <= 8
        few = painter.layer(p[None], R[None])
        with monkeypatch.context() as patch:
            patch.setattr(PartGroups, "front_to_back", lambda self, camera: self._parts.front_to_back(camera))
            all_parts = painter.layer(p[None], R[None])
        assert few is not None
        assert all_parts is not None
        assert few.box == all_parts.box
        # Seams between the parts differ, and small hollows at the handle's roots.
        assert np.mean(np.abs(few.cover - all_parts.cover) > 0.2) < 0.005
        assert np.mean(np.abs(few.light - all_parts.light) > 10) < 0.01


def test_every_part_is_shown_once_from_anywhere(surfaces: PartGroups) -> None:
    for viewer in np.random.default_rng(0).normal(0, 0.3, (40, 3)):
        shown = [i for g in surfaces.front_to_back(viewer) for i in surfaces.members[g]]
        assert sorted(shown) == list(range(surfaces.count))


def test_what_lies_in_the_open_is_not_bridged(surfaces: PartGroups) -> None:
    into_the_cup, from_the_side = np.array([0.0, 0.0, 0.6]), np.array([-0.6, 0.0, 0.05])
    assert len(surfaces.front_to_back(into_the_cup)) > 2 * len(surfaces.front_to_back(from_the_side))


def test_two_parts_that_touch_are_one_block() -> None:
    block = np.array([(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)]) * 0.05
    parts = ConvexParts((block, block + np.array([0.05, 0, 0])), np.array([[0.0, 0.05, -1.0, -2.0]]))
    assert PartGroups(parts).front_to_back(np.array([0.3, 0.4, 0.5])) == [2]
    apart = ConvexParts((block, block + np.array([0.06, 0, 0])), np.array([[0.0, 0.055, -1.0, -2.0]]))
    assert PartGroups(apart).front_to_back(np.array([0.3, 0.4, 0.5])) == [1, 0]


def test_faces_in_one_plane_are_seen_alike() -> None:
    # Rounding made single triangles of a flat lid look away: their rows were grey up to the image's border.
    angle = np.linspace(0, 2 * np.pi, 90, endpoint=False)
    rim = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(90)]) * 0.04
    turn = Rotation.from_rotvec([0.3, 0.7, -0.2]).as_matrix()
    group = hull_group(np.concatenate([rim, rim + np.array([0, 0, 0.09])]) @ turn.T)
    lid = group.face_normal @ turn[:, 2] > 0.999
    assert lid.sum() > 80
    assert len(np.unique(group.face_normal[lid], axis=0)) == 1
    assert len(np.unique(group.face_point[lid], axis=0)) == 1


def test_a_resting_object_is_not_drawn_again_while_the_arm_moves(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    drawn: list[int] = []
    layer = ObjectPainter.layer
    monkeypatch.setattr(ObjectPainter, "layer", lambda self, p, R: drawn.append(1) or layer(self, p, R))
    renderer, again = (Renderer(load_object("carton", 1), PLACE, 1) for _ in range(2))
    pose = np.zeros((1, 3)), np.array([[1.0, 0, 0, 0]])
    hinge = np.array([[-0.1, 0, 0.25]])
    for angle in (-0.5, -0.4, -0.3):
        image = renderer.render(*pose, np.array([angle]), hinge, 1500.0, 0.0)
    assert len(drawn) == 1
    for _ in range(2):  # the noise depends on the number of images
        again._noise.expose(again._clean, again._sd)
    np.testing.assert_array_equal(image, again.render(*pose, np.array([-0.3]), hinge, 1500.0, 0.0))
