"""The answer of the cube's tosses as JSON values, and the standard deviation of a distance."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from analyze.errors import EstimationError
from analyze.least_squares.intervals import student_sigmas_95
from analyze.motion.moment_balance import tensor
from analyze.reproduce.cube_tosses import GRAVITY_M_S2, contact_ratios

if TYPE_CHECKING:
    from analyze.motion.moment_balance import BalancedBody
    from analyze.reproduce.cube_tosses import CubeAnswer
    from analyze.types import Array


def answer_json(answer: CubeAnswer) -> dict[str, Any]:
    """Centre of mass and inertia per mass by each method, as JSON values with units and 95 % intervals.

    The methods are free flight, contact at an edge and contact at a corner; the difference of edge contact
    and flight is added. An interval is the value ± its half-width by Student's t. Lengths are in true metres
    and the cube's frame; only `gravity` is in the file's unit of length per s^2. Flight determines the
    inertia up to its factor: `inertia_ratios` is the tensor over the mean of its diagonal.
    """

    def quantity(value: Array, sd: Array, half: Array, unit: str) -> dict[str, Any]:
        interval = [(value - half).tolist(), (value + half).tolist()]
        return {"value": value.tolist(), "sd": sd.tolist(), "unit": unit, "interval95": interval}

    def ratios(values: Array, covariance: Array, freedom: Array) -> dict[str, Any]:
        sd = np.sqrt(np.diag(covariance))
        return quantity(tensor(values), tensor(sd), tensor(student_sigmas_95(freedom) * sd), "1")

    def balanced(body: BalancedBody) -> dict[str, Any]:
        half = body.half_width
        rounding, rounding_sd = np.array(body.rounding), np.array(body.rounding_sd)
        return {
            "contacts": body.contacts,
            "centre_of_mass": quantity(body.com, body.com_sd, half[:3], "m"),
            "inertia_per_mass": quantity(body.inertia, body.inertia_sd, tensor(half[3:9]), "m^2"),
            "inertia_ratios": ratios(*contact_ratios(body)),
            "edge_rounding": quantity(rounding, rounding_sd, half[9], "m"),
            "explained": body.explained,
        }

    difference, covariance = answer.edge_minus_flight
    flight, rotation = answer.flight, answer.rotation
    sd = np.sqrt(np.diag(covariance))
    gravity, gravity_sd = np.array(flight.gravity), np.array(flight.gravity_sd)
    return {
        "tosses": answer.tosses,
        "frames": answer.frames,
        "flight": {
            "flights": flight.flights,
            "centre_of_mass": quantity(flight.com, flight.com_sd, flight.half_width[:3], "m"),
            "gravity": {
                **quantity(gravity, gravity_sd, flight.half_width[3], "m/s^2"),
                "true": GRAVITY_M_S2,
            },
            "residual_m": flight.residual,
            "inertia_per_mass": None,
            "inertia_ratios": ratios(rotation.ratios, rotation.covariance, rotation.freedom),
            "residual_rad": rotation.residual,
        },
        "metre_of_the_file": answer.scale,
        "edge_contact": balanced(answer.edges),
        "corner_contact": balanced(answer.corners),
        "edge_minus_flight": {
            **quantity(difference, sd, student_sigmas_95(answer.edge_minus_flight_freedom) * sd, "m"),
            "distance": float(np.linalg.norm(difference)),
        },
        "edge_slides_m": {"quartiles": list(answer.slides_m)},
    }


def distance_sd(difference: Array, covariance: Array) -> float:
    """Standard deviation [m] of the length of a vector, from the vector's covariance along its direction.

    Args:
        difference: (3,) the vector, the difference of two centres of mass [m].
        covariance: (3, 3) its covariance [m^2].

    Raises:
        EstimationError: the difference is exactly zero: its length has no direction to take the variance
            along.
    """
    length = float(np.linalg.norm(difference))
    if length == 0:
        raise EstimationError(
            "the difference of the two centres of mass is exactly zero: its standard deviation is undefined"
        )
    direction = difference / length
    return math.sqrt(float(direction @ covariance @ direction))
