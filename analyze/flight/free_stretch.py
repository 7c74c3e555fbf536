"""The free flight within the frames of a toss: after the hand, before the landing.

In a short stretch of free flight the body's poses obey x(t) + R(t) c = p0 + v0 t + g t^2 / 2, which is
linear in c, p0 and v0. The longest of the stretches that do so shows where the flight begins; the residuals
of the fit in pixels then show which frames belong to it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from analyze.flight.first_guess import body_poses, first_fit
from analyze.flight.flight_model import FlightModel
from analyze.flight.toss_fit import FlightPrior, TossFit, fit_tosses

if TYPE_CHECKING:
    from analyze.flight.flight_model import ThrownBody
    from analyze.flight.views import TagSet, TossViews
    from analyze.types import Array, CameraModel

WINDOW_S = 0.1
"""length of the stretches that are tested one by one [s]"""
_MIN_FRAMES, _LEAST_SHARE = 7, 0.8
"""least number of frames of a stretch, and least share of its length that they span"""
_ACROSS_SD, _DEPTH_SD = 5e-4, 3e-3
"""rough standard deviations of a body's place by the pose of one tag, across and along the view [m]"""
_MAX_GAP_S, _BRIDGED_S = 0.04, 0.15
"""longest time without a tag in view within a stretch, and between two that are joined [s]"""
_FREE_RATIO = 2.0
"""largest rms residual of a free stretch, in those standard deviations"""
_END_FRAMES = 3
"""number of frames at an end of a flight whose residuals are judged together"""
_END_RATIO = 2.5
"""rms residual of the frames at an end, over that of all frames, above which they are cut off"""
_CORE_FRAMES, _ADDED_FRAMES = 16, 16
"""frames that are fitted at first, and most frames added at once"""
_SKIPPED_FRAMES, _MAX_LATE_FRAMES = 2, 20
"""frames left out at once at the start if the first do not fit, and at most"""
_MAX_CORE_PX, _MAX_GROWTH = 1.0, 1.6
"""largest rms residual of the first frames [px], and its largest growth by frames that are added"""
_MAX_STEPS = 6
"""number of steps after which the fit to a flight that grows ends"""
_LEAST_GAIN = 1.0
"""decrease of chi^2 in a step below which it ends as well"""
_MAX_PREDICTED_PX = 8.0
"""largest median distance of the corners in frames that are added from where the fit so far predicts them"""
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
        if stop - first < _MIN_FRAMES or time[stop - 1] - time[first] < _LEAST_SHARE * WINDOW_S:
            continue
        if np.diff(time[part]).max() > _MAX_GAP_S:
            continue
        if _fall_residual(time[part], R[part], origin[part], R_camera_world, prior) < _FREE_RATIO:
            free[part] = True
    return _longest(free, time)


def grown_flight(
    body: ThrownBody, prior: FlightPrior, camera: CameraModel, tags: TagSet, views: TossViews, start: int
) -> tuple[TossViews, TossFit] | None:
    """Views of the longest flight from near a frame on, with the fit to them alone.

    The first frames are fitted, and left out as long as they do not fit; then frames are added as long as the
    newest fit as well as the others.

    Args:
        body: hull, mass and size of the body.
        prior: body as known before.
        camera: camera that took the frames.
        tags: the object's tags.
        views: views of all frames of the toss.
        start: first frame that seems free.

    Returns:
        The views and the fit; None if no `_CORE_FRAMES` frames fit.
    """
    begin, found = start + _GUARD_FRAMES, None
    for begin in range(start + _GUARD_FRAMES, start + _MAX_LATE_FRAMES, _SKIPPED_FRAMES):
        core = views.part(begin, begin + _CORE_FRAMES)
        if len(core) < _CORE_FRAMES:
            return None
        found = first_fit(core, tags, camera, body, prior)
        if _rms_px(found) < _MAX_CORE_PX and _ends_fit(core, found):
            break
    else:
        return None
    end, more, failed = begin + _CORE_FRAMES, _ADDED_FRAMES // 2, False
    while more and end < len(views):
        if views.seconds[end] - views.seconds[end - 1] > _BRIDGED_S:
            break
        part = views.part(begin, end + more)
        fit = _extended(part, found, end - begin)
        if fit is not None:
            end, found = begin + len(part), fit
            more = more if failed else min(2 * more, _ADDED_FRAMES)
        else:
            failed, more = True, more // 2
    part = views.part(begin, end - _GUARD_FRAMES)
    again = [(part, found.starts()[0])]
    return part, fit_tosses(body, prior, camera, tags, again, found.x[: found.model.shared])


def _extended(views: TossViews, fit: TossFit, fitted: int) -> TossFit | None:
    """Fit to a flight with further frames, which begins from that to its first `fitted` ones.

    None if the further frames do not belong to the flight: the fit so far predicts other places, or the new
    one fits its ends worse than the rest.
    """
    model = FlightModel(fit.model.body, fit.model.camera, fit.model.tags, [(views, fit.starts()[0])])
    shared = fit.x[: fit.model.shared]
    predicted, _ = model(np.concatenate([shared, model.tosses[0][1].numbers]))
    off = np.abs(predicted - views.corners.ravel()).reshape(-1, 8)[views.frame >= fitted]
    if not float(np.median(off)) < _MAX_PREDICTED_PX:
        return None
    new = fit_tosses(
        model.body, fit.prior, model.camera, model.tags, model.tosses, shared, _MAX_STEPS, _LEAST_GAIN
    )
    usual = max(_rms_px(fit), float(views.sd.mean()))
    return new if _ends_fit(views, new) and _rms_px(new) < _MAX_GROWTH * usual else None


def _ends_fit(views: TossViews, fit: TossFit) -> bool:
    """True if the residuals in the first and last frames are like those of the others."""
    size = _frame_residuals(views, fit)
    usual = max(1.0, float(np.sqrt(np.median(size**2))))
    ends = [float(np.sqrt(np.mean(each**2))) for each in (size[:_END_FRAMES], size[-_END_FRAMES:])]
    return max(ends) < _END_RATIO * usual


def _rms_px(fit: TossFit) -> float:
    return float(np.sqrt(np.mean(fit.residual**2)))


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
    """Longest run [start, stop) of true values in time, without a gap longer than `_BRIDGED_S`."""
    frames = np.flatnonzero(free)
    if not len(frames):
        return None
    runs = np.split(frames, np.flatnonzero(np.diff(time[frames]) > _BRIDGED_S) + 1)
    best = max(runs, key=lambda run: time[run[-1]] - time[run[0]])
    return int(best[0]), int(best[-1]) + 1


def _frame_residuals(views: TossViews, fit: TossFit) -> Array:
    """Rms residual (n,) of each frame's corners, in their standard deviations."""
    square = np.mean(fit.residual.reshape(-1, 8) ** 2, axis=1) / views.sd**2
    total = np.bincount(views.frame, square, minlength=len(views))
    return np.sqrt(total / np.maximum(np.bincount(views.frame, minlength=len(views)), 1))
