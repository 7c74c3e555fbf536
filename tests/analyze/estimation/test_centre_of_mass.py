from dataclasses import replace

import numpy as np
import pytest

from analyze.errors import EstimationError
from analyze.estimation.centre_of_mass import centre_of_mass
from analyze.estimation.equiplane import equiplane_from_fit
from analyze.estimation.paper import paper_centre_of_mass
from analyze.estimation.priors import ComPrior, SystematicErrors
from tests.analyze.estimation.bodies import SIX_AXES, box_body, fit_of, planned_strike, tip

SIZE = (0.08, 0.06, 0.15)
BODY = box_body(SIZE, (0.026, 0.014, 0.004), 0.005, (0.5, -0.35, 0.79), pitch=0.01)
PRIOR = ComPrior.from_bounds(-np.array(SIZE) / 2, np.array(SIZE) / 2)
ERRORS = SystematicErrors(gravity_tilt_sd=0.0035, scale_sd=2e-3, edge_radius_sd=3e-4)
EXACT = SystematicErrors(gravity_tilt_sd=0.0, axis_angle_sd=0.0, strike_angle_sd=0.0)
SD_PHI = 3e-4


def planes(rng, axes=SIX_AXES, repeats=3, errors=ERRORS, body=BODY, bias=0.0):
    """Equi-planes with all errors drawn with the standard deviations of `errors`."""
    tilt, scale, radius = rng.normal(0, 1, 3) * (
        errors.gravity_tilt_sd,
        errors.scale_sd,
        errors.edge_radius_sd,
    )
    found = []
    for axis in axes:
        strike = planned_strike(body, *axis)
        forward, up = np.array(strike.R_world_object)[0], np.array(strike.R_world_object)[2]
        edge = strike.pivot.sd_m if errors is not EXACT else 0.0
        moved = (
            rng.normal(0, edge) * forward
            + rng.normal(0, edge) * up
            + radius * (up - forward)
            + scale * np.array(strike.pivot.point)
        )
        phi, k = tip(body, strike, moved, body.edge_radius + radius)
        shared = tilt + rng.normal(0, errors.axis_angle_sd) + bias
        for repeat in range(repeats):
            measured = phi + shared + rng.normal(0, np.hypot(SD_PHI, errors.strike_angle_sd))
            found.append(
                equiplane_from_fit(
                    f"{strike.axis_id}.{repeat}", strike, fit_of(measured, k, SD_PHI, 2e-3 * k)
                )
            )
    return found


def test_exact_angles_give_the_exact_centre():
    strikes = [planned_strike(BODY, *axis) for axis in SIX_AXES]
    exact = [equiplane_from_fit(s.id, s, fit_of(*tip(BODY, s), 1e-6, 1e-3)) for s in strikes]
    com = centre_of_mass(exact, EXACT, PRIOR)
    assert np.linalg.norm(com.position - BODY.com) < 1e-7
    assert com.observed


@pytest.mark.parametrize("repeats", [1, 3])
def test_95_percent_intervals_contain_the_truth_in_90_to_98_percent(repeats):
    rng = np.random.default_rng(7)
    z = []
    for _ in range(50):
        com = centre_of_mass(planes(rng, repeats=repeats), ERRORS, PRIOR)
        z.append((com.position - BODY.com) / np.sqrt(np.diag(com.covariance)))
    z = np.array(z)
    assert 0.90 <= np.mean(np.abs(z) < 1.96) <= 0.985
    assert 0.8 < np.sqrt(np.mean(z**2)) < 1.25, "neither too narrow nor too wide"


def test_repeats_do_not_reduce_shared_errors():
    once = centre_of_mass(planes(np.random.default_rng(1), repeats=1), ERRORS, PRIOR)
    often = centre_of_mass(planes(np.random.default_rng(1), repeats=30), ERRORS, PRIOR)
    ratio = np.sqrt(np.trace(often.covariance) / np.trace(once.covariance))
    assert 0.5 < ratio <= 1.0, "30 repeats do not reduce the uncertainty of the table's tilt"


def test_three_edges_at_one_vertex_leave_the_diagonal_unobserved():
    axes = ((2, -1, 1, 1), (2, -1, 0, 1), (0, 1, 1, -1))
    com = centre_of_mass(planes(np.random.default_rng(2), axes=axes), ERRORS, PRIOR)
    edges = [planned_strike(BODY, *axis) for axis in axes]
    vertex = np.array([SIZE[0], SIZE[1], -SIZE[2]]) / 2
    assert len({s.axis_id for s in edges}) == 3
    if not com.observed:
        assert abs(com.unobserved_direction @ (BODY.com - vertex) / np.linalg.norm(BODY.com - vertex)) > 0.9
    assert np.sqrt(np.linalg.eigvalsh(com.covariance)[-1]) > 2e-3, "not smaller than the geometry allows"


