"""Placement cards: pictures and texts agree with the plan."""

import re
from functools import cache

import cv2
import numpy as np
import pytest
import trimesh
from click.testing import CliRunner

from analyze.cards import ink
from analyze.cards.by_hand import force_words
from analyze.cards.drawn_shape import MAX_FACES, drawn_shape, simplify_mesh
from analyze.cards.page import placement_cards, render_cards
from analyze.cards.scene import HEIGHT, SQUARES, WIDTH
from analyze.cards.view import from_above, from_the_camera, from_the_front_right
from analyze.cli import main
from analyze.geometry.object_model import load_object_model
from analyze.planning.impact import StrikerModel
from analyze.reading.object_file import read_object_files
from schemas.object_spec import LengthUnit
from schemas.strike_plan import StrikePlan
from schemas.tags import family_and_id
from tests.analyze.balanced_html import Balanced
from tests.analyze.planning.planned import make_plan
from tests.places import OBJECTS


@cache
def planned(name):
    files = read_object_files(OBJECTS / f"{name}.toml")
    model = load_object_model(files.spec, files.shape_bytes, files.shape_name)
    return make_plan(model, files.spec, files.sha256, StrikerModel()), model, files.spec


@pytest.mark.parametrize("name", ["carton", "salt"])
def test_page_has_a_card_per_strike_and_is_self_contained(name):
    plan, model, spec = planned(name)
    html = render_cards(plan, model, spec)
    parser = Balanced()
    parser.feed(html)
    assert parser.open == []
    assert parser.tags.count("article") == len(plan.strikes)
    assert parser.tags.count("svg") == 4 * len(plan.strikes)
    assert not {"script", "link", "img"} & set(parser.tags)
    assert not re.search(r'(?:src|href)="(?!#)', html)
    assert "nan" not in re.sub(r"[a-z-]*nan[a-z]+", "", html)
    assert render_cards(plan, model, spec) == html


def test_card_shows_the_plans_numbers():
    plan, model, spec = planned("carton")
    pages = render_cards(plan, model, spec).split("<article")[1:]
    for strike, page in zip(plan.strikes, pages, strict=True):
        for said in (
            f"{1000 * strike.impact_height_m:.0f} <small>mm",
            f"{strike.tip_speed_m_s.target:.2f} <small>m/s",
            f"{np.degrees(strike.phi_predicted_rad):.0f}°",
            f"± {np.degrees(strike.phi_measured_sd_rad):.2f}°",
            f"tag {strike.visible_markers[0]} faces the camera".capitalize(),
            f"strike&nbsp;{strike.id}",
        ):
            assert said in page, said
    assert "Put it back exactly as before" in pages[3]


def test_measures_are_of_the_object_as_placed():
    plan, model, spec = planned("carton")
    for card in placement_cards(plan, model, spec):
        place = card.place
        along = np.abs(np.array(card.strike.pivot.direction))
        half = float(along @ model.extent) / 2
        assert place.edge == pytest.approx((-half, half), abs=1e-9)
        assert place.front_to_mark == pytest.approx(half)
        assert place.hit[1:] == pytest.approx([0.0, card.strike.impact_height_m], abs=1e-9)
        assert place.hit[0] == pytest.approx(place.low[0], abs=1e-9)
        assert place.low[2] == pytest.approx(0.0, abs=1e-9)


def test_rim_touches_the_line_in_one_point():
    plan, model, spec = planned("salt")
    card = placement_cards(plan, model, spec)[0]
    assert card.place.edge is None
    assert "rim touches the line at the mark" in card.on_line
    assert card.place.front_to_mark == pytest.approx(0.036, abs=1e-4)


def painted(svg):
    """Filled paths of one of our SVG pictures as pixels, 4 per unit."""
    width, height = map(float, re.search(r'viewBox="0 0 ([\d.]+) ([\d.]+)"', svg).groups())
    image = np.full((int(4 * height), int(4 * width)), 255, dtype=np.uint8)
    for path, fill in re.findall(r'<path d="([^"]*)" fill="#([0-9a-f]+)"', svg):
        level = int(fill[:1] * 2 if len(fill) == 3 else fill[:2], 16)
        for part in path.split("M")[1:]:
            points = np.array([[float(x) for x in pair.split()] for pair in part.rstrip("Z").split("L")])
            cv2.fillPoly(image, [np.round(64 * points).astype(np.int32)], level, shift=4)
    return image


