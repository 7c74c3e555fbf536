"""Covariance of fits to few groups of correlated residuals: coverage of the intervals."""

from __future__ import annotations

import numpy as np
import pytest

from analyze.least_squares.grouped_errors import group_freedom, grouped_covariance, jackknife_covariance
from analyze.least_squares.intervals import pooled_freedom, student_sigmas_95


@pytest.mark.parametrize("groups", [6, 12, 40])
def test_intervals_of_few_groups_hold_as_stated(groups):
    """A line through points whose residuals share most of their error within a group."""
    rng = np.random.default_rng(groups)
    held, held_normal, held_jackknife = [], [], []
    for _ in range(400):
        x = np.repeat(rng.normal(size=groups), 5) + 0.3 * rng.normal(size=5 * groups)
        J = np.column_stack([np.ones(len(x)), x])
        y = np.repeat(rng.normal(size=groups), 5) + 0.5 * rng.normal(size=len(x))
        member = np.repeat(np.arange(groups), 5)
        normals = np.array([J[member == g].T @ J[member == g] for g in range(groups)])
        normal = normals.sum(axis=0)
        right = np.array([J[member == g].T @ y[member == g] for g in range(groups)])
        found = np.linalg.solve(normal, right.sum(axis=0))
        scores = right - normals @ found
        inverse = np.linalg.inv(normal)
        factor = student_sigmas_95(group_freedom(inverse, normals))
        sd = np.sqrt(np.diag(grouped_covariance(normal, normals, scores)))
        without = np.linalg.solve(normal - normals, (right.sum(axis=0) - right)[..., None])[..., 0]
        uncorrected = np.sqrt(np.diag(inverse @ scores.T @ scores @ inverse))
        held.append(np.abs(found) < factor * sd)
        held_jackknife.append(np.abs(found) < factor * np.sqrt(np.diag(jackknife_covariance(without))))
        held_normal.append(np.abs(found) < 1.96 * uncorrected)
    # 400 draws: a coverage has an error of 1 %.
    assert np.all(np.mean(held, axis=0) > 0.92)
    assert np.all(np.mean(held, axis=0) < 0.985)
    assert np.all(np.mean(held_jackknife, axis=0) > 0.93)
    if groups == 6:
        assert np.mean(held_normal) < 0.88


def test_the_degrees_of_freedom_are_those_of_equal_groups_or_of_the_one_that_decides():
    equal = np.tile(np.eye(2), (9, 1, 1))
    assert group_freedom(np.eye(2) / 9, equal) == pytest.approx(8)
    one = equal.copy()
    one[0] *= 1e6
    assert group_freedom(np.eye(2) / 1e6, one) == pytest.approx(1)


def test_a_known_variance_adds_no_doubt():
    assert student_sigmas_95(np.array([np.inf, 4.0])) == pytest.approx([1.96, 2.776], abs=1e-3)
    freedom = pooled_freedom(np.array([[1.0], [3.0]]), np.array([[5.0], [np.inf]]))
    assert freedom == pytest.approx(5 * 16)
