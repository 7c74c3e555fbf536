"""Fit of all tosses of one body in pixels: centre of mass, shape of the tensor, air, tags' places together.

The priors (tag places as stated, gravity, rough coefficients of the air) are observations beside the corners.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from analyze.flight.flight_model import (
    COM,
    DRAG,
    FIRST_TAG,
    GRAVITY,
    LINE_TIME,
    PRESSURE,
    SHAPE,
    TAG_SIZE,
    TAG_TERMS,
    FlightModel,
    ThrownBody,
    TossStart,
)
from analyze.least_squares.levenberg_marquardt import Ending, Minimum, minimise
from analyze.least_squares.robust import correlation_factor

if TYPE_CHECKING:
    from collections.abc import Sequence

    from analyze.flight.views import TagSet, TossViews
    from analyze.types import Array, CameraModel

DRAG_COEFFICIENT, DRAG_COEFFICIENT_SD = 1.1, 0.4
"""prior of the coefficients of Newton's law of resistance: 0.9 gives a sphere's drag, 1.05 that of a cube's
face, 1.6 that of a long cylinder"""
PRESSURE_SHIFT = 0.1
"""1 sigma of the place where the air's force acts against that by its law, as a fraction of the extent: so
wide that the air's moment, which depends on the law, tells nothing about c"""
TAG_SIZE_SD = 0.003
"""1 sigma of the size of printed tags over the stated one"""
SHAPE_SD = 1.5
"""1 sigma of the numbers of the tensor's shape about those of the uniform solid: wide"""
GRAVITY_TURN_SD = 0.02
"""1 sigma of the direction of gravity in W, about each horizontal axis [rad]: wide, as flights measure it"""

CONVERGED = Ending(least_gain=1e-3)
"""a fit ends with a step that decreases chi^2 by less: what is left is a small part of the unknowns' sd"""


@dataclass(frozen=True)
class FlightPrior:
    """Body as known before its flights: c and shape of the tensor, roughly, and gravity."""

    com: Array
    """(3,) centroid of the shape [m, in O]"""
    extent: Array
    """(3,) edges of the shape's bounding box along O's axes [m]; a quarter is c's 1 sigma"""
    shape: Array
    """(5,) numbers of the tensor's shape (`second_moments.scale_free`) of the uniform solid"""
    gravity: float
    """gravity [m/s^2]"""
    gravity_sd: float
    """its 1 sigma [m/s^2]"""
    line_time_sd: float = 1e-9
    """1 sigma of the delay from image row to row beyond that of the calibration [s]"""

    def mean_and_sd(self, tags: TagSet) -> tuple[Array, Array]:
        """Mean and standard deviation of the unknowns that tosses share, with the places of the tags."""
        count = FIRST_TAG + TAG_TERMS * len(tags.names)
        mean, sd = np.zeros(count), np.ones(count)
        mean[COM], sd[COM] = self.com, 0.25 * self.extent
        mean[SHAPE], sd[SHAPE] = self.shape, SHAPE_SD
        turned = GRAVITY_TURN_SD * self.gravity
        mean[GRAVITY], sd[GRAVITY] = (0.0, 0.0, -self.gravity), (turned, turned, self.gravity_sd)
        mean[DRAG], sd[DRAG] = DRAG_COEFFICIENT, DRAG_COEFFICIENT_SD
        sd[PRESSURE] = PRESSURE_SHIFT * self.extent
        mean[TAG_SIZE], sd[TAG_SIZE] = 1.0, TAG_SIZE_SD
        mean[LINE_TIME], sd[LINE_TIME] = 0.0, self.line_time_sd
        places = np.column_stack(
            [np.repeat(tags.place_sd[:, None], 3, 1), np.repeat(tags.turn_sd[:, None], 3, 1)]
        )
        sd[FIRST_TAG:] = places.ravel()
        return mean, sd


@dataclass(frozen=True)
class TossFit:
    """Fit of one or more tosses of a body, with the covariance of its unknowns."""

    model: FlightModel
    """the model fitted"""
    prior: FlightPrior
    """body as known before"""
    x: Array
    """(count,) unknowns, in the order of `flight_model`"""
    covariance: Array
    """(count, count) their covariance, with the residuals' own variance"""
    residual: Array
    """(rows,) measured minus fitted corners [px]"""
    cost: float
    """sum of the squared residuals, in sd, robustly weighted, with those of the priors"""
    noise: float
    """variance of the residuals over the stated one, correlation of neighbouring frames included; at least
    1"""

    def starts(self) -> list[TossStart]:
        """Motion of each toss at its first frame."""
        own = [self.x[self.model.own(i)] for i in range(len(self.model.tosses))]
        return [start.moved(numbers) for (_, start), numbers in zip(self.model.tosses, own, strict=True)]


