"""What the verdict says of the region masses."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from analyze.result.assessment import regions_text

NAMES = ("shell", "upper", "lower")


def masses(half, explained=True):
    """Regions of 100 g whose shell is known to ± `half` grams."""
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
            "trust the region masses, if the object is a uniform shell with two uniform parts: ± 4 g of the shell at most, 4 % of the total",
        ),
        (
            20.0,
            "doubt the region masses: they are known only roughly, ± 20 g of the shell at most, 20 % of the total; strikes about more axes narrow them",
        ),
        (
            40.0,
            "doubt the region masses: the moments do not determine them: shell 10 to 90 g, upper 20 to 22 g, lower 28 to 30 g",
        ),
    ],
)
def test_as_far_as_their_intervals_reach(half, said):
    assert regions_text(masses(half), 0.1) == said


def test_a_body_of_another_kind_is_doubted_however_narrow_they_are():
    said = regions_text(masses(1.0, explained=False), 0.1)
    assert said.startswith("doubt the region masses: no uniform shell")
    assert said.endswith("shell 10 to 90 g, upper 0 to 40 g, lower 0 to 50 g")
