"""Random-effects estimate over sessions: published examples, coverage of intervals, influence, edge cases."""

from __future__ import annotations

import math

import numpy as np
import pytest

from analyze.batch.between_sessions import estimate_over_sessions, homogeneity, q_profile_interval

# Trials of the BCG vaccine (Colditz et al., 1994, JAMA 271, 698): cases and others, vaccinated and control.
CASES = np.array([4, 6, 3, 62, 33, 180, 8, 505, 29, 17, 186, 5, 27.0])
OTHERS = np.array([119, 300, 228, 13536, 5036, 1361, 2537, 87886, 7470, 1699, 50448, 2493, 16886.0])
CONTROL_CASES = np.array([11, 29, 11, 248, 47, 372, 10, 499, 45, 65, 141, 3, 29.0])
CONTROL_OTHERS = np.array([128, 274, 209, 12619, 5761, 1079, 619, 87892, 7232, 1600, 27197, 2338, 17825.0])


def log_risk_ratios():
    treated, control = CASES + OTHERS, CONTROL_CASES + CONTROL_OTHERS
    variance = 1 / CASES - 1 / treated + 1 / CONTROL_CASES - 1 / control
    return np.log(CASES / treated / (CONTROL_CASES / control)), np.sqrt(variance)


def log_odds_ratios():
    variance = 1 / CASES + 1 / OTHERS + 1 / CONTROL_CASES + 1 / CONTROL_OTHERS
    return np.log(CASES * CONTROL_OTHERS / (OTHERS * CONTROL_CASES)), np.sqrt(variance)


def test_risk_ratios_of_the_bcg_trials_as_published():
    """REML and Q by metafor (Viechtbauer, 2010, J. Stat. Softw. 36(3)), PM and HK by statsmodels 0.14."""
    found = estimate_over_sessions(*log_risk_ratios())
    assert found.between_sd**2 == pytest.approx(0.3180684522, rel=1e-8)
    assert found.between_sd_reml**2 == pytest.approx(0.3132, abs=5e-5)
    low, high = np.square(found.between_interval)
    assert (low, high) == pytest.approx((0.1197, 1.1115), abs=5e-5)
    assert found.mean == pytest.approx(-0.7149681535, rel=1e-8)
    assert found.mean_sd == pytest.approx(0.1808921915, rel=1e-7)
    assert found.chi_square == pytest.approx(152.2330, abs=5e-5)
    assert found.p_value < 1e-20


def test_interval_of_the_odds_ratios_variance_as_published():
    """H. C. van Houwelingen et al. (2002, Stat. Med. 21, 589), as replicated on the site of metafor."""
    value, sd = log_odds_ratios()
    assert np.square(q_profile_interval(value, sd)) == pytest.approx((0.1302, 1.1812), abs=1e-4)
    assert estimate_over_sessions(value, sd).between_sd_reml ** 2 == pytest.approx(0.338, abs=5e-4)


def test_nine_laboratories_as_by_statsmodels():
    """Nine laboratories' results with stated variances, of statsmodels' notebook on meta-analysis."""
    value = np.array([61.00, 61.40, 62.21, 62.30, 62.34, 62.60, 62.70, 62.84, 65.90])
    variance = np.array([0.2025, 1.2100, 0.0900, 0.2025, 0.3844, 0.5625, 0.0676, 0.0225, 1.8225])
    found = estimate_over_sessions(value, np.sqrt(variance))
    assert found.between_sd**2 == pytest.approx(0.7053953092, rel=1e-8)
    assert found.mean == pytest.approx(62.4076199113, rel=1e-10)
    assert found.mean_half == pytest.approx(0.7794999676, rel=1e-7)
    assert found.chi_square == pytest.approx(24.8018977, rel=1e-7)


