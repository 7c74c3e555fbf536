"""Plans that show contents that move: three energies on one edge, and two poses."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import pytest

from analyze.errors import PlanError
from analyze.geometry.object_model import load_object_model
from analyze.planning.contents import MIDDLE, SLOW, contents_test
from analyze.planning.examine import Bench
from analyze.planning.impact import StrikerModel
from analyze.planning.prepared import FRICTION, prepare_object
from analyze.planning.view import default_camera
from schemas.object_spec import Box, MarkerSpec, ObjectSpec, Shape, object_sha256
from schemas.strike_plan import StrikePlan
from tests.analyze.planning.planned import make_plan

SPEC = ObjectSpec(
    name="box",
    mass_kg=0.2,
    mass_sd_kg=1e-4,
    shape=Shape(box=Box(size_m=[0.07, 0.06, 0.14])),
    edge_radius_m=1e-3,
    edge_radius_sd_m=1e-4,
    marker=[MarkerSpec(id=0, size_m=0.03)],
)


def planned(**request) -> StrikePlan:
    model = load_object_model(SPEC, None, "box")
    return make_plan(
        model,
        SPEC,
        object_sha256(SPEC, None),
        StrikerModel(fastest_m_s=5.0),
        **request,
    )


@pytest.mark.parametrize("strikes", [3, 9])
def test_one_edge_is_struck_at_three_energies_and_two_faces_twice(strikes):
    plan = planned(strikes=strikes, contents=True)
    energies = {strike.axis_id: set[float]() for strike in plan.strikes}
    for strike in plan.strikes:
        energies[strike.axis_id].add(strike.aim.energy_ratio)
    tested = max(energies.values(), key=len)
    assert min(tested) == SLOW
    assert MIDDLE in tested
    assert max(tested) >= 1.4
    poses = Counter(strike.plane_id for strike in plan.strikes)
    assert sorted(poses.values())[-2] >= 2
    assert [strike.id for strike in plan.strikes] == [f"s{i + 1}" for i in range(len(plan.strikes))]
    assert len(plan.strikes) <= strikes + 4


def test_faster_strikes_are_harder():
    plan = planned(strikes=3, contents=True)
    fast = max(plan.strikes, key=lambda strike: strike.aim.energy_ratio)
    slow = next(
        each for each in plan.strikes if each.axis_id == fast.axis_id and each.aim.energy_ratio == SLOW
    )
    ratio = fast.aim.impulse_n_s.target / slow.aim.impulse_n_s.target
    assert ratio == pytest.approx((fast.aim.energy_ratio / SLOW) ** 0.5, rel=0.01)


def test_a_plan_without_the_option_is_as_before():
    assert len({strike.aim.energy_ratio for strike in planned(strikes=9).strikes}) == 1


def test_a_striker_that_is_too_slow_for_a_fast_strike_is_refused_with_a_remedy():
    model = load_object_model(SPEC, None, "box")
    bench = Bench(StrikerModel(fastest_m_s=5.0), default_camera(), FRICTION)
    prepared = prepare_object(model, SPEC, bench)
    slow = replace(prepared, bench=replace(bench, striker=StrikerModel(fastest_m_s=0.1)))
    with pytest.raises(PlanError, match="take a faster or heavier striker"):
        contents_test(slow, [0, 1], [2, 1])


def test_edges_of_one_face_alone_leave_the_poses_untested():
    model = load_object_model(SPEC, None, "box")
    prepared = prepare_object(model, SPEC, Bench(StrikerModel(fastest_m_s=5.0), default_camera(), FRICTION))
    face = prepared.usable[0].candidate.axis.plane.id
    own = [each for each in prepared.usable if each.candidate.axis.plane.id == face]
    found = contents_test(replace(prepared, usable=own), [0], [3])
    assert found.added == ()
    assert found.warning.startswith("all edges that can be struck belong to one face")
