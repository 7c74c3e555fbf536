"""Objects without a plan are refused in one clear line, with the remedy."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from analyze.errors import PlanError
from analyze.geometry.object_model import load_object_model
from analyze.planning.examine import Bench
from analyze.planning.impact import StrikerModel
from analyze.planning.plan import PlanRequest, plan_strikes
from analyze.planning.prepared import prepare_object
from analyze.planning.rejections import rejection_summary
from analyze.planning.view import default_camera
from schemas.strike_plan import Rejection
from tests.analyze.geometry.shapes import box_triangles, spec_of, stl
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
    assert len(line) < 500
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
        r"\d+ axes rejected: \d+ too steep \(balance after 75 deg\): print a base .*, or glue it upright",
        line,
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
        match=r"no axis can be used; \d+ axes .*\d+ without a place that the striker can meet.*: strike by",
    ):
        make_plan(model, spec, "", StrikerModel(lowest_m=0.3, highest_m=0.4), friction=2.0)


def test_reasons_are_reported_with_their_numbers():
    spec = spec_of({"box": {"size_m": [0.08, 0.06, 0.15]}}, markers=[FAR_TAG])
    model = load_object_model(spec, None, "")
    with pytest.raises(PlanError) as caught:
        make_plan(model, spec, "", StrikerModel(fastest_m_s=5.0), friction=0.01)
    found = re.search(
        r"no axis can be used; (\d+) axes rejected: (.*): use a mat with more friction, at least 0\.5 ",
        str(caught.value),
    )
    assert found is not None
    total, reasons = found.groups()
    assert re.search(r"\d+ slipping \(friction needed 0\.\d\d to \d\.\d\d\)", reasons)
    assert sum(int(number) for number in re.findall(r"(?:^|, )(\d+) [a-z]", reasons)) == int(total)


def test_summary_of_rejections():
    def some(code, *numbers):
        return [Rejection(axis_id=f"a{i}", code=code, number=number) for i, number in enumerate(numbers)]

    assert rejection_summary(some("slips", 0.9, 1.4, None) + some("impact_unreachable", None, None)) == (
        "3 slipping (friction needed 0.90 to 1.40), 2 without a place that the striker can meet"
    )
    assert rejection_summary(some("tag_small", 40.2)) == "1 with a tag too small in the image (40 px)"
    assert rejection_summary(some("lifts", -0.2)) == "1 lifting off before balance"
    assert (
        rejection_summary(some("too_steep", np.radians(52.0), np.radians(61.0)))
        == "2 too steep (balance after 52 to 61 deg)"
    )
    assert rejection_summary(some("something_new", 1.0)) == "1 something new"


def sides(size, centre, edge=0.03, only=("+x", "-x", "+y", "-y")):
    """Markers [m] in the middle of the upright sides of a box (size, centre) [mm]."""
    markers = []
    for number, side in enumerate(only):
        axis, sign = "xyz".index(side[1]), 1.0 if side[0] == "+" else -1.0
        z = sign * np.eye(3)[axis]
        y = np.eye(3)[2 if axis < 2 else 1]
        pose = np.eye(4)
        pose[:3, :3] = np.stack([np.cross(y, z), y, z], axis=1)
        pose[:3, 3] = 0.001 * (np.array(centre) + z * np.array(size) / 2)
        markers.append({"id": number, "size_m": edge, "T_object_marker": pose.tolist()})
    return markers


def attempt(triangles, markers, back_m=0.55, **more):
    """Plan of a body of triangles [mm], or the refusal's line; the camera stands `back_m` from the edge."""
    spec = spec_for(triangles, markers)
    model = load_object_model(spec, stl(triangles), "b.stl")
    nominal = default_camera()
    pose = nominal.T_world_camera.copy()
    pose[:3, 3] *= back_m / 0.55
    bench = Bench(
        more.pop("striker", StrikerModel(fastest_m_s=5.0)),
        replace(nominal, T_world_camera=pose, **more.pop("camera", {})),
        more.pop("friction", 0.6),
    )
    try:
        return plan_strikes(prepare_object(model, spec, bench), "", PlanRequest())
    except PlanError as error:
        return str(error)


