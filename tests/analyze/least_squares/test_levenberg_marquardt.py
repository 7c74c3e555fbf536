"""The robust fit against scipy's, and its covariance against the scatter of repeated fits."""

import numpy as np
import pytest
from scipy.optimize import least_squares

from analyze.least_squares.levenberg_marquardt import (
    HUBER_THRESHOLD,
    Ending,
    minimise,
    residual_variance,
    unit_covariance,
)

TIME = np.linspace(0.0, 2.0, 60)
TRUTH = np.array([1.5, 0.8])
SCALE = np.array([0.1, 0.1])
SD = np.full(len(TIME), 0.02)


def decay(x):
    """A exp(-b t), with b positive."""
    value = x[0] * np.exp(-x[1] * TIME)
    return value, np.column_stack([value / x[0], -TIME * value])


def fitted(value, start=(1.0, 2.0)):
    return minimise(value, SD, decay, np.array(start), SCALE)


def test_exact_observations_give_the_exact_parameters():
    assert fitted(decay(TRUTH)[0]).parameters == pytest.approx(TRUTH, abs=1e-9)


def test_with_a_fixed_scale_the_minimum_is_scipys():
    rng = np.random.default_rng(3)
    value = decay(TRUTH)[0] + 0.005 * rng.normal(size=len(TIME))
    value[[7, 30]] += 0.5

    def residual(x):
        return (value - decay(x)[0]) / SD

    expected = least_squares(residual, TRUTH, loss="huber", f_scale=HUBER_THRESHOLD, xtol=1e-14, ftol=1e-14)
    # Noise below the stated sd keeps the scale at 1, scipy's; the stop rule allows a thousandth of a weight.
    assert fitted(value).parameters == pytest.approx(expected.x, abs=1e-5)


def test_outliers_lose_weight():
    value = decay(TRUTH)[0] + 0.02 * np.random.default_rng(4).normal(size=len(TIME))
    value[12] += 1.0
    found = fitted(value)
    assert found.weight[12] < 0.1
    assert np.median(found.weight) == 1.0
    assert found.parameters == pytest.approx(TRUTH, abs=0.02)


def test_the_covariance_is_that_of_repeated_fits():
    rng = np.random.default_rng(5)
    clean = decay(TRUTH)[0]
    fits = [fitted(clean + SD * rng.normal(size=len(TIME)), TRUTH) for _ in range(300)]
    scatter = np.std([fit.parameters for fit in fits], axis=0)
    reported = [
        np.sqrt(np.diag(unit_covariance(fit, SD, SCALE)) * residual_variance(fit, SD)) for fit in fits
    ]
    # 300 draws know a standard deviation to 4 %.
    assert scatter / np.median(reported, axis=0) == pytest.approx(np.ones(2), abs=0.15)


def test_a_parameter_that_must_be_positive_stays_so():
    value = decay(np.array([1.0, 0.05]))[0]
    assert fitted(value, (1.0, 1.0)).parameters[1] > 0.1


def counted(value, start, ending):
    """Result of a fit, and the number of times that it computed the model."""
    calls = 0

    def model(x):
        nonlocal calls
        calls += 1
        return decay(x)

    return minimise(value, SD, model, np.array(start), SCALE, ending=ending), calls


def test_a_fit_ends_at_its_start_if_the_first_step_takes_too_little_away():
    rng = np.random.default_rng(6)
    jumps = decay(TRUTH)[0] + np.where(np.arange(len(TIME)) % 2, 1.0, -1.0)
    strict = Ending(halve_above=2.0 * len(TIME))
    stopped, calls = counted(jumps, TRUTH, strict)
    assert stopped.parameters == pytest.approx(TRUTH)
    assert calls == 2
    noisy = decay(TRUTH)[0] + 0.02 * rng.normal(size=len(TIME))
    found, _ = counted(noisy, (1.6, 1.0), strict)
    assert found.parameters == pytest.approx(fitted(noisy, (1.6, 1.0)).parameters)


def test_small_gains_end_a_fit_close_to_its_minimum():
    value = decay(TRUTH)[0] + 0.02 * np.random.default_rng(7).normal(size=len(TIME))
    whole, most = counted(value, (1.0, 2.0), Ending())
    for ending in (Ending(least_gain=0.1), Ending(least_gain=0.1, damping_kept=2)):
        early, fewer = counted(value, (1.0, 2.0), ending)
        assert fewer <= most
        spread = np.sqrt(np.diag(unit_covariance(whole, SD, SCALE)))
        assert np.abs(early.parameters - whole.parameters).max() < 0.3 * spread.max()
