"""Planned edges carry the object up to balance: no neighbour lands before."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import pytest

from analyze.geometry.object_model import ObjectModel, load_object_model
from analyze.planning import view
from analyze.planning.examine import Bench
from analyze.planning.impact import StrikerModel
from analyze.planning.next_edge import CODE, MAX_SHIFT_M, over_next_line, with_next_edge
from analyze.planning.pivots import PivotAxis, pivot_axes
from analyze.planning.plan import PlanRequest, plan_strikes
from analyze.planning.prepared import PreparedObject, prepare_object
from analyze.planning.rejections import rejection_summary
from schemas.object_spec import ObjectSpec
from schemas.strike_plan import StrikePlan
from tests.analyze.geometry.shapes import stl
from tests.analyze.motion.tipping import planned
from tests.analyze.planning.footed_bodies import KINDS, drawn_com, footed_body, off_at_balance
from tests.analyze.planning.random_bodies import convex_triangles, spec_for

BENCH = Bench(StrikerModel(fastest_m_s=8.0), view.default_camera(), 0.6)
SHARP = {"edge_radius_m": 1e-7, "edge_radius_sd_m": 1e-6}
BODIES = 2
COMS = 8


def loaded(triangles: np.ndarray) -> tuple[ObjectModel, ObjectSpec]:
    spec = spec_for(triangles, **SHARP)
    return load_object_model(spec, stl(triangles), "b.stl"), spec


@cache
def prepared(kind: str, seed: int) -> PreparedObject:
    model, spec = loaded(footed_body(kind, seed))
    return prepare_object(model, spec, BENCH)


@cache
def plan_of(kind: str, seed: int) -> StrikePlan:
    return plan_strikes(prepared(kind, seed), "0" * 64, PlanRequest(9))


def axis_strike(axis: PivotAxis):
    """Planned strike with the rest pose and pivot of an axis; its other entries have no meaning."""
    strike = planned(0.0)
    pivot = strike.pivot.model_copy(update={"point": axis.point.tolist(), "sd_m": axis.sd})
    return strike.model_copy(update={"R_world_object": axis.R_world_object.tolist(), "pivot": pivot})


def is_off(model: ObjectModel, axis: PivotAxis, com: np.ndarray) -> bool:
    """True if the hull balances over another line than the axis."""
    return abs(off_at_balance(model.hull_vertices, axis_strike(axis), com)) > max(MAX_SHIFT_M, 2 * axis.sd)


def test_no_edge_that_counts_as_sure_balances_over_another_line():
    pairs, off, refused_off = 0, 0, 0
    for kind in KINDS:
        for seed in range(BODIES):
            ready = prepared(kind, seed)
            region, rng = ready.believed.region, np.random.default_rng(seed)
            sure = [each.candidate.axis for each in ready.usable if each.candidate.axis.carries_for(1.0)]
            left = {each.axis_id for each in ready.rejected if each.code == CODE}
            every = pivot_axes(ready.model, ready.spec, ready.stable, ready.believed)
            refused = [axis for axis in every if axis.id in left]
            for com in (drawn_com(region, rng) for _ in range(COMS)):
                pairs += len(sure)
                off += sum(is_off(ready.model, axis, com) for axis in sure)
                refused_off += sum(is_off(ready.model, axis, com) for axis in refused)
    assert pairs >= 500
    assert off == 0
    assert refused_off > 100, "those refused would have been planned, and would have balanced elsewhere"


def test_rejection_says_where_and_when_the_neighbour_lands():
    (first, *_) = entries = [each for each in prepared("ring", 0).rejected if each.code == CODE]
    assert "mm from this one, touches the table at" in first.text
    assert "and balance comes at" in first.text
    assert "with a neighbour that may land before balance (at" in rejection_summary(entries)


def test_edges_that_may_carry_are_used_with_a_warning_if_the_sure_ones_do_not_suffice():
    plan, ready = plan_of("chamfer", 4), prepared("chamfer", 4)
    doubtful = {
        each.candidate.axis.id for each in ready.usable if not each.candidate.axis.carries_for(1.0)
    } & {strike.axis_id for strike in plan.strikes}
    assert doubtful, "the sure ones leave a direction of c unknown"
    (note,) = (text for text in plan.warnings if "neighbour may touch the table before" in text)
    assert all(f"{name} (next edge " in note for name in doubtful)
    assert "--given" in note
    for each in ready.usable:
        if each.candidate.axis.id in doubtful:
            assert not is_off(ready.model, each.candidate.axis, ready.believed.region.centre)


def chamfered(width: float, angle_deg: float) -> tuple[ObjectModel, ObjectSpec]:
    """Box of 60 x 50 x 120 mm whose bottom edges have a chamfer of given width [mm] and angle."""
    turn = np.radians(angle_deg)
    corners, half = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]), np.array([30.0, 25.0])
    levels = [(0.0, width * np.cos(turn)), (width * np.sin(turn), 0.0), (120.0, 0.0)]
    return loaded(
        convex_triangles(
            np.vstack([np.column_stack([corners * (half - less), np.full(4, z)]) for z, less in levels])
        )
    )


def bottom_axes(width: float, angle_deg: float) -> list[tuple[PivotAxis, PivotAxis]]:
    """Axes of the chamfered bottom, before and after the check."""
    model, spec = chamfered(width, angle_deg)
    ready = prepare_object(model, spec, BENCH)
    axes = pivot_axes(model, spec, ready.planes, ready.believed)
    bottom = [axis for axis in axes if axis.plane.up[2] > 0.999]
    assert len(bottom) == 4
    return [(axis, with_next_edge(model, axis, ready.believed.region)) for axis in bottom]


def test_chamfer_that_is_reached_after_balance_leaves_the_edge_as_it_is():
    for before, after in bottom_axes(3.0, 60.0):
        assert after.sd == before.sd
        assert after.next_edge.takes_over == pytest.approx(np.radians(60.0))
        assert after.next_edge.shift == pytest.approx(3e-3, rel=1e-3)
        assert after.carries_for(1.0)


def test_chamfer_that_is_reached_before_balance_takes_the_tip_over():
    for _, after in bottom_axes(3.0, 10.0):
        assert not after.carries_for(0.0)


FIVE = np.radians(5.0)


def test_line_that_takes_over_is_planned_for_with_the_same_placement():
    for axis in (after for _, after in bottom_axes(4.0, 5.0)):
        over = over_next_line(axis)
        assert over is not None
        out = (over.point - axis.point) @ np.stack([axis.tip, axis.plane.up]).T
        np.testing.assert_allclose(out, 4e-3 * np.array([np.cos(FIVE), np.sin(FIVE)]), atol=1e-5)
        np.testing.assert_array_equal(over.p_world_object, axis.p_world_object)
    assert all(over_next_line(after) is None for _, after in bottom_axes(3.0, 60.0))
    assert all(over_next_line(after) is None for _, after in bottom_axes(1.5, 5.0)), "too near a line"


def test_body_with_a_low_bevel_all_round_gets_a_plan_over_the_next_lines():
    body = np.array([90.0, 70.0, 140.0]) * np.array(list(np.ndindex(2, 2, 2)) - np.array(0.5))
    ends = np.sign(body)
    model, spec = loaded(
        convex_triangles(np.concatenate([body - ends * [0, 0, 1.0], body - ends * [4, 4, 0]]))
    )
    plan = plan_strikes(prepare_object(model, spec, BENCH), "0" * 64, PlanRequest(strikes=9))
    ends_up = [strike for strike in plan.strikes if abs(strike.R_world_object[2][2]) > 0.99]
    assert ends_up
    # The pivot is the edge of placement, and phi that about the body's edge, 4 mm out.
    for strike in ends_up:
        edge = float(np.array(strike.R_world_object)[0] @ strike.pivot.point)
        assert edge == pytest.approx(0.041, abs=1e-5) or edge == pytest.approx(0.031, abs=1e-5)
        assert strike.phi_predicted_rad == pytest.approx(math.atan2(edge + 4e-3, 69e-3), abs=0.01)
    assert any("the next line takes over before balance" in text for text in plan.warnings)


def test_narrow_bevel_enlarges_the_sd_of_the_edges_place():
    for before, after in bottom_axes(0.2, 10.0):
        assert after.sd == pytest.approx(np.hypot(before.sd, 0.2e-3), rel=0.01)
        assert after.carries_for(1.0)