@pytest.mark.parametrize("name", ["carton", pytest.param("spray", marks=pytest.mark.slow), "salt"])
def test_tag_that_faces_the_camera_can_be_detected_in_the_pictures(name):
    plan, model, spec = planned(name)
    detector = cv2.aruco.ArucoDetector(cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11))
    seen = {}
    for card in placement_cards(plan, model, spec):
        if card.strike.axis_id in seen:
            continue
        for picture in (card.scene, card.side):
            found = detector.detectMarkers(painted(str(picture)))[1]
            assert found is not None
            assert card.strike.visible_markers[0] in found.ravel()
        seen[card.strike.axis_id] = card


def test_tags_of_two_families_are_drawn(tmp_path):
    """A carton whose ends carry tags of family 25h9, with the same ids as its other tags."""
    path = OBJECTS / "carton.toml"
    text = path.read_text().replace('family = "36h11"\nid = 0\n', 'family = "25h9"\nid = 2\n')
    (tmp_path / "carton.toml").write_text(text)
    files = read_object_files(tmp_path / "carton.toml")
    model = load_object_model(files.spec, files.shape_bytes, files.shape_name)
    plan = make_plan(model, files.spec, files.sha256, StrikerModel())
    usual = planned("carton")[0]
    names = [strike.visible_markers for strike in plan.strikes]
    assert names == [
        ["25h9-2" if name == 0 else name for name in strike.visible_markers] for strike in usual.strikes
    ]
    assert StrikePlan.model_validate_json(plan.model_dump_json()) == plan
    for card in placement_cards(plan, model, files.spec):
        family, tag_id = family_and_id(card.strike.visible_markers[0])
        detector = cv2.aruco.ArucoDetector(
            cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, family.opencv))
        )
        assert tag_id in detector.detectMarkers(painted(str(card.side)))[1].ravel()
    assert any(name == ["25h9-2"] for name in names)
    assert "Tag 25h9-2 faces the camera" in render_cards(plan, model, files.spec)


def test_object_name_is_escaped():
    plan, model, spec = planned("carton")
    html = render_cards(plan.model_copy(update={"object_name": "<script>x"}), model, spec)
    assert "<script" not in html


def test_parallel_views_are_to_scale_and_not_mirrored():
    frame = (0, 0), (100, 100)
    box = np.array([[0, 0, 0], [0.1, 0.2, 0.05]])
    side = from_the_camera().fitted(box, *frame)
    assert side.project(np.array([0.1, 0, 0]))[0] - side.project(np.zeros(3))[0] == pytest.approx([100, 0])
    assert side.project(np.array([0, 0, 0.05]))[0] - side.project(np.zeros(3))[0] == pytest.approx([0, -50])
    above = from_above().fitted(box, *frame)
    assert above.project(np.array([0, 0.2, 0]))[0] - above.project(np.zeros(3))[0] == pytest.approx([0, -100])
    scene = from_the_front_right(np.zeros(3), 1.0, 0.5, 0.4)
    assert np.linalg.det(scene.axes) == pytest.approx(1.0)


def test_fine_mesh_is_simplified_and_keeps_its_edges():
    box = trimesh.creation.box([80.0, 60.0, 150.0]).subdivide_to_size(1.2)
    cell = 150.0 / 30
    vertices, faces = simplify_mesh(np.asarray(box.vertices), np.asarray(box.faces), cell)
    assert len(box.faces) > 50_000
    assert len(faces) < MAX_FACES * 1.5
    assert np.ptp(vertices, axis=0) == pytest.approx([80, 60, 150], abs=0.02 * cell)
    # Every point still lies on the box's surface.
    off = np.abs(np.abs(vertices) / [40, 30, 75] - 1).min(axis=1)
    assert off.max() < 1e-3


def test_fine_convex_mesh_is_drawn_as_its_hull():
    _, _, spec = planned("carton")
    box = trimesh.creation.box([0.08, 0.06, 0.15]).subdivide().subdivide().subdivide()
    shape = spec.shape.model_copy(update={"box": None, "file": "b.stl", "unit": LengthUnit.METRE})
    model = load_object_model(spec.model_copy(update={"shape": shape}), box.export(file_type="stl"), "b.stl")
    assert len(model.faces) == 12 * 64
    drawn = drawn_shape(model)
    assert len(drawn.triangles) == 12
    assert sum(drawn.creases) == 12
    a, b, c = np.moveaxis(drawn.triangles, 1, 0)
    assert np.all(np.einsum("ti,ti->t", np.cross(b - a, c - a), a) > 0)


