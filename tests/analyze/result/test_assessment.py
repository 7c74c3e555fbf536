"""Sentences of the verdict on the region masses."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from analyze.result.assessment import regions_text

NAMES = ("shell", "upper", "lower")


def masses(half, explained=True):
    """Regions of 100 g in total, with the shell known to ± `half` g (95 %)."""
    intervals = 1e-3 * np.array([[50.0 - half, 50.0 + half], [20.0, 22.0], [28.0, 30.0]])
    return SimpleNamespace(
        names=NAMES,
        intervals=intervals,
        limits=1e-3 * np.array([[10.0, 90.0], [0.0, 40.0], [0.0, 50.0]]),
        explained=explained,
    )


@pytest.mark.parametrize(
    ("half", "said"),
    [
        (
            4.0,
            (
                "trust the region masses, if the object is a uniform shell with two uniform parts: the"
                " least certain, shell, to ± 4 g, 4 % of the total"
            ),
        ),
        (
            20.0,
            (
                "doubt the region masses: they are known only roughly (the least certain, shell, to ± 20 g,"
                " 20 % of the total): strike about more axes"
            ),
        ),
        (
            40.0,
            (
                "doubt the region masses: the moments do not determine them: shell 10 to 90 g, upper 20 to 22"
                " g, lower 28 to 30 g"
            ),
        ),
    ],
)
def test_region_masses_are_trusted_or_doubted_by_their_intervals(half, said):
    assert regions_text(masses(half), 0.1) == said


def test_unexplained_moments_are_doubted_even_with_narrow_intervals():
    said = regions_text(masses(1.0, explained=False), 0.1)
    assert said.startswith("doubt the region masses: no uniform shell")
    assert said.endswith("shell 10 to 90 g, upper 0 to 40 g, lower 0 to 50 g")


def test_ranges_that_span_the_whole_mass_are_said_to_determine_nothing():
    whole = masses(40.0)
    whole.intervals = whole.limits = 1e-3 * np.array([[0.0, 95.0], [0.0, 90.0], [2.0, 99.0]])
    assert regions_text(whole, 0.1).startswith("not determined are the region masses")
    whole.explained = False
    assert regions_text(whole, 0.1).startswith("not determined are the region masses")