@pytest.mark.parametrize("tau", [0.0, 1.0, 3.0])
@pytest.mark.parametrize("sessions", [3, 6, 12, 30])
def test_intervals_hold_as_often_as_they_say(sessions, tau):
    """95 % intervals hold in 93 to 97 % of the runs; the sessions' stated sds differ by up to two."""
    rng = np.random.default_rng((97, sessions, int(tau)))
    runs, held, predicted, between = 2000, 0, 0, 0
    for _ in range(runs):
        sd = rng.uniform(0.7, 1.4, sessions)
        found = estimate_over_sessions(
            rng.normal(0.0, tau, sessions) + rng.normal(0.0, sd), sd, influence=False
        )
        new = rng.normal(0.0, tau) + rng.normal(0.0, rng.uniform(0.7, 1.4))
        held += abs(found.mean) <= found.mean_half
        predicted += abs(new - found.mean) <= found.prediction_half
        low, high = found.between_interval
        between += low <= tau <= high
    assert 0.93 <= held / runs <= 0.97
    assert 0.93 <= predicted / runs <= 0.97
    assert 0.93 <= between / runs <= (0.99 if tau == 0 else 0.97), "one-sided at tau = 0"


def test_one_session_leaves_everything_between_sessions_open():
    found = estimate_over_sessions(np.array([3.0]), np.array([0.2]))
    assert (found.mean, found.stated_sd, found.left_out) == (3.0, 0.2, ())
    for number in (found.mean_half, found.between_sd, found.prediction_half, found.p_value, found.scatter):
        assert math.isnan(number)


def test_odd_session_is_named_and_moves_the_mean_by_its_share():
    rng = np.random.default_rng(4)
    value, sd = rng.normal(10.0, 1.0, 12), np.ones(12)
    value[7] += 12.0
    found = estimate_over_sessions(value, sd)
    assert found.odd == (7,)
    assert found.left_out[7].shift == pytest.approx(value.mean() - np.delete(value, 7).mean(), rel=0.05)
    assert estimate_over_sessions(np.delete(value, 7), np.ones(11)).odd == ()


def test_false_alarms_of_the_odd_session_are_rare():
    rng = np.random.default_rng(5)
    found = [estimate_over_sessions(rng.normal(0, 1.5, 8), np.ones(8)).odd for _ in range(1500)]
    assert sum(map(bool, found)) / len(found) < 0.02


def test_unit_and_origin_do_not_matter():
    rng = np.random.default_rng(6)
    value, sd = rng.normal(0, 2, 9), rng.uniform(0.5, 1.5, 9)
    found, small = estimate_over_sessions(value, sd), estimate_over_sessions(1e-9 * value + 7e-4, 1e-9 * sd)
    assert 1e9 * (small.mean - 7e-4) == pytest.approx(found.mean, abs=1e-6)
    for name in ("mean_half", "between_sd", "between_sd_reml", "prediction_half", "scatter"):
        assert 1e9 * getattr(small, name) == pytest.approx(getattr(found, name), rel=1e-5)


def test_equal_values_of_all_sessions_give_no_scatter():
    found = estimate_over_sessions(np.full(4, 2.5), np.full(4, 0.1))
    assert (found.mean, found.mean_half, found.between_sd, found.between_sd_reml) == (2.5, 0.0, 0.0, 0.0)
    assert found.between_interval == (0.0, 0.0)


@pytest.mark.parametrize(
    ("value", "sd"), [([], []), ([1.0], [0.0]), ([math.nan], [1.0]), ([1.0], [math.inf])]
)
def test_sessions_without_value_or_sd_are_refused(value, sd):
    with pytest.raises(ValueError, match="every session needs a finite value and an sd above 0"):
        estimate_over_sessions(np.array(value), np.array(sd))


def test_joint_homogeneity_is_uniform_for_sessions_that_agree():
    rng = np.random.default_rng(7)
    p_values = []
    for _ in range(800):
        root = rng.normal(size=(6, 3, 3))
        covariance = root @ root.transpose(0, 2, 1) + 0.1 * np.eye(3)
        value = np.array([rng.multivariate_normal(np.zeros(3), each) for each in covariance])
        chi_square, freedom, p_value = homogeneity(value, covariance)
        assert freedom == 15
        assert chi_square >= 0
        p_values.append(p_value)
    assert np.mean(np.array(p_values) < 0.05) == pytest.approx(0.05, abs=0.025)
    apart = np.array([[0, 0, 0], [1, 1, 1.0]])
    assert homogeneity(apart, np.tile(0.01 * np.eye(3), (2, 1, 1)))[2] < 1e-6
