"""The free flight within the frames of a toss: after the hand, before the landing.

In a short stretch of free flight the body's poses obey x(t) + R(t) c = p0 + v0 t + g t^2 / 2, which is
linear in c, p0 and v0. Stretches that do so are joined; the frames at their ends in which a hand or the
cushion still pushes are then cut off by the residuals of the fit in pixels.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from analyze.flight.first_guess import body_poses, first_start
from analyze.flight.flight_model import ThrownBody, TossStart
from analyze.flight.toss_fit import FlightPrior, TossFit, fit_tosses

if TYPE_CHECKING:
    from analyze.flight.views import TagSet, TossViews
    from analyze.types import Array, CameraModel

WINDOW_S = 0.1
"""length of the stretches that are tested one by one [s]"""
_MIN_FRAMES = 7
"""least number of frames of a stretch"""
_ACROSS_SD, _DEPTH_SD = 5e-4, 3e-3
"""rough standard deviations of a body's place by the pose of one tag, across and along the view [m]"""
_MAX_GAP_S = 0.04
"""longest time without a tag in view within a flight [s]"""
_FREE_RATIO = 2.0
"""largest rms residual of a free stretch, in those standard deviations"""
_END_FRAMES = 3
"""number of frames at an end of a flight whose residuals are judged together"""
_END_RATIO = 2.5
"""rms residual of the frames at an end, over that of all frames, above which they are cut off"""
_CUT_FRAMES, _CUT_SHARE, _FAR_OFF = 2, 0.1, 8.0
"""frames cut off at once, and the share of the flight cut off where that ratio is above the last"""
_GUARD_FRAMES = 1
"""frames cut off at either end in any case, as the hand and the cushion push softly at first"""


def free_stretch(
    views: TossViews, tags: TagSet, camera: CameraModel, prior: FlightPrior
) -> tuple[int, int] | None:
    """Longest stretch [start, stop) of frames in which the body's poses are those of a free fall.

    Args:
        views: views of all frames of the toss.
        tags: the object's tags.
        camera: camera that took the frames.
        prior: body as known before.

    Returns:
        Indices of the frames; None if there is no such stretch.
    """
    if len(views) < _MIN_FRAMES:
        return None
    R, origin = body_poses(views, tags, camera)
    time = views.seconds
    R_camera_world = camera.T_world_camera[:3, :3].T
    free = np.zeros(len(time), dtype=bool)
    stops = np.searchsorted(time, time + WINDOW_S, side="right")
    for first, stop in enumerate(stops.tolist()):
        part = slice(first, stop)
        if stop - first < _MIN_FRAMES or np.diff(time[part]).max() > _MAX_GAP_S:
            continue
        if _fall_residual(time[part], R[part], origin[part], R_camera_world, prior) < _FREE_RATIO:
            free[part] = True
    return _longest(free, time)


def trimmed_flight(
    body: ThrownBody,
    prior: FlightPrior,
    camera: CameraModel,
    tags: TagSet,
    views: TossViews,
    start: int,
    stop: int,
) -> tuple[TossViews, TossFit] | None:
    """Views of a flight without the frames at its ends that are not free, with the fit to them alone.

    Args:
        body: hull, mass and size of the body.
        prior: body as known before.
        camera: camera that took the frames.
        tags: the object's tags.
        views: views of all frames of the toss.
        start: first frame of the free stretch.
        stop: frame after its last.

    Returns:
        The views and the fit; None if fewer than `_MIN_FRAMES` frames are left.
    """
    start, stop = start + _GUARD_FRAMES, stop - _GUARD_FRAMES
    guess: TossStart | None = None
    while stop - start >= _MIN_FRAMES:
        part = views.part(start, stop)
        guess = guess or first_start(part, tags, camera, prior.com, prior.gravity)
        fit = fit_tosses(body, prior, camera, tags, [(part, guess)])
        size = _frame_residuals(part, fit)
        usual = max(1.0, float(np.sqrt(np.median(size**2))))
        early, late = (float(np.sqrt(np.mean(each**2))) for each in (size[:_END_FRAMES], size[-_END_FRAMES:]))
        if max(early, late) < _END_RATIO * usual:
            return part, fit
        far = max(early, late) > _FAR_OFF * usual
        cut = max(_CUT_FRAMES, round(_CUT_SHARE * len(part)) if far else 0)
        path = fit.model.paths(fit.x)[0]
        if early > late:
            start, guess = start + cut, TossStart.at(path, cut)
        else:
            stop, guess = stop - cut, TossStart.at(path, 0)
    return None


def _fall_residual(time: Array, R: Array, origin: Array, R_camera_world: Array, prior: FlightPrior) -> float:
    """Rms residual of a free fall through poses (n), in the rough standard deviations of a pose's place."""
    t = time - time.mean()
    fallen = origin + R @ prior.com
    fallen[:, 2] += 0.5 * prior.gravity * t**2
    weight = 1.0 / np.array([_ACROSS_SD, _ACROSS_SD, _DEPTH_SD])
    eye = np.broadcast_to(R_camera_world, R.shape)
    matrix = np.concatenate([-R_camera_world @ R, eye, t[:, None, None] * eye], axis=2) * weight[:, None]
    level = (fallen @ R_camera_world.T) * weight
    bounds = np.hstack([np.diag(8.0 / prior.extent), np.zeros((3, 6))])
    rows = np.concatenate([matrix.reshape(-1, 9), bounds])
    right = np.concatenate([level.ravel(), np.zeros(3)])
    found, *_ = np.linalg.lstsq(rows, right, rcond=None)
    return float(np.sqrt(np.sum((right - rows @ found) ** 2) / max(3 * len(t) - 9, 1)))


def _longest(free: np.ndarray, time: Array) -> tuple[int, int] | None:
    """Longest run [start, stop) of true values in time, without a gap longer than `_MAX_GAP_S`."""
    best, start = None, None
    for i in range(len(free) + 1):
        broken = i == len(free) or not free[i] or (start is not None and time[i] - time[i - 1] > _MAX_GAP_S)
        if broken and start is not None:
            if best is None or time[i - 1] - time[start] > time[best[1] - 1] - time[best[0]]:
                best = start, i
            start = None
        if start is None and i < len(free) and free[i]:
            start = i
    return best


def _frame_residuals(views: TossViews, fit: TossFit) -> Array:
    """Rms residual (n,) of each frame's corners, in their standard deviations."""
    square = np.mean(fit.residual.reshape(-1, 8) ** 2, axis=1) / views.sd**2
    total = np.bincount(views.frame, square, minlength=len(views))
    return np.sqrt(total / np.maximum(np.bincount(views.frame, minlength=len(views)), 1))
