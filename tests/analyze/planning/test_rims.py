"""Rounded bases, feet and ovals: the edges and rim tangents that are planned tip as planned in MuJoCo."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from analyze.geometry.object_model import ObjectModel, load_object_model
from analyze.planning.hypothesis import hypothesis
from analyze.planning.impact import StrikerModel
from analyze.planning.pivots import PivotAxis, pivot_axes
from analyze.planning.stable_planes import resting_planes
from schemas.object_spec import ObjectSpec
from tests.analyze.geometry.shapes import stl
from tests.analyze.planning.planned import make_plan
from tests.analyze.planning.random_bodies import convex_triangles, spec_for
from tests.analyze.planning.whole_tip import TrueBody, whole_tip

ANGLES = np.arange(96) * 2 * np.pi / 96


def oval(width: float, depth: float, power: float = 2.0) -> np.ndarray:
    """Outline (96, 2) [mm]; a circle or ellipse with power 2, with flatter sides above it."""
    cos, sin = np.cos(ANGLES), np.sin(ANGLES)
    return np.column_stack(
        [
            width / 2 * np.sign(cos) * np.abs(cos) ** (2 / power),
            depth / 2 * np.sign(sin) * np.abs(sin) ** (2 / power),
        ]
    )


def rounded_rectangle(width: float, depth: float, radius: float) -> np.ndarray:
    """Outline (36, 2) [mm] of a rectangle with corners rounded by facets of 11 deg."""
    corner = radius * np.column_stack([np.cos(part := np.linspace(0, np.pi / 2, 9)), np.sin(part)])
    middle = np.array([width, depth]) / 2 - radius
    quarters = [middle + corner, [-1, 1] * (middle + corner[::-1])]
    return np.vstack([*quarters, *(-quarter for quarter in quarters)])


def upright(outline: np.ndarray, height: float) -> np.ndarray:
    """Triangles (f, 3, 3) [mm] of a prism that stands on its base `outline` (n, 2) [mm]."""
    return convex_triangles(
        np.vstack([np.column_stack([outline, np.full(len(outline), z)]) for z in (0.0, height)])
    )


def on_feet(places: list[tuple[float, float]], radius: float) -> np.ndarray:
    """Triangles (f, 3, 3) [mm] of a box on round feet with their centres at `places` [mm]."""
    parts = [
        trimesh.creation.cylinder(radius, 16, sections=24, transform=[
            [1, 0, 0, x], [0, 1, 0, y], [0, 0, 1, 8], [0, 0, 0, 1]
        ]) for x, y in places
    ]  # fmt: skip
    box = trimesh.creation.box([70, 60, 105])
    return np.asarray(trimesh.boolean.union([*parts, box.apply_translation([0, 0, 67])]).triangles)


def loaded(triangles: np.ndarray) -> tuple[ObjectModel, ObjectSpec]:
    spec = spec_for(triangles)
    return load_object_model(spec, stl(triangles), "b.stl"), spec


def upright_axes(triangles: np.ndarray) -> list[PivotAxis]:
    """Axes of the base on z = 0."""
    model, spec = loaded(triangles)
    base = [plane for plane in resting_planes(model) if plane.up[2] > 0.999]
    return pivot_axes(model, spec, base[:1], hypothesis(model))


BODIES = {
    "rounded rectangle": upright(rounded_rectangle(70, 45, 12), 130),
    "curved sides": upright(oval(80, 60, 4), 120),
    "three feet": on_feet([(28, 10), (-22, 22), (-10, -24)], 5),
    "four feet": on_feet([(28, 22), (-28, 22), (-28, -22), (28, -22)], 6),
}


@pytest.mark.parametrize(
    "name",
    [
        "rounded rectangle",
        "three feet",
        *(pytest.param(name, marks=pytest.mark.slow) for name in ("curved sides", "four feet")),
    ],
)
def test_every_planned_strike_tips_over_its_line_without_yawing(name):
    """Each axis just tips over with 1.2 times the energy to balance, and rocks back with 0.85 times."""
    model, spec = loaded(BODIES[name])
    plan = make_plan(model, spec, "", StrikerModel(), friction=0.6)
    body = TrueBody(spec.mass_kg, model.centroid, model.unit_inertia * spec.mass_kg)
    strikes = list({strike.axis_id: strike for strike in plan.strikes}.values())
    assert len(strikes) >= 4
    for strike in strikes[::3]:
        tip = whole_tip(model, strike, body)
        assert tip.is_over
        assert tip.until_balance(tip.aside) < np.radians(1)
        assert tip.until_balance(tip.slip) < 3e-4
    assert not whole_tip(model, strikes[0], body, energy=0.85).is_over


def test_straight_sides_between_rounded_corners_are_edges():
    axes = upright_axes(BODIES["rounded rectangle"])
    assert not any(axis.rolls for axis in axes)
    assert sorted(tuple(np.round(axis.tip[:2] + 0.0, 6)) for axis in axes) == [
        (-1, 0),
        (0, -1),
        (0, 1),
        (1, 0),
    ]
    ends = next(axis.edge for axis in axes if axis.tip[0] > 0.9)
    assert np.ptp([end[1] for end in ends]) == pytest.approx(0.045 - 2 * 0.012, abs=1e-4)


@pytest.mark.parametrize(("name", "feet"), [("three feet", 3), ("four feet", 4)])
def test_body_on_round_feet_tips_over_the_line_of_two_feet(name, feet):
    axes = upright_axes(BODIES[name])
    assert len(axes) == feet
    assert not any(axis.rolls for axis in axes)


@pytest.mark.parametrize("turn", [0.0, 0.4])
def test_oval_tips_over_its_sides_and_ends(turn):
    """Elsewhere the centre of mass does not stand beside the point of contact, and it would yaw."""
    cos, sin = np.cos(turn), np.sin(turn)
    axes = upright_axes(upright(oval(95, 60) @ [[cos, sin], [-sin, cos]], 110))
    assert all(axis.rolls for axis in axes)
    directions = np.array([axis.tip[:2] for axis in axes]) @ [[cos, -sin], [sin, cos]]
    assert len(axes) == 4
    for expected in ((1, 0), (-1, 0), (0, 1), (0, -1)):
        assert (directions @ expected).max() > np.cos(np.radians(5))


def test_circle_tips_in_every_direction():
    axes = upright_axes(upright(oval(60, 60), 120))
    assert len(axes) == 8
    assert all(axis.rolls for axis in axes)
