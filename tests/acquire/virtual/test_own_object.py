"""Users' object files on the virtual rig: shapes, tags, hidden masses, refusals."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest
import trimesh
from scipy.spatial import ConvexHull

from acquire.errors import ConfigError
from acquire.virtual import held_masses, own_object
from acquire.virtual.contact_shape import contact_centres
from acquire.virtual.convex_parts import convex_parts, few_corners
from acquire.virtual.mesh_samples import sample_mesh
from acquire.virtual.object_archive import open_object, save_object
from acquire.virtual.own_object import OwnObject, read_own_object
from acquire.virtual.primitive_meshes import box_mesh
from acquire.virtual.render import Renderer
from acquire.virtual.station import DISTANCE_M, station
from acquire.virtual.tag_places import tag_places
from schemas.object_spec import read_object_spec

HEAD = 'name = "thing"\nmass_kg = 0.2\nmass_sd_kg = 0.001\n'
BOX = "[shape]\nbox = { size_m = [0.08, 0.06, 0.12] }\n"
TAGS = "".join(f"[[marker]]\nid = {number}\nsize_m = 0.03\n" for number in (3, 9))


def cup(segments: int = 48) -> trimesh.Trimesh:
    """Open cup, 80 mm wide and 90 mm tall, with a wall and floor of 6 mm; in mm, standing on z = 0."""
    line = [(0, 0), (40, 0), (40, 90), (34, 90), (34, 6), (0, 6)]
    return trimesh.creation.revolve(line, sections=segments)


@pytest.fixture(autouse=True)
def quick_analyze(monkeypatch: pytest.MonkeyPatch) -> None:
    """Run `analyze shape` in this process, because a process of its own takes two seconds to start."""
    from click.testing import CliRunner

    from analyze.cli import main

    monkeypatch.setattr(held_masses, "SAMPLES", 100_000)

    class Done:
        def __init__(self, command: list[str]) -> None:
            result = CliRunner().invoke(main, command[3:])
            self.returncode, self.stdout, self.stderr = result.exit_code, result.stdout, result.stderr

    monkeypatch.setattr(own_object.subprocess, "run", lambda command, **_: Done(command))


def own(folder: Path, text: str, seed: int = 1, truth: str | None = None) -> OwnObject:
    """Virtual object from the text of an object file, in a folder whose name has spaces and brackets."""
    home, run = folder / "my objects [v2]", folder / "run"
    home.mkdir(exist_ok=True)
    run.mkdir(exist_ok=True)
    path, truth_path = home / "my thing (1).toml", home / "truth.toml"
    path.write_text(text, encoding="utf-8")
    if truth is not None:
        truth_path.write_text(truth, encoding="utf-8")
    return read_own_object(path, seed, None if truth is None else truth_path, run)


def test_file_without_tags_gets_some_and_is_complete(tmp_path: Path) -> None:
    thing = own(tmp_path, HEAD + BOX)
    spec = read_object_spec(thing.object_path)
    assert [marker.id for marker in spec.marker] == list(range(6))
    for marker in spec.marker:  # in the middle of each side, facing outwards
        T = np.array(marker.T_object_marker)
        assert np.abs(T[:3, 3]) == pytest.approx(np.abs(T[:3, 2]) * np.array([0.04, 0.03, 0.06]), abs=1e-6)
        assert T[:3, 3] @ T[:3, 2] > 0
        assert np.linalg.det(T) == pytest.approx(1.0)
    assert thing.virtual.camera_distance_m == DISTANCE_M
    assert thing.notes == ("my thing (1).toml lists no tags: 6 tags are glued on, of 30 mm",)


def test_tags_without_a_place_are_glued_on_where_the_file_does_not_know(tmp_path: Path) -> None:
    thing = own(tmp_path, HEAD + BOX + TAGS)
    assert all(marker.T_object_marker is None for marker in read_object_spec(thing.object_path).marker)
    places = [np.array(marker.T_object_marker) for marker in thing.virtual.spec.marker]
    middles = np.array([T[:3, 3] for T in places])
    assert np.abs(middles / [0.04, 0.03, 0.06]).max(axis=1) == pytest.approx(
        [1, 1], abs=1e-6
    )  # on the surface
    assert np.linalg.norm(middles[0] - middles[1]) > 0.05
    assert "glued on where the file does not know: 3, 9" in thing.notes[-1]


def test_edges_with_a_radius_of_their_own_are_left_out_with_a_note(tmp_path: Path) -> None:
    edges = (
        '[[edge]]  # measured\nid = "p0e1"\nradius_m = 0.003\n\n [[ edge ]]\nid = "p4e0"\nradius_m = 0.0\n'
    )
    thing = own(tmp_path, HEAD + TAGS + edges + BOX)
    assert thing.notes[0].endswith("the [[edge]] entries of my thing (1).toml are left out: p0e1, p4e0")
    spec = read_object_spec(thing.object_path)
    assert thing.object_path != tmp_path / "my objects [v2]" / "my thing (1).toml"
    assert (spec.edge, len(spec.marker), thing.virtual.spec.edge) == (None, 2, None)
    assert len(read_object_spec(own(tmp_path, HEAD + BOX + edges).object_path).marker) == 6


def test_seed_draws_what_the_file_leaves_open(tmp_path: Path) -> None:
    one, again, other = (own(tmp_path, HEAD + BOX, seed).virtual for seed in (1, 1, 2))
    assert np.array_equal(one.body.com_object, again.body.com_object)
    assert np.linalg.norm(one.body.com_object - other.body.com_object) > 1e-4
    assert 0.0002 <= one.edge_radius_m <= 0.0015
    assert one.body.mass_kg == pytest.approx(0.2)
    shifts = [np.linalg.norm(each.body.com_object) for each in (one, other)]
    assert min(shifts) > 0.001  # a hidden distribution worth finding


def test_truth_file_gives_the_masses(tmp_path: Path) -> None:
    truth = """[truth]
