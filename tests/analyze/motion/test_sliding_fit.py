"""Friction from the fall of simulated strikes: a value where the edge slid, a bound where it held."""

import math
from dataclasses import replace

import numpy as np
import pytest

from analyze.errors import EstimationError
from analyze.motion.held_edge import held_ratio, rolling_loss, slide_range
from analyze.motion.settings import MotionSettings
from analyze.motion.sliding_fit import PivotBody, friction_likelihood
from analyze.motion.sliding_motion import SlidingBodies, held_forces, sliding_path
from analyze.motion.strike import analyse_motion
from tests.analyze.motion.drawn_strikes import holding_height, seen
from tests.analyze.motion.sliding import Body, G, _acceleration, push_for, simulate

NOISE = math.radians(0.02)
TALL = Body(R=0.1, phi=0.3, inertia=0.0034, rho=0.001, friction=0.25, height=0.19)


def struck(body: Body, energy: float = 1.1, seed: int = 1):
    rng = np.random.default_rng(seed)
    course = simulate(body, [push_for(body, energy, holding_height(body))])
    motion, task = seen(course, body, rng, NOISE)
    return analyse_motion(motion, task, MotionSettings())


def known(body: Body, fit) -> PivotBody:
    scale = np.array([1.0, 1 / fit.k])
    covariance = fit.covariance * np.outer(scale, scale)
    return PivotBody(fit.phi, fit.k, covariance, body.R, 3e-4, body.rho, 3e-4, 0.0, 1e-4, G)


def fall(body: Body, seed: int = 1):
    motion = struck(body, seed=seed)
    assert motion.fit is not None
    assert motion.phases.stage_two is not None
    first = int(np.argmax(motion.angle.theta > motion.fit.phi + 0.05))
    window = first, motion.phases.stage_two[1] - 1
    return friction_likelihood(motion.angle, motion.edge_path, window, known(body, motion.fit), moving=False)


@pytest.mark.parametrize("friction", [0.2, 0.32])
def test_an_edge_that_slides_gives_the_coefficient_of_friction(friction):
    found = fall(replace(TALL, friction=friction))
    inside = found.mu[found.chi2 < 3.84]
    assert inside[0] < friction < inside[-1]
    assert found.mu[np.argmin(found.chi2)] == pytest.approx(friction, abs=0.01)
    assert found.slid > 6e-4


def test_an_edge_that_holds_gives_a_bound_only():
    # It lands on its side before friction gives out.
    wide = Body(R=0.06, phi=0.75, inertia=0.0012, rho=0.001, friction=0.6, height=0.088)
    found = fall(wide)
    assert found.value(np.array([2.0]))[0] < 3.84
    assert found.value(np.array([0.2]))[0] > 3.84
    assert found.slid < 3e-4


def test_too_few_frames_are_refused():
    motion = struck(TALL)
    with pytest.raises(EstimationError, match="too few frames"):
        friction_likelihood(motion.angle, motion.edge_path, (60, 63), known(TALL, motion.fit), moving=False)


def test_forces_are_those_of_the_independent_simulation():
    for theta, omega in ((0.05, 2.0), (0.35, 0.7), (0.9, 4.0)):
        one = np.ones(1)
        bodies = SlidingBodies(one, TALL.phi * one, TALL.k * one, TALL.R * one, 0 * one, TALL.rho, G)
        alpha, pull, load = (float(each[0]) for each in held_forces(bodies, theta * one, omega * one))
        state = (0.0, TALL.rho, theta, 0.0, 0.0, omega)
        _, _, true_alpha, true_load, _ = _acceleration(
            replace(TALL, friction=99.0), state, 0.0, 0.0, contact=True, stick=True
        )
        assert alpha == pytest.approx(true_alpha, rel=1e-9)
        assert load == pytest.approx(true_load, rel=1e-9)
        assert abs(pull) < 10.0


def test_an_edge_that_stops_sliding_sticks():
    one = np.ones(1)
    bodies = SlidingBodies(0.5 * one, TALL.phi * one, TALL.k * one, TALL.R * one, 0 * one, TALL.rho, G)
    time = np.linspace(0.0, 0.2, 25)
    _, slip, _ = sliding_path(time, bodies, np.array([[0.1], [1.0], [0.0], [0.3]]))
    assert slip[-1, 0] == pytest.approx(slip[-5, 0], abs=1e-9)
    assert 0.001 < slip[-1, 0] < 0.03


def test_the_ratio_that_an_edge_needed_is_below_the_friction_that_held_it():
    motion = struck(replace(TALL, friction=0.35))
    held = held_ratio(motion.fit, known(TALL, motion.fit), 0.25)
    assert 0.1 < held.ratio < 0.35
    assert 0.0005 < held.sd < 0.01
    assert slide_range(motion.angle, motion.edge_path, motion.phases.stage_one) < 1e-4


def test_a_strike_that_rocks_back_shows_that_nothing_is_lost():
    motion = struck(replace(TALL, friction=0.6), energy=0.9)
    loss = rolling_loss(motion.fit, motion.angle, TALL.R)
    assert abs(loss.arm) < 4 * loss.sd
    assert loss.sd < 1e-3
    assert rolling_loss(struck(TALL).fit, struck(TALL).angle, TALL.R) is None
