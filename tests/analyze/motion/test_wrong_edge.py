"""Strikes that balance over a chamfer's other edge, in MuJoCo: none may count for the planned one."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from analyze.motion.pivot_place import PivotPlace, judge_place, judge_support, measure_pivot
from analyze.motion.settings import MotionSettings
from analyze.motion.strike import analyse_motion
from analyze.motion.supports import SupportLine
from schemas.strike_result import Verdict
from tests.analyze.motion.hopping import CONTACTS, chamfered, filmed, struck

PLACE_SD = 6e-4
"""1 sigma of the edge's place [m] by a marker 0.1 m from it, placed to 0.3 mm and 0.3 degrees"""
USED = (Verdict.GOOD, Verdict.ROCKED_BACK)


def verdicts(seeds, place_sd):
    """Motions of strikes over another line, and of strikes over the planned one.

    The latter stay on the planned line for 3 degrees past balance.
    """
    wrong, right = [], []
    for seed in seeds:
        rng = np.random.default_rng((seed, 11))
        prism = chamfered(rng)
        takes_over = math.atan2(prism.corners[1, 1], prism.corners[1, 0])
        over = int(takes_over < prism.about(prism.corners[0]).phi)
        hop = float(rng.choice([0.0, 0.05]))
        contact = str(rng.choice(list(CONTACTS)))
        strike = struck(prism, rng.uniform(1.03, 1.3), contact, hop, phase=rng.uniform(), over=over)
        if strike.carried is None:
            continue
        noise = math.radians(rng.uniform(0.01, 0.05))
        motion, task = filmed(strike, rng, noise, 3e-4, place_sd, shape=True)
        found = analyse_motion(motion, task, MotionSettings())
        if strike.carried:
            wrong.append(found)
        elif takes_over > prism.about(prism.corners[0]).phi + math.radians(3):
            right.append(found)
    return wrong, right


@pytest.mark.parametrize("place_sd", [PLACE_SD, None])
def test_no_strike_over_another_line_is_used_for_the_planned_one(place_sd):
    wrong, right = verdicts(range(12), place_sd)
    assert len(wrong) > 5
    assert right
    assert [found.reason for found in wrong if found.verdict in USED] == []
    assert [found.reason for found in right if found.verdict is Verdict.WRONG_EDGE] == []
    named = [found for found in wrong if found.verdict is Verdict.WRONG_EDGE]
    assert len(named) > 0.8 * len(wrong)
    assert all("another edge, " in found.reason and "reached at" in found.reason for found in named)


@pytest.mark.slow
@pytest.mark.parametrize("place_sd", [PLACE_SD, None])
def test_none_of_500_strikes_over_another_line_is_used(place_sd):
    wrong, right = verdicts(range(1000), place_sd)
    assert len(wrong) > 500
    assert [found.reason for found in wrong if found.verdict in USED] == []
    assert sum(found.verdict is Verdict.WRONG_EDGE for found in right) <= 0.01 * len(right)


def test_the_place_of_the_line_at_balance_is_measured_within_its_error():
    errors = []
    for seed in range(8):
        rng = np.random.default_rng((seed, 12))
        prism = chamfered(rng)
        takes_over = math.atan2(prism.corners[1, 1], prism.corners[1, 0])
        over = int(takes_over < prism.about(prism.corners[0]).phi)
        strike = struck(prism, 1.1, "hard", phase=rng.uniform(), over=over)
        phi = prism.about(prism.corners[strike.carried or 0]).phi
        if strike.carried is None or abs(phi - takes_over) < math.radians(12):
            continue
        motion, _ = filmed(strike, rng, math.radians(0.02), place_sd=1e-4)
        near = np.flatnonzero(np.abs(strike.course.theta - phi) < 0.3)
        found = measure_pivot(motion, SimpleNamespace(phi=phi, window=(near[0], near[-1] + 1)))
        x, z = prism.corners[strike.carried]
        errors.append((found.ahead - (x * math.cos(phi) + z * math.sin(phi))) / found.sd)
    assert len(errors) >= 2
    assert np.max(np.abs(errors)) < 3.0


LINES = (SupportLine(0.0, 0.0, 0.0), SupportLine(0.004, 0.001, 0.25, 0.01))


@pytest.mark.parametrize(
    ("phi", "place", "wrong"),
    [
        (0.15, None, False),
        (0.4, None, True),
        (0.15, PivotPlace(1e-4, 6e-4), False),
        (0.4, PivotPlace(4e-3, 6e-4), True),
        (0.26, PivotPlace(4e-3, 6e-4), True),
        (0.24, PivotPlace(4e-3, 6e-4), True),
        (0.26, PivotPlace(2e-4, 6e-4), True),
        (0.24, PivotPlace(2e-4, 6e-4), False),
        (0.15, PivotPlace(4e-3, 6e-4), True),
        (0.15, PivotPlace(1.5e-3, 6e-4), False),
        (0.15, PivotPlace(-9e-4, 1e-4), False),
    ],
)
def test_the_measured_place_decides_where_the_shape_does_not(phi, place, wrong):
    rng = np.random.default_rng(1)
    strike = struck(chamfered(rng), 3.0)
    motion, task = filmed(strike, rng, 1e-3)
    frames = (0, len(strike.course.theta))
    fit = SimpleNamespace(phi=phi, covariance=np.diag([1e-8, 1.0]), window=frames, rolling=None)
    found = judge_support(motion, fit, place, replace(task, supports=LINES)) or judge_place(place, fit)
    assert (found is not None) == wrong
    assert found is None or found.code is Verdict.WRONG_EDGE