shell_kg = 0.0
edge_radius_m = 0.002
friction = 0.5
lump = [{ centre_m = [0.02, 0, 0], radius_m = 0.01, mass_kg = 0.05 }]
"""
    virtual = own(tmp_path, HEAD + BOX, truth=truth).virtual
    assert virtual.body.com_object == pytest.approx([0.02 * 0.05 / 0.2, 0, 0], abs=1e-4)
    assert virtual.body.mass_kg == pytest.approx(0.2)
    assert (virtual.edge_radius_m, virtual.friction) == (0.002, 0.5)


@pytest.mark.parametrize(
    ("truth", "reason"),
    [
        ("[truth]\nshell_kg = 0.3\n", "add up to 0.3 kg, the object without its tags weighs 0.2 kg"),
        (
            "[truth]\nlump = [{ centre_m = [20, 0, 0], radius_m = 0.01, mass_kg = 0.05 }]\n",
            "puts 0.05 kg into lump 1, but nothing of the object is there",
        ),
        ("[truth]\nshel_kg = 0.3\n", "shel_kg"),
        ("shell_kg = 0.3\n", "truth"),
        ("[truth", "not valid TOML"),
    ],
)
def test_truth_that_cannot_be_is_refused(tmp_path: Path, truth: str, reason: str) -> None:
    with pytest.raises(ConfigError, match=reason):
        own(tmp_path, HEAD + BOX, truth=truth)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        (HEAD.replace("mass_kg = 0.2\n", "") + BOX, r"my thing \(1\).toml.*mass_kg"),
        (HEAD + "[shape]\nbox = { size_m = [80, 60, 120] }\n", "120 m"),
        (HEAD + '[shape]\nfile = "gone.stl"\nunit = "mm"\n', "gone.stl: the shape file cannot be read"),
        (HEAD + '[shape]\nfile = "../cup.stl"\nunit = "mm"\n', "into the folder of the object file"),
        (
            'edge = [{ id = "p0e1", radius_m = 0.003 }]\n' + HEAD + BOX,
            "rounds all edges alike: take the edge",
        ),
        (
            HEAD + "edge_radius_m = 0.01\n[shape]\nbox = { size_m = [0.08, 0.06, 0.02] }\n",
            "too thin for edges",
        ),
        ("name = ", "not valid TOML"),
    ],
)
def test_object_that_cannot_be_simulated_is_refused(tmp_path: Path, text: str, reason: str) -> None:
    with pytest.raises(ConfigError, match=reason) as found:
        own(tmp_path, text)
    assert "\n" not in str(found.value)
    assert str(tmp_path / "run") not in str(found.value)  # the user's file is named, not our copy


def test_cup_is_hollow_and_its_tags_are_seen(tmp_path: Path) -> None:
    (tmp_path / "my objects [v2]").mkdir()
    cup().export(tmp_path / "my objects [v2]" / "a [cup].stl")
    thing = own(
        tmp_path,
        HEAD + '[shape]\nfile = "a [cup].stl"\nunit = "mm"\n',
        truth="[truth]\nshell_kg = 0\nshell_thickness_m = 1e-5\n",
    )
    virtual = thing.virtual
    solid = cup()
    assert virtual.body.com_object == pytest.approx(1e-3 * solid.center_mass, abs=2e-4)
    exact = solid.moment_inertia * 1e-6 * 0.2 / solid.volume
    assert np.diag(virtual.body.inertia_com) == pytest.approx(np.diag(exact), rel=0.01)
    assert (tmp_path / "run" / "a [cup].stl").exists()  # beside the object file with tags
    assert len(contact_centres(virtual)) < 1500
    save_object(virtual, tmp_path / "o.npz")
    read = open_object(str(tmp_path / "o.npz"), 1)
    assert read.camera_distance_m == virtual.camera_distance_m
    assert np.array_equal(read.body.inertia_com, virtual.body.inertia_com)
    painter = Renderer(read, station(1, read.camera_distance_m), 1)
    image = painter.render(
        np.zeros((1, 3)),
        np.array([[1.0, 0, 0, 0]]),
        np.array([-0.5]),
        np.array([[-0.05, 0, 0.2]]),
        1500.0,
        0.0,
    )
    import cv2

    detector = cv2.aruco.ArucoDetector(cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11))
    _, found, _ = detector.detectMarkers(image)
    faced = [m.id for m in read.spec.marker if np.array(m.T_object_marker)[1, 2] < -0.9]
    assert [int(number) for number in np.ravel(found)] == faced


def test_parts_stand_for_a_body_and_know_what_hides_what() -> None:
    solid = trimesh.creation.box((0.1, 0.04, 0.02)).union(
        trimesh.creation.box((0.02, 0.04, 0.1), trimesh.transformations.translation_matrix((0.04, 0, 0.04)))
    )
    triangles = np.array(solid.triangles)
    parts = convex_parts(triangles, sample_mesh(triangles, 20_000), solid.volume)
    hulls = [ConvexHull(part) for part in parts.corners]
    assert len(parts.corners) == 2  # an L
    assert sum(hull.volume for hull in hulls) == pytest.approx(solid.volume, rel=1e-6)
    (plane,) = parts.tree
    axis = int(plane[0])
    low = int(np.argmin([part[:, axis].mean() for part in parts.corners]))
    assert parts.front_to_back(-np.eye(3)[axis]) == [low, 1 - low]
    assert parts.front_to_back(np.eye(3)[axis]) == [1 - low, low]


def test_few_corners_keep_the_hull_within_the_tolerance() -> None:
    ball = trimesh.creation.icosphere(3, 0.05).vertices
    kept = few_corners(ball, 2e-3)
    assert len(kept) < len(ball) / 3
    planes = ConvexHull(kept).equations
    assert (ball @ planes[:, :3].T + planes[:, 3]).max() <= 2e-3


def test_samples_fill_a_mesh_evenly() -> None:
    solid = cup()
    points = sample_mesh(np.array(solid.triangles), 60_000)
    assert ((points[:, 2] <= 6) | (np.hypot(points[:, 0], points[:, 1]) > 33.9)).all()
    assert points.mean(axis=0) == pytest.approx(solid.center_mass, abs=0.3)


def test_no_tag_is_put_where_the_surface_is_not_flat() -> None:
    grid = np.array(trimesh.creation.box((0.1, 0.1, 0.005)).triangles)
    assert len(tag_places(grid, 0.03)) == 2  # the thin sides have no room
    ball = np.array(trimesh.creation.icosphere(2, 0.02).triangles)
    assert tag_places(ball, 0.06) == []


def test_binary_stl_of_analyze_is_what_the_rig_reads(tmp_path: Path) -> None:
    thing = own(tmp_path, HEAD + BOX)
    data = (tmp_path / "run" / "exterior.stl").read_bytes()
    assert struct.unpack_from("<I", data, 80) == (12,)
    assert np.ptp(thing.virtual.mesh_vertices, axis=0) == pytest.approx([0.08, 0.06, 0.12])


def test_card_of_a_legible_tag_juts_out_over_a_narrow_side() -> None:
    """On the sides of a plank only tags of 12 mm lie flat: 17 px at the camera's distance, 60 are needed."""
    vertices, faces = box_mesh(np.array([0.15, 0.04, 0.0075]))
    flat = {place.size_m for place in tag_places(vertices[faces], 0.05)}
    assert flat == {0.05, 0.012}
    legible = tag_places(vertices[faces], 0.05, 0.045)
    assert [place.size_m for place in legible] == [0.05] * 6
    inner = (
        np.abs([place.T_object_marker[:3, 3] for place in legible]) <= np.array([0.15, 0.04, 0.0075]) + 1e-9
    )
    assert inner.all()


def test_card_does_not_jut_out_where_a_part_stands_before_it() -> None:
    """A step 30 mm high beside a narrow ledge leaves no room for the card."""
    low_v, low_f = box_mesh(np.array([0.1, 0.1, 0.05]))
    high_v, high_f = box_mesh(np.array([0.1, 0.088, 0.08]))
    triangles = np.concatenate([low_v[low_f], high_v[high_f]])
    top = [place for place in tag_places(triangles, 0.05, 0.05) if place.T_object_marker[2, 2] > 0.9]
    assert all(abs(place.T_object_marker[2, 3] - 0.08) < 1e-9 for place in top)
