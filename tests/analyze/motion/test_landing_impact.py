"""Restitution at a landing, from the angle and height of a body whose line bounces."""

import math

import numpy as np
import pytest

from analyze.motion.landing_impact import LandingBody, landing
from analyze.types import EdgePath, TipAngle

LENGTH, RATE = 0.15, 120.0
LINE = np.array([0.0, LENGTH])
COM = np.array([-0.03, 0.075])


def landed(restitution: float, noise: float = 2e-5, speed: float = 1.4, rate: float = RATE, seed: int = 1):
    """Landing at 90 degrees of a line that comes down at `speed` [m/s] and goes back up."""
    rng = np.random.default_rng(seed)
    time = np.arange(-0.3, 0.1, 1 / rate) + 0.003
    before = speed * np.minimum(time, 0.0) - 2.0 * np.minimum(time, 0.0) ** 2
    height = -before
    bounce = restitution * speed
    late = np.maximum(time, 0.0)
    flight = bounce * late - 0.5 * 11.0 * late**2
    height = np.where(time < 0, height, np.maximum(flight, 0.0)) + rng.normal(0, noise, len(time))
    theta = math.pi / 2 - height / LENGTH
    zero = np.zeros(len(time))
    angle = TipAngle((time * 1e9).astype(np.int64), theta, zero + noise / LENGTH, zero, zero)
    covariance = np.zeros((len(time), 3, 3))
    covariance[:, 0, 0] = (noise / LENGTH) ** 2
    path = EdgePath(zero, zero, covariance, 5e-4)
    last = int(np.searchsorted(time, 0.0)) - 2
    return landing(angle, path, LandingBody(LINE, np.zeros((0, 2)), COM), last, 9.81)


@pytest.mark.parametrize("restitution", [0.15, 0.3, 0.6])
def test_a_rebound_is_measured(restitution):
    found = landed(restitution)
    assert found.upper is None
    assert found.restitution == pytest.approx(restitution, abs=0.01)
    assert abs(found.restitution - restitution) < 2.5 * found.sd
    assert found.speed == pytest.approx(1.4, rel=0.01)
    assert found.omega_before == pytest.approx(1.4 / LENGTH, rel=0.04)
    assert found.omega_after < 0


def test_a_line_that_stays_down_gives_an_upper_limit():
    found = landed(0.0)
    assert found is not None
    assert found.upper is not None
    assert found.upper < 0.06
    assert 0 < found.restitution < found.upper


def test_a_landing_without_frames_after_it_is_none():
    assert landed(0.3, rate=20.0) is None