def test_parallel_axes_leave_their_direction_unobserved():
    axes = ((2, -1, 1, 1), (2, -1, 1, -1), (0, -1, 1, 1))
    com = centre_of_mass(planes(np.random.default_rng(3), axes=axes), ERRORS, PRIOR)
    assert not com.observed
    assert abs(com.unobserved_direction[1]) > 0.99
    assert np.sqrt(com.covariance[1, 1]) == pytest.approx(PRIOR.sd[1], rel=0.05), (
        "a direction that was not measured has the prior's sd"
    )


def test_outlier_has_little_weight():
    good = planes(np.random.default_rng(4))
    bad = [*good]
    strike = planned_strike(BODY, *SIX_AXES[2])
    phi, k = tip(BODY, strike)
    bad[7] = equiplane_from_fit(good[7].strike_id, strike, fit_of(phi + np.radians(3), k, SD_PHI, 0.1))
    before, after = (centre_of_mass(p, ERRORS, PRIOR) for p in (good, bad))
    assert after.robust[7] < 0.05
    assert np.delete(after.robust, 7).min() > 0.3
    assert np.linalg.norm(after.position - before.position) < 0.2e-3


def test_scatter_beyond_the_stated_sd_widens_the_covariance():
    calm, wild = np.random.default_rng(5), np.random.default_rng(5)
    stated = SystematicErrors(gravity_tilt_sd=0.0, axis_angle_sd=0.0, strike_angle_sd=1e-4)
    drawn = SystematicErrors(gravity_tilt_sd=0.0, axis_angle_sd=0.0, strike_angle_sd=5e-3)
    narrow = centre_of_mass(planes(calm, errors=stated), stated, PRIOR)
    wide = centre_of_mass(planes(wild, errors=drawn), stated, PRIOR)
    assert np.trace(wide.covariance) > 1.5 * np.trace(narrow.covariance)


def test_no_strike_is_refused_with_the_remedy():
    with pytest.raises(EstimationError, match="strike again"):
        centre_of_mass([], ERRORS, PRIOR)


def test_papers_estimator_is_within_a_few_millimetres():
    found = paper_centre_of_mass(planes(np.random.default_rng(6)), BODY.cells, np.radians(0.5))
    assert np.linalg.norm(found.position - BODY.com) < 2.5e-3
    assert found.volume > 0
    assert found.err >= np.radians(0.5)


def test_papers_estimator_is_finer_than_its_first_grid():
    exact = SystematicErrors(gravity_tilt_sd=0.0, axis_angle_sd=0.0, strike_angle_sd=0.0)
    three = planes(np.random.default_rng(6), axes=SIX_AXES[:3], repeats=1, errors=exact)
    found = paper_centre_of_mass(three, BODY.cells)
    assert np.linalg.norm(found.position - BODY.com) < 1.2e-3, (
        "Fig. 9(b): error from the width of the regions alone"
    )
    turned = [replace(plane, phi=plane.phi + 2e-3) for plane in three]
    moved = np.linalg.norm(paper_centre_of_mass(turned, BODY.cells).position - found.position)
    assert 0.5 * 2e-3 * 0.03 < moved < 2e-3 * 0.3, "the result depends continuously on the angles"


def test_target_for_the_papers_own_noise_is_met():
    """Target: centre of mass from angles with 1.85 deg noise, 9 strikes on 3 axes: 5 mm (paper: 12.5 mm)."""
    rng = np.random.default_rng(8)
    noise = SystematicErrors(gravity_tilt_sd=0.0, axis_angle_sd=0.0, strike_angle_sd=np.radians(1.85))
    axes = ((2, -1, 1, 1), (2, 1, 0, 1), (0, -1, 2, 1), (2, -1, 0, -1), (1, -1, 0, 1))
    error = [
        np.linalg.norm(
            centre_of_mass(planes(rng, axes=axes, repeats=2, errors=noise), noise, PRIOR).position - BODY.com
        )
        for _ in range(40)
    ]
    assert np.mean(error) < 5e-3


def test_stated_rounding_does_not_apply_to_flanks_of_the_shape():
    found = planes(np.random.default_rng(5))
    unknown = SystematicErrors(gravity_tilt_sd=1e-4, edge_radius_sd=3e-3)
    known = SystematicErrors(gravity_tilt_sd=1e-4)
    sharp, on_edges = (centre_of_mass(found, errors, PRIOR) for errors in (known, unknown))
    assert np.trace(on_edges.covariance) > 1.3 * np.trace(sharp.covariance)
    flanks = [replace(plane, rounded=False) for plane in found]
    on_flanks = centre_of_mass(flanks, unknown, PRIOR)
    np.testing.assert_allclose(on_flanks.covariance, sharp.covariance, rtol=1e-6)
    np.testing.assert_allclose(on_flanks.position, sharp.position, atol=1e-9)
