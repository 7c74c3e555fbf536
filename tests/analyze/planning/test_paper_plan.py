"""The paper's steps 3.1.1 to 3.1.3 compared with results by hand, and applied to simple objects."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from analyze.errors import PlanError
from analyze.geometry.even_samples import even_samples
from analyze.geometry.object_model import load_object_model
from analyze.planning import view
from analyze.planning.examine import Bench
from analyze.planning.hypothesis import paper_hypothesis
from analyze.planning.impact import StrikerModel
from analyze.planning.paper_plan import CONTACT_ANGLE, impact_force, paper_plan, rotation_points
from analyze.planning.paper_strikes import paper_strike_plan
from analyze.planning.prepared import prepare_object
from analyze.planning.stable_planes import resting_planes
from schemas.strike_plan import PlanMethod, parse_strike_plan
from tests.analyze.geometry.shapes import spec_of

TALL = [0.06, 0.05, 0.2]


def model_of(shape, **more):
    spec = spec_of(shape, **more)
    return load_object_model(spec, None, ""), spec


BENT = np.array([[-2.0, 3, 0], [-2, -3, 0], [4, 0, 0]]) * 0.001
FAR = np.array([[20.0, 0, 0], [-20, 0, 0], [0, 20, 0], [0, -20, 0]]) * 0.001
"""pairs whose sums cancel: they only widen the extent"""
SUMS = (2 * np.hypot(2, 3) - 4) * 0.001


def test_eq_1_by_hand():
    """Along x the sums of lengths are 2*sqrt(13) and 4, along y they are equal; 1 mm is added."""
    assert np.allclose(paper_hypothesis(np.vstack([BENT, FAR])).half[:2], [SUMS + 0.001, 0.001])
    assert np.allclose(paper_hypothesis(np.vstack([BENT, FAR]), 1 / 7).half[:2], [SUMS / 7 + 0.001, 0.001])


def test_q_is_clipped_to_the_object():
    assert np.isclose(SUMS + 0.001, 0.00421, atol=1e-5)
    assert np.isclose(paper_hypothesis(BENT).half[0], 0.004)


def test_eq_1_grows_with_the_number_of_points_and_means_do_not():
    cloud = np.vstack([BENT, FAR])
    thrice = np.repeat(cloud, 3, axis=0)
    assert np.isclose(paper_hypothesis(thrice).half[0], 3 * SUMS + 0.001)
    assert np.allclose(
        paper_hypothesis(thrice, 1 / len(thrice)).half, paper_hypothesis(cloud, 1 / len(cloud)).half
    )


def test_cloud_is_uniform_over_the_surface():
    model, _ = model_of({"box": {"size_m": TALL}})
    cloud, _ = even_samples(model.vertices, model.faces, 4000)
    share = np.mean(np.abs(np.abs(cloud[:, 2]) - 0.1) < 1e-9)
    ends = 2 * 0.06 * 0.05
    assert np.isclose(share, ends / (ends + 2 * 0.2 * (0.06 + 0.05)), atol=2e-3)
    assert np.abs(cloud.mean(axis=0)).max() < 5e-4


def test_rays_leave_a_box_in_the_middle_of_its_edges():
    model, _ = model_of({"box": {"size_m": TALL}})
    plane = next(plane for plane in resting_planes(model) if plane.up[2] > 0.9)
    found = rotation_points(plane, plane.polygon)
    points = np.array([point for point, _ in found])
    assert np.allclose(
        points, [[0.03, 0, -0.1], [-0.03, 0, -0.1], [0, 0.025, -0.1], [0, -0.025, -0.1]], atol=1e-9
    )


def test_square_base_takes_the_objects_axes():
    model, _ = model_of({"box": {"size_m": [0.05, 0.05, 0.2]}})
    plane = next(plane for plane in resting_planes(model) if plane.up[2] > 0.9)
    points = np.array([point for point, _ in rotation_points(plane, plane.polygon)])
    assert np.allclose(np.abs(points[:, :2]), [[0.025, 0], [0.025, 0], [0, 0.025], [0, 0.025]], atol=1e-9)


def test_eq_2_is_energy_over_the_path_of_the_force():
    """Force of eq. 2 for an impact 0.2 m above and 0.06 m behind the edge.

    It is m*g*(|r| - 0.2) over the path along the force while r turns by 5 degrees.
    """
    up, inwards = np.array([0, 0, 1.0]), np.array([-1.0, 0, 0])
    force = impact_force(np.zeros(3), np.array([-0.06, 0, 0.2]), up, inwards, weight=0.5)
    start = np.arctan2(0.2, -0.06)
    way = np.hypot(0.06, 0.2) * (np.cos(start - CONTACT_ANGLE) - np.cos(start))
    assert np.isclose(force * way, 0.5 * (np.hypot(0.06, 0.2) - 0.2), rtol=1e-9)


def test_first_three_by_force_are_singular_for_a_tall_box():
    model, _ = model_of({"box": {"size_m": TALL}})
    found = paper_plan(model, 0.05)
    assert len(found.strikes) == 8
    forces = [strike.force for strike in found.strikes]
    assert all(later > earlier * (1 - 1e-5) for earlier, later in pairwise(forces))
    axes = np.array([strike.axis for strike in found.struck])
    assert np.linalg.matrix_rank(axes, tol=1e-3) < 3
    for strike in found.strikes:
        assert strike.plane.margin(np.zeros((1, 3))) > 0
        inwards = (strike.plane.polygon.mean(axis=0) - strike.rotation_point) @ -strike.tip
        assert inwards > 0
        assert (strike.impact_point - strike.rotation_point) @ strike.tip < -0.02


def test_paper_refuses_its_own_cylinder():
    model, _ = model_of({"cylinder": {"radius_m": 0.036, "height_m": 0.15}})
    with pytest.raises(PlanError, match="parallel"):
        paper_plan(model, 0.034)


def test_papers_plan_lists_its_faults():
    model, spec = model_of({"box": {"size_m": TALL}})
    prepared = prepare_object(model, spec, Bench(StrikerModel(), view.default_camera(), 0.4))
    plan = paper_strike_plan(prepared, "0" * 64, 9)
    assert plan.method is PlanMethod.PAPER
    assert [strike.id for strike in plan.strikes] == [f"s{i}" for i in range(1, 10)]
    assert len({strike.axis_id for strike in plan.strikes}) == 3
    assert plan.predicted_com_sd_m is None
    assert any("singular" in warning for warning in plan.warnings)
    for strike in plan.strikes:
        R, p = np.array(strike.R_world_object), np.array(strike.p_world_object)
        assert np.allclose(R @ strike.pivot.point + p, [0, 0, strike.pivot.radius_m], atol=1e-9)
        assert strike.energy_ratio > 1
    assert parse_strike_plan(plan.model_dump_json(), "plan.json") == plan
    with pytest.raises(PlanError, match="3 points"):
        paper_strike_plan(prepared, "0" * 64, 2)
