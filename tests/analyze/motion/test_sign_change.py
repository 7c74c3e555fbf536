"""The paper's estimator: near the truth, noisier than the pendulum fit, and refused short of the balance."""

import numpy as np
import pytest

from analyze.errors import EstimationError
from analyze.motion.pendulum_fit import pivot_fit
from analyze.motion.sign_change import sign_change
from analyze.types import TipAngle
from tests.analyze.motion.tipping import free_part


def test_sign_change_is_near_and_noisier():
    tip, angle = free_part(1.05, 0.01, np.random.default_rng(5))
    fit = sign_change(angle, (0, len(angle.theta)))
    assert fit.k is None
    assert abs(np.degrees(fit.phi - tip.phi)) < 0.5


def test_sign_change_where_frames_are_missing():
    """Balance angle within 0.5 degrees although a quarter of the frames is missing.

    Averages that took the frames for evenly spaced put it off by up to 10 degrees.
    """
    rng = np.random.default_rng(5)
    tip, angle = free_part(1.05, 0.01, rng)
    kept = rng.random(len(angle.theta)) > 0.25
    part = TipAngle(
        angle.time_ns[kept], angle.theta[kept], angle.sd[kept], angle.off_axis[kept], angle.slip[kept]
    )
    fit = sign_change(part, (0, len(part.theta)), fit=pivot_fit(part, (0, len(part.theta))))
    assert abs(fit.phi - tip.phi) < 3 * np.sqrt(fit.covariance[0, 0]) < np.radians(0.5)


def test_sign_change_needs_to_pass_the_balance():
    _, angle = free_part(0.9, 0.0005, np.random.default_rng(5))
    with pytest.raises(EstimationError, match="no second sign change"):
        sign_change(angle, (0, len(angle.theta) - 6))
