"""Tilt of the table from two headings of one edge, and from the reading of a level."""

from dataclasses import replace

import numpy as np
import pytest

from analyze.estimation.centre_of_mass import centre_of_mass
from analyze.estimation.equiplane import equiplane_from_fit
from analyze.estimation.priors import ComPrior, SystematicErrors, TiltPrior
from analyze.motion.pendulum_fit import pivot_fit
from tests.analyze.estimation.bodies import box_body, fit_of, planned_strike
from tests.analyze.estimation.tilted_table import (
    ErrorSds,
    PlacedStrike,
    measured_tips,
    placed_session,
    reversed_strike,
)

SIZE = (0.08, 0.06, 0.15)
BODY = box_body(SIZE, (0.026, 0.014, 0.004), 0.005, (0.5, -0.35, 0.79), pitch=0.01)
HALF = np.array(SIZE) / 2
PRIOR = ComPrior.from_bounds(-HALF, HALF)
ONE_FACE = ((2, -1, 1, 1), (2, -1, 1, -1), (2, -1, 0, 1))
TILT = np.radians(0.2)
STATED = SystematicErrors(TILT, edge_radius_sd=1e-4)
NOISE = np.radians(0.05)
NOTHING = np.zeros(3)


def planes_of(laid, noise=NOISE, seed=0):
    seen = measured_tips(laid, noise, np.random.default_rng(seed))
    return [
        equiplane_from_fit(each.strike.id, each.strike, pivot_fit(*tip))
        for each, tip in zip(laid, seen, strict=True)
    ]


def exact(strikes, slope):
    return planes_of(
        [PlacedStrike(BODY, strike, np.array(slope), NOTHING, BODY.edge_radius, 0.0) for strike in strikes],
        1e-6,
    )


def test_half_the_difference_of_phi_is_the_tilt():
    strike = planned_strike(BODY, *ONE_FACE[0])
    here, turned = exact([strike, reversed_strike(strike)], (0.004, 0.0))
    # The rounding rolls uphill, which adds radius / R, a hundredth.
    assert (here.phi - turned.phi) / 2 == pytest.approx(0.004, rel=0.02)


def test_turned_strike_determines_the_tilt_and_corrects_c():
    strikes = [planned_strike(BODY, *axis) for axis in ONE_FACE]
    slope = (0.006, -0.003)
    planes = exact([*strikes, reversed_strike(strikes[0])], slope)
    com, without = (
        centre_of_mass(some, replace(STATED, axis_angle_sd=1e-5), PRIOR) for some in (planes, planes[:3])
    )
    (tilt,) = com.tilts
    assert tilt.lean[0] == pytest.approx(slope[0], abs=1e-4)
    assert tilt.sd[0] < 0.2 * TILT
    assert tilt.sd[1] > TILT, "no heading shows the rise along the pivot line"
    assert np.linalg.norm(com.position - BODY.com) < 0.1e-3
    assert np.linalg.norm(without.position - BODY.com) > 0.5e-3
    assert np.trace(com.covariance) < 0.5 * np.trace(without.covariance)
    assert without.tilts[0].sd[0] > 0.95 * TILT


def test_residuals_refer_to_planes_upright_in_gravity():
    """Planes upright in gravity contain c for any tilt; those upright on the table miss it by R tilt."""
    strikes = [planned_strike(BODY, *axis) for axis in ONE_FACE]
    planes = exact([*strikes, reversed_strike(strikes[0])], (0.006, 0.0))
    com = centre_of_mass(planes, STATED, PRIOR)
    assert np.max(np.abs(com.residuals)) < 0.03e-3
    assert np.min(np.abs([plane.normal @ (com.position - plane.point) for plane in planes])) > 0.4e-3
    assert [plane.phi for plane in com.planes] == [plane.phi for plane in planes], "what was measured stays"


