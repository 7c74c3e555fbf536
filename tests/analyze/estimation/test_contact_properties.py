"""Friction and restitution combined over strikes."""

from dataclasses import replace

import numpy as np
import pytest

from analyze.estimation.contact_properties import (
    LandingRestitution,
    StrikeFriction,
    combined_friction,
    combined_restitution,
    combined_rolling,
    held_evidence,
)

GRID = np.geomspace(0.05, 2.0, 800)


def slid(value: float, sd: float, number: int = 1) -> StrikeFriction:
    return StrikeFriction(f"s{number}.1", GRID, ((GRID - value) / sd) ** 2, 2e-3, None, None)


def held(ratio: float, number: int = 1) -> StrikeFriction:
    return StrikeFriction(f"s{number}.1", *held_evidence(ratio, 0.003), 0.0, ratio, 0.003)


def landing(value: float, number: int, upper: float | None = None) -> LandingRestitution:
    return LandingRestitution(f"s{number}.1", value, 0.005, upper, 1.4, 9.0, -3.0)


def test_strikes_that_held_give_a_bound_and_no_value():
    found = combined_friction([held(0.21), held(0.28, 2), held(0.25, 3)], 1e-3)
    assert (found.value, found.interval, found.sd) == (None, None, None)
    assert found.bound == pytest.approx(0.275, abs=0.006)


def test_strikes_that_slid_give_a_value_with_the_error_that_they_share():
    found = combined_friction([slid(0.301, 0.004), slid(0.298, 0.004, 2), slid(0.30, 0.004, 3)], 1e-3)
    assert found.value == pytest.approx(0.30, abs=0.002)
    low, high = found.interval
    assert low < 0.3 < high
    # Two and a half per cent of lens and contact, however many strikes there are.
    assert 0.006 < found.sd < 0.012
    assert found.scatter < 0.02


def test_a_creep_of_tenths_of_a_millimetre_is_no_slide():
    found = combined_friction([replace(slid(0.38, 0.01), slid=2e-4)], 1e-3)
    assert found.value is None
    assert found.bound == pytest.approx(0.36, abs=0.01)


def test_scatter_between_strikes_widens_the_interval():
    scattered = [slid(0.24, 0.003), slid(0.30, 0.003, 2), slid(0.36, 0.003, 3)]
    wide, narrow = combined_friction(scattered, 1e-3), combined_friction([slid(0.3, 0.003)] * 3, 1e-3)
    assert wide.sd > 2 * narrow.sd
    assert wide.scatter > 0.06


def test_a_bound_above_a_poor_value_counts():
    found = combined_friction([slid(0.30, 0.05), held(0.33, 2)], 1e-3)
    assert found.interval[0] > 0.31


def test_a_tilted_table_is_in_the_error_of_friction():
    level, tilted = (combined_friction([slid(0.3, 0.002)], sd) for sd in (1e-4, 0.03))
    assert tilted.sd > 2 * level.sd


def test_no_strikes_give_nothing():
    assert combined_friction([], 1e-3) is None
    assert combined_restitution([]) is None
    assert combined_rolling([]) is None


def test_restitution_is_a_distribution():
    values = (0.36, 0.42, 0.38, 0.45, 0.40)
    found = combined_restitution([landing(value, i) for i, value in enumerate(values)])
    assert found.mean == pytest.approx(np.mean(values), abs=1e-3)
    assert found.scatter == pytest.approx(np.std(values, ddof=1), rel=0.1)
    assert found.interval[0] < found.mean < found.interval[1]
    assert combined_restitution([landing(0.4, 1)]).scatter is None


def test_rolling_resistance_is_the_weighted_mean():
    found = combined_rolling([(1e-4, 1e-4), (3e-4, 1e-4)])
    assert found.arm == pytest.approx(2e-4)
    assert found.strikes == 2
