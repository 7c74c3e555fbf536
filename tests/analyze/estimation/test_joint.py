"""Joint estimate: derivatives, exact data, outliers, scatter and start, on closed-form strikes of a box."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from analyze.estimation.equiplane import equiplane_from_fit
from analyze.estimation.inertia import shape_prior
from analyze.estimation.joint import MomentModel, solve_joint
from analyze.estimation.joint_model import COM, SECOND, JointModel
from analyze.estimation.priors import ComPrior, Scale, SystematicErrors
from analyze.geometry.second_moments import unit_inertia
from tests.analyze.estimation.bodies import GRAVITY, SIX_AXES, box_body, fit_of, planned_strike, tip

SIZE = (0.08, 0.06, 0.15)
BODY = box_body(SIZE, (0.026, 0.014, 0.004), 0.005, (0.5, -0.35, 0.79), pitch=0.01)
PRIOR = ComPrior.from_bounds(-np.array(SIZE) / 2, np.array(SIZE) / 2)
ERRORS = SystematicErrors(gravity_tilt_sd=0.0035, scale_sd=2e-3, edge_radius_sd=3e-4)
EXACT = SystematicErrors(gravity_tilt_sd=0.0, axis_angle_sd=0.0, strike_angle_sd=0.0)
MOMENTS = MomentModel(Scale(BODY.mass, 1e-4, GRAVITY, 1e-3), shape_prior(BODY.cells))


def planes(sd_phi=3e-4, relative_sd_k=2e-3, repeats=1, rng=None):
    """Equi-planes of strikes over six edges, exact or with noise of the stated sd."""
    found = []
    for axis in SIX_AXES:
        strike = planned_strike(BODY, *axis)
        phi, k = tip(BODY, strike)
        for repeat in range(repeats):
            d_phi, d_k = (0.0, 0.0) if rng is None else rng.normal(0, 1, 2) * (sd_phi, relative_sd_k * k)
            fit = fit_of(phi + d_phi, k + d_k, sd_phi, relative_sd_k * k)
            found.append(equiplane_from_fit(f"{strike.axis_id}.{repeat}", strike, fit))
    return found


def test_derivatives_agree_with_difference_quotients():
    model = JointModel(planes(), ERRORS, MOMENTS.scale)
    rng = np.random.default_rng(3)
    x = model.start(BODY.com, BODY.inertia / BODY.mass)
    x = x + np.concatenate([rng.normal(0, 1e-3, 9), rng.normal(0, 1, model.count - 9)])
    step = 1e-6 * np.eye(model.count)
    for value, design in (
        (model.residual, model.design),
        (model.distances, model.distance_design),
        (lambda x: model.log_k(x)[0], lambda x: model.log_k(x)[1]),
    ):
        quotients = np.array([(value(x + each) - value(x - each)) / 2e-6 for each in step]).T
        assert np.allclose(quotients, design(x), rtol=1e-5, atol=1e-6)


def test_exact_phi_and_k_give_the_exact_centre_and_moments():
    scale = Scale(BODY.mass, 0.0, GRAVITY, 1e-9, 1e-9)
    solution = solve_joint(planes(1e-6, 1e-6), EXACT, PRIOR, MomentModel(scale, MOMENTS.prior))
    assert np.linalg.norm(solution.x[COM] - BODY.com) < 1e-5
    J = unit_inertia(solution.x[SECOND])[0]
    for plane in solution.model.planes:
        truth = plane.direction @ BODY.inertia @ plane.direction / BODY.mass
        assert plane.direction @ J @ plane.direction == pytest.approx(truth, rel=1e-3)


def test_phi_alone_uses_no_k():
    solution = solve_joint(planes(), ERRORS, PRIOR)
    assert not solution.data.uses_k.any()
    assert solution.moment_prior is None
    assert (solution.data.parts == 1.0).all()


def test_outlier_loses_its_weight_and_hardly_moves_c():
    some = planes(repeats=3, rng=np.random.default_rng(5))
    clean = solve_joint(some, ERRORS, PRIOR, MOMENTS)
    odd = [replace(some[0], phi=some[0].phi + 0.1), *some[1:]]
    robust = solve_joint(odd, ERRORS, PRIOR, MOMENTS)
    assert robust.weight[0] < 0.01
    assert np.median(robust.weight) > 0.5
    # The strike is left out, which moves c by less than its standard deviation.
    assert np.linalg.norm(robust.x[COM] - clean.x[COM]) < np.sqrt(np.trace(clean.covariance[COM, COM]))


def test_scatter_beyond_the_stated_sd_widens_the_covariance():
    # Drawn with three times the stated sd.
    noisy = [
        replace(plane, sd_phi=plane.sd_phi / 3, sd_k=plane.sd_k / 3, cov_phi_k=plane.cov_phi_k / 9)
        for plane in planes(3e-3, 6e-3, repeats=5, rng=np.random.default_rng(6))
    ]
    solution = solve_joint(noisy, replace(ERRORS, strike_angle_sd=0.0), PRIOR, MOMENTS)
    assert 2.0 < solution.spread < 15.0
    assert solve_joint(planes(repeats=5), ERRORS, PRIOR, MOMENTS).spread == 1.0


def test_solution_does_not_depend_on_the_start():
    some = planes(repeats=2, rng=np.random.default_rng(8))
    cold = solve_joint(some, ERRORS, PRIOR, MOMENTS)
    other = solve_joint(planes(repeats=2, rng=np.random.default_rng(9)), ERRORS, PRIOR, MOMENTS)
    warm = solve_joint(some, ERRORS, PRIOR, MOMENTS, initial=other)
    assert np.abs(warm.x - cold.x).max() < 1e-7
