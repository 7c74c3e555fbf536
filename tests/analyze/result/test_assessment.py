"""Sentences of the verdict on the region masses."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from analyze.result.assessment import regions_text

NAMES = ("shell", "upper", "lower")


def masses(half, explained=True, lump=False):
    """Regions of 100 g in total, with the shell known to ± `half` g (95 %)."""
    intervals = 1e-3 * np.array([[50.0 - half, 50.0 + half], [20.0, 22.0], [28.0, 30.0]])
    return SimpleNamespace(
        names=NAMES,
        intervals=intervals,
        limits=1e-3 * np.array([[10.0, 90.0], [0.0, 40.0], [0.0, 50.0]]),
        explained=explained,
        two_parts_explain=explained,
        lump_explains=lump,
    )


@pytest.mark.parametrize(
    ("half", "said"),
    [
        (
            4.0,
            (
                "trust the region masses on either side of the dividing plane, if the object is a uniform"
                " shell with two uniform parts: the least certain, shell, to ± 4 g, 4 % of the total"
            ),
        ),
        (
            20.0,
            (
                "not determined: region masses on either side of the dividing plane, if the object is a"
                " uniform shell with two uniform parts, more closely than shell 30 to 70 g, upper 20 to 22 g,"
                " lower 28 to 30 g; strike about more axes"
            ),
        ),
    ],
)
def test_region_masses_are_trusted_or_not_determined_by_their_intervals(half, said):
    assert regions_text(masses(half), 0.1) == said


def test_a_lump_that_has_the_moments_as_well_is_named():
    both = regions_text(masses(4.0, lump=True), 0.1)
    assert "a uniform shell with two uniform parts or one lump (or void): the least certain" in both


def test_unexplained_moments_determine_no_masses_even_with_narrow_intervals():
    said = regions_text(masses(1.0, explained=False), 0.1)
    assert said.startswith("not determined: region masses: no uniform shell")
    assert said.endswith("shell 10 to 90 g, upper 0 to 40 g, lower 0 to 50 g")


def test_ranges_that_span_the_whole_mass_are_said_to_determine_nothing():
    whole = masses(40.0)
    whole.intervals = whole.limits = 1e-3 * np.array([[0.0, 95.0], [0.0, 90.0], [2.0, 99.0]])
    assert regions_text(whole, 0.1).startswith("not determined: region masses")
    whole.explained = False
    assert regions_text(whole, 0.1).startswith("not determined: region masses")
