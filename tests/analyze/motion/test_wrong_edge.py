"""Strikes over a chamfer, in MuJoCo: each counts for the line over which it balanced, or for none."""

import math
from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
import pytest

from analyze.motion.pivot_place import PivotPlace, judge_place, judge_support, measure_pivot
from analyze.motion.settings import MotionSettings
from analyze.motion.strike import analyse_motion
from analyze.types import RollingContact, SupportLine, TipMotion
from schemas.strike_result import Verdict
from tests.analyze.motion.hopping import CONTACTS, Prism, chamfered, filmed, struck

PLACE_SD = 6e-4
"""1 sigma of the edge's place [m] by a marker 0.1 m from it, placed to 0.3 mm and 0.3 degrees"""


@dataclass(frozen=True)
class Judged:
    """Analysed strike with the truth: the line that carried at balance, and the margin to the take-over."""

    found: TipMotion
    prism: Prism
    carried: int
    margin: float
    """angle from the planned edge's balance to the take-over [rad]"""

    @property
    def used(self):
        """True if the strike counts for a line."""
        return self.found.verdict in (Verdict.GOOD, Verdict.ROCKED_BACK) and self.found.fit is not None

    @property
    def counted(self):
        """Index of the line for which it counts."""
        return int(self.found.carried_by is not None)

    def off(self):
        """Errors of phi and k over their sd, about the line for which the strike counts."""
        truth = self.prism.about(self.prism.corners[self.counted])
        error = np.array([self.found.fit.phi - truth.phi, self.found.fit.k - truth.k])
        return error / np.sqrt(np.diag(self.found.fit.covariance))


def judged(seeds, place_sd):
    """Yield analysed strikes, half-random, that balance over the planned edge or over the next line.

    Args:
        seeds: seed of each strike.
        place_sd: 1 sigma [m] of the edge's place by the markers; None if their places are not known.
    """
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
        yield Judged(found, prism, strike.carried, takes_over - prism.about(prism.corners[0]).phi)


def test_a_strike_counts_for_the_line_over_which_it_balanced():
    strikes = list(judged(range(14), PLACE_SD))
    used = [each for each in strikes if each.used]
    assert [each.found.reason for each in used if each.counted != each.carried and each.margin < 0] == []
    moved = [each for each in used if each.counted]
    assert len(moved) > 5
    assert all("next line" in each.found.reason and "counted for it" in each.found.reason for each in moved)
    off = np.array([each.off() for each in moved])
    assert np.max(np.abs(off)) < 4.0
    assert np.sqrt(np.mean(off**2)) < 1.5


def test_without_a_measured_place_no_strike_counts_for_another_line():
    strikes = list(judged(range(8), None))
    assert [each.found.reason for each in strikes if each.carried and each.used] == []
    named = [each.found.reason for each in strikes if each.found.verdict is Verdict.WRONG_EDGE]
    assert len(named) > 2
    assert all("another edge, " in reason and "reached at" in reason for reason in named)


def test_only_the_motion_before_the_next_line_takes_over_is_fitted():
    # The next line takes over 4 to 8 deg past balance: fitted beyond that, phi is 3 to 5 sd off.
    near = [each for each in judged((1, 29, 93, 97), PLACE_SD) if each.used]
    assert [each.counted for each in near] == [0, 0, 0, 0]
    assert np.max(np.abs([each.off()[0] for each in near])) < 2.0


def test_a_strike_whose_fit_ends_before_the_take_over_is_not_used_if_it_balances_later():
    # The window ends at 13 deg, the next line may carry from 14 deg, and phi came out as 16.4 for 18.4 deg.
    assert [each.found.verdict for each in judged((484,), PLACE_SD)] == [Verdict.WRONG_EDGE]


@pytest.mark.slow
@pytest.mark.timeout(1200)
@pytest.mark.parametrize("place_sd", [PLACE_SD, None])
def test_none_of_500_strikes_over_the_next_line_counts_for_the_planned_edge(place_sd):
    strikes = list(judged(range(1000), place_sd))
    wrong = [each for each in strikes if each.carried]
    assert len(wrong) > 500
    assert [each.found.reason for each in wrong if each.used and not each.counted] == []
    # Balanced up to 1.5 deg beyond the angle to which the planned edge surely carries: 4 of 316.
    right = [each for each in strikes if each.margin > math.radians(3)]
    assert sum(each.found.verdict is Verdict.WRONG_EDGE for each in right) <= 0.02 * len(right)
    off = np.array([each.off() for each in strikes if each.used])
    assert np.mean(np.abs(off) < 1.96) > 0.88


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
        (0.15, PivotPlace(1.6e-3, 6e-4), True),
        (0.15, PivotPlace(1.4e-3, 6e-4), False),
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


def test_an_edge_that_a_scan_misplaces_is_no_other_edge():
    """Edges of scanned cartons that the meshing rounded to 5 mm were said to be wrong."""
    fit = SimpleNamespace(phi=math.radians(20), rolling=None)
    behind = PivotPlace(-2.4e-3, 6e-4)
    assert judge_place(behind, fit) is not None
    assert judge_place(behind, fit, edge_sd=1.6e-3) is None
    assert judge_place(PivotPlace(-8e-3, 6e-4), fit, edge_sd=1.6e-3) is not None


def test_a_rolling_contact_is_compared_where_it_rolls():
    """Two strikes of a toy that rolled on axles 4.5 mm from where its shape has them counted as good."""
    phi = math.radians(20)
    rolling = RollingContact(3e-3, 1e-3, 5e-3, 2e-4, 1.2)
    fit = SimpleNamespace(phi=phi, rolling=rolling)
    below_centre = 3e-3 * math.cos(phi) + 1e-3 * math.sin(phi)
    assert judge_place(PivotPlace(below_centre + 1e-3, PLACE_SD), fit) is None
    for off in (-4.5e-3, 4.5e-3):
        assert judge_place(PivotPlace(below_centre + off, PLACE_SD), fit).code is Verdict.WRONG_EDGE
    vague = SimpleNamespace(phi=phi, rolling=replace(rolling, sd=3e-3))
    assert judge_place(PivotPlace(below_centre + 4.5e-3, PLACE_SD), vague) is None
