"""Strikes that nobody planned: faces, headings and edges are found, or the import is refused."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from analyze.cli import main as analyze
from analyze.errors import ImportRefused
from analyze.geometry.object_model import load_object_model
from analyze.geometry.rotations import inverse_transform, matrix_from_vector, transform
from analyze.importing.edge_matches import EdgeMatch, match_edges
from analyze.importing.found_placing import found_placing
from analyze.importing.headings import common_headings
from analyze.importing.matching import TipInView
from analyze.importing.options import ImportOptions
from analyze.importing.prepare import prepare
from analyze.importing.stated_edges import stated_edges
from analyze.planning.possible_tips import PossibleTip, PossibleTips
from analyze.planning.rim_tangents import named_tangents
from analyze.planning.stable_planes import resting_planes
from schemas.document import DocumentError
from schemas.object_spec import ObjectSpec, parse_object_spec
from schemas.strike_plan import PlanMethod, parse_strike_plan, read_strike_plan
from tests.analyze.importing.tip_videos import OBJECT, T_WORLD_CAMERA
from tests.analyze.importing.tipped_boxes import images, strikes, write_videos
from tests.analyze.importing.unplanned_sessions import (
    OFF_LINE_M,
    SHAPES,
    camera,
    object_file,
    seen_view,
    without,
)

RATE = 120
SHUFFLED = (2, 0, 3)


@pytest.fixture(scope="module")
def filmed(tmp_path_factory) -> tuple[list[Path], dict[str, Path]]:
    """A video of each of three strikes over parallel edges, named by a phone; the option files."""
    folder = tmp_path_factory.mktemp("filmed")
    planned = strikes()
    paths, options = write_videos(folder, planned, images(planned, RATE), RATE)
    renamed = [
        paths[number].rename(folder / f"IMG_{7 * place:04}.mp4") for place, number in enumerate(SHUFFLED)
    ]
    files = dict(zip(options[::2], map(Path, options[1::2]), strict=True))
    text = files["--camera"].read_text()
    files["--lens"] = folder / "lens.toml"
    files["--lens"].write_text("\n".join(line for line in text.splitlines() if "T_world_camera" not in line))
    return renamed, files


def options_for(filmed, lens="--lens", **more) -> ImportOptions:
    paths, files = filmed
    return ImportOptions(tuple(paths), files["--object"], None, files[lens], **more)


def run(*arguments: object) -> tuple[int, str, str]:
    done = CliRunner().invoke(analyze, list(map(str, arguments)), catch_exceptions=False)
    return done.exit_code, done.stdout, done.stderr


@pytest.mark.parametrize("lens", ["--lens", "--camera"])
def test_edges_headings_and_camera_are_found_from_videos_alone(filmed, lens):
    with prepare(options_for(filmed, lens)) as prepared:
        plan = prepared.plan
        assert plan.method is PlanMethod.IMAGES
        assert [strike.id for strike in plan.strikes] == ["s1", "s2", "s3"]
        for found, number in zip(plan.strikes, SHUFFLED, strict=True):
            planned = strikes()[number]
            assert np.allclose(found.R_world_object, planned.R_world_object, atol=1e-9)
            apart = np.cross(np.subtract(found.pivot.point, planned.pivot.point), planned.pivot.direction)
            assert np.linalg.norm(apart) < 1.1e-3, "the edge's expected rounding is not that of the drawn box"
            assert abs(found.heading_rad) < math.radians(1.0)
            assert found.visible_markers == [3]
            assert found.impact is None
        T = np.array(prepared.calibration.T_world_camera)
        assert np.degrees(np.arccos(T[2, :3] @ T_WORLD_CAMERA[2, :3])) < 0.5
        assert abs(T[2, 3] - T_WORLD_CAMERA[2, 3]) < 1e-3
        assert parse_strike_plan(prepared.plan_text, "plan.json") == plan


def test_centre_of_mass_is_that_with_the_plan(filmed, tmp_path):
    paths, files = filmed
    usual = [*paths, "--object", files["--object"], "--camera", files["--lens"]]
    with prepare(options_for(filmed)) as prepared:
        exact = [strike.model_copy(update={"heading_rad": 0.0}) for strike in prepared.plan.strikes]
        plan = prepared.plan.model_copy(update={"strikes": exact})
    (tmp_path / "plan.json").write_text(plan.model_dump_json())
    assert run("import", *usual, "--plan", tmp_path / "plan.json", "-o", tmp_path / "with.mcap")[0] == 0
    code, shown, _ = run("import", *usual, "-o", tmp_path / "without.mcap", "--yes")
    assert code == 0
    assert "strikes assigned by the tag at rest and the edge" in shown
    found = []
    for name in ("with", "without"):
        _, shown, _ = run("estimate", tmp_path / f"{name}.mcap", "--json", "--no-cache")
        found.append(np.array(json.loads(shown)["centre_of_mass"]["value"]))
    # Three parallel edges do not show c along them.
    assert np.linalg.norm((found[0] - found[1])[[0, 2]]) < 2e-5


def test_table_shows_edge_and_confidence_and_writing_is_confirmed(filmed, tmp_path):
    paths, files = filmed
    usual = ["import", *paths, "--object", files["--object"], "--camera", files["--lens"]]
    code, shown, said = run(*usual, "-o", tmp_path / "a.mcap", "--edge", "s2=bottom,+x")
    assert code == 2
    assert "cannot be confirmed without a terminal" in said
    assert not (tmp_path / "a.mcap").exists()
    assert all(word in " ".join(shown.split()) for word in ("tips over", "heading", "next best", "(p"))
    assert run(*usual, "--dry-run", "--edge", "s1=+x,bottom", "--plan", files["--plan"])[0] == 2


def test_stated_edge_that_the_images_contradict_is_refused_with_both_sides(filmed):
    with pytest.raises(
        ImportRefused, match=r"^IMG_0007.mp4: by --edge s2=-x,top it is an edge of \+z and -x, but"
    ):
        prepare(options_for(filmed, edges=("s2=-x,top",)))


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ({"strikes": ("s1", "-", "-")}, "without a plan strikes have no names: state an edge"),
        ({"whole": True}, "leave out --whole"),
    ],
)
def test_options_that_need_a_plan_are_refused_with_the_remedy(filmed, more, said):
    with pytest.raises(ImportRefused, match=said) as caught:
        prepare(options_for(filmed, **more))
    assert "\n" not in str(caught.value)


def test_strikes_that_are_left_out_keep_the_others_ids(filmed):
    with prepare(options_for(filmed, strikes=("auto", "-", "auto"))) as prepared:
        assert [window.strike_id for window in prepared.windows] == ["s1.1", "s3.1"]


def test_object_without_places_of_tags_is_refused_in_one_line(filmed, tmp_path):
    paths, files = filmed
    bare = tmp_path / "box.toml"
    text = files["--object"].read_text()
    bare.write_text("\n".join(line for line in text.splitlines() if "T_object_marker" not in line))
    with pytest.raises(
        ImportRefused, match=r"has no place of a tag on the object .* give it .--plan., or measure"
    ):
        prepare(ImportOptions(tuple(paths), bare, None, files["--camera"]))


def test_plan_of_what_was_struck_is_not_carried_out(filmed, tmp_path):
    path = tmp_path / "found.json"
    with prepare(options_for(filmed)) as prepared:
        path.write_text(prepared.plan_text)
    with pytest.raises(DocumentError, match="found in images, without a place and speed to strike at"):
        read_strike_plan(path)
    with pytest.raises(DocumentError, match="s1': impact is missing"):
        parse_strike_plan(prepared.plan_text.replace('"images"', '"ours"'), "plan.json")


# --- every tip of five objects, as poses with the errors of tracking and glue


@pytest.fixture(scope="module", params=SHAPES)
def tipped(request) -> tuple[PossibleTips, ObjectSpec, list[tuple[PossibleTip, TipInView, float]]]:
    """Possible tips of an object, and each as seen: anywhere on the table, in any heading."""
    text, data = object_file(request.param)
    spec = parse_object_spec(text, "object.toml")
    possible = PossibleTips(load_object_model(spec, data, "object.stl"), spec)
    random, seen = np.random.default_rng(3), []
    for number, tip in enumerate(possible.tips):
        heading = float(random.uniform(-np.pi, np.pi))
        stands = transform(
            matrix_from_vector(np.array([0.0, 0.0, heading])),
            np.array([*random.uniform(-OFF_LINE_M, OFF_LINE_M, 2), 0.0]),
        ) @ transform(tip.axis.R_world_object, tip.axis.p_world_object)
        T = inverse_transform(camera().T_world_camera) @ stands
        view = seen_view(T, tip.axis.direction, tip.axis.point, random)
        seen.append((tip, TipInView(f"V{number}.mp4", view), heading))
    return possible, spec, seen


def matched(tipped, up=None) -> list[EdgeMatch]:
    possible, spec, seen = tipped
    return match_edges([tip for _, tip, _ in seen], [None] * len(seen), possible, spec, up)


def test_every_tip_is_recognised_with_its_heading_wherever_the_object_stands(tipped):
    _, _, seen = tipped
    matches = matched(tipped)
    assert [match.best.tip.axis.id for match in matches] == [tip.axis.id for tip, _, _ in seen]
    assert all(match.following is None or match.following.mismatch > 1 for match in matches)
    placing = found_placing([tip for _, tip, _ in seen], matches, None)
    turned = np.subtract(placing.headings, [heading for _, _, heading in seen])
    off = np.angle(np.exp(1j * (turned - turned[0])))
    assert np.degrees(np.abs(off).max()) < 5.0
    true = camera().T_world_camera
    assert abs(placing.T_world_camera[2, 3] - true[2, 3]) < 0.005
    assert np.degrees(np.arccos(placing.T_world_camera[2, :3] @ true[2, :3])) < 1.0


def test_a_tip_over_an_edge_that_is_not_possible_is_refused(tipped):
    possible, spec, seen = tipped
    up = camera().T_world_camera[2, :3]
    for tip, view, _ in seen:
        with pytest.raises(ImportRefused, match=r"^V\d+.mp4: .*nearest is p\d"):
            match_edges([view], [None], without(possible, tip.axis.id), spec, up)


def test_a_camera_that_was_moved_is_refused_for_the_strike_after_which_it_moved(tipped):
    possible, spec, seen = tipped
    tips = [view for _, view, _ in seen[:3]]
    moved = transform(matrix_from_vector(np.array([0.0, 0.0, 0.35])), np.zeros(3))
    view = tips[2].view
    assert view is not None
    tips[2] = TipInView("moved.mp4", type(view)(view.marker, moved @ view.T_camera_object, view.line))
    with pytest.raises(ImportRefused, match=r"^moved.mp4: .* tilted by (19|20|21) deg"):
        match_edges(tips, [None] * 3, possible, spec, None)


def test_rim_is_tipped_over_in_any_direction():
    text, _ = object_file("cylinder")
    spec = parse_object_spec(text, "object.toml")
    possible = PossibleTips(load_object_model(spec, None, "object"), spec)
    direction = np.array([math.cos(0.7), math.sin(0.7), 0.0])
    tips = possible.over_rims(direction)
    assert len(tips) == 2
    assert all(tip.axis.rolls and tip.axis.id.endswith("deg") for tip in tips)
    assert all(abs(float(tip.axis.direction @ direction)) > math.cos(math.radians(0.6)) for tip in tips)
    model = load_object_model(spec, None, "object")
    again = named_tangents([tip.axis.id for tip in tips], model, spec, resting_planes(model), model.centroid)
    assert [axis.id for axis in again] == sorted(tip.axis.id for tip in tips)
    planned = next(tip for tip in possible.tips if tip.axis.rolls)
    assert planned.axis.id in {tip.axis.id for tip in possible.over_rims(planned.axis.direction)}


def test_statement_names_the_two_sides_that_meet_in_an_edge():
    spec = parse_object_spec(OBJECT, "object.toml")
    possible = PossibleTips(load_object_model(spec, None, "object"), spec)
    (stated,) = stated_edges(["s1=+x,bottom"], ["s1"], possible.tips)
    assert stated is not None
    named = [tip for tip in possible.tips if stated.names(tip)]
    assert len(named) == 2, "once from the bottom towards +x, once from +x towards the bottom"
    (other,) = stated_edges([f"s1={named[0].axis.id}"], ["s1"], possible.tips)
    assert other is not None
    assert [tip for tip in possible.tips if other.names(tip)] == named[:1]


@pytest.mark.parametrize(
    ("values", "said"),
    [
        (["s9=p0e1"], "there is no strike s9, the sources show 2 strikes, s1 to s2"),
        (["s1=middle"], "--edge s1=middle: the object has no such edge: name the two sides"),
        (["p0e1"], "state strike and edge, as s1="),
        (["s1=p0e1", "s1=p0e2"], "the edge of s1 is stated twice"),
    ],
)
def test_statement_that_cannot_be_used_is_refused_with_the_remedy(values, said):
    spec = parse_object_spec(OBJECT, "object.toml")
    possible = PossibleTips(load_object_model(spec, None, "object"), spec)
    with pytest.raises(ImportRefused, match=said) as caught:
        stated_edges(values, ["s1", "s2"], possible.tips)
    assert "\n" not in str(caught.value)


def test_headings_of_one_edge_are_common_to_a_few_degrees():
    degrees = [179.0, 0.0, -179.0, 90.0, 3.0]
    found = np.degrees(common_headings(np.radians(degrees).tolist(), ["a", "a", "a", "a", "b"]))
    assert np.allclose(np.abs(found[[0, 2]]), 180.0)
    assert np.allclose(found[[1, 3, 4]], [0.0, 90.0, 3.0])
