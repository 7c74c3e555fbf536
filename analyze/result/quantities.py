"""Quantities of the Result document: values with units, standard deviations and 95 % intervals."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from analyze.geometry.second_moments import symmetric_matrix
from analyze.least_squares.intervals import SIGMAS_95
from schemas.quantity import Quantity

if TYPE_CHECKING:
    from analyze.estimation.mass_properties import CentreOfMass, InertialParameters
    from analyze.types import Array, MotionFit


def quantity(
    value: float,
    sd: float,
    unit: str,
    lowest: float | None = None,
    interval: tuple[float, float] | None = None,
) -> Quantity:
    """Scalar in the Result's form, marked as observed, with its 95 % interval, by default value ± 1.96 sd.

    Args:
        value: value in `unit`.
        sd: standard deviation of the value.
        unit: name of the unit.
        lowest: bound below which the interval is cut, as 0 for a moment of inertia; None for no bound.
        interval: 95 % interval in `unit`; None for value ± 1.96 sd.
    """
    low, high = interval or (value - SIGMAS_95 * sd, value + SIGMAS_95 * sd)
    return Quantity(
        value=value,
        sd=sd,
        unit=unit,
        interval95=[low if lowest is None else max(low, lowest), high],
        observed=True,
    )


def com_quantity(com: CentreOfMass) -> Quantity:
    """Centre of mass (3,) [m] in the Result's form, with 95 % intervals and covariance (3, 3) [m²].

    The frame is the object frame O. The entry for the unobserved direction is None if the strikes determine
    all three coordinates.
    """
    sd = np.sqrt(np.diag(com.covariance))
    return Quantity(
        value=com.position.tolist(),
        unit="m",
        sd=sd.tolist(),
        covariance=com.covariance.tolist(),
        interval95=intervals95(com.position, sd) if com.intervals is None else com.intervals.tolist(),
        frame="O",
        observed=com.observed,
        unobserved_direction=(
            None if com.unobserved_direction is None else com.unobserved_direction.tolist()
        ),
    )


def inertia_quantity(parameters: InertialParameters) -> Quantity:
    """Inertia tensor (3, 3) [kg m²] in the Result's form, with standard deviations and 95 % intervals.

    It is about the centre of mass, with the axes of the object frame O. Standard deviations and intervals are
    listed by rows, nine each. The tensor counts as observed, with source "measured", only if strikes
    determine every entry; otherwise its source is "prior".
    """
    value, sd = without_rounding_noise(parameters.inertia), parameters.inertia_sd
    every = bool(parameters.measured.all())
    intervals = intervals95(value.ravel(), sd.ravel())
    if parameters.inertia_intervals is not None:
        entries = np.stack([symmetric_matrix(ends) for ends in parameters.inertia_intervals.T], axis=-1)
        intervals = entries.reshape(9, 2).tolist()
    return Quantity(
        value=value.tolist(),
        unit="kg m^2",
        sd=sd.ravel().tolist(),
        interval95=intervals,
        frame="O",
        observed=every,
        source="measured" if every else "prior",
    )


def intervals95(values: Array, sd: Array) -> list[list[float]]:
    """List of n pairs [low, high], in the values' unit: 95 % intervals of values (n,) with sd (n,)."""
    return np.stack([values - SIGMAS_95 * sd, values + SIGMAS_95 * sd], axis=1).tolist()


def k_quantity(fit: MotionFit) -> Quantity | None:
    """Rate constant k [1/s²] of the fit theta'' = -k sin(phi - theta), with its 95 % interval, or None.

    theta is the tipping angle, phi the balance angle; the document writes the unit as rad/s^2. None if the
    estimator does not report k.
    """
    return None if fit.k is None else quantity(fit.k, math.sqrt(fit.covariance[1, 1]), "rad/s^2")


def without_rounding_noise(matrix: Array) -> Array:
    """Copy of an array without rounding noise: entries of a size below 1e-9 of the largest are set to 0."""
    return np.where(np.abs(matrix) < 1e-9 * np.abs(matrix).max(), 0.0, matrix)
