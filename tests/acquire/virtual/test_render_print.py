"""Print on virtual objects: exact coverage, on the faces as they move, clipped at edges, seeded; gloss."""

import tomllib
from dataclasses import replace
from itertools import pairwise

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from acquire.errors import ConfigError
from acquire.virtual import render_print
from acquire.virtual.body_chart import BodyChart
from acquire.virtual.devices import DeviceOptions, prepare_devices
from acquire.virtual.lens import Lens
from acquire.virtual.object_archive import open_object, save_object
from acquire.virtual.objects import OBJECT_NAMES, load_object, without_tags
from acquire.virtual.packaging import (
    BLANK,
    MOST_CONTRAST,
    Packaging,
    Panel,
    Patches,
    PrintKind,
    design,
    filled_rectangles,
)
from acquire.virtual.render import Renderer
from acquire.virtual.render_mesh import face_groups
from acquire.virtual.render_object import ObjectPainter
from acquire.virtual.station import HEIGHT_PX, WIDTH_PX, station

SEED = 3
PLACE = station(SEED)
LENS = Lens(PLACE)
PRINTED = Packaging(PrintKind.PRINT, SEED)


def pose(thing, theta, yaw=0.0):
    """Position (1, 3) and rotation (1, 3, 3) of an object tipped by `theta` about its lower edge at +x."""
    R = Rotation.from_euler("zy", [yaw, theta]).as_matrix()
    rest = [-thing.mesh_vertices[:, 0].max(), 0.0, -thing.mesh_vertices[:, 2].min()]
    return (R @ rest)[None], R[None]


def light(thing, at):
    layer = ObjectPainter(thing, LENS, WIDTH_PX, HEIGHT_PX).layer(*at)
    image, cover = (np.zeros((HEIGHT_PX, WIDTH_PX)) for _ in range(2))
    image[layer.box.slices], cover[layer.box.slices] = layer.light, layer.cover
    return image, cover


def one_patch(monkeypatch, low, high, step=80.0):
    """Let every design be one rectangle of the chart; returns its low and high corner."""
    patches = Patches(np.array([low]), np.array([high]), np.array([step]))
    monkeypatch.setattr(render_print, "design", lambda *_: patches)


def front_corner(thing, uv):
    """Point of O on the carton's -y face at a place of the chart, and the face's chart."""
    chart = BodyChart(thing.mesh_vertices)
    groups = face_groups(thing.mesh_vertices, thing.mesh_faces)
    piece = next(piece for piece in chart.pieces(groups[0]) if groups[0].face_normal[piece.face][1] < -0.99)
    middle = piece.corners.mean(axis=0)
    return piece.points(middle + np.array(uv)), middle


@pytest.mark.parametrize("theta", [0.0, 0.37, 1.1])
def test_rectangle_covers_pixels_as_supersampling_does(monkeypatch, theta):
    carton = without_tags(load_object("carton", SEED))
    corners, middle = front_corner(carton, [[-6e-3, -4e-3], [6e-3, -4e-3], [6e-3, 5e-3], [-6e-3, 5e-3]])
    one_patch(monkeypatch, middle - np.array([6e-3, 4e-3]), middle + np.array([6e-3, 5e-3]))
    at = pose(carton, theta)
    drawn = light(replace(carton, packaging=PRINTED), at)[0] - light(carton, at)[0]
    quad = LENS.pixels(corners @ at[1][0].T + at[0])
    left, top = np.floor(quad.min(axis=0)).astype(int) - 1
    right, bottom = np.ceil(quad.max(axis=0)).astype(int) + 2
    fine = (np.arange(32) + 0.5) / 32 - 0.5
    x = (np.arange(left, right)[:, None] + fine).ravel()
    y = (np.arange(top, bottom)[:, None] + fine).ravel()
    inside = np.ones((len(y), len(x)), bool)
    for a, b in zip(quad, np.roll(quad, -1, axis=0), strict=True):
        inside &= (b[0] - a[0]) * (y[:, None] - a[1]) - (b[1] - a[1]) * (x[None, :] - a[0]) < 0
    share = inside.reshape(bottom - top, 32, right - left, 32).mean(axis=(1, 3))
    step = drawn.max()
    assert 60 < step < 90
    assert np.abs(drawn[top:bottom, left:right] / step - share).max() < 0.02
    assert abs(drawn.sum() - drawn[top:bottom, left:right].sum()) < 1e-2


def test_print_is_clipped_at_the_edges_of_its_face(monkeypatch):
    carton = without_tags(load_object("carton", SEED))
    _, middle = front_corner(carton, [[0.0, 0.0]])
    one_patch(monkeypatch, middle + np.array([0.02, 0.06]), middle + np.array([0.06, 0.2]), -80.0)
    at = pose(carton, 0.4)
    plain, cover = light(carton, at)
    drawn, same = light(replace(carton, packaging=PRINTED), at)
    assert np.array_equal(cover, same)
    changed = np.abs(drawn - plain) > 1e-3
    assert changed.sum() > 500
    assert not np.any(changed & (cover == 0))
    assert drawn.min() > -0.05  # the lens bends face and print at other joints


