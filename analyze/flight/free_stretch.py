"""The free flight within the frames of a toss: after the hand, before the landing.

In a short stretch of free flight the body's poses obey x(t) + R(t) c = p0 + v0 t + g t^2 / 2, which is
linear in c, p0 and v0. The longest of the stretches that do so shows where the flight begins; the residuals
of the fit in pixels then show which frames belong to it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from analyze.flight.first_guess import body_poses, first_fit
from analyze.flight.flight_model import GRAVITY, SHAPE, FlightModel, TossStart
from analyze.flight.toss_fit import FlightPrior, TossFit, fit_model, fit_tosses
from analyze.geometry.rotations import matrix_from_vector
from analyze.geometry.second_moments import unit_inertia, with_size
from analyze.least_squares.levenberg_marquardt import Ending

if TYPE_CHECKING:
    from numpy.typing import NDArray

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
_END_RATIO = 3.0
"""rms residual of the frames at an end, over the median of all frames, above which they are cut off"""
_CORE_FRAMES, _CORE_S = 16, 0.13
"""number of frames that are fitted at first, and added at most at once, and the time that they cover where
that takes more"""
_LATE_FRAMES = 4
"""number of later frames that are added at most at once to a flight that has all earlier ones: most often
there are none"""
_MAX_CORES = 6
"""largest number of places where first frames are tried, half of them apart, from the middle of the stretch
outwards"""
_GOOD_CORE, _MAX_CORE_PX = 2.5, 1.0
"""rms residual of the first frames, in their sd, with which no other place is tried, and the largest one of
the best place [px]"""
_MAX_GROWTH = 1.6
"""largest growth of the rms residual by frames that are added"""
_ENDING = Ending(max_steps=25, least_gain=0.1, damping_kept=2)
"""when the fit to a whole flight ends: the fit of all tosses begins from it"""
_MAX_STEPS = 6
"""number of steps after which the fit to a flight that grows ends"""
_LEAST_GAIN = 0.01
"""decrease of chi^2 in a step, as a fraction of what is usual, below which it ends as well"""
_HALVED_ABOVE = 3.0
"""chi^2, over what is usual, above which the first step to further frames must halve it, or they are not of
the flight"""
_MAX_PREDICTED_PX = 8.0
"""largest median distance of the corners in frames that are added from where the fit so far predicts them"""
_GUARD_FRAMES = 1
"""frames cut off at either end in any case, as the hand and the cushion push softly at first"""


def free_stretch(
    views: TossViews, tags: TagSet, camera: CameraModel, prior: FlightPrior, coarseness: float = 1.0
) -> tuple[int, int] | None:
    """Longest stretch [start, stop) of frames in which the body's poses are those of a free fall.

    Args:
        views: views of all frames of the toss.
        tags: the object's tags.
        camera: camera that took the frames.
        prior: body as known before.
        coarseness: errors of a body's place by one tag, over the usual ones.

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
        residual = _fall_residual(time[part], R[part], origin[part], R_camera_world, prior)
        if residual < _FREE_RATIO * coarseness:
            free[part] = True
    return _longest(free, time)


def grown_flight(
    body: ThrownBody,
    prior: FlightPrior,
    camera: CameraModel,
    tags: TagSet,
    views: TossViews,
    stretch: tuple[int, int],
) -> tuple[TossViews, TossFit] | None:
    """Views of the longest flight around the middle of a stretch of frames, with the fit to them alone.

    Frames in the middle, where no hand is near, are fitted first. Then frames after them, and after these
    frames before them, are added as long as the newest fit as well as the others. A hand pushes softly at its
    end: a fit that began near it would take its push for the motion of another centre of mass.

    Args:
        body: hull, mass and size of the body.
        prior: body as known before.
        camera: camera that took the frames.
        tags: the object's tags.
        views: views of all frames of the toss.
        stretch: first frame that seems free, and the one after the last.

    Returns:
        The views and the fit; None if no `_CORE_FRAMES` frames fit.
    """
    core = _core(body, prior, camera, tags, views, stretch)
    if core is None:
        return None
    begin, end, found = core
    most = end - begin
    for later, at_once in ((True, most), (False, most), (True, _LATE_FRAMES)):
        begin, end, found = _grown(views, begin, end, found, at_once, later=later)
    size = _frame_residuals(views.part(begin, end), found)
    fits = np.flatnonzero(size < _END_RATIO * max(1.0, float(np.median(size))))
    first, last = begin + int(fits[0]) + _GUARD_FRAMES, begin + int(fits[-1]) + 1 - _GUARD_FRAMES
    part = views.part(first, last)
    seconds = float(views.seconds[first] - views.seconds[begin])
    again = [(part, moved_in_time(found, seconds))]
    return part, fit_tosses(body, prior, camera, tags, again, found.x[: found.model.shared], _ENDING)


