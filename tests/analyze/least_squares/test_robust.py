"""Robust weights and scale, and the correlation of residuals, on known distributions."""

import numpy as np
import pytest

from analyze.least_squares.robust import correlation_factor, huber_weights, lag_one_correlation, median_scale


def test_the_median_scale_is_a_normal_distributions_sd():
    values = 3.0 * np.random.default_rng(1).normal(size=20_000)
    assert median_scale(values) == pytest.approx(3.0, rel=0.02)
    values[:2000] = 1e6
    assert median_scale(values) == pytest.approx(3.0, rel=0.2), "a tenth of outliers hardly changes it"


def test_huber_weights_fall_with_the_distance_beyond_the_threshold():
    weights = huber_weights(np.array([0.0, 1.0, -2.0, 4.0, -8.0]), 2.0)
    assert weights == pytest.approx([1.0, 1.0, 1.0, 0.5, 0.25])
    assert huber_weights(np.array([8.0]), 2.0, scale=2.0) == pytest.approx([0.5])


@pytest.mark.parametrize("correlation", [0.3, 0.6])
def test_the_correlation_of_an_autoregressive_series_is_found(correlation):
    noise = np.random.default_rng(2).normal(size=20_000)
    series = np.zeros_like(noise)
    for i in range(1, len(noise)):
        series[i] = correlation * series[i - 1] + noise[i]
    assert lag_one_correlation(series) == pytest.approx(correlation, abs=0.02)
    assert correlation_factor(series) == pytest.approx((1 + correlation) / (1 - correlation), rel=0.1)


def test_white_noise_and_short_alternation_are_no_correlation():
    assert correlation_factor(np.random.default_rng(3).normal(size=400)) == 1.0
    assert lag_one_correlation(np.array([1.0, -1.0] * 20)) == 0.0


def test_the_correlation_is_limited_to_nine_tenths():
    assert lag_one_correlation(np.linspace(1.0, 2.0, 500)) == 0.9
