"""c and I of a simulated cube that slides, rolls and flies: from the moment balance, and from flight."""

from __future__ import annotations

import numpy as np
import pytest

from analyze.errors import EstimationError
from analyze.flight.free_flight import Flight, fit_flights
from analyze.motion.moment_balance import balance_moments
from analyze.reproduce.cube_tosses import corner_contacts, edge_contacts, flights
from tests.analyze.flight.tossed_cube import MASS, Cube, G, tossed

CUBE = Cube(np.array([0.001, -0.002, 0.006]), np.array([1.0, 0.95, 0.9]) * 1e-3)
TOUCHING = {"edge": edge_contacts, "corner": corner_contacts}
SHARP = (1e-4, 2e-4)
POSE_NOISE = {"noise_m": 5e-5, "noise_rad": 2e-4}


def balanced(cube, start, count, rounding=SHARP, **noise):
    return balance_moments(TOUCHING[start](tossed(cube, count, 1, start, **noise)), G, rounding)


@pytest.mark.parametrize("friction", [0.05, 0.25, 0.8])
def test_an_edge_that_slides_shows_c_and_i_whatever_the_friction(friction):
    found = balanced(Cube(CUBE.com, CUBE.moments, friction), "edge", 24)
    assert found.com == pytest.approx(CUBE.com, abs=3e-5)
    assert MASS * np.diag(found.inertia) == pytest.approx(CUBE.moments, rel=0.005)


def test_a_sliding_corner_shows_c_and_inertia():
    found = balanced(CUBE, "corner", 60)
    assert found.com == pytest.approx(CUBE.com, abs=5e-5)
    assert MASS * np.diag(found.inertia) == pytest.approx(CUBE.moments, rel=0.01)


def test_the_rounding_of_the_edges_is_found():
    """Taken as sharp, the rounded edges put c 0.4 mm off, which is checked too."""
    rounded = Cube(CUBE.com, CUBE.moments, rounding=0.004)
    found = balanced(rounded, "edge", 24, rounding=(0.002, 0.002))
    assert found.rounding == pytest.approx(0.004, abs=2e-4)
    assert found.com == pytest.approx(CUBE.com, abs=1e-4)
    assert MASS * np.diag(found.inertia) == pytest.approx(CUBE.moments, rel=0.01)
    sharp = balanced(rounded, "edge", 24, rounding=(1e-6, 1e-6))
    assert np.linalg.norm(sharp.com - CUBE.com) > 3e-4


def test_with_noisy_poses_the_errors_are_as_stated():
    found = balanced(CUBE, "edge", 50, **POSE_NOISE)
    assert np.all(np.abs(found.com - CUBE.com) < 3 * found.com_sd)
    assert np.all(found.com_sd < 1e-4)
    error = MASS * np.diag(found.inertia) - CUBE.moments
    assert np.all(np.abs(error) < 3 * MASS * np.diag(found.inertia_sd) + 0.005 * CUBE.moments)


def test_flight_shows_c_and_g():
    found = fit_flights(flights(tossed(CUBE, 12, 2)), 0.0)
    assert found.com == pytest.approx(CUBE.com, abs=1e-6)
    assert found.gravity == pytest.approx(G, abs=1e-5)


def test_flight_with_noisy_poses_errs_as_stated_though_one_throw_is_still_held():
    motions = tossed(CUBE, 40, 3, **POSE_NOISE)
    flown = flights(motions)
    held = flown[0].motion
    pulled = held.position + 0.5 * 3.0 * (held.time - held.time[0])[:, None] ** 2
    flown[0] = Flight(type(held)(held.time, pulled, held.R_world_object), flown[0].group)
    found = fit_flights(flown, 0.0)
    assert np.all(np.abs(found.com - CUBE.com) < 4 * found.com_sd)
    assert np.all(found.com_sd < 1e-4)
    assert abs(found.gravity - G) < 4 * found.gravity_sd


def test_sixteen_flights_err_as_stated():
    held = []
    for seed in range(3):
        found = fit_flights(flights(tossed(CUBE, 16, 90 + seed, **POSE_NOISE)), 0.0)
        held.append(np.abs(np.append(found.com - CUBE.com, found.gravity - G)) < found.half_width)
    assert np.mean(held) >= 0.9


def test_nine_throws_do_not_support_ten_unknowns():
    with pytest.raises(EstimationError, match="of 9 throws are too few"):
        balanced(CUBE, "edge", 9)


def test_too_few_contacts_are_refused():
    with pytest.raises(EstimationError, match="too few"):
        balance_moments([], G, SHARP)
    with pytest.raises(EstimationError, match="8 are the least"):
        fit_flights(flights(tossed(CUBE, 2, 1)), 0.0)