def test_triangles_of_hollow_bodies_are_small_enough_to_sort_by_depth():
    _, carton, _ = planned("carton")
    _, spray, _ = planned("spray")
    assert drawn_shape(carton).convex
    hollow = drawn_shape(spray)
    assert not hollow.convex
    lengths = np.linalg.norm(np.roll(hollow.triangles, -1, axis=1) - hollow.triangles, axis=2)
    assert lengths.max() <= hollow.size / 8


def test_plan_command_writes_cards_by_default(tmp_path):
    out = CliRunner().invoke(
        main, ["plan", str(OBJECTS / "carton.toml"), "--strikes", "3", "-o", str(tmp_path / "p.json")]
    )
    assert out.exit_code == 0
    assert "cards: " in out.output
    assert (tmp_path / "p-cards.html").read_text(encoding="utf-8").count("<article") == 3
    out = CliRunner().invoke(
        main,
        [
            "plan",
            str(OBJECTS / "carton.toml"),
            "--strikes",
            "3",
            "--no-cards",
            "-o",
            str(tmp_path / "q.json"),
        ],
    )
    assert out.exit_code == 0
    assert {path.name for path in tmp_path.iterdir()} == {"p.json", "p-cards.html", "q.json"}


def test_card_states_an_impact_beside_the_mark():
    plan, model, spec = planned("carton")
    first = plan.strikes[0]
    moved = [x + 0.012 * d for x, d in zip(first.impact.point, first.pivot.direction, strict=True)]
    other = first.model_copy(update={"impact": first.impact.model_copy(update={"point": moved})})
    plain, beside = (
        placement_cards(plan.model_copy(update={"strikes": [each]}), model, spec)[0]
        for each in (first, other)
    )
    assert "from the mark" not in plain.set_striker
    assert "12 mm from the mark away from the camera" in beside.set_striker
    assert beside.on_line == plain.on_line


def test_plan_by_the_papers_rule_has_cards(tmp_path):
    out = CliRunner().invoke(
        main, ["plan", str(OBJECTS / "carton.toml"), "--method", "paper", "-o", str(tmp_path / "p.json")]
    )
    assert out.exit_code == 0
    assert "not predicted by this method" in (tmp_path / "p-cards.html").read_text(encoding="utf-8")


def test_cards_for_a_hand_and_a_phone_have_no_speeds_and_no_striker():
    plan, model, spec = planned("carton")
    html = render_cards(plan, model, spec, by_hand=True)
    parser = Balanced()
    parser.feed(html)
    assert parser.open == []
    shown = re.sub(r"<style>.*?</style>|<[^>]+>", " ", html, flags=re.DOTALL)
    assert not re.search(r"m/s|striker|camera", shown)
    card = placement_cards(plan, model, spec, by_hand=True)[0]
    assert card.set_striker.startswith(
        f"Flick it {1000 * plan.strikes[0].impact_height_m:.0f} mm above the table"
    )
    distance = -1000 * plan.strikes[0].camera_pose[1][3]
    assert f'{distance:.0f} <small>mm</small></div>\n<div class="note">from the mark to the lens' in html


@pytest.mark.parametrize(
    ("impulse", "word"), [(0.001, "very gently"), (0.02, "gently"), (0.3, "hard"), (9.0, "very hard")]
)
def test_force_is_said_in_words(impulse, word):
    strike = planned("carton")[0].strikes[0]
    aimed = strike.impulse_n_s.model_copy(update={"target": impulse})
    assert force_words(strike.model_copy(update={"impulse_n_s": aimed}))[0] == word


def test_lines_of_the_table_end_at_the_pictures_edges():
    cut = ink.cut_line(np.array([[-50.0, 20.0], [150.0, 20.0]]), 100, 40)
    assert cut == pytest.approx(np.array([[0, 20], [100, 20]]))
    slanting = ink.cut_line(np.array([[-10.0, 10.0], [20.0, -20.0]]), 100, 40)
    assert slanting is None
    within = np.array([[10.0, 10.0], [20.0, 30.0]])
    assert ink.cut_line(within, 100, 40) == pytest.approx(within)
    plan, model, spec = planned("carton")
    for scene in render_cards(plan, model, spec, by_hand=True).split('<figure class="scene">')[1:]:
        lines = re.findall(rf'<path d="M(\S+ \S+L\S+ \S+)" fill="none" stroke="{SQUARES}"', scene)
        ends = np.array([line.replace("L", " ").split() for line in lines], dtype=float)
        assert len(lines) > 9
        assert (ends >= -0.1).all()
        assert (ends.reshape(-1, 2) <= np.array([WIDTH, HEIGHT]) + 0.1).all()
