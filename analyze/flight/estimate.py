"""Centre of mass and shape of the tensor from all good tosses of a body together.

Fits start from the shape and from what each toss alone gives; the one of least misfit counts, as single
flights have false minima. The estimate under a second law of the air's pressure widens the intervals.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from analyze.flight.flight_model import COM, DRAG, GRAVITY, SHAPE
from analyze.flight.toss_fit import TossFit, fit_tosses
from analyze.types import FlightEstimate

if TYPE_CHECKING:
    from collections.abc import Sequence

    from analyze.flight.toss import TossMotion
    from analyze.flight.toss_fit import FlightPrior
    from analyze.types import Array, CameraModel

_FOUND = np.r_[COM, SHAPE]
"""places of c and the tensor's shape among the unknowns"""
_SAME_SHAPE = 0.02
"""largest difference of the tensor's numbers of two first guesses that count as one"""


@dataclass(frozen=True)
class FlightFit:
    """Estimate from a body's flights, with the fit behind it."""

    estimate: FlightEstimate
    """c and shape of the tensor, with covariance"""
    fit: TossFit
    """fit of all tosses together"""
    by_law: Array
    """(8,) change of the estimate under the second law of the air's pressure"""

    @property
    def drag(self) -> Array:
        """Coefficients (2,) of the air's force and moment."""
        return self.fit.x[DRAG]

    @property
    def gravity(self) -> Array:
        """Gravity (3,) in W [m/s^2]."""
        return self.fit.x[GRAVITY]


def estimate_flights(tosses: Sequence[TossMotion], prior: FlightPrior, camera: CameraModel) -> FlightFit:
    """Estimate centre of mass and shape of the tensor from flights that were found and judged good.

    Args:
        tosses: flights with their own fits, at least one.
        prior: body as known before.
        camera: camera that took all frames.
    """
    flown = [(toss.views, toss.fit) for toss in tosses if toss.views is not None and toss.fit is not None]
    first = flown[0][1].model
    data = [(views, fit.starts()[0]) for views, fit in flown]
    best = fit_tosses(first.body, prior, camera, first.tags, data)
    for _, alone in flown:
        if float(np.abs(alone.x[SHAPE] - best.x[SHAPE]).max()) < _SAME_SHAPE:
            continue
        fit = fit_tosses(first.body, prior, camera, first.tags, data, alone.x[: first.shared])
        best = min(best, fit, key=lambda each: each.cost)
    second = replace(first.body, panels=replace(first.body.panels, oblique=True))
    again = [(views, start) for (views, _), start in zip(data, best.starts(), strict=True)]
    other = fit_tosses(second, prior, camera, first.tags, again, best.x[: first.shared])
    by_law = other.x[_FOUND] - best.x[_FOUND]
    covariance = best.covariance[np.ix_(_FOUND, _FOUND)] + np.outer(by_law, by_law)
    ids = tuple(toss.toss_id for toss in tosses)
    return FlightFit(FlightEstimate(best.x[_FOUND], covariance, ids), best, by_law)
