"""First guess of a flight's motion from the poses of single tags."""

# pyright: reportUnknownArgumentType=false

from __future__ import annotations

from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from analyze.flight.flight_model import FlightModel, TossStart
from analyze.flight.toss_fit import fit_tosses
from analyze.geometry.rotations import matrix_from_vector, nearest_rotation, vector_from_matrix
from analyze.least_squares.levenberg_marquardt import Ending

if TYPE_CHECKING:
    from analyze.flight.flight_model import ThrownBody
    from analyze.flight.toss_fit import FlightPrior, TossFit
    from analyze.flight.views import TagSet, TossViews
    from analyze.types import Array, CameraModel

_TRIED_FRAMES, _LAGS = 6, (1, 3)
"""number of frames whose poses are tried, and of frames from each to the one that gives the spin; of every
n-th frame only where frames are less than `_APART_S` apart"""
_APART_S = 0.006
"""least time between frames from whose poses the spin is taken [s]"""
_FITTED_GUESSES = 2
"""number of the best guesses that are fitted"""
_ENDING = Ending(max_steps=12, least_gain=1.0)
"""when the fit to a guess ends"""
_GOOD_PX = 0.5
"""rms residual of a fit to a guess [px] below which no further guess is fitted"""
_CLIP_PX = 40.0
"""largest distance of a corner that counts [px]"""


def body_poses(views: TossViews, tags: TagSet, camera: CameraModel) -> tuple[Array, Array]:
    """Attitude (n, 3, 3) and place (n, 3) [m] of the object frame O in W in each frame, by its best tag.

    The best tag is the one that fills most of the image.
    """
    x, y = views.corners[..., 0], views.corners[..., 1]
    area = np.abs(np.sum(x * np.roll(y, -1, axis=1) - y * np.roll(x, -1, axis=1), axis=1))
    order = np.lexsort((area, views.frame))
    best = order[np.append(np.diff(views.frame[order]) > 0, True)]
    R_object_tag, p_object_tag = tag_poses(tags)
    tag = views.tag[best]
    R_world_camera = camera.T_world_camera[:3, :3]
    R = R_world_camera @ views.R_camera_tag[best] @ np.swapaxes(R_object_tag[tag], 1, 2)
    centre = views.p_camera_tag[best] @ R_world_camera.T + camera.T_world_camera[:3, 3]
    return R, centre - np.einsum("nij,nj->ni", R, p_object_tag[tag])


def tag_poses(tags: TagSet) -> tuple[Array, Array]:
    """Rotations (k, 3, 3) from the tags' frames to O, and their centres (k, 3) in O [m]."""
    along = tags.corners[:, 1] - tags.corners[:, 0]
    up = tags.corners[:, 0] - tags.corners[:, 3]
    x = along / np.linalg.norm(along, axis=1, keepdims=True)
    y = up / np.linalg.norm(up, axis=1, keepdims=True)
    return nearest_rotation(np.stack([x, y, np.cross(x, y)], axis=-1)), tags.centres


def first_fit(
    views: TossViews, tags: TagSet, camera: CameraModel, body: ThrownBody, prior: FlightPrior
) -> TossFit:
    """Fit to the beginning of a flight, from the poses of tags in its first frames.

    A square seen alone has a second, mirrored pose that fits almost as well, so that several attitudes and
    spins are tried; those whose motion predicts the corners best are fitted, and the best fit counts.

    Args:
        views: the beginning of the flight, at least three frames.
        tags: the object's tags.
        camera: camera that took the frames.
        body: hull, mass and size of the body.
        prior: body as known before.
    """
    R, origin = body_poses(views, tags, camera)
    time = views.seconds
    fallen = origin + R @ prior.com + 0.5 * prior.gravity * time[:, None] ** 2 * np.array([0.0, 0.0, 1.0])
    line, *_ = np.linalg.lstsq(np.column_stack([np.ones_like(time), time]), fallen, rcond=None)
    shared = prior.mean_and_sd(tags)[0]
    guesses: list[tuple[float, TossStart]] = []
    every = max(1, int(np.ceil(_APART_S / np.median(np.diff(time)))))
    for first, lag in product(range(0, every * _TRIED_FRAMES, every), every * np.array(_LAGS)):
        if first + lag >= len(R):
            continue
        turn = vector_from_matrix(R[first].T @ R[first + lag])
        spin = turn / (time[first + lag] - time[first])
        start = TossStart(R[first] @ matrix_from_vector(-spin * time[first]), spin, line[0], line[1])
        guesses.append((_misfit(body, camera, tags, views, start, shared), start))
    best = sorted(guesses, key=lambda each: each[0])[:_FITTED_GUESSES]
    fits: list[TossFit] = []
    for _, start in best:
        toss = [(views, start)]
        fits.append(fit_tosses(body, prior, camera, tags, toss, ending=_ENDING))
        if float(np.sqrt(np.mean(fits[-1].residual ** 2))) < _GOOD_PX:
            break
    return min(fits, key=lambda fit: fit.cost)


def _misfit(
    body: ThrownBody, camera: CameraModel, tags: TagSet, views: TossViews, start: TossStart, shared: Array
) -> float:
    """Mean distance [px] of the corners from those that a start predicts, each at most `_CLIP_PX`."""
    model = FlightModel(body, camera, tags, [(views, start)])
    predicted, _ = model(np.concatenate([shared, start.numbers]))
    return float(
        np.mean(np.minimum(np.abs(np.nan_to_num(predicted - views.corners.ravel(), nan=1e9)), _CLIP_PX))
    )