def fit_tosses(
    body: ThrownBody,
    prior: FlightPrior,
    camera: CameraModel,
    tags: TagSet,
    tosses: Sequence[tuple[TossViews, TossStart]],
    shared: Array | None = None,
    ending: Ending = CONVERGED,
) -> TossFit:
    """Fit all unknowns of the body, its tags and its tosses to the tags' corners, with Huber's loss.

    Args:
        body: hull, mass and size of the body.
        prior: body as known before.
        camera: camera that took all frames.
        tags: the object's tags, with the sd of their places.
        tosses: views of each toss, with a first guess of its start.
        shared: first guess of the unknowns (s,) that tosses share; None for the prior's mean.
        ending: when the fit ends.
    """
    return fit_model(FlightModel(body, camera, tags, tosses), prior, shared, ending)


def fit_model(
    model: FlightModel,
    prior: FlightPrior,
    shared: Array | None = None,
    ending: Ending = CONVERGED,
) -> TossFit:
    """Fit a model of tosses to the corners of their views, as `fit_tosses` does.

    Args:
        model: model of all tosses, which holds their views and first guesses.
        prior: body as known before.
        shared: first guess of the unknowns (s,) that tosses share; None for the prior's mean.
        ending: when the fit ends.
    """
    tosses = model.tosses
    mean, sd = prior.mean_and_sd(model.tags)
    first = mean if shared is None else shared
    start = np.concatenate([first, *(each.numbers for _, each in tosses)])
    observed = np.concatenate([*(views.corners.ravel() for views, _ in tosses), mean])
    corner_sd = np.concatenate([np.repeat(views.sd, 8) for views, _ in tosses])
    scale = _SCALE * np.concatenate([np.minimum(sd, 0.1), np.tile(_OWN_SCALE, len(tosses))])

    def expected(x: Array) -> tuple[Array, Array]:
        pixels, by = model(x)
        return np.concatenate([pixels, x[: model.shared]]), np.vstack(
            [by, np.eye(model.count)[: model.shared]]
        )

    stated = np.concatenate([corner_sd, sd])
    found = minimise(observed, stated, expected, start, scale, TAG_SIZE, ending)
    return _result(model, prior, found, corner_sd, sd)


_OWN_SCALE = np.repeat([1e-2, 1e-1, 1e-3, 1e-2], 3)
"""typical changes of a toss's own unknowns [rad, rad/s, m, m/s]"""
_SINGULAR = 1e-14
"""least eigenvalue of the scaled information below which it counts as singular"""
_UNKNOWN = 1e12
"""variance of unknowns about which a fit tells nothing [rad^2, m^2, ...]"""
_SCALE = 30.0
"""factor on typical changes: a step of 3e-4 of them ends the fit"""


def _result(model: FlightModel, prior: FlightPrior, found: Minimum, corner_sd: Array, sd: Array) -> TossFit:
    rows = len(corner_sd)
    z = found.weight[:rows] * found.residual[:rows] / corner_sd
    own_freedom = model.count - model.shared + 5
    inside = max(0.5, float(np.mean(found.weight[:rows] > 0.999)))
    variance = float(np.sum(z**2)) / max(rows - own_freedom, 1) / inside**2
    correlation = correlation_factor(_by_corner(model, z))
    # Where the stated variance holds errors that neighbouring frames share, it may exceed that of the noise.
    noise = max(1.0, variance * correlation if model.tags.shared_errors else max(1.0, variance) * correlation)
    by = found.jacobian[:rows] * (np.sqrt(found.weight[:rows]) / corner_sd)[:, None]
    information = by.T @ by / noise
    information[: model.shared, : model.shared] += np.diag(sd**-2)
    whole = np.concatenate([z / np.sqrt(found.weight[:rows]), found.residual[rows:] / sd])
    cost = float(np.sum(whole**2))
    return TossFit(
        model,
        prior,
        found.parameters,
        _inverse(information),
        found.residual[:rows],
        cost if math.isfinite(cost) else math.inf,
        noise,
    )


def _inverse(information: Array) -> Array:
    """Covariance by an information matrix (n, n); variances of `_UNKNOWN` if it is singular.

    A fit that led to a body whose rotation cannot be integrated has no information, or one without end.
    """
    unknown = _UNKNOWN * np.eye(len(information))
    size = np.sqrt(np.diag(information))
    if not np.all(np.isfinite(information)) or not np.all(size > 0.0):
        return unknown
    values, vectors = np.linalg.eigh(information / np.outer(size, size))
    if values[0] < _SINGULAR:
        return unknown
    return (vectors / values) @ vectors.T / np.outer(size, size)


def _by_corner(model: FlightModel, values: Array) -> Array:
    """Values (rows,) of all corners, in sequences of one coordinate of one corner over the frames."""
    first = 0
    parts: list[Array] = []
    for views, _ in model.tosses:
        each = values[first : first + 8 * len(views.tag)].reshape(-1, 8)
        parts += [each[views.tag == tag].T.ravel() for tag in range(len(model.tags.names))]
        first += 8 * len(views.tag)
    return np.concatenate(parts)
