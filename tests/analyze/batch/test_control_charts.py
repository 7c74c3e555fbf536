"""Control charts: false alarms and delay by simulation, a published example, outliers, edge cases."""

from __future__ import annotations

import numpy as np
import pytest

from analyze.batch.control_charts import (
    BASELINE,
    D2,
    FALSE_ALARMS_PER_SESSION,
    MIN_SESSIONS,
    control_chart,
)

NOTHING = np.full(400, np.nan)
WEEKS_PER_MONTH = 365.25 / 12 / 7


def chart_of(value, stated_sd=None, baseline=BASELINE):
    value = np.asarray(value, dtype=np.float64)
    sd = np.full(len(value), np.nan if stated_sd is None else stated_sd)
    found = control_chart(value, sd, baseline)
    assert found is not None
    return found


def test_limits_are_those_of_the_textbook():
    """Data of the EWMA chart in NIST's e-Handbook, 6.3.2.4 (there with lambda 0.3), by its formulas."""
    value = [
        52.0,
        47,
        53,
        49.3,
        50.1,
        47,
        51,
        50.1,
        51.2,
        50.5,
        49.6,
        47.6,
        49.9,
        51.3,
        47.8,
        51.2,
        52.6,
        52.4,
        53.6,
        52.1,
    ]
    found = chart_of(value)
    assert found.sd == pytest.approx(np.abs(np.diff(value)).mean() / D2)
    assert found.centre == pytest.approx(np.mean(value))
    ewma = found.centre
    for x, seen in zip(value, found.ewma, strict=True):
        ewma = 0.2 * x + 0.8 * ewma
        assert seen == pytest.approx(ewma)
    # Few sessions widen the limits: Student's t with 0.605 * 19 degrees of freedom in place of 3 sd.
    assert found.half[0] / found.sd == pytest.approx(3.75 * np.sqrt(1.05), rel=0.02)
    assert found.in_control


def run_lengths(baseline, runs, sessions, rng, drift=0.0):
    """Sessions until the first signal (one more than there are if there is none), and rates of signals."""
    lengths, signals, phase_one = [], 0, 0
    for _ in range(runs):
        value = rng.normal(size=baseline + sessions)
        value[baseline:] += drift * np.arange(1, sessions + 1)
        found = chart_of(value, baseline=baseline)
        outside, drifted = found.outside, found.drifted
        phase_one += bool((outside | drifted)[:baseline].any())
        # A drift that lasts is one signal.
        starts = drifted[baseline:] & ~drifted[baseline - 1 : -1]
        signals += int(outside[baseline:].sum() + starts.sum())
        seen = np.flatnonzero((outside | drifted)[baseline:])
        lengths.append(seen[0] + 1 if len(seen) else sessions + 1)
    return np.array(lengths), signals / runs / sessions, phase_one / runs


@pytest.mark.parametrize("baseline", [MIN_SESSIONS, 12, BASELINE, 40])
def test_false_alarms_stay_below_the_stated_rate(baseline):
    lengths, rate, phase_one = run_lengths(baseline, 1500, 100, np.random.default_rng((97, baseline)))
    assert rate < FALSE_ALARMS_PER_SESSION
    assert np.median(lengths) > 100, "half of all charts run for two years of weekly sessions without one"
    assert phase_one < FALSE_ALARMS_PER_SESSION * baseline


def test_drift_of_one_sd_a_month_is_found_within_three_months_of_weekly_sessions():
    rng = np.random.default_rng(98)
    lengths, _, _ = run_lengths(BASELINE, 1500, 60, rng, drift=1 / WEEKS_PER_MONTH)
    assert np.median(lengths) <= 11
    assert np.quantile(lengths, 0.95) <= 3.5 * WEEKS_PER_MONTH


def test_outlier_in_the_baseline_does_not_widen_the_limits():
    rng = np.random.default_rng(2)
    value = rng.normal(size=60)
    clean = chart_of(value)
    value[9] += 25.0
    found = chart_of(value)
    assert found.outliers == 1
    assert found.half[-1] == pytest.approx(clean.half[-1], rel=0.15)
    assert found.centre == pytest.approx(clean.centre, abs=0.2)
    assert np.flatnonzero(found.outside).tolist() == [9]
    assert not found.drifted.any(), "one outlier is no drift"


def test_single_outlier_later_is_no_drift_and_a_step_is():
    rng = np.random.default_rng(3)
    value = rng.normal(size=60)
    value[40] += 30.0
    found = chart_of(value)
    assert np.flatnonzero(found.outside).tolist() == [40]
    assert not found.drifted.any()
    value[40] -= 30.0
    value[45:] += 2.0
    assert chart_of(value).drifted[-1]


def test_drift_within_the_baseline_is_found():
    rng = np.random.default_rng(4)
    found = chart_of(rng.normal(size=20) + 0.35 * np.arange(20))
    assert found.in_phase_two == 0
    assert found.unsteady
    assert not found.in_control


def test_steady_baseline_is_rarely_called_unsteady():
    rng = np.random.default_rng(41)
    for sessions in (MIN_SESSIONS, BASELINE):
        found = [chart_of(rng.normal(size=sessions)).unsteady for _ in range(4000)]
        assert np.mean(found) < 0.002


def test_stated_sd_makes_the_limits_where_it_is_larger():
    rng = np.random.default_rng(5)
    value = rng.normal(size=40)
    alone, stated, small = chart_of(value), chart_of(value, 5.0), chart_of(value, 0.01)
    assert stated.by_stated
    assert not small.by_stated
    assert stated.half[-1] == pytest.approx(15.0 * np.sqrt(1 + 1 / 20))
    assert small.half[-1] == alone.half[-1]


def test_sessions_may_state_different_sds():
    value, sd = np.random.default_rng(6).normal(size=30), np.full(30, 0.1)
    sd[25] = 4.0
    found = control_chart(value, sd)
    assert found is not None
    assert found.half[25] == pytest.approx(12.0 * np.sqrt(1.05))
    assert found.half[24] < 6
    assert found.ewma_half[25] > 1.5 * found.ewma_half[24]


@pytest.mark.parametrize("value", [np.arange(7.0), np.full(30, 1.25)])
def test_no_chart_of_too_few_sessions_or_of_equal_values(value):
    assert control_chart(value, NOTHING[: len(value)]) is None


def test_baseline_of_too_few_sessions_is_refused():
    with pytest.raises(ValueError, match="at least 8 sessions, not 7"):
        control_chart(np.arange(30.0), NOTHING[:30], 7)
