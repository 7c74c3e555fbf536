"""Videos in any order and of any name find their planned strikes by what they show."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from analyze.errors import ImportRefused
from analyze.geometry.rotations import inverse_transform, matrix_from_vector, transform
from analyze.importing.matching import (
    Match,
    TipInView,
    match_strikes,
    matched_ids,
)
from analyze.importing.options import ImportOptions
from analyze.importing.prepare import prepare
from analyze.importing.prepared_import import Assignment
from analyze.importing.tip_view import TipView, TurningLine
from schemas.document import canonical_json
from schemas.object_spec import parse_object_spec
from schemas.strike_plan import StrikePlan, parse_strike_plan
from tests.analyze.estimation.bodies import box_body, planned_strike
from tests.analyze.importing import tip_videos
from tests.analyze.importing.tip_videos import setting, tip, write_video
from tests.analyze.importing.tipped_boxes import angles, images, picture, strikes, write_videos

RATE = 120
SHUFFLED = (2, 0, 3, 1)


@pytest.fixture(scope="module")
def filmed(tmp_path_factory) -> tuple[list[Path], dict[str, Path]]:
    """A video of each of four strikes over parallel edges, named as a phone names them; the option files."""
    folder = tmp_path_factory.mktemp("filmed")
    planned = strikes()
    paths, options = write_videos(folder, planned, images(planned, RATE), RATE)
    renamed = [path.rename(folder / f"IMG_{7 * number:04}.mp4") for number, path in enumerate(paths)]
    files = dict(zip(options[::2], map(Path, options[1::2]), strict=True))
    camera = files["--camera"]
    unplaced = camera.with_name("lens.toml")
    unplaced.write_text(re.sub("T_world_camera.*\n", "", camera.read_text()))
    return renamed, {**files, "--lens": unplaced}


def options_for(sources, files, lens="--lens", **more) -> ImportOptions:
    return ImportOptions(tuple(sources), files["--object"], files["--plan"], files[lens], **more)


@pytest.mark.parametrize("lens", ["--lens", "--camera"])
def test_shuffled_videos_of_any_name_find_their_strikes(filmed, lens):
    paths, files = filmed
    with prepare(options_for([paths[number] for number in SHUFFLED], files, lens)) as prepared:
        found = [window.plan_strike_id for window in prepared.windows]
    assert found == [f"s{number + 1}" for number in SHUFFLED]
    assert prepared.assignment is Assignment.IMAGES


def test_name_that_contradicts_the_images_is_refused_with_both_sides(filmed, tmp_path):
    paths, files = filmed
    wrong = tmp_path / "s1.mp4"
    wrong.write_bytes(paths[1].read_bytes())
    with pytest.raises(ImportRefused) as caught:
        prepare(options_for([wrong], files))
    said = str(caught.value)
    assert said.startswith("s1.mp4: by its name it is s1 (the −z side underneath, tag 3 to the camera, tips ")
    assert "but the images show s2 (the +x side underneath" in said
    assert "\n" not in said


def test_video_without_a_strike_is_named_among_recognised_ones(filmed, tmp_path):
    paths, files = filmed
    still = write_video(tmp_path / "still.mp4", [picture(strikes()[0], 0.0)] * 60)
    with pytest.raises(ImportRefused) as caught:
        prepare(options_for([paths[2], still, paths[0]], files))
    assert str(caught.value).startswith(
        "still.mp4: which strike it shows is unknown: no tag is at rest in view and then tips"
    )


def test_object_placed_the_wrong_way_round_is_refused_with_the_reason(filmed, tmp_path):
    paths, files = filmed
    strike = strikes()[0]
    turned = write_video(tmp_path / "turned.mp4", [picture(strike, -theta) for theta in angles(strike, RATE)])
    with pytest.raises(ImportRefused, match=r"turned.mp4: .* its tag turns the other way round than in the"):
        prepare(options_for([paths[2], turned, paths[0]], files))


def test_strike_that_is_not_planned_is_refused_with_the_nearest(filmed, tmp_path):
    paths, files = filmed
    plan = parse_strike_plan(files["--plan"].read_text(), "plan.json")
    fewer = tmp_path / "fewer.json"
    fewer.write_text(canonical_json(plan.model_copy(update={"strikes": plan.strikes[:2]})))
    with pytest.raises(ImportRefused, match=r"IMG_0014.mp4: .* edge of no planned strike; nearest is s[12] "):
        prepare(options_for([paths[0], paths[2]], {**files, "--plan": fewer}))


def test_session_video_with_fewer_strikes_than_planned_is_matched(tmp_path):
    path = write_video(tmp_path / "a.mp4", tip(), crf="10")
    with prepare(ImportOptions((path,), *setting(tmp_path, ("s1", "s2"), placed=False))) as prepared:
        assert [window.strike_id for window in prepared.windows] == ["s1.1"]


def test_tags_without_places_are_reported_with_the_command_that_finds_them(tmp_path, monkeypatch):
    unplaced = re.sub(r"(?m)^T_object_marker.*\n", "", tip_videos.OBJECT)
    monkeypatch.setattr(tip_videos, "OBJECT", unplaced)
    path = write_video(tmp_path / "IMG_0001.mp4", tip())
    with prepare(ImportOptions((path,), *setting(tmp_path))) as prepared:
        assert prepared.assignment is Assignment.IMAGES
        assert any("`analyze register` finds the places" in remark for remark in prepared.remarks())


# --- thirty sets, as poses with a hand's and a phone's errors

SPEC = parse_object_spec(
    Path(__file__).parents[3].joinpath("docs/examples/teabox.toml").read_text(encoding="utf-8"), "teabox.toml"
)
BODY = box_body((0.075, 0.065, 0.13), (0.03, 0.05, 0.02), -0.01, (0.3, 0.1, -0.9), edge_radius=0.001)
EDGES = [
    planned_strike(BODY, face, sign, along, side)
    for face, along in ((2, 1), (2, 0), (0, 1), (1, 0))
    for sign in (-1, 1)
    for side in (-1, 1)
]
PLAN = StrikePlan(object_name="tea box", object_sha256="0" * 64, strikes=EDGES[:12])
T_WORLD_CAMERA = transform(
    matrix_from_vector(np.array([-0.1, 0.0, 0.03])) @ np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]]),
    np.array([0.0, -0.4, 0.12]),
)


def seen(strike, random: np.random.Generator, name: str, heading: float = 0.0) -> TipInView:
    """View of a strike: placed by hand, tags glued by hand, pose and line with the errors of tracking."""
    hand = transform(
        matrix_from_vector(np.array([0.0, 0.0, strike.heading_rad + heading + random.normal(0, 0.03)])),
        np.array([*random.normal(0, 0.004, 2), 0.0]),
    )
    glued = transform(matrix_from_vector(random.normal(0, 0.02, 3)), random.normal(0, 0.002, 3))
    placed = transform(np.array(strike.R_world_object), np.array(strike.p_world_object))
    pose = inverse_transform(T_WORLD_CAMERA) @ hand @ placed @ glued
    direction = matrix_from_vector(random.normal(0, 0.05, 3)) @ np.array(strike.pivot.direction)
    point = np.array(strike.pivot.point) + random.normal(0, 0.004, 3)
    return TipInView(name, TipView(0, pose, TurningLine(direction, point, 0.07)))


def matched(tips, up=None) -> list[Match]:
    return match_strikes(tips, PLAN, SPEC, up)


@pytest.mark.parametrize("seed", range(30))
def test_thirty_shuffled_sets_are_matched_or_refused_with_the_reason(seed):
    """Sets of 4 to 9 videos, with repeats and gaps; a third have one video of another strike or end."""
    random = np.random.default_rng(seed)
    chosen = random.choice(len(PLAN.strikes), size=random.integers(4, 10))
    tips = [seen(PLAN.strikes[i], random, f"V{number}.mp4") for number, i in enumerate(chosen)]
    expected = [PLAN.strikes[i].axis_id for i in chosen]
    odd = int(random.integers(len(tips)))
    if seed % 3 == 1:
        tips[odd] = seen(PLAN.strikes[chosen[odd]], random, "odd.mp4", heading=np.pi)
        matches = matched(tips)
        assert "over an edge of no planned strike" in matches[odd].misfit
        assert matched_ids(matches, [None] * len(tips)) is None
        return
    if seed % 3 == 2:
        tips[odd] = seen(EDGES[12 + int(random.integers(4))], random, "odd.mp4")
        assert "over an edge of no planned strike" in matched(tips)[odd].misfit
        return
    ids = matched_ids(matched(tips), [None] * len(tips))
    assert ids is not None
    axis_of = {strike.id: strike.axis_id for strike in PLAN.strikes}
    assert [axis_of[each] for each in ids] == expected
