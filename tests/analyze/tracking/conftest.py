"""The rig's camera, and frames of it with tags of known corners."""

import numpy as np
import pytest

from analyze.types import CameraModel


@pytest.fixture
def camera():
    K = np.array([[1430.0, 0, 327.5], [0, 1430.0, 245.5], [0, 0, 1]])
    return CameraModel(656, 492, K, np.array([-0.12, 0.05, 3e-4, -2e-4, 0.0]), np.eye(4))


@pytest.fixture
def rng():
    return np.random.default_rng(1)
