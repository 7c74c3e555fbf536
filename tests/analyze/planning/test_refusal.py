"""Objects without a plan are refused in one clear line, with the remedy."""

from __future__ import annotations

import re

import numpy as np
import pytest

from analyze.errors import PlanError
from analyze.geometry.object_model import load_object_model
from analyze.planning.impact import StrikerModel
from analyze.planning.rejections import rejection_summary
from schemas.strike_plan import Rejection
from tests.analyze.geometry.shapes import spec_of, stl
from tests.analyze.planning.planned import make_plan
from tests.analyze.planning.random_bodies import FAR_TAG, convex_triangles, spec_for


def refusal(points, **more) -> str:
    triangles = convex_triangles(points)
    spec = spec_for(triangles)
    model = load_object_model(spec, stl(triangles), "b.stl")
    with pytest.raises(PlanError) as caught:
        make_plan(model, spec, "", StrikerModel(fastest_m_s=5.0), friction=2.0, **more)
    line = str(caught.value)
    assert "\n" not in line
    assert len(line) < 400
    return line


def sphere(n, radius=40.0):
    i = np.arange(n) + 0.5
    z = 1 - 2 * i / n
    turn = i * np.pi * (1 + np.sqrt(5))
    return radius * np.stack([np.sqrt(1 - z**2) * np.cos(turn), np.sqrt(1 - z**2) * np.sin(turn), z], axis=1)


def capsule(length, sides=48):
    """A cylinder with round ends."""
    ball = sphere(600, 30.0)
    ring = 2 * np.pi * np.arange(sides) / sides
    rim = 30.0 * np.stack([np.cos(ring), np.sin(ring), 0 * ring], axis=1)
    ends = [
        np.vstack([ball[side * ball[:, 2] > 0], rim]) + np.array([0, 0, side * length / 2])
        for side in (1, -1)
    ]
    return np.vstack(ends)


@pytest.mark.parametrize("points", [120, 900])
def test_ball_is_refused_with_a_stand_or_foot(points):
    line = refusal(sphere(points))
    assert "is a ball" in line
    assert "ring stand" in line
    assert "stick on a foot" in line


def test_capsule_only_rolls():
    line = refusal(capsule(80.0))
    assert "only rolls, about (0.00, 0.00, 1.00)" in line
    assert "stand that keeps it from rolling" in line


def test_egg_is_refused_with_a_foot():
    line = refusal(sphere(800) * [1.0, 0.85, 1.4])
    assert "it rolls" in line or "may fall over on each" in line
    assert "foot" in line


def test_bar_with_pointed_ends_leaves_one_direction_unknown():
    """Every edge that a square bar with pointed ends can tip over runs along the bar."""
    square = np.array([[1, 1], [1, -1], [-1, -1], [-1, 1]]) * 30.0
    bar = np.vstack(
        [
            *(np.column_stack([square, np.full(4, z)]) for z in (-110.0, 110.0)),
            [[0, 0, 190.0], [0, 0, -190.0]],
        ]
    )
    line = refusal(bar)
    assert "leave the centre of mass unknown along (0.00, 0.00, 1.00)" in line
    assert re.search(
        r"\d+ axes rejected: \d+ too steep \(balance after 75 deg\): stand it on a smaller face", line
    )


def test_ball_on_a_foot_gets_a_plan():
    foot = np.array([[x, y, -46.0 - z] for x in (-35, 35) for y in (-30, 30) for z in (0, 6)])
    triangles = np.concatenate([convex_triangles(sphere(600)), convex_triangles(foot)])
    spec = spec_for(triangles)
    # A neck connects ball and foot to one body.
    neck = convex_triangles(
        np.array([[x, y, z] for x in (-12, 12) for y in (-12, 12) for z in (-47.0, -30.0)])
    )
    triangles = np.concatenate([triangles, neck])
    model = load_object_model(spec, stl(triangles), "b.stl")
    plan = make_plan(model, spec, "", StrikerModel(fastest_m_s=5.0), friction=2.0)
    assert len({strike.axis_id for strike in plan.strikes}) >= 3


def test_reach_of_the_striker_is_reported():
    spec = spec_of({"box": {"size_m": [0.08, 0.06, 0.15]}}, markers=[FAR_TAG])
    model = load_object_model(spec, None, "")
    with pytest.raises(
        PlanError,
        match=r"no axis can be used; [0-9]+ axes rejected: .*[0-9]+ out of the striker's reach.*: glue",
    ):
        make_plan(model, spec, "", StrikerModel(lowest_m=0.3, highest_m=0.4), friction=2.0)


def test_reasons_are_reported_with_their_numbers():
    spec = spec_of({"box": {"size_m": [0.08, 0.06, 0.15]}}, markers=[FAR_TAG])
    model = load_object_model(spec, None, "")
    with pytest.raises(PlanError) as caught:
        make_plan(model, spec, "", StrikerModel(fastest_m_s=5.0), friction=0.01)
    found = re.search(
        r"no axis can be used; (\d+) axes rejected: (.*): use a mat with more friction$", str(caught.value)
    )
    assert found is not None
    total, reasons = found.groups()
    assert re.search(r"\d+ slipping \(friction needed 0\.\d\d to \d\.\d\d\)", reasons)
    assert sum(int(number) for number in re.findall(r"(?:^|, )(\d+) [a-z]", reasons)) == int(total)


def test_summary_of_rejections():
    def some(code, *numbers):
        return [Rejection(axis_id=f"a{i}", code=code, number=number) for i, number in enumerate(numbers)]

    assert rejection_summary(some("slips", 0.9, 1.4, None) + some("impact_unreachable", None, None)) == (
        "3 slipping (friction needed 0.90 to 1.40), 2 out of the striker's reach"
    )
    assert rejection_summary(some("tag_small", 40.2)) == "1 with a tag too small in the image (40 px)"
    assert rejection_summary(some("lifts", -0.2)) == "1 lifting off before balance"
    assert (
        rejection_summary(some("too_steep", np.radians(52.0), np.radians(61.0)))
        == "2 too steep (balance after 52 to 61 deg)"
    )
    assert rejection_summary(some("something_new", 1.0)) == "1 something new"