def _core(
    body: ThrownBody,
    prior: FlightPrior,
    camera: CameraModel,
    tags: TagSet,
    views: TossViews,
    stretch: tuple[int, int],
) -> tuple[int, int, TossFit] | None:
    """Frames [begin, end) that move freely, near the middle of a stretch, with the fit to them."""
    frames = max(_CORE_FRAMES, round(_CORE_S / float(np.median(np.diff(views.seconds)))))
    frames = min(frames, max(stretch[1] - stretch[0], _CORE_FRAMES))
    half = (stretch[1] - frames - stretch[0]) // 2
    away = np.arange(_MAX_CORES + 1) // 2 * (frames // 2) * np.where(np.arange(_MAX_CORES + 1) % 2, 1, -1)
    best: tuple[float, int, TossFit] | None = None
    for begin in (stretch[0] + half + away[np.abs(away) <= max(half, 0)]).tolist():
        part = views.part(begin, begin + frames)
        if len(part) < frames or np.diff(part.seconds).max() > _BRIDGED_S:
            continue
        fit = first_fit(part, tags, camera, body, prior)
        size = _rms(_frame_residuals(part, fit))
        if best is None or size < best[0]:
            best = size, begin, fit
        if size < _GOOD_CORE:
            break
    if best is None or _rms(best[2].residual) > _MAX_CORE_PX:
        return None
    return best[1], best[1] + frames, best[2]


def _grown(
    views: TossViews, begin: int, end: int, found: TossFit, most: int, *, later: bool
) -> tuple[int, int, TossFit]:
    """Frames [begin, end) of a flight with all those that belong to it on one side, and the fit to them.

    Args:
        views: views of all frames of the toss.
        begin: first frame of the flight so far.
        end: frame after its last.
        found: fit to the flight so far.
        most: largest number of frames to add at once.
        later: True to add later frames, False to add earlier ones.
    """
    more, failed = most // 2, False
    time = views.seconds
    while more:
        first, stop = (begin, min(end + more, len(views))) if later else (max(begin - more, 0), end)
        if stop - first == end - begin or np.diff(time[first:stop]).max() > _BRIDGED_S:
            break
        part = views.part(first, stop)
        added = part.frame >= end - begin if later else part.frame < begin - first
        fit = _extended(part, moved_in_time(found, float(time[first] - time[begin])), found, added)
        if fit is not None:
            begin, end, found = first, stop, fit
            more = more if failed else min(2 * more, most)
        else:
            failed, more = True, more // 2
    return begin, end, found


def moved_in_time(fit: TossFit, seconds: float) -> TossStart:
    """Motion of a fitted toss by some seconds after or before its first frame, without the air.

    Over a few frames; the middle between two rates takes Euler's equations to second order.
    """
    (start,) = fit.starts()
    inertia = unit_inertia(with_size(fit.x[SHAPE], fit.model.body.log_size))[0]
    change = seconds * np.linalg.solve(inertia, -np.cross(start.spin, inertia @ start.spin))
    gravity = fit.x[GRAVITY]
    return TossStart(
        start.R_world_object @ matrix_from_vector(seconds * (start.spin + 0.5 * change)),
        start.spin + change,
        start.place + seconds * start.velocity + 0.5 * seconds**2 * gravity,
        start.velocity + seconds * gravity,
    )


def _extended(views: TossViews, start: TossStart, fit: TossFit, added: NDArray[np.bool_]) -> TossFit | None:
    """Fit to a flight with further frames, which begins from the fit so far.

    None if the further frames do not belong to the flight: the fit so far predicts other places, or the new
    one fits the end that has grown worse than the rest.

    Args:
        views: views with the further frames.
        start: motion at the first of them by the fit so far.
        fit: the fit so far.
        added: (m,) True for views in further frames.
    """
    model = FlightModel(fit.model.body, fit.model.camera, fit.model.tags, [(views, start)])
    shared = fit.x[: fit.model.shared]
    predicted, _ = model(np.concatenate([shared, model.tosses[0][1].numbers]))
    off = np.abs(predicted - views.corners.ravel()).reshape(-1, 8)[added]
    if not float(np.median(off)) < _MAX_PREDICTED_PX:
        return None
    chi2 = fit.cost * len(views.frame) / len(fit.model.tosses[0][0].frame)
    new = fit_model(model, fit.prior, shared, Ending(_MAX_STEPS, _LEAST_GAIN * chi2, _HALVED_ABOVE * chi2))
    usual = max(_rms(_frame_residuals(fit.model.tosses[0][0], fit)), 1.0)
    fits_all = _rms(_frame_residuals(views, new)) < _MAX_GROWTH * usual
    return new if fits_all and _end_fits(views, new, last=bool(added[views.frame.argmax()])) else None


def _end_fits(views: TossViews, fit: TossFit, *, last: bool) -> bool:
    """True if the residuals in the last frames, or in the first ones, are like those of the others."""
    size = _frame_residuals(views, fit)
    end = size[-_END_FRAMES:] if last else size[:_END_FRAMES]
    return _rms(end) < _END_RATIO * max(1.0, float(np.median(size)))


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


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
    """Rms residual (n,) of the corners of each frame's best tag, in their standard deviations.

    Before a hand or a cushion all tags leave the flight; one that turns into view may be off by itself.
    """
    square = np.mean(fit.residual.reshape(-1, 8) ** 2, axis=1) / views.sd**2
    least = np.full(len(views), np.inf)
    np.minimum.at(least, views.frame, square)
    return np.sqrt(least)
