"""Plans with tosses: entries that are refused, and plans without tosses that stay as they were."""

from __future__ import annotations

import json

import pytest

from schemas.document import DocumentError, canonical_json
from schemas.planned_toss import PlannedToss
from schemas.strike_plan import TOSS_PLAN_VERSION, StrikePlan, parse_strike_plan
from tests.analyze.motion.tipping import planned

TOSS = {
    "id": "t1",
    "spin_axis_object": [0.6, 0.0, 0.8],
    "turns_per_s": {"min": 2.0, "target": 3.0, "max": 4.0},
    "flight_s": {"min": 0.3, "target": 0.45, "max": 0.5},
    "R_world_object": [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
    "p_world_apex": [0.0, 0.4, 0.3],
}


def plan_with(*tosses: object) -> str:
    plan = StrikePlan(object_name="box", object_sha256="0", strikes=[planned()])
    return json.dumps(
        json.loads(canonical_json(plan)) | {"schema_version": TOSS_PLAN_VERSION, "tosses": tosses}
    )


def test_tosses_are_read_back():
    plan = parse_strike_plan(plan_with(TOSS), "plan.json")
    assert plan.tosses == [PlannedToss.model_validate(TOSS)]
    assert StrikePlan.model_validate_json(canonical_json(plan)) == plan


def test_a_plan_without_tosses_does_not_mention_them():
    plan = StrikePlan(object_name="box", object_sha256="0", strikes=[planned()])
    assert "tosses" not in canonical_json(plan)
    assert plan.schema_version == "1.0"


@pytest.mark.parametrize(
    ("entry", "value", "text"),
    [
        ("spin_axis_object", [1.0, 1.0, 0.0], "is not a unit vector: its length is 1.414"),
        ("turns_per_s", {"min": 3.0, "target": 2.0, "max": 4.0}, "turns_per_s must have 0 < min <= target"),
        ("flight_s", {"min": 0.0, "target": 0.4, "max": 0.5}, "flight_s must have 0 < min <= target <= max"),
        ("R_world_object", [[1, 0, 0], [0, 1, 0], [0, 0, -1]], "is not a rotation"),
        ("id", "s1", "toss id 's1' is used twice"),
    ],
)
def test_entries_of_a_toss_are_checked(entry, value, text):
    with pytest.raises(DocumentError, match="create it again with `analyze plan`") as caught:
        parse_strike_plan(plan_with(TOSS | {entry: value}), "plan.json")
    assert text in str(caught.value)
