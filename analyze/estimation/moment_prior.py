"""Prior of the inertia tensor per kilogram: from the shape, and from flights where there are some."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from analyze.estimation.joint_model import COM, SECOND
from analyze.geometry.second_moments import scale_free, symmetric_entries, unit_inertia
from analyze.types import Array, FlightEstimate


@dataclass(frozen=True)
class UnitPrior:
    """Prior of the inertia tensor per kilogram, from the shape: mean and sd of each entry [m^2].

    The tensor is about the centre of mass, along the axes of the object frame O.
    """

    mean: Array
    """(3, 3) mean [m^2]."""
    sd: Array
    """(3, 3) 1 sigma of each entry [m^2]."""
    flight: FlightEstimate | None = None
    """Centre of mass and shape of the tensor by the body's flights; None without any."""


MomentPrior = Callable[[Array], UnitPrior]
"""Prior of the inertia per kilogram as a function of c (3,) [m, in O]."""


def widened(prior: MomentPrior, factor: float) -> MomentPrior:
    """Prior of the inertia per kilogram with `factor` times its standard deviations."""

    def wide(com: Array) -> UnitPrior:
        shape = prior(com)
        return replace(shape, sd=factor * shape.sd)

    return wide


def with_flight(prior: MomentPrior, flight: FlightEstimate) -> MomentPrior:
    """Prior of the inertia per kilogram that also contains what a body's flights determine."""

    def both(com: Array) -> UnitPrior:
        return replace(prior(com), flight=flight)

    return both


def shape_rows(shape: UnitPrior, x: Array) -> tuple[Array, Array]:
    """Differences (6,) of the inertia per kilogram from its prior by the shape, in sd, and their derivatives.

    The entries of the tensor are in the order xx, yy, zz, xy, xz, yz; the derivatives by the unknowns `x` are
    (6, count). With flights eight rows follow: the differences of c and of the tensor's shape from the
    flights', multiplied so that they are independent and have unit sd.
    """
    J, by = unit_inertia(x[SECOND])
    sd = symmetric_entries(shape.sd)
    rows = np.zeros((6, len(x)))
    rows[:, SECOND] = symmetric_entries(by).T / sd[:, None]
    off = symmetric_entries(J - shape.mean) / sd
    if shape.flight is None:
        return off, rows
    numbers, by_second = scale_free(x[SECOND])
    flown = np.zeros((8, len(x)))
    flown[:3, COM], flown[3:, SECOND] = np.eye(3), by_second
    whiten = np.linalg.cholesky(np.linalg.inv(shape.flight.covariance)).T
    apart = np.concatenate([x[COM], numbers]) - shape.flight.mean
    return np.concatenate([off, whiten @ apart]), np.concatenate([rows, whiten @ flown])
