"""Centre of mass and shape of the tensor from all good tosses of a body together.

Fits start from the shape and from what each toss alone gives; the one of least misfit counts, as single
flights have false minima. The estimate under a second law of the air's pressure widens the intervals.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from analyze.flight.flight_model import COM, DRAG, FIRST_TAG, GRAVITY, SHAPE, TAG_TERMS
from analyze.flight.toss_fit import TossFit, fit_tosses
from analyze.types import FlightEstimate

if TYPE_CHECKING:
    from collections.abc import Sequence

    from analyze.flight.flight_model import ThrownBody
    from analyze.flight.toss import TossMotion
    from analyze.flight.toss_fit import FlightPrior
    from analyze.flight.views import TagSet
    from analyze.types import Array, CameraModel

_FOUND = np.r_[COM, SHAPE]
"""places of c and the tensor's shape among the unknowns"""
MISPLACED_SD = 5.0
"""shift of a tag against its stated place, in standard deviations of that, from which on it is reported"""
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
    def misplaced(self) -> dict[int | str, float]:
        """Distance [m] of the tags from their stated places, of those off by more than `MISPLACED_SD` sd."""
        model = self.fit.model
        shifts = self.fit.x[FIRST_TAG : model.shared].reshape(-1, TAG_TERMS)[:, :3]
        off = np.abs(shifts).max(axis=1) > MISPLACED_SD * model.tags.place_sd
        return {model.tags.names[i]: float(np.linalg.norm(shifts[i])) for i in np.flatnonzero(off)}

    @property
    def gravity(self) -> Array:
        """Gravity (3,) in W [m/s^2]."""
        return self.fit.x[GRAVITY]


def estimate_flights(
    tosses: Sequence[TossMotion], body: ThrownBody, prior: FlightPrior, camera: CameraModel, tags: TagSet
) -> FlightFit:
    """Estimate centre of mass and shape of the tensor from flights that were found and judged good.

    Args:
        tosses: tosses with a free flight, at least one.
        body: hull, mass and size of the body.
        prior: body as known before.
        camera: camera that took all frames.
        tags: the object's tags.
    """
    flights = [toss.flight for toss in tosses if toss.flight is not None]
    data = [(flight.views, flight.start) for flight in flights]
    best = fit_tosses(body, prior, camera, tags, data)
    for flight in flights:
        if float(np.abs(flight.shared[SHAPE] - best.x[SHAPE]).max()) < _SAME_SHAPE:
            continue
        fit = fit_tosses(body, prior, camera, tags, data, flight.shared)
        best = min(best, fit, key=lambda each: each.cost)
    second = replace(body, panels=replace(body.panels, oblique=True))
    again = [(views, start) for (views, _), start in zip(data, best.starts(), strict=True)]
    other = fit_tosses(second, prior, camera, tags, again, best.x[: best.model.shared])
    by_law = other.x[_FOUND] - best.x[_FOUND]
    covariance = best.covariance[np.ix_(_FOUND, _FOUND)] + np.outer(by_law, by_law)
    ids = tuple(toss.toss_id for toss in tosses)
    return FlightFit(FlightEstimate(best.x[_FOUND], covariance, ids), best, by_law)
