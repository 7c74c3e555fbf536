"""Changes of an estimate under alternatives: small where all is sound, found where something is not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from analyze.estimation.common_point import common_point
from analyze.estimation.inertia import inertial_parameters_from_joint
from analyze.estimation.joint import solve_joint
from analyze.estimation.what_ifs import WhatIf, alternatives
from analyze.types import RadiusPrior, RadiusSource
from tests.analyze.estimation.bodies import SIX_AXES
from tests.analyze.estimation.drawn_sessions import BODY, ERRORS, PRIOR, SIZE, VERTEX_AXES, model, session


def table(planes, other_planes=None, errors=ERRORS):
    moments = model()
    solution = solve_joint(planes, errors, PRIOR, moments)
    stated = inertial_parameters_from_joint(solution, PRIOR, moments.scale)
    found = alternatives(planes, errors, PRIOR, moments, solution, stated, other_planes)
    return {each.what_if: each for each in found}, solution


def test_sound_sessions_hold_under_every_alternative():
    for seed in range(3):
        found, _ = table(session(np.random.default_rng(seed), SIX_AXES))
        assert list(found) == [WhatIf.RADIUS, WhatIf.TILT, WhatIf.SCAN, WhatIf.STRIKE, WhatIf.NO_K]
        assert all(each.holds for each in found.values())


def test_session_with_one_strike_for_each_axis_is_not_blamed_for_depending_on_it():
    for seed in range(3):
        found, _ = table(session(np.random.default_rng(seed), SIX_AXES, repeats=1))
        assert all(each.holds for each in found.values())


def test_change_without_a_strike_equals_a_new_estimate_without_it():
    planes = session(np.random.default_rng(1), SIX_AXES)
    found, solution = table(planes)
    left = found[WhatIf.STRIKE]
    rest = solve_joint(
        [plane for plane in planes if plane.strike_id != left.strike_id], ERRORS, PRIOR, model()
    )
    assert np.allclose(left.com_shift, rest.x[:3] - solution.x[:3], atol=1e-7)


def test_tilt_stated_too_certain_is_found_by_the_strikes_and_c_stays_inside():
    """The table leans by 1.2 degrees, stated as 0 with an sd of 0.06.

    While that sd was not estimated, c moved by more than its interval when the sd was doubled.
    """
    planes = [
        replace(plane, phi=plane.phi + 0.02 * np.cos(plane.heading))
        for plane in session(np.random.default_rng(2), SIX_AXES)
    ]
    found, solution = table(planes)
    assert all(each.com_holds for each in found.values())
    sd = np.sqrt(np.diag(solution.covariance[:3, :3]))
    assert np.all(np.abs(solution.x[:3] - BODY.com) < 2.5 * sd)
    assert sd.max() < 3.5e-4


def test_radius_that_no_strike_checks_is_not_trusted():
    """Three edges across each other leave the radius open: only the statement makes c sure."""
    three, sure = ((2, -1, 1, 1), (0, -1, 2, 1), (1, -1, 0, 1)), replace(ERRORS, gravity_tilt_sd=2e-4)
    open_radius = table(session(np.random.default_rng(0), three), errors=replace(sure, edge_radius_sd=5e-5))
    found = open_radius[0][WhatIf.RADIUS]
    assert found.unchecked
    assert not found.com_holds
    assert found.com_half > 5e-4
    full = table(session(np.random.default_rng(0), SIX_AXES))[0][WhatIf.RADIUS]
    assert not full.unchecked
    assert full.com_holds


def test_radius_larger_than_any_assumed_is_not_replaced_by_the_assumed_one():
    large = RadiusPrior(2e-3, 0.0, 1e-4, RadiusSource.EDGE)
    planes = [
        replace(plane, edge_radius=large.mean, radius_prior=large)
        for plane in session(np.random.default_rng(0), SIX_AXES)
    ]
    assert WhatIf.RADIUS not in table(planes)[0]


def test_other_estimator_that_contradicts_is_found():
    planes = session(np.random.default_rng(3), SIX_AXES)
    others = [replace(plane, phi=plane.phi + 0.01 * np.sign(plane.direction.sum())) for plane in planes]
    found, _ = table(planes, others)
    assert not found[WhatIf.ESTIMATOR].com_holds
    vague = [replace(plane, sd_phi=0.02) for plane in others]
    assert table(planes, vague)[0][WhatIf.ESTIMATOR].com_holds


def test_edges_of_a_corner_share_it_and_others_share_no_point():
    planes = session(np.random.default_rng(0), VERTEX_AXES)
    found = common_point(planes)
    assert found is not None
    assert found.edges == 3
    assert np.allclose(found.point, np.array([SIZE[0], SIZE[1], -SIZE[2]]) / 2, atol=2e-3)
    assert found.miss < 2e-3
    apart = common_point(session(np.random.default_rng(0), SIX_AXES))
    assert apart is not None
    assert apart.miss > 0.03
    assert common_point([plane for plane in planes if plane.axis_id == planes[0].axis_id]) is None
