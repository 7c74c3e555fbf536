"""Gauss-Newton on a state that is no vector: a rotation that maps points onto each other."""

import numpy as np
from scipy.spatial.transform import Rotation

from analyze.least_squares.gauss_newton import Linearised, gauss_newton

TRUTH = Rotation.from_rotvec([0.2, -0.1, 0.3])


def turned(rotation, step):
    return Rotation.from_rotvec(step) * rotation


def linearised_on(points, seen):
    def linearise(rotation):
        expected = rotation.apply(points)
        by_turn = [np.cross(axis, expected) for axis in np.eye(3)]
        return Linearised((seen - expected).ravel(), np.stack(by_turn, axis=-1).reshape(-1, 3))

    return linearise


def test_it_finds_a_rotation():
    points = np.random.default_rng(1).normal(size=(10, 3))
    linearise = linearised_on(points, TRUTH.apply(points))
    found = gauss_newton(Rotation.identity(), linearise, turned, 20, 1e-12)
    np.testing.assert_allclose(found.as_matrix(), TRUTH.as_matrix(), atol=1e-14)


def test_it_takes_no_more_steps_than_allowed():
    points = np.random.default_rng(1).normal(size=(10, 3))
    linearise = linearised_on(points, TRUTH.apply(points))
    calls = []

    def counted(rotation):
        calls.append(1)
        return linearise(rotation)

    gauss_newton(Rotation.identity(), counted, turned, 2, 1e-12)
    assert len(calls) == 2
