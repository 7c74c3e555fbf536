"""Fill level from the centres of mass of the poses of a box, whose true ones follow from its dimensions."""

from __future__ import annotations

import numpy as np
import pytest

from analyze.estimation.detection import critical_value, noncentrality
from analyze.estimation.fill_level import KnownDensity
from analyze.estimation.pose_test import PoseCentre
from analyze.estimation.settled_contents import settled_contents
from tests.analyze.simulated_session import carton

FILLED, CONTENTS, MASS = 0.4, 0.11, 0.15


def centres(filled: float, contents: float, sd: float) -> list[PoseCentre]:
    """Centres of mass of a carton upright, upside down and on a side, its shell about its middle."""
    body, found = carton(), []
    inside = body.size - 2 * body.pitch
    for up in np.array([[0.0, 0, 1], [0, 0, -1], [1, 0, 0]]):
        low = 0.5 * (1 - filled) * float(inside @ np.abs(up))
        position = -contents / MASS * low * up
        found.append(PoseCentre("p", up, position, sd**2 * np.eye(3), 0.0))
    return found


def test_filled_share_and_mass_follow_from_the_poses():
    found = settled_contents(centres(FILLED, CONTENTS, 2e-4), carton().cells, MASS, None)
    assert found is not None
    assert found.misfit < 1.0
    assert found.filled.interval[0] <= FILLED <= found.filled.interval[1]
    assert found.mass.interval[0] <= CONTENTS <= found.mass.interval[1]


def test_a_known_density_narrows_both():
    inside = float(carton().cells.interior.sum())
    density = KnownDensity(CONTENTS / FILLED / inside, 0.03 * CONTENTS / FILLED / inside)
    found = settled_contents(centres(FILLED, CONTENTS, 2e-4), carton().cells, MASS, density)
    assert found is not None
    assert found.filled.value == pytest.approx(FILLED, abs=0.04)
    assert found.mass.value == pytest.approx(CONTENTS, rel=0.1)
    assert found.filled.observed


def test_one_pose_shows_no_level():
    assert settled_contents(centres(FILLED, CONTENTS, 2e-4)[:1], carton().cells, MASS, None) is None


def test_noncentrality_is_found_with_the_stated_probability():
    from scipy.stats import ncx2

    for freedom in (1, 4, 12):
        limit = critical_value(freedom)
        assert ncx2.sf(limit, freedom, noncentrality(limit, freedom)) == pytest.approx(0.9, abs=1e-6)
