"""Direction of the line about which a body turns, against the planned edge."""

import math
from dataclasses import replace

import numpy as np
import pytest

from analyze.motion.axis_heading import judge_heading, measure_heading
from schemas.strike_result import Verdict
from tests.analyze.motion.test_verdict import N, motion

WINDOW = (13, N)
ROLL_SD = math.radians(2)


def rolling_aside(askew, sd=ROLL_SD, seed=0):
    """Tip over a line at the angle `askew` [rad] to the planned one, with noise of the roll."""
    tip = motion()
    noise = np.random.default_rng(seed).normal(0, sd, N)
    return replace(tip, roll=math.tan(askew) * tip.angle.theta + noise, roll_sd=np.full(N, sd))


def test_the_direction_is_measured_within_its_error():
    off = []
    for seed in range(40):
        ratio, sd = measure_heading(rolling_aside(0.3, seed=seed), WINDOW)
        off.append((ratio - math.tan(0.3)) / sd)
    assert abs(np.mean(off)) < 0.5
    assert 0.7 < np.std(off) < 1.3


@pytest.mark.parametrize("side", [1, -1])
def test_a_tip_over_an_askew_line_is_a_wrong_edge(side):
    found = judge_heading(rolling_aside(side * math.radians(20)), WINDOW, rolls=False)
    assert found.code is Verdict.WRONG_EDGE
    assert found.reason.startswith("turned over a line 20 deg askew of the planned edge")


@pytest.mark.parametrize(
    "tip",
    [
        rolling_aside(math.radians(6)),
        rolling_aside(0.0, sd=math.radians(40)),
        motion(),
        replace(rolling_aside(0.3), angle=motion(theta_max=0.01).angle),
    ],
)
def test_small_angles_noise_and_unknown_rolls_are_not_judged(tip):
    assert judge_heading(tip, WINDOW, rolls=False) is None


def test_a_round_rim_has_no_direction():
    assert judge_heading(rolling_aside(math.radians(20)), WINDOW, rolls=True) is None
