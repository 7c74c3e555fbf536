"""Videos find their strikes where tags have no known place, or the strikes to be named are asked for."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pytest

from analyze.errors import ImportRefused
from analyze.geometry.object_model import load_object_model
from analyze.geometry.rotations import inverse_transform, matrix_from_vector, transform
from analyze.importing.matching import Match, TipInView, matched_ids, refuse_contradiction
from analyze.importing.tag_place import TaggedBody
from analyze.importing.tip_view import TagView, TurningLine
from analyze.importing.unplaced_matches import match_unplaced
from schemas.strike_plan import StrikePlan
from tests.analyze.importing.test_matching import EDGES, SPEC, T_WORLD_CAMERA

UNPLACED = SPEC.model_copy(
    update={"marker": [each.model_copy(update={"T_object_marker": None}) for each in SPEC.marker]}
)
STRIKES = [each.model_copy(update={"id": f"s{number + 1}"}) for number, each in enumerate(EDGES)]
BODY = TaggedBody(
    load_object_model(SPEC, None, "box"), {each.name: each for each in SPEC.marker}, T_WORLD_CAMERA
)


def plan_of(*numbers: int) -> StrikePlan:
    return StrikePlan(
        object_name="tea box", object_sha256="0" * 64, strikes=[STRIKES[number - 1] for number in numbers]
    )


WHOLE = plan_of(*range(1, 13))


def glued(random: np.random.Generator) -> dict:
    """Place of a tag on each side, turned and shifted at random."""
    return {
        marker.name: np.array(marker.T_object_marker)
        @ transform(
            matrix_from_vector(np.array([0, 0, random.uniform(0, 2 * math.pi)])),
            np.array([*random.uniform(-0.012, 0.012, 2), 0]),
        )
        for marker in SPEC.marker
    }


def seen(number: int, places: dict, random: np.random.Generator, heading: float = 0.0) -> list[TagView]:
    """Tags that a strike shows: placed by hand, tracked to 0.5 deg and 0.5 mm, distance to 1 %."""
    strike = STRIKES[number - 1]
    turn = np.array([0.0, 0.0, strike.heading_rad + heading + random.normal(0, 0.03)])
    hand = transform(matrix_from_vector(turn), np.array([*random.normal(0, 0.004, 2), 0.0]))
    placed = transform(np.array(strike.R_world_object), np.array(strike.p_world_object))
    below = np.array(strike.pivot.point) - strike.pivot.radius_m * np.array(strike.R_world_object)[2]
    views = []
    for name, T_object_marker in places.items():
        T = inverse_transform(T_WORLD_CAMERA) @ hand @ placed @ T_object_marker
        if float(T[:3, 2] @ T[:3, 3]) > -0.5 * np.linalg.norm(T[:3, 3]):
            continue
        on_tag = inverse_transform(T_object_marker)
        direction = on_tag[:3, :3] @ np.array(strike.pivot.direction)
        direction = matrix_from_vector(random.normal(0, math.radians(0.5), 3)) @ direction
        point = on_tag[:3, :3] @ below + on_tag[:3, 3] + random.normal(0, 5e-4, 3)
        point -= direction * float(direction @ point)
        T[:3, :3] = T[:3, :3] @ matrix_from_vector(random.normal(0, math.radians(0.5), 3))
        T[:3, 3] *= 1 + random.normal(0, 0.01)
        views.append(TagView(name, T, TurningLine(direction, point, float(np.linalg.norm(point)))))
    return views


def matched(
    tags: Sequence[list[TagView]], stated: Sequence[str | None], plan: StrikePlan = WHOLE
) -> list[Match]:
    """Matches of videos V0, V1, ... with the plan; contradictions are refused."""
    tips = [TipInView(f"V{number}", None) for number in range(len(tags))]
    matches, spec = match_unplaced(tips, tags, [Match(None)] * len(tags), stated, plan, UNPLACED, BODY)
    refuse_contradiction(tips, stated, matches, plan, spec, "its name")
    return matches


def refused(tags, stated, plan: StrikePlan = WHOLE) -> str:
    with pytest.raises(ImportRefused) as caught:
        matched(tags, stated, plan)
    assert "\n" not in str(caught.value)
    return str(caught.value)


@pytest.mark.parametrize("seed", range(10))
def test_the_videos_that_are_asked_for_decide_all_others(seed):
    random = np.random.default_rng(seed)
    shown = [int(each) + 1 for each in random.choice(12, size=random.integers(4, 10), replace=False)]
    places = glued(random)
    tags = [seen(number, places, random) for number in shown]
    said = refused(tags, [None] * len(tags))
    assert "the shape looks the same from several sides: rename" in said
    asked = [f"V{number} may be s" in said for number in range(len(tags))]
    tags_seen = {views[0].marker for views in tags}
    assert sum(asked) == len(tags_seen), "one for each tag"
    stated = [f"s{number}" if named else None for number, named in zip(shown, asked, strict=True)]
    assert matched_ids(matched(tags, stated), stated) == [f"s{number}" for number in shown]


@pytest.mark.parametrize("order", [(1, 10), (10, 1), (10, 1, 10)])
def test_strikes_that_only_one_place_of_the_tag_explains_need_no_name(order):
    """Turned by 180 deg these two strikes would be s4 and s11, which are not planned."""
    random = np.random.default_rng(5)
    places = glued(random)
    tags = [seen(number, places, random) for number in order]
    none = [None] * len(order)
    matches = matched(tags, none, plan_of(1, 10))
    assert matched_ids(matches, none) == [f"s{number}" for number in order]


def test_wrong_name_among_three_of_a_tag_is_refused_with_both_sides():
    random = np.random.default_rng(6)
    places = glued(random)
    tags = [seen(number, places, random) for number in (1, 4, 10)]
    assert refused(tags, ["s1", "s4", "s11"]).startswith("V2: by its name it is s11 (")
    assert "but the images show s10 (" in refused(tags, ["s1", "s4", "s11"])


def test_two_names_of_which_either_may_be_wrong_are_both_listed():
    random = np.random.default_rng(7)
    places = glued(random)
    tags = [seen(number, places, random) for number in (1, 10)]
    said = refused(tags, ["s1", "s11"])
    assert said.startswith("V0 as s1, V1 as s11: the tag in these videos cannot show all of these strikes")


def test_strike_that_is_not_planned_is_named_among_three_of_its_tag():
    random = np.random.default_rng(8)
    places = glued(random)
    tags = [seen(number, places, random) for number in (1, 4, 10)]
    matches = matched(tags, [None] * 3, plan_of(1, 4))
    assert [bool(match.misfit) for match in matches] == [False, False, True]
    assert matches[2].misfit.startswith("V2: with tag 2 as in V0, V1, the object tips over an edge of no")


def test_names_by_which_two_tags_would_lie_on_one_side_are_refused():
    random = np.random.default_rng(9)
    places = glued(random)
    tags = [seen(number, places, random) for number in (1, 10, 2)]
    said = refused(tags, ["s1", "s10", "s4"])
    assert said.startswith("V0, V1 or V2: in all videos together, two tags would lie on one side of")


def test_object_turned_round_shows_no_planned_strike():
    random = np.random.default_rng(9)
    places = glued(random)
    tags = [seen(1, places, random), seen(10, places, random), seen(4, places, random, math.pi)]
    matches = matched(tags, [None] * 3)
    assert matches[2].misfit.startswith("V2: in no strike of the plan would tag 3 lie on the object")


def test_stated_strikes_stand_where_no_reading_explains_all():
    random = np.random.default_rng(10)
    places = glued(random)
    tags = [seen(number, places, random) for number in (1, 4, 10)]
    stated = ["s1", "s4", "s4"]
    assert matched_ids(matched(tags, stated, plan_of(1, 4)), stated) == stated
