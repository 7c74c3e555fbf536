"""Points at which the centre of mass is held: they span its distribution, whatever the directions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from analyze.estimation.profile_walk import ProfilePoint, walk
from analyze.types import Array

SDS = np.array([3.0e-3, 4.5e-3])


@dataclass(frozen=True)
class NormalCom:
    """Normal distribution of c about 0, in the place of all strikes; does not model anything but c."""

    covariance: Array
    """(3, 3) covariance of c [m^2]"""

    def inside(self, x: Array) -> bool:
        return bool(np.all(np.abs(x) < 1.0))

    def solved(self, x: Array, directions: Array, values: Array) -> ProfilePoint:
        across = self.covariance @ directions.T
        held = directions @ across
        slopes = np.linalg.solve(held, across.T)
        return ProfilePoint(
            values @ slopes,
            self.covariance - across @ slopes,
            -0.5 * float(values @ np.linalg.solve(held, values)),
            np.asarray(slopes, dtype=np.float64),
        )


@pytest.mark.parametrize("correlation", [0.0, 0.9, -0.97, 0.995])
def test_grid_over_two_directions_has_the_covariance_of_c(correlation):
    """Held along both directions at once, the walk gave 0.4 of the sd at a correlation of 0.97."""
    root = np.array([[1.0, 0.0], [correlation, np.sqrt(1 - correlation**2)]]) * SDS[:, None]
    covariance = np.diag([0.0, 0.0, 1e-8])
    covariance[:2, :2] = root @ root.T
    points = walk(NormalCom(covariance), np.eye(3)[:2], SDS, np.zeros(3), 7)
    weight = np.array([np.exp(point.log_density) * np.prod(part) for point, part in points])
    places = np.array([point.x[:2] for point, _ in points])
    mean = weight @ places / weight.sum()
    found = (places - mean).T @ ((places - mean) * weight[:, None]) / weight.sum()
    assert mean == pytest.approx(np.zeros(2), abs=2e-4)
    assert np.sqrt(np.diag(found)) == pytest.approx(SDS, rel=0.12)
    assert found[0, 1] / np.sqrt(found[0, 0] * found[1, 1]) == pytest.approx(correlation, abs=0.05)
