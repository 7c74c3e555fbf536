"""Statistics of ISO 5725 compared with its tables and with a simulated population."""

from __future__ import annotations

import numpy as np
import pytest

from analyze.estimation.precision import mandel_h, mandel_h_limit, precision


@pytest.mark.parametrize(
    ("groups", "five_percent", "one_percent"), [(3, 1.15, 1.15), (5, 1.57, 1.72), (10, 1.80, 2.18)]
)
def test_limits_of_mandels_h_are_those_of_the_standard(groups, five_percent, one_percent):
    """ISO 5725-2:1994, tables 6 and 7."""
    assert mandel_h_limit(groups, 0.05) == pytest.approx(five_percent, abs=0.006)
    assert mandel_h_limit(groups, 0.01) == pytest.approx(one_percent, abs=0.006)


def test_groups_of_equal_size_by_plain_analysis_of_variance():
    groups = [[1.0, 1.2], [1.5, 1.7], [0.9, 0.9]]
    found = precision(groups)
    assert found.s_r == pytest.approx(np.sqrt((0.02 + 0.02 + 0.0) / 3))
    s_d2 = 2 * np.var([1.1, 1.6, 0.9], ddof=1)
    assert found.s_L == pytest.approx(np.sqrt((s_d2 - found.s_r**2) / 2))
    assert found.s_R == pytest.approx(np.hypot(found.s_L, found.s_r))
    assert (found.freedom_r, found.freedom_R) == (3, 2)


def test_standard_deviations_of_a_simulated_population():
    rng = np.random.default_rng(1)
    groups = [rng.normal(5 + rng.normal(0, 0.3), 0.1, size).tolist() for size in rng.integers(2, 5, 400)]
    found = precision(groups)
    assert found.mean == pytest.approx(5, abs=0.06)
    assert found.s_r == pytest.approx(0.1, rel=0.1)
    assert found.s_L == pytest.approx(0.3, rel=0.1)
    assert found.s_R == pytest.approx(np.hypot(0.3, 0.1), rel=0.1)


def test_undetermined_quantities_are_none():
    one = precision([[1.0, 1.1, 0.9]])
    assert one.s_r == pytest.approx(0.1)
    assert one.s_R is None
    single = precision([[1.0], [1.2], [1.1]])
    assert single.s_r is None
    assert single.s_R == pytest.approx(0.1)
    assert precision([[1.0], [2.0]]).s_R == pytest.approx(np.sqrt(0.5))
    assert precision([[1.0]]).s_R is None


def test_groups_closer_than_their_scatter_have_no_variance_between_them():
    found = precision([[1.0, 2.0], [1.2, 1.8], [1.1, 1.9]])
    assert found.s_L == 0
    assert found.s_R == found.s_r


def test_h_of_an_outlying_group_exceeds_the_limit():
    h = mandel_h([1.0, 1.01, 0.99, 1.0, 2.0])
    assert h is not None
    assert int(np.argmax(np.abs(h))) == 4
    assert abs(h[4]) > mandel_h_limit(5)
    assert mandel_h([1.0, 2.0]) is None
    assert mandel_h([1.0, 1.0, 1.0]) is None
