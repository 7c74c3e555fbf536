"""Intervals of centre of mass and moments where strikes leave a direction of the centre of mass open."""

from __future__ import annotations

import numpy as np
import pytest

from analyze.estimation.damped_solve import moved
from analyze.estimation.inertia import inertial_parameters_from_joint
from analyze.estimation.joint import solve_joint
from analyze.estimation.posterior import linear_posterior
from analyze.estimation.profile import profiled_posterior
from analyze.geometry.second_moments import log_cholesky
from tests.analyze.estimation.bodies import SIX_AXES, Body, box_body
from tests.analyze.estimation.drawn_sessions import (
    BODY,
    ERRORS,
    PRIOR,
    SIZE,
    VERTEX_AXES,
    lump_body,
    model,
    session,
)

BODIES = {
    "shell and core": BODY,
    "uniform core": box_body(tuple(SIZE.tolist()), (0.0, 0.02, 0.02), 0.0, pitch=0.01),
    "lump in the middle": lump_body((0.005, -0.005, 0.01)),
    "lump at a corner": lump_body((0.015, -0.005, -0.04)),
}


def found(body: Body, axes: tuple[tuple[int, int, int, int], ...], seed: int):
    planes, moments = session(np.random.default_rng(seed), axes, body), model(body)
    solution = solve_joint(planes, ERRORS, PRIOR, moments)
    posterior = profiled_posterior(planes, ERRORS, PRIOR, moments, solution)
    return solution, posterior, inertial_parameters_from_joint(solution, PRIOR, moments.scale, posterior)


def test_singular_set_states_intervals_that_hold_and_measures_nothing():
    held: list[bool] = []
    for body in BODIES.values():
        for seed in range(2):
            _, posterior, parameters = found(body, VERTEX_AXES, seed)
            assert len(posterior.open_directions) == 1
            assert not parameters.com.observed
            assert not parameters.measured.any()
            assert parameters.com.intervals is not None
            assert parameters.inertia_intervals is not None
            ends = np.vstack([parameters.com.intervals, parameters.inertia_intervals[:3]])
            truth = np.concatenate([body.com, np.diag(body.inertia)])
            held += ((ends[:, 0] <= truth) & (truth <= ends[:, 1])).tolist()
            for axis in parameters.axes:
                assert axis.i_com_interval is not None
                about = axis.direction @ body.inertia @ axis.direction
                held.append(bool(axis.i_com_interval[0] <= about <= axis.i_com_interval[1]))
    assert np.mean(held) >= 0.9


def test_open_direction_points_from_the_corner_to_the_centre_of_mass():
    _, posterior, parameters = found(BODY, VERTEX_AXES, 0)
    corner = np.array([SIZE[0], SIZE[1], -SIZE[2]]) / 2
    towards = (BODY.com - corner) / np.linalg.norm(BODY.com - corner)
    assert abs(posterior.open_directions[0] @ towards) > 0.99
    assert parameters.com.unobserved_direction is not None
    assert abs(parameters.com.unobserved_direction @ towards) > 0.99


def test_linear_posterior_stands_where_strikes_determine_everything():
    for body in BODIES.values():
        solution, posterior, parameters = found(body, SIX_AXES, 1)
        assert posterior.linear
        plain = linear_posterior(solution)
        assert np.array_equal(posterior.mean, plain.mean)
        assert np.array_equal(posterior.covariance, plain.covariance)
        assert parameters.com.intervals is None
        assert np.diag(parameters.measured).all()


def test_interval_of_a_mixture_contains_95_percent_of_draws():
    _, posterior, _ = found(BODIES["lump in the middle"], VERTEX_AXES, 2)
    rng = np.random.default_rng(0)
    which = rng.choice(len(posterior.weights), 4000, p=posterior.weights)
    for index in (2, 3, 9):
        draws = rng.normal(posterior.means[which, index], posterior.sds[which, index])
        low, high = posterior.interval(index)
        assert np.mean((low <= draws) & (draws <= high)) == pytest.approx(0.95, abs=0.012)
        assert draws.std() == pytest.approx(np.sqrt(posterior.covariance[index, index]), rel=0.05)


def test_a_step_to_no_possible_tensor_is_refused_by_its_misfit():
    """Such a step made LinAlgError end the whole estimate."""
    start = np.concatenate([np.zeros(3), log_cholesky(np.diag([1e-3, 2e-3, 2.5e-3])), np.zeros(5)])
    assert np.isfinite(moved(start, np.full(14, 1e-3))).all()
    assert np.isnan(moved(start, np.full(14, np.inf))[3:9]).all()