def disc(height=0.0):
    """Disc of 200 mm, 20 mm thick, upright: its axis along y."""
    turn = np.linspace(0, 2 * np.pi, 72, endpoint=False)
    rim = [np.array([100 * np.cos(turn), 0 * turn + y, 100 * np.sin(turn) + height]).T for y in (-10, 10)]
    return convex_triangles(np.concatenate(rim))


BOX = box_triangles(np.array([80.0, 60.0, 150.0]))
EVERY = ("+x", "-x", "+y", "-y", "+z", "-z")
PLANK = box_triangles(np.array([300.0, 80.0, 15.0]))
BOX_SIDES = sides((80, 60, 150), (0, 0, 0))
FRUSTUM = convex_triangles(
    np.array([[x * r, y * r, z] for x in (-1, 1) for y in (-1, 1) for r, z in ((45, 0.0), (12, 80.0))])
)
LENS = convex_triangles(sphere(600, 1.0) * [60.0, 60.0, 35.0])
LENS_FOOT = box_triangles(np.array([40.0, 40.0, 6.0]), (0, 0, -33))
UPRIGHT_LENS_FOOT = box_triangles(np.array([20.0, 70.0, 70.0]), (-60, 0, 0))
PLATES = [
    box_triangles(np.array(size), at)
    for s in (-1, 1)
    for size, at in (((30.0, 20.0, 60.0), (s * 30, 0, 30.0)), ((20.0, 30.0, 60.0), (0, s * 30, 30.0)))
]


@pytest.mark.parametrize(
    ("remedy", "refused", "mended"),
    [
        (
            "glue it upright on a foot",
            {"triangles": disc(), "markers": sides((200, 20, 200), (0, 0, 0)), "back_m": 0.9},
            {
                "triangles": np.concatenate(
                    [disc(102.0), box_triangles(np.array([100.0, 100.0, 10.0]), (0, 0, 0))]
                ),
                "markers": sides((196, 20, 200), (0, 0, 102), 0.05),
                "back_m": 1.0,
            },
        ),
        (
            "a card may jut out over a narrow face",
            {"triangles": PLANK, "markers": sides((300, 80, 15), (0, 0, 0), 0.012, EVERY), "back_m": 1.0},
            {"triangles": PLANK, "markers": sides((300, 80, 15), (0, 0, 0), 0.06, EVERY), "back_m": 1.0},
        ),
        (
            "print larger tags",
            {"triangles": BOX, "markers": sides((80, 60, 150), (0, 0, 0), 0.01)},
            {"triangles": BOX, "markers": BOX_SIDES},
        ),
        (
            "glue markers to the faces square to the edges",
            {"triangles": BOX, "markers": sides((80, 60, 150), (0, 0, 0), 0.03, ["+z"])},
            {"triangles": BOX, "markers": sides((80, 60, 150), (0, 0, 0), 0.03, ["+x", "-x", "+y", "-y"])},
        ),
        (
            "move or turn the camera",
            {"triangles": BOX, "markers": BOX_SIDES, "camera": {"width": 200, "height": 150}},
            {"triangles": BOX, "markers": BOX_SIDES},
        ),
        (
            "a mat with more friction",
            {"triangles": BOX, "markers": BOX_SIDES, "friction": 0.02},
            {"triangles": BOX, "markers": BOX_SIDES},
        ),
        (
            "change the striker: arm, servo, reach, speed limits (rig file)",
            {"triangles": BOX, "markers": BOX_SIDES, "striker": StrikerModel(fastest_m_s=0.1)},
            {"triangles": BOX, "markers": BOX_SIDES},
        ),
        (
            "glue on an upright plate",
            {"triangles": FRUSTUM, "markers": [FAR_TAG]},
            {"triangles": np.concatenate([FRUSTUM, *PLATES]), "markers": [FAR_TAG]},
        ),
        (
            "glue it upright on a foot",
            {"triangles": np.concatenate([LENS, LENS_FOOT]), "markers": [FAR_TAG]},
            {"triangles": np.concatenate([LENS, UPRIGHT_LENS_FOOT]), "markers": [FAR_TAG]},
        ),
    ],
)
def test_the_stated_remedy_leads_to_a_plan(remedy, refused, mended):
    line = attempt(**refused)
    assert isinstance(line, str), "not refused"
    assert line.endswith(remedy) or remedy in line.rpartition(" rejected: ")[2], line
    found = attempt(**mended)
    assert not isinstance(found, str), found
    assert found.predicted_com_sd_m < 0.005
