"""Tips with a spoilt start or end: the clean stretch between gives phi, a strike in mid-tip leaves none."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from analyze.motion.free_motion import largest_jump, longest_clean_fit, settled_fit
from analyze.motion.pendulum_fit import pivot_fit
from analyze.types import TipAngle

PHI, K, RATE = np.radians(30.0), 85.0, 120.0
SD = np.radians(0.02)


def tip(jumps: dict[float, float], seed: int = 1, energy: float = 1.15, seconds: float = 0.36) -> TipAngle:
    """Tip of a pendulum whose angular speed jumps: [rad/s] by time of the jump [s]."""
    state = np.array([0.0, np.sqrt(2 * K * (1 - np.cos(PHI)) * energy)])
    times = np.arange(0.0, seconds, 1 / RATE)
    theta, begin = [], 0.0
    for end, change in [*sorted(jumps.items()), (seconds, 0.0)]:
        mine = times[(times >= begin) & (times < end)]
        run = solve_ivp(
            lambda _, y: [y[1], -K * np.sin(PHI - y[0])],
            (begin, end),
            state,
            t_eval=[*mine, end],
            rtol=1e-10,
            atol=1e-12,
        )
        theta += list(run.y[0, :-1])
        state, begin = run.y[:, -1] + [0.0, change], end
    noisy = np.array(theta) + np.random.default_rng(seed).normal(0.0, SD, len(theta))
    count = len(noisy)
    return TipAngle(
        (times * 1e9).astype(np.int64), noisy, np.full(count, SD), np.zeros(count), np.zeros(count)
    )


def whole(angle: TipAngle) -> tuple[int, int]:
    return 0, len(angle.theta)


def test_a_clean_tip_is_used_whole():
    angle = tip({})
    fit = longest_clean_fit(angle, whole(angle))
    assert fit is not None
    assert fit.window == whole(angle)


@pytest.mark.parametrize(
    "jumps", [{0.27: -1.0}, {0.035: -0.4}, {0.035: -0.4, 0.27: -1.0}], ids=["landing", "slid", "both"]
)
def test_a_spoilt_end_is_left_out(jumps):
    angle = tip(jumps, energy=1.4)
    spoilt = pivot_fit(angle, whole(angle))
    assert largest_jump(angle, spoilt)[2] > 60
    fit = longest_clean_fit(angle, whole(angle))
    assert fit is not None
    assert abs(fit.phi - PHI) < 4 * np.sqrt(fit.covariance[0, 0]) + np.radians(0.02)
    start, end = (t / 1e9 for t in angle.time_ns[[fit.window[0], fit.window[1] - 1]])
    if 0.035 in jumps:
        assert 0.02 < start < 0.08
    if 0.27 in jumps:
        assert 0.2 < end < 0.29


def test_a_second_strike_in_mid_tip_leaves_no_clean_stretch():
    angle = tip({0.13: 0.8}, energy=1.05)
    fit = longest_clean_fit(angle, whole(angle))
    assert fit is None


def test_the_largest_jump_is_located():
    angle = tip({0.15: 0.8})
    index, size, _ = largest_jump(angle, pivot_fit(angle, whole(angle)))
    assert index == pytest.approx(0.15 * RATE, abs=2)
    assert size == pytest.approx(0.8, rel=0.3)


def test_the_fit_begins_after_light_contacts():
    # 4, 3 and 4 % of the speed, one after the other: no single jump stands out
    angle = tip({0.010: 0.2, 0.021: 0.15, 0.031: 0.2})
    spoilt = pivot_fit(angle, whole(angle))
    fit = settled_fit(spoilt, lambda frames: pivot_fit(angle, frames))
    assert abs(np.degrees(spoilt.phi - PHI)) > 0.1
    assert 3 <= fit.window[0] <= 6
    assert abs(fit.phi - PHI) < 3.5 * np.sqrt(fit.covariance[0, 0])
    assert abs(np.degrees(fit.phi - PHI)) < 0.1
    assert "the striker still touched" in fit.note


@pytest.mark.parametrize("seed", range(6))
def test_a_clean_tip_is_fitted_from_its_first_frame(seed):
    angle = tip({}, seed)
    fit = pivot_fit(angle, whole(angle))
    assert settled_fit(fit, lambda frames: pivot_fit(angle, frames)) is fit
