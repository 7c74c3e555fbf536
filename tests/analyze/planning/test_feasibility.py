"""Predicted lift and slip of an edge, against results by hand and an independent simulation.

The simulation is a small form of `make bench-plan-feasibility`.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from analyze.planning.feasibility import SLIP_LIMIT, StrikeCase, least_friction, simulate_tips
from tests.analyze.planning.simulated_strikes import bench, predicted, strike, trials

G = 9.81
WIDTH, HEIGHT, MASS = 0.06, 0.2, 0.5
R, PHI = np.hypot(WIDTH, HEIGHT) / 2, np.arctan2(WIDTH, HEIGHT)
I_COM = MASS * (WIDTH**2 + HEIGHT**2) / 12
I_EDGE = I_COM + MASS * R**2
"""moment of inertia of a box of 200 mm height about its bottom edge [kg m^2]: the example of method 1.4"""


def box(height, friction, energy=1.15, **more):
    rate = np.sqrt(2 * energy * MASS * G * R * (1 - np.cos(PHI)) / I_EDGE)
    return StrikeCase(R, PHI, I_COM, MASS, 0.0, height, I_EDGE * rate / height, friction, **more)


def test_strike_height_decides_whether_a_box_slides():
    """Predicted slip of a box at friction 0.3 against an independent simulation, at three strike heights.

    Struck at 100 mm it slides 23 mm and does not tip, at 145 mm it slips 0.01 mm, at 198 mm 0.5 mm.
    """
    result = simulate_tips([box(height, 0.3) for height in (0.1, 0.145, 0.198)], G)
    assert result.over.tolist() == [False, True, True]
    low, best, top = result.slip
    assert low == pytest.approx(0.023, abs=0.002)
    assert best < 2e-5
    assert top == pytest.approx(0.0005, abs=0.00015)


def test_friction_needed_by_the_impulse_is_that_of_method_1_4():
    """Friction needed by a short, hard strike: |R*cos phi - I_edge/(m*h)| <= mu*R*sin phi.

    Gravity's part is small then.
    """
    for height in (0.12, 0.13, 0.16, 0.19):
        needed = abs(R * np.cos(PHI) - I_EDGE / (MASS * height)) / (R * np.sin(PHI))
        held, slid = simulate_tips(
            [box(height, factor * needed, energy=9.0, duration=2e-4) for factor in (1.1, 0.9)], G
        ).slip
        assert slid > 2 * held + 1e-6


def test_energy_ratio_decides_whether_the_box_tips_over():
    result = simulate_tips([box(0.145, 5.0, energy=energy) for energy in (0.9, 1.1)], G)
    assert result.over.tolist() == [False, True]


def test_fast_swing_lifts_off_the_table():
    """N = m*(g + R*sin b*theta'' - R*cos b*theta'^2) falls below 0 with speed."""
    result = simulate_tips([box(0.145, 50.0, energy=energy) for energy in (1.1, 40.0)], G)
    assert result.least_load[0] > 0
    assert result.least_load[1] <= 0


def test_smallest_load_is_that_of_the_pendulum():
    """Load at release, b = phi: N/(m*g) = 1 - k*R*sin^2(phi)/g - R*cos(phi)*rate^2/g.

    It is least there for a tall box.
    """
    k = MASS * G * R / I_EDGE
    rate2 = 2 * 1.15 * k * (1 - np.cos(PHI))
    load = simulate_tips([box(0.145, 5.0)], G).least_load[0]
    assert load == pytest.approx(1 - k * R * np.sin(PHI) ** 2 / G - R * np.cos(PHI) * rate2 / G, abs=0.01)


def test_centre_of_mass_beside_the_strike_needs_more_friction():
    edge = {"i_zz": MASS * WIDTH**2 / 6, "low": -WIDTH / 2, "high": WIDTH / 2}
    straight, beside = simulate_tips([box(0.145, 0.4, **edge), box(0.145, 0.4, beside=0.01, **edge)], G).slip
    assert beside > straight + 1e-4


def test_least_friction_holds_and_less_does_not():
    case = box(0.12, 1.0)
    needed = least_friction([case], G)[0]
    assert 0.1 < needed < 1.0
    held, lost = simulate_tips(
        [replace(case, friction=float(needed)), replace(case, friction=float(needed) - 0.11)], G
    ).slip
    assert held <= SLIP_LIMIT < lost
    assert np.isinf(least_friction([box(0.03, 1.0)], G)[0])


def test_cases_are_independent():
    several = [box(0.12, 0.3), box(0.145, 0.5), box(0.19, 0.1)]
    together = simulate_tips(several, G)
    for i, each in enumerate(several):
        alone = simulate_tips([each], G)
        assert together.slip[i] == pytest.approx(alone.slip[0], rel=1e-12)
        assert together.least_load[i] == pytest.approx(alone.least_load[0], rel=1e-12)
    assert simulate_tips([], G).slip.shape == (0,)


@pytest.mark.parametrize("name", ["carton", pytest.param("juice", marks=pytest.mark.slow)])
def test_prediction_agrees_with_an_independent_simulation(name):
    """Strikes at planned and other heights, some of which hold and some of which slide."""
    on = bench(name)
    rng = np.random.default_rng(3)
    every = trials(on, (1.15, 2.0), (0.2, 0.6), 0.3, rng)
    chosen = [every[i] for i in rng.permutation(len(every))[:10]]
    outcome = simulate_tips([trial.case for trial in chosen], G)
    outcomes = [
        (predicted(outcome, i), seen.outcome)
        for i, trial in enumerate(chosen)
        if (seen := strike(on, trial)) is not None
    ]
    assert len(outcomes) >= 9
    assert (
        sum((predicted_outcome == "holds") == (seen == "holds") for predicted_outcome, seen in outcomes)
        >= len(outcomes) - 1
    )
    assert {seen == "holds" for _, seen in outcomes} == {True, False}
