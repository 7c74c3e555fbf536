"""Inertia's ratios from the rotation in flight of cubes simulated apart (MuJoCo)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from analyze.errors import EstimationError
from analyze.flight.free_flight import Flight
from analyze.flight.free_rotation import fit_rotations, tensor_ratios
from analyze.motion.body_motion import BodyMotion
from analyze.motion.moment_balance import tensor
from analyze.reproduce.cube_tosses import flights
from tests.analyze.flight.tossed_cube import Cube, tossed

CUBE = Cube(np.array([0.0, 0.001, 0.006]), np.array([1.0, 0.93, 0.85]) * 1e-3)
TURN = Rotation.from_rotvec([0.5, -0.8, 0.3]).as_matrix()


def flown(tosses: int, noise_rad: float = 0.0, seed: int = 3) -> list[Flight]:
    """Flights in a frame that is turned against the principal axes by TURN."""
    # The table is found by the cube's corners, in its own frame.
    straight = flights(tossed(CUBE, tosses, seed, "air", noise_rad=noise_rad))
    return [
        replace(each, motion=replace(each.motion, R_world_object=each.motion.R_world_object @ TURN))
        for each in straight
    ]


TRUTH = tensor_ratios(TURN.T @ np.diag(CUBE.moments) @ TURN)


def test_exact_flights_give_the_tensor() -> None:
    found = fit_rotations(flown(12))
    assert found.ratios == pytest.approx(TRUTH, abs=2e-4)
    assert np.trace(tensor(found.ratios)) == pytest.approx(3.0)
    assert found.residual < 1e-4


def test_errors_are_as_stated() -> None:
    """Standard deviation, and coverage of the 95 % intervals, over repeated sets of throws."""
    off = []
    for seed in range(8):
        found = fit_rotations(flown(16, noise_rad=1e-3, seed=20 + seed))
        off.append((found.ratios - TRUTH) / found.half_width)
    off = np.array(off)
    assert np.mean(np.abs(off) < 1) >= 0.88
    assert np.sqrt(np.mean(off**2)) > 0.25, "the intervals are far too wide"


def test_too_few_throws_are_refused() -> None:
    with pytest.raises(EstimationError, match="8 are the least"):
        fit_rotations(flown(6))


def test_flights_about_one_axis_are_refused() -> None:
    time = np.arange(20) / 148.0
    R = Rotation.from_rotvec(np.outer(time, [0.0, 0.0, 12.0])).as_matrix()
    still = [Flight(BodyMotion(time, np.zeros((20, 3)), R), number) for number in range(10)]
    with pytest.raises(EstimationError, match="do not determine"):
        fit_rotations(still)
