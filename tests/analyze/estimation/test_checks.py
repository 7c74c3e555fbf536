from dataclasses import replace

import numpy as np
import pytest

from analyze.estimation.checks import (
    checked_left_out,
    estimated_gravity,
    impossible_moments,
    leave_one_out,
    sigmas_outside_hull,
)
from analyze.estimation.equiplane import equiplane_from_fit
from analyze.estimation.inertia import shape_prior
from analyze.estimation.joint import MomentModel, solve_joint
from analyze.estimation.priors import ComPrior, Scale, SystematicErrors
from tests.analyze.estimation import drawn_sessions
from tests.analyze.estimation.bodies import GRAVITY, SIX_AXES, box_body, fit_of, planned_strike, tip

SIZE = np.array((0.08, 0.06, 0.15))
BODY = box_body(tuple(SIZE.tolist()), (0.026, 0.014, 0.004), 0.005, (0.5, -0.35, 0.79), pitch=0.01)
PRIOR = ComPrior.from_bounds(-SIZE / 2, SIZE / 2)
ERRORS = SystematicErrors(gravity_tilt_sd=1e-3, edge_radius_sd=2e-4)
MOMENTS = MomentModel(Scale(BODY.mass, 1e-4, GRAVITY, 1e-3), shape_prior(BODY.cells))
CORNERS = np.stack(np.meshgrid(*[(-s / 2, s / 2) for s in SIZE]), axis=-1).reshape(-1, 3)
LUMP = drawn_sessions.lump_body((0.005, -0.005, 0.01))
VERTEX = drawn_sessions.VERTEX_AXES


def planes(rng, faster=1.0):
    found = []
    for axis in SIX_AXES:
        for repeat in range(2):
            strike = planned_strike(BODY, *axis, repeat)
            phi, k = tip(BODY, strike)
            fit = fit_of(phi + rng.normal(0, 7e-4), faster * k * (1 + rng.normal(0, 3e-3)), 5e-4, 3e-3 * k)
            found.append(equiplane_from_fit(strike.id, strike, fit))
    return found


def test_leave_one_out_prediction_equals_a_fit_without_the_strike():
    some = planes(np.random.default_rng(0))
    solution = solve_joint(some, ERRORS, PRIOR, MOMENTS)
    found = leave_one_out(solution)
    assert all(each.agrees for each in found)
    # The last axis has another strike, so that the unknowns stay the same.
    without = solve_joint(some[:-1], ERRORS, PRIOR, MOMENTS)
    assert found[-1].phi - some[-1].phi == pytest.approx(
        without.model.residual(without.x)[-1] + some[-2].phi - some[-1].phi, abs=3e-5
    )


def test_outlying_strike_fails_its_prediction():
    some = planes(np.random.default_rng(1))
    some[3] = replace(some[3], phi=some[3].phi + 0.02)
    found = leave_one_out(solve_joint(some, ERRORS, PRIOR, MOMENTS))
    assert [each.strike_id for each in found if not each.agrees] == [some[3].strike_id]
    assert found[3].phi_off == pytest.approx(0.02, abs=3e-3)


def far_prior(com):
    """Prior of the moments about c for which they grow with the distance of c from O.

    It pulls a c that the strikes leave open far away from the object.
    """
    near = drawn_sessions.SHAPE(np.zeros(3))
    return replace(near, mean=near.mean + com @ com * np.eye(3) - np.outer(com, com))


def test_strikes_that_the_others_leave_open_are_not_accused():
    """Edges of one vertex, a lump inside: strikes fail the linear prediction, not the likelihood ratio."""
    moments = replace(drawn_sessions.model(LUMP), prior=far_prior)
    failed, nonsense = 0, 0
    for seed in range(12):
        some = drawn_sessions.session(np.random.default_rng(seed), VERTEX, LUMP, repeats=1)
        solution = solve_joint(some, drawn_sessions.ERRORS, PRIOR, moments)
        nonsense += sum(not each.agrees for each in leave_one_out(solution))
        found = checked_left_out(solution, PRIOR, moments)
        failed += sum(not each.agrees for each in found)
        assert not any(each.checkable for each in found if abs(each.k_off or 0.0) > 1)
    assert nonsense >= 2
    assert failed == 0


