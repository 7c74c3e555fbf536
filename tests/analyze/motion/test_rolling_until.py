"""A body rolls on a rounding until a part that juts out lands: how far, and what a strike then gives."""

from __future__ import annotations

import math
import re
from dataclasses import replace

import numpy as np
import pytest

from analyze.motion.landing import rolling_landing_angle
from analyze.motion.rolling_choice import is_curved, rolling_curve, rolls_until
from analyze.motion.settings import MotionSettings
from analyze.motion.strike import analyse_motion
from analyze.motion.support_function import SupportFunction, support_of_outline
from schemas.strike_result import Verdict
from tests.analyze.motion.rolling import as_tracked, draw_rolling
from tests.analyze.motion.tipping import planned

RADIUS = 0.003
HANDLE = np.array([0.03, 0.036])


def cup(*outer: np.ndarray) -> np.ndarray:
    """Outline (n, 2) [m] of a cup with a rounded foot of facets of 10 deg, and points that jut out."""
    turned = np.radians(np.arange(0, 91, 10))
    foot = RADIUS * np.column_stack([np.sin(turned) - 1, 1 - np.cos(turned)])
    return np.vstack([[-0.08, 0.0], foot, [[0.0, 0.09], [-0.08, 0.09]], *outer])


def handle_lands() -> float:
    """Tipping angle [rad] at which the handle's point and the foot's arc touch the table together."""
    turned = np.linspace(0, math.pi / 2, 9001)
    arc = RADIUS * np.column_stack([np.sin(turned) - 1, 1 - np.cos(turned)])
    line = HANDLE - arc
    return float(np.min(np.arctan2(line[:, 1], line[:, 0])[turned < 1.2]))


def seen(*outer: np.ndarray, until: float | None = None) -> SupportFunction:
    points = cup(*outer)
    return support_of_outline(points, np.zeros(2)) if until is None else support_of_outline(
        points, np.zeros(2), until=until
    )  # fmt: skip


def test_a_cup_rolls_on_its_foot_until_its_handle_lands():
    """It did not count as rolling: the handle lands less than 25 deg past balance."""
    lands = rolls_until(seen(HANDLE), math.radians(34))
    assert lands == pytest.approx(handle_lands(), abs=math.radians(1.5))
    assert rolls_until(seen(), math.radians(34)) == math.inf


def test_on_a_wide_rounding_it_does_not_roll_until_the_handle_lands():
    """A toy truck's wing of 6 mm in coarse facets gave phi 1.1 deg too small, and a wrong answer."""
    wide = 2 * cup(HANDLE)
    assert rolls_until(support_of_outline(wide, np.zeros(2)), math.radians(34)) is None


@pytest.mark.parametrize("phi_deg", [47, 60])
def test_it_does_not_roll_to_a_balance_after_the_handle(phi_deg):
    assert not is_curved(seen(HANDLE), math.radians(phi_deg))
    assert rolling_curve(seen(HANDLE), planned(0.001, math.radians(phi_deg)))[0] is None


def test_the_reason_names_the_rounding_before_the_handle():
    curve, reason = rolling_curve(seen(HANDLE), planned(0.001, math.radians(34)))
    assert curve is not None
    found = re.search(r"rolls on a curve of (\d+) to (\d+) mm radius", reason)
    assert found is not None
    assert int(found[1]) <= 1000 * RADIUS <= int(found[2]) < 10


def test_landing_angle_of_the_handle_has_a_margin():
    strike = planned(0.001, math.radians(34))
    lands = rolling_landing_angle(seen(HANDLE), strike)
    assert lands is not None
    assert lands == pytest.approx(rolls_until(seen(HANDLE), math.radians(34)) - math.radians(1.0), abs=1e-9)
    unsure = strike.model_copy(update={"pivot": strike.pivot.model_copy(update={"sd_m": 4e-4})})
    assert rolling_landing_angle(seen(HANDLE), unsure) < lands
    assert rolling_landing_angle(seen(), strike) is None


def test_an_uneven_handle_is_no_error_of_the_foot():
    """Its facets made the place of the contact unsure: of a mug's, by 8 mm."""
    turned = np.radians(np.sort(np.random.default_rng(9).uniform(-20, 100, 14)))
    grip = np.array([0.012, 0.05]) + np.array([0.018, 0.033]) * np.column_stack(
        [np.cos(turned), np.sin(turned)]
    )
    phi = math.radians(34)
    lands = rolls_until(seen(grip), phi)
    assert lands is not None
    assert math.isfinite(lands)
    assert seen(grip).sd > 1e-4
    assert seen(grip, until=lands).sd < 1e-5


def test_a_strike_that_balances_after_the_landing_is_a_wrong_edge():
    rng = np.random.default_rng(4)
    body = draw_rolling(rng, 0.03, 0.03)
    motion, task = as_tracked(body, 1.2, math.radians(0.02), rng)
    whole = analyse_motion(motion, task, MotionSettings())
    assert whole.verdict is Verdict.GOOD
    assert whole.fit is not None
    early, late = whole.fit.phi - math.radians(2.0), whole.fit.phi + math.radians(6.0)
    found = analyse_motion(motion, replace(task, landing_angle_rad=late), MotionSettings())
    assert found.verdict is Verdict.GOOD
    assert found.fit is not None
    assert found.angle is not None
    assert found.angle.theta[found.fit.window[1] - 1] < late
    assert found.fit.phi == pytest.approx(whole.fit.phi, abs=math.radians(0.1))
    found = analyse_motion(motion, replace(task, landing_angle_rad=early), MotionSettings())
    assert found.verdict is Verdict.WRONG_EDGE
    assert "next edge takes over" in found.reason
