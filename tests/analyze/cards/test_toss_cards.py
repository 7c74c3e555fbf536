"""Cards of tosses: their numbers and pictures agree with the plan."""

from __future__ import annotations

import re

import numpy as np
import pytest
from click.testing import CliRunner

from analyze.cards.drawn_shape import drawn_shape
from analyze.cards.page import render_cards
from analyze.cards.toss_picture import ARC, TURNED, hold_picture
from analyze.cli import main
from analyze.geometry.rotations import matrix_from_vector
from analyze.planning.examine import Bench
from analyze.planning.hypothesis import hypothesis
from analyze.planning.impact import StrikerModel
from analyze.planning.tosses import plan_tosses
from analyze.planning.view import default_camera
from schemas.document import canonical_json
from tests.analyze.balanced_html import Balanced
from tests.analyze.cards.test_cards import planned
from tests.places import OBJECTS


def tossed(name: str):
    plan, model, spec = planned(name)
    tosses = plan_tosses(spec, hypothesis(model), Bench(StrikerModel(), default_camera(), 0.6), 3)
    return plan.model_copy(update={"tosses": tosses}), model, spec


@pytest.mark.parametrize("name", ["carton", "salt"])
def test_page_has_a_card_per_toss(name):
    plan, model, spec = tossed(name)
    html = render_cards(plan, model, spec)
    parser = Balanced()
    parser.feed(html)
    assert parser.open == []
    assert parser.tags.count("article") == len(plan.strikes) + 3
    assert f"{len(plan.strikes)} strikes, 3 tosses</h1>" in html.replace("\n", "")
    for toss, page in zip(plan.tosses, html.split("<article")[-3:], strict=True):
        rise = 9.81 * toss.flight_s.target**2 / 8
        for said in (
            f'id="{toss.id}"',
            "3 <small>turns/s",
            f"{1000 * rise:.0f} <small>mm",
            f"{1000 * toss.p_world_apex[1]:.0f} <small>mm",
            f"{toss.flight_s.target:.2f} s in the air",
            f"{np.degrees(toss.principal_axis_angle_rad):.0f}°",
        ):
            assert said in page
    assert "nan" not in re.sub(r"[a-z-]*nan[a-z]+", "", html)


def test_a_plan_without_tosses_has_none():
    plan, model, spec = planned("carton")
    assert "toss" not in render_cards(plan, model, spec).lower().replace("toss.", "")


def test_cards_for_a_phone_have_no_camera():
    plan, model, spec = tossed("carton")
    cards = render_cards(plan, model, spec, by_hand=True).split("<article")[-3:]
    assert all("camera" not in re.sub(r'class="camera"|aria-label="[^"]*"', "", card) for card in cards)
    assert all("phone" in card for card in cards)


def test_the_arrow_of_the_spin_turns_by_the_right_hand_rule():
    """Top of the object moves away from the thrower, towards the camera."""
    plan, _, _ = tossed("carton")
    toss = plan.tosses[0]
    axis = TURNED @ np.array(toss.R_world_object) @ np.array(toss.spin_axis_object)
    assert (matrix_from_vector(0.1 * axis) @ [0.0, 0.0, 1.0])[1] > 0
    assert ARC[-1] > ARC[0]


def test_picture_names_what_is_held():
    plan, model, spec = tossed("carton")
    svg = hold_picture(drawn_shape(model), spec, plan.tosses[0], np.zeros(3), "tag 2")
    for said in (
        "spin axis",
        "spin this way",
        "a finger of each hand on each red dot",
        "tag 2 faces the camera",
    ):
        assert said in svg


def test_command_draws_the_tosses_too(tmp_path):
    plan, _, _ = tossed("carton")
    (tmp_path / "plan.json").write_text(canonical_json(plan))
    done = CliRunner().invoke(
        main, ["cards", str(OBJECTS / "carton.toml"), str(tmp_path / "plan.json"), "-o", str(tmp_path)]
    )
    assert done.exit_code == 0, done.output
    assert (tmp_path / "t3.svg").read_text().startswith("<svg")