def test_outlying_strike_fails_the_likelihood_ratio_too():
    some = planes(np.random.default_rng(1))
    some[3] = replace(some[3], phi=some[3].phi + 0.02)
    found = checked_left_out(solve_joint(some, ERRORS, PRIOR, MOMENTS), PRIOR, MOMENTS)
    assert [each.strike_id for each in found if not each.agrees] == [some[3].strike_id]
    assert all(each.checkable for each in found)
    assert found[3].phi_off == pytest.approx(0.02, abs=3e-3)


def test_wrong_time_base_changes_the_estimated_gravity():
    for faster in (1.0, 1.4):
        some = planes(np.random.default_rng(2), faster)
        solution = solve_joint(some, ERRORS, PRIOR, MOMENTS)
        found = estimated_gravity(some, ERRORS, PRIOR, MOMENTS, solution)
        assert found.sd < 0.1
        assert found.agrees == (faster == 1.0)


def gravity(seed, axes, body=BODY, k_off=None, faster=1.0):
    some = drawn_sessions.session(np.random.default_rng(seed), axes, body, k_off)
    some = [replace(plane, k=faster * plane.k, sd_k=faster * plane.sd_k) for plane in some]
    moments = drawn_sessions.model(body)
    solution = solve_joint(some, drawn_sessions.ERRORS, PRIOR, moments)
    return estimated_gravity(some, drawn_sessions.ERRORS, PRIOR, moments, solution)


NINE_AXES = (*SIX_AXES, (2, -1, 0, -1), (0, -1, 1, -1), (1, -1, 2, -1))


def test_hop_of_two_parallel_edges_and_a_lump_inside_leave_gravity_as_stated():
    """With the usual error of k and prior of the moments, one in three of these sessions doubted gravity."""
    off = dict.fromkeys((SIX_AXES[0], SIX_AXES[2]), 0.0085)
    for seed in range(4):
        found = gravity(seed, SIX_AXES, LUMP, off)
        assert abs(found.relative) < 2.2 * found.sd


@pytest.mark.parametrize("faster", [0.9, 1.1])
def test_frame_rate_off_by_five_percent_is_still_found_and_blames_no_axis(faster):
    found = gravity(0, NINE_AXES, faster=faster)
    assert not found.agrees
    assert found.single_axis is None
    assert found.relative == pytest.approx(faster - 1, abs=0.05)


def test_impossible_moments_and_centres_are_reported():
    some = planes(np.random.default_rng(3))
    assert not impossible_moments(solve_joint(some, ERRORS, PRIOR, MOMENTS), CORNERS)
    odd = [replace(plane, k=2.5 * plane.k) if plane.axis_id == some[0].axis_id else plane for plane in some]
    assert some[0].axis_id in impossible_moments(solve_joint(odd, ERRORS, PRIOR, MOMENTS), CORNERS)
    hull = np.vstack([np.column_stack([sign * np.eye(3), -SIZE / 2]) for sign in (1, -1)])
    assert sigmas_outside_hull(np.zeros(3), np.eye(3) * 1e-8, hull) == 0
    assert sigmas_outside_hull(np.array([0.041, 0, 0]), np.eye(3) * 1e-8, hull) == pytest.approx(10)


@pytest.mark.parametrize("axis", [SIX_AXES[3], SIX_AXES[5]])
def test_axis_whose_k_alone_is_off_is_named(axis):
    found = gravity(4, NINE_AXES, LUMP, {axis: -0.1})
    assert not found.agrees
    assert found.single_axis == planned_strike(LUMP, *axis).axis_id