def test_clipped_polygons_have_the_shared_area():
    rng = np.random.default_rng(1)
    triangle = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    for _ in range(20):
        low = rng.uniform(-0.5, 0.8, 2)
        high = low + rng.uniform(0.1, 0.8, 2)
        square = np.array([low, [high[0], low[1]], high, [low[0], high[1]]])
        found = render_print.clipped(square, triangle)
        ticks = (np.arange(400) + 0.5) / 400
        x, y = (low[i] + ticks * (high[i] - low[i]) for i in range(2))
        within = (x[None, :] > 0) & (y[:, None] > 0) & (x[None, :] + y[:, None] < 1)
        area = 0.5 * abs(
            np.sum(found[:, 0] * np.roll(found[:, 1], -1) - np.roll(found[:, 0], -1) * found[:, 1])
        )
        assert area == pytest.approx(within.mean() * np.prod(high - low), abs=3e-3)


def test_blank_objects_look_as_without_packaging():
    carton = load_object("carton", SEED)
    assert carton.packaging == BLANK
    at = pose(carton, 0.3)
    seeded = replace(carton, packaging=Packaging(PrintKind.BLANK, 9))
    assert np.array_equal(light(carton, at)[0], light(seeded, at)[0])


def test_designs_differ_by_seed_and_object_only():
    panels = (Panel(0.0, 0.0, 0.06, 0.12),)
    one = design(panels, PRINTED, "carton")
    again, other = design(panels, PRINTED, "carton"), design(panels, replace(PRINTED, seed=4), "carton")
    assert np.array_equal(one.low, again.low)
    assert one.low.shape != other.low.shape or not np.array_equal(one.low, other.low)
    assert len(design(panels, PRINTED, "juice").step) != 0
    assert len(design(panels, BLANK, "carton").step) == 0
    light_print = design(panels, replace(PRINTED, kind=PrintKind.LIGHT), "carton")
    assert np.allclose(light_print.step / MOST_CONTRAST["light"], one.step / MOST_CONTRAST["print"])


@pytest.mark.parametrize("name", OBJECT_NAMES)
def test_printed_objects_keep_their_outline_and_have_contrast(name):
    thing = without_tags(load_object(name, SEED))
    at = pose(thing, 0.2)
    plain, cover = light(thing, at)
    printed, same = light(replace(thing, packaging=PRINTED), at)
    pale, _ = light(replace(thing, packaging=Packaging(PrintKind.LIGHT, SEED)), at)
    assert np.array_equal(cover, same)
    assert 60 < np.abs(printed - plain).max() < 150
    assert np.abs(printed - plain)[cover == 0].max() < 0.05
    assert 8 < np.abs(pale - plain).max() < 20


def test_print_runs_on_from_facet_to_facet_of_a_round_wall():
    salt = load_object("salt", SEED)
    chart = BodyChart(salt.mesh_vertices)
    (group,) = face_groups(salt.mesh_vertices, salt.mesh_faces)
    walls = [piece for piece in chart.pieces(group) if abs(group.face_normal[piece.face][2]) < 0.5]
    walls.sort(key=lambda piece: piece.corners[:, 0].min())
    assert len(walls) > 40
    for one, other in pairwise(walls):
        assert one.corners[:, 0].max() == pytest.approx(other.corners[:, 0].min(), abs=1e-6)


def test_rectangles_cover_each_cell_once():
    image = np.random.default_rng(2).random((9, 14)) < 0.5
    count = np.zeros(image.shape, int)
    for top, bottom, left, right in filled_rectangles(image):
        count[top:bottom, left:right] += 1
    assert np.array_equal(count, image.astype(int))


def test_highlight_stays_in_the_image_while_the_print_moves():
    carton = without_tags(load_object("carton", SEED))
    glossy = replace(carton, packaging=Packaging(PrintKind.PRINT, SEED, True))
    printed = replace(carton, packaging=PRINTED)
    peaks = []
    for theta in (0.2, 0.35):
        at = pose(carton, theta)
        spot = light(glossy, at)[0] - light(printed, at)[0]
        assert spot.max() > 30
        peaks.append(cv2.minMaxLoc(cv2.GaussianBlur(spot, (0, 0), 3))[3])
    assert np.abs(np.subtract(*peaks)).max() <= 2


def test_object_without_tags_survives_its_archive(tmp_path):
    printed = replace(without_tags(load_object("juice", SEED)), packaging=Packaging(PrintKind.LIGHT, 8, True))
    assert "[[marker]]" not in printed.spec_toml
    save_object(printed, tmp_path / "o.npz")
    again = open_object(str(tmp_path / "o.npz"), 0)
    assert again.packaging == printed.packaging
    assert not again.spec.marker
    one, other = (Renderer(thing, PLACE, 1) for thing in (printed, again))
    poses = *pose(printed, 0.1), np.zeros(1), np.tile([-1.0, 0.0, 0.3], (1, 1))
    q = np.array([[np.cos(0.05), 0.0, np.sin(0.05), 0.0]])
    pictures = [each.render(poses[0], q, *poses[2:], 1500.0, 0.0) for each in (one, other)]
    assert np.array_equal(*pictures)


def test_devices_hand_the_surface_over_and_keep_it_out_of_the_object_file(tmp_path):
    usual = DeviceOptions("carton", SEED, "127.0.0.1")
    devices = prepare_devices(replace(usual, packaging=PRINTED, tags=False), tmp_path)
    text = devices.object_path.read_text(encoding="utf-8")
    assert "marker" not in tomllib.loads(text)
    assert "print" not in text
    given = devices._arguments()[1]
    assert open_object(given, SEED).packaging == PRINTED
    own = replace(usual, object_name=str(devices.object_path), tags=False)
    with pytest.raises(ConfigError, match="--no-tags"):
        prepare_devices(own, tmp_path)