def test_any_two_headings_determine_a_part_of_the_tilt():
    strike = planned_strike(BODY, *ONE_FACE[0])
    quarter = strike.model_copy(update={"id": "q", "heading_rad": np.pi / 2})
    planes = exact([strike, reversed_strike(strike), quarter], (0.004, -0.005))
    (tilt,) = centre_of_mass(planes, replace(STATED, axis_angle_sd=1e-5), PRIOR).tilts
    assert tilt.lean == pytest.approx((0.004, -0.005), abs=4e-4)
    assert max(tilt.sd) < 0.3 * TILT


def test_intervals_of_tilt_and_c_contain_the_truth():
    rng = np.random.default_rng(31)
    strikes = [planned_strike(BODY, *axis) for axis in ONE_FACE]
    sessions = [
        placed_session(BODY, [*strikes, reversed_strike(strikes[0])], ErrorSds(TILT), rng) for _ in range(50)
    ]
    planes = planes_of([each for session in sessions for each in session], seed=1)
    tilts, places, without = [], [], []
    for number, session in enumerate(sessions):
        own = planes[4 * number : 4 * number + 4]
        com, plain = centre_of_mass(own, STATED, PRIOR), centre_of_mass(own[:3], STATED, PRIOR)
        tilts.append((com.tilts[0].lean[0] - session[0].slope[0]) / com.tilts[0].sd[0])
        places.append((com.position - BODY.com) / np.sqrt(np.diag(com.covariance)))
        without.append(np.linalg.norm(plain.position - BODY.com) / np.linalg.norm(com.position - BODY.com))
    assert 0.88 <= np.mean(np.abs(tilts) < 1.96) <= 1.0
    assert 0.90 <= np.mean(np.abs(places) < 1.96) <= 0.985
    assert 0.75 < np.sqrt(np.mean(np.square(tilts))) < 1.25
    assert np.median(without) > 1.2


def test_reading_of_a_level_replaces_the_prior():
    strikes = [planned_strike(BODY, *axis) for axis in ONE_FACE]
    planes = exact(strikes, (0.006, 0.0))
    read = replace(STATED, readings=(TiltPrior((0.006, 0.0), (2e-4, TILT)),))
    level_read, unread = (centre_of_mass(planes, systematic, PRIOR) for systematic in (read, STATED))
    assert (
        np.linalg.norm(level_read.position - BODY.com) < 0.1e-3 < np.linalg.norm(unread.position - BODY.com)
    )
    assert np.trace(level_read.covariance) < 0.5 * np.trace(unread.covariance)
    assert level_read.tilts[0].lean[0] == pytest.approx(0.006, abs=1e-4)


def test_two_tables_have_their_own_tilts():
    strikes = [planned_strike(BODY, *axis) for axis in ONE_FACE]
    both = [*strikes, reversed_strike(strikes[0])]
    one = exact(both, (0.004, 0.0))
    other = [
        replace(plane, level=1, strike_id=f"2:{plane.strike_id}") for plane in exact(both, (-0.003, 0.0))
    ]
    com = centre_of_mass([*one, *other], replace(STATED, other_tilt_sds=(TILT,)), PRIOR)
    assert [tilt.lean[0] for tilt in com.tilts] == pytest.approx([0.004, -0.003], abs=2e-4)


def test_repeat_at_another_heading_is_not_an_outlier():
    strike = planned_strike(BODY, *ONE_FACE[0])
    fit = fit_of(0.4, 60.0, 3e-4, 0.1)
    same = [equiplane_from_fit(f"s{i}", strike, fit) for i in range(3)]
    turned = equiplane_from_fit("t", reversed_strike(strike), fit_of(0.38, 60.0, 3e-4, 0.1))
    com = centre_of_mass([*same, turned], replace(STATED, gravity_tilt_sd=0.02), PRIOR)
    assert com.robust.min() == 1.0
    assert com.tilts[0].lean[0] == pytest.approx(0.01, rel=0.05)
