"""Truncated normal distributions compared with sums over a fine grid, and far out in their tails."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import log_ndtr

from analyze.estimation.truncated_normal import (
    EMPTY_PART_PRIOR,
    draw_truncated,
    log_normal_mass,
    share_distribution,
    shortest_intervals,
)

CASES = {
    "inside": ((0.3, 0.3), ((100.0, 20.0), (20.0, 60.0))),
    "beyond a side": ((-0.5, 0.3), ((100.0, 20.0), (20.0, 60.0))),
    "far beyond a corner": ((2.0, -3.0), ((3.0, 0.2), (0.2, 5.0))),
    "a thin valley": ((0.3, 0.3), ((1e5, 9e4), (9e4, 1e5))),
}


def on_a_grid(mean, precision, n=1500):
    """Distribution of two shares by sums over a fine grid: of their triangle and its two sides.

    Returns:
        Log integral of prior times likelihood; means (2,) and sd (2,) of the shares; probabilities of the
        two sides, on which the second or the third share is 0.
    """
    places = (np.arange(n) + 0.5) / n
    u, v = (grid.ravel() for grid in np.meshgrid(places, places, indexing="ij"))
    inside = u + v < 1
    u, v = np.concatenate([u[inside], places, places]), np.concatenate([v[inside], 0 * places, 1 - places])
    kind = np.concatenate([0 * u[: inside.sum()], 0 * places + 1, 0 * places + 2])
    prior = np.choose(
        kind.astype(int),
        [2 * (1 - sum(EMPTY_PART_PRIOR)) / n**2, EMPTY_PART_PRIOR[0] / n, EMPTY_PART_PRIOR[1] / n],
    )
    off = np.stack([u - mean[0], v - mean[1]], axis=-1)
    exponent = -0.5 * np.einsum("...i,ij,...j", off, np.array(precision), off)
    weight = prior * np.exp(exponent - exponent.max())
    mass = float(exponent.max() + np.log(weight.sum()))
    weight /= weight.sum()
    middle = np.array([(weight * u).sum(), (weight * v).sum()])
    sd = np.sqrt([(weight * (u - middle[0]) ** 2).sum(), (weight * (v - middle[1]) ** 2).sum()])
    return mass, middle, sd, [weight[kind == 1].sum(), weight[kind == 2].sum()]


@pytest.mark.parametrize("case", CASES)
def test_mass_and_draws_agree_with_the_grid(case):
    mean, precision = CASES[case]
    mass, middle, sd, empty = on_a_grid(mean, precision)
    found = share_distribution(np.tile(mean, (20_000, 1)), np.tile(precision, (20_000, 1, 1)))
    assert found.log_mass[0] == pytest.approx(mass, abs=0.05)
    draws = found.draw(np.random.default_rng(1))
    assert draws.sum(axis=1) == pytest.approx(np.ones(len(draws)))
    assert draws.min() >= 0
    assert draws[:, :2].mean(axis=0) == pytest.approx(middle, abs=0.05 * sd.max())
    assert draws[:, :2].std(axis=0) == pytest.approx(sd, rel=0.05)
    assert (draws[:, 1:] == 0).mean(axis=0) == pytest.approx(empty, abs=0.015)


def test_draws_keep_a_width_forty_sigmas_beyond_the_bounds():
    """Almost all probability is in the corner of shell only, yet the draws must keep a width."""
    found = share_distribution(np.array([[1.5, -0.6]]), np.array([[[6e3, 2e3], [2e3, 6e3]]])).draw(
        np.random.default_rng(2)
    )
    many = share_distribution(
        np.tile([1.5, -0.6], (3000, 1)), np.tile([[6e3, 2e3], [2e3, 6e3]], (3000, 1, 1))
    ).draw(np.random.default_rng(2))
    assert np.isfinite(found).all()
    assert many.min() >= 0
    assert (many.std(axis=0) > 1e-5).all()


def test_draws_of_a_far_tail_are_nearly_exponential():
    rng = np.random.default_rng(3)
    zeros = np.zeros(20_000)
    far = draw_truncated(zeros, zeros + 1.0, zeros + 50.0, zeros + 60.0, rng) - 50.0
    assert far.mean() == pytest.approx(1 / 50, rel=0.03)
    assert far.std() == pytest.approx(1 / 50, rel=0.05)


def test_log_normal_mass_is_precise_in_the_tails():
    low, high = np.array([-1.0, 38.0, -60.0]), np.array([1.0, 39.0, -50.0])
    expected = [np.log(0.6826894921), log_ndtr(-38.0), log_ndtr(-50.0)]
    assert log_normal_mass(low, high) == pytest.approx(np.array(expected), rel=1e-9)


def test_shortest_interval_begins_at_the_bound_if_draws_concentrate_there():
    rng = np.random.default_rng(4)
    draws = np.column_stack([rng.exponential(1.0, 4000), rng.normal(10.0, 1.0, 4000)])
    low, high = shortest_intervals(draws, 0.0)
    assert low[0] == 0.0
    assert high[0] == pytest.approx(3.0, rel=0.06)
    assert (low[1], high[1]) == pytest.approx((8.04, 11.96), abs=0.25)
