"""Ratio q of true to stated time in a video, from a tag that falls freely in view of the camera.

With the stated time tau, the true time t = q tau, the tag's position p(tau) in the camera frame, its rotation
R(tau), and p0, v0 and a the position, velocity and acceleration of the centre of mass at tau = 0,

    p(tau) = p0 + v0 tau + 1/2 a tau^2 + R(tau) r - drag + shutter,    norm(a) = q^2 g

The magnitude of g is known, its direction is not needed. The tag may turn: r is the arm from the centre of
mass to the tag, with prior standard deviation `ARM_SD`. Air decelerates by beta norm(v) v, beta = 1/2 rho C_d
A / m (air density rho, drag coefficient C_d, area A), which is the same in either time; a rolling shutter
exposes each row later by its line time. Both are unknowns with priors, so that the error of q includes them.
Lengths are relative to the tag: q is proportional to the root of its size.
"""

# scipy is only partly typed.
# pyright: reportMissingTypeStubs=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false, reportUnknownMemberType=false

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.integrate import cumulative_trapezoid
from scipy.spatial.transform import Rotation

from analyze.errors import EstimationError
from analyze.least_squares.robust import huber_weights
from analyze.motion.fall_window import MIN_FALL_M, MIN_FRAMES, FallWindow
from analyze.types import Array, MarkerTrack

ARM_SD = 0.05
"""standard deviation of the arm from the centre of mass to the tag [m]"""
AIR_DENSITY = 1.2
"""density of air [kg/m^3]"""
DRAG_COEFFICIENT = 1.2
"""drag coefficient of a plate that falls face on; edge on it is nearly zero"""
CARD_RATIO = 1.5
"""edge of the card that carries the tag, over the edge of the tag"""
TURN_DEGREE = 2
"""degree of the polynomial in time that smooths the tag's rotation: free rotation is smooth, the pose of one
frame is noisy"""
ROUNDS = 8
"""number of re-weighted solutions"""
TURNING_POINT_SIGMAS = 2.5
"""robust standard deviations above which a frame loses weight"""
MAX_EXCESS_MISFIT = 1.5
"""largest excess of the misfit over 1, times the root of the number of frames; a stretch is cut at its ends
until it fits as well"""
MAX_MISFIT = 3.0
"""largest misfit of a stretch that is a fall"""
MIN_IMPROVEMENT = 0.97
"""largest ratio of misfits after and before a useful cut; a smaller gain means that lens or codec cause the
misfit, not a hand at the ends"""
MARGIN_SHARE = 0.05
"""share of the frames left out at either end of a stretch that fits"""
CUT_SHARE = 0.06
"""share of the frames removed by one cut"""
MEDIAN_RMS, NINTH_DECILE_RMS = 0.89, 1.44
"""median and ninth decile of the root of a third of chi^2 with 3 degrees of freedom"""
MAX_LAG_ONE_CORRELATION = 0.9
"""upper bound of the residuals' correlation from frame to frame"""
LINE_TIME_SD_SHARE = 0.1
"""relative standard deviation of a line time that the camera file states"""
READ_OUT_SD_SHARE = 1 / np.sqrt(3.0)
"""standard deviation of an unknown read-out time over the frame's duration: anything up to the whole of it"""
FOCAL_SD_SHARE = 0.005
"""relative standard deviation of the focal length, which only affects motion along the line of sight"""


@dataclass(frozen=True)
class FallSetup:
    """Known quantities of a free fall: tag, gravity, falling mass and camera."""

    size: float
    """edge of the tag [m]"""
    size_sd: float
    """standard deviation of `size` [m]"""
    gravity: float
    """magnitude of g [m/s^2]"""
    gravity_sd: float
    """standard deviation of `gravity` [m/s^2]"""
    mass: float
    """mass of the falling body [kg]"""
    line_time: float | None
    """true time between rows [s]; 0 for a global shutter, None if unknown"""
    rows: int
    """number of rows of the image"""
    time_sd: float
    """standard deviation of a frame's stated time [s]"""

    @property
    def drag(self) -> tuple[float, float]:
        """Drag beta (deceleration over squared speed) of the card with the tag, and its sd, both [1/m].

        A card that falls face on has the largest beta, one that falls edge on has almost none. As the
        attitude is unknown, beta and its sd are each half of the largest value.
        """
        most = 0.5 * AIR_DENSITY * DRAG_COEFFICIENT * (CARD_RATIO * self.size) ** 2 / self.mass
        return most / 2, most / 2


@dataclass(frozen=True)
class Fall:
    """One free fall of the tag, with its estimate of q, the ratio of true to stated time."""

    start_ns: int
    """stated time of the first frame [ns]"""
    end_ns: int
    """stated time of the last frame [ns]"""
    frames: int
    """number of frames"""
    dropped: float
    """fall from rest in the time T from the first to the last frame, 1/2 a T^2 with a the acceleration [m]"""
    frame_s: float
    """stated time between frames [s]"""
    time_ratio: float
    """q, true seconds per stated second"""
    noise_sd: float
    """standard deviation of q caused by this fall's own noise"""
    shared_sd: float
    """standard deviation of q caused by the errors that all falls share: air, shutter, arm"""
    scatter: float
    """factor on the corners' stated noise: median residual over the expected one, increased by the
    correlation of neighbouring frames"""
    misfit: float
    """ninth decile of the residuals over the one expected from the noise"""
    residual: float
    """rms residual across the line of sight [m]"""
    drag_share: float
    """deceleration by air at the end of the fall, as a share of g"""
    blur_px: float
    """fastest motion per frame [px]"""


def settled_fall(track: MarkerTrack, covariance: Array, window: FallWindow, setup: FallSetup) -> Fall | None:
    """Fall fitted with its ends cut where a hand or the ground still acts; None if no fall is left.

    The fall returned holds q, the ratio of true to stated time, with its errors. The misfit is the ninth
    decile of the residuals over the value expected from noise. While it is too large, 6 % of the frames are
    cut at the end where that reduces it more, as long as it falls by 3 % or more; then 5 % are left out at
    both ends. None if the misfit stays above `MAX_MISFIT` (3), or the remaining fall is shorter than
    `MIN_FALL_M` (0.2 m).

    Args:
        track: track of the tag, not yet corrected for a rolling shutter.
        covariance: (n, 3, 3) covariance of its positions in the camera frame [m^2].
        window: stretch of the track that looks like a fall.
        setup: tag, gravity, falling mass and camera.

    Raises:
        EstimationError: the tag shows no acceleration in the window.
    """
    fall = fit_fall(track, covariance, window, setup)
    while fall.misfit > 1.0 + MAX_EXCESS_MISFIT / np.sqrt(fall.frames):
        cut = max(1, round(CUT_SHARE * fall.frames))
        if fall.frames - cut < MIN_FRAMES:
            break
        ends = (replace(window, start=window.start + cut), replace(window, stop=window.stop - cut))
        tried = [(fit_fall(track, covariance, end, setup), end) for end in ends]
        best, end = min(tried, key=lambda each: each[0].misfit)
        if best.misfit > MIN_IMPROVEMENT * fall.misfit:
            break
        fall, window = best, end
    # A release, or a landing, shows in the positions only after some frames.
    margin = max(1, round(MARGIN_SHARE * fall.frames))
    if fall.frames - 2 * margin >= MIN_FRAMES:
        fall = fit_fall(
            track, covariance, FallWindow(window.start + margin, window.stop - margin, window.fall), setup
        )
    return fall if fall.misfit <= MAX_MISFIT and fall.dropped >= MIN_FALL_M else None


def fit_fall(track: MarkerTrack, covariance: Array, window: FallWindow, setup: FallSetup) -> Fall:
    """Fit the motion of one free fall by generalised least squares with robust weights.

    Args:
        track: track of the tag, not yet corrected for a rolling shutter.
        covariance: (n, 3, 3) covariance of its positions in the camera frame [m^2].
        window: the frames of the fall.
        setup: tag, gravity, falling mass and camera.

    Returns:
        The fall with q, the ratio of true to stated time, the standard deviations of q, and the fit's
        residuals over those expected from noise.

    Raises:
        EstimationError: the tag shows no acceleration in the window.
    """
    part = slice(window.start, window.stop)
    stated = 1e-9 * (track.time_ns[part] - (track.time_ns[window.start] + track.time_ns[window.stop - 1]) / 2)
    p, P, seen = track.p_camera_marker[part], covariance[part], track.corners_px[part].mean(axis=1)
    turned = _turn_columns(track.R_camera_marker[part], stated)
    frame_s = _frame_s(stated)
    seen = seen - seen[len(seen) // 2]
    beta, beta_sd = setup.drag
    q, v, a = 1.0, np.zeros(3), np.zeros(3)
    weight = np.ones(len(p))
    time, scatter, solution, inverse = stated, 1.0, np.zeros(15), np.eye(15)
    off, each = np.zeros((len(p), 3)), np.ones(len(p))
    for number in range(ROUNDS):
        speed = v + a * stated[:, None]
        # A stated line time is in true seconds.
        known = 0.0 if setup.line_time is None else setup.line_time / q
        time = stated + known * seen[:, 1]
        shutter_sd = (
            READ_OUT_SD_SHARE * frame_s / setup.rows
            if setup.line_time is None
            else abs(known) * LINE_TIME_SD_SHARE
        )
        late = np.stack([speed * seen[:, 1:], speed * seen[:, :1]], axis=2)
        columns = np.concatenate(
            [
                _powers(time),
                turned,
                (-_drag(speed, stated))[:, :, None],
                late if number else np.zeros_like(late),
            ],
            axis=2,
        )
        prior = np.zeros(15)
        prior[12] = beta
        sd = np.concatenate(
            [np.full(9, 1e3), np.full(3, ARM_SD), [beta_sd], np.full(2, max(shutter_sd, 1e-12))]
        )
        if setup.line_time is not None:
            sd[14] = 1e-12
        whole = P + setup.time_sd**2 * speed[:, :, None] * speed[:, None, :]
        root = np.swapaxes(np.linalg.cholesky(np.linalg.inv(whole)), 1, 2)
        rows = np.einsum("nij,njc->nic", root, columns)
        target = np.einsum("nij,nj->ni", root, p)
        flat = (rows * np.sqrt(weight)[:, None, None]).reshape(-1, 15) * sd
        aim = (target * np.sqrt(weight)[:, None]).ravel() - flat @ (prior / sd)
        normal = flat.T @ flat / scatter**2 + np.eye(15)
        inverse = np.linalg.inv(normal) * np.outer(sd, sd)
        solution = prior + sd * np.linalg.solve(normal, flat.T @ aim / scatter**2)
        off = p - np.einsum("nic,c->ni", columns, solution)
        standardised = np.einsum("nij,nj->ni", root, off)
        each = np.linalg.norm(standardised, axis=1) / np.sqrt(3.0)
        rms = max(1.0, float(np.median(each)) / MEDIAN_RMS)
        weight = huber_weights(each, TURNING_POINT_SIGMAS, rms) ** 2
        scatter = rms * _correlation_sd_factor(standardised * np.sqrt(weight)[:, None])
        v, a = solution[3:6], solution[6:9]
        q = float(np.sqrt(np.linalg.norm(a) / setup.gravity))
        if not np.isfinite(q) or q <= 0:
            break
    if not np.isfinite(q) or q <= 0:
        raise EstimationError(
            "a stretch that looked like a fall has no acceleration:"
            " film the tag while it falls by 0.3 m or more"
        )
    misfit = float(np.quantile(each, 0.9)) / NINTH_DECILE_RMS
    return _fall(track, window, _Solved(stated, solution, inverse, q, scatter, misfit, off, weight))


@dataclass(frozen=True)
class _Solved:
    """Weighted least-squares fit of one fall of a tag: its motion, drag, and true over stated time.

    Positions, velocity, acceleration and residuals are in the camera frame; "per second" refers to the times
    that the video states. The arm, from the centre of mass to the tag, is in the marker frame.
    """

    stated: Array
    """(n,) stated time since the middle of the fall [s]"""
    solution: Array
    """(15,) at the fall's middle the tag's position, and velocity and acceleration of the centre of mass (3
    each) [m, m/s, m/s^2]; arm (3) [m], drag [1/m], delay per row and per column [s/px]"""
    inverse: Array
    """(15, 15) covariance of `solution`"""
    time_ratio: float
    """q, true seconds per stated second"""
    scatter: float
    """factor on the corners' stated noise, including correlation"""
    misfit: float
    """ninth decile of the residuals over the one expected from the noise"""
    off: Array
    """(n, 3) residuals [m]"""
    weight: Array
    """(n,) robust weights"""


def _fall(track: MarkerTrack, window: FallWindow, solved: _Solved) -> Fall:
    """Result of one fall: q with its error by this fall's own noise, and the error that all falls share.

    q is the ratio of true to stated time. The result also has the fall's length [m], residuals and blur.

    Args:
        track: track of the tag.
        window: the frames of the fall.
        solved: solution of the fall's least-squares fit.
    """
    solution, inverse, stated, q = solved.solution, solved.inverse, solved.stated, solved.time_ratio
    v, a = solution[3:6], solution[6:9]
    size = float(np.linalg.norm(a))
    along = a / size
    variance = float(along @ inverse[6:9, 6:9] @ along)
    # With the nuisance parameters known, the rest is this fall's own noise.
    nuisances = slice(9, 15)
    block = inverse[nuisances, nuisances]
    cross = inverse[6:9, nuisances]
    own = float(
        along @ (inverse[6:9, 6:9] - cross @ np.linalg.solve(block + 1e-30 * np.eye(6), cross.T)) @ along
    )
    own = min(max(own, 0.0), variance)
    to_q = q / (2 * size)
    sighted = float(along[2] ** 2)
    shared = variance - own + (FOCAL_SD_SHARE * sighted * size) ** 2
    last = v + a * stated[-1]
    moves = np.linalg.norm(np.diff(track.corners_px[window.start : window.stop].mean(axis=1), axis=0), axis=1)
    return Fall(
        start_ns=int(track.time_ns[window.start]),
        end_ns=int(track.time_ns[window.stop - 1]),
        frames=window.stop - window.start,
        dropped=0.5 * size * float(stated[-1] - stated[0]) ** 2,
        frame_s=_frame_s(stated),
        time_ratio=q,
        noise_sd=to_q * float(np.sqrt(own)),
        shared_sd=to_q * float(np.sqrt(shared)),
        scatter=solved.scatter,
        misfit=solved.misfit,
        residual=float(
            np.sqrt(np.average(np.sum(solved.off[:, :2] ** 2, axis=1) / 2, weights=solved.weight))
        ),
        drag_share=float(solution[12] * (last @ last) / size),
        blur_px=float(moves.max()),
    )


def _correlation_sd_factor(residuals: Array) -> float:
    """Factor >= 1 on a fit's standard deviations, as the residuals of neighbouring frames are correlated.

    Args:
        residuals: (n, 3) residuals of n frames, in order of time.
    """
    size = float(np.sum(residuals**2))
    r = float(np.sum(residuals[1:] * residuals[:-1])) / size if size > 0 else 0.0
    r = min(max(r, 0.0), MAX_LAG_ONE_CORRELATION)
    return float(np.sqrt((1 + r) / (1 - r)))


def _frame_s(stated: Array) -> float:
    """Mean time between frames [s] for stamps (n,) [s] that may be rounded and frames that may be missing."""
    steps = np.diff(stated)
    return float(stated[-1] - stated[0]) / float(np.sum(np.round(steps / np.median(steps))))


def _powers(time: Array) -> Array:
    """Derivatives (n, 3, 9) of a falling body's position at times (n,) [s] by p0, v0 and a.

    p0, v0 and a are its position, velocity and (constant) acceleration at time 0, of three columns each in
    this order; the derivatives are in the units 1, s and s^2.
    """
    eye = np.eye(3)
    return np.concatenate(
        [each[:, None, None] * eye for each in (np.ones_like(time), time, 0.5 * time**2)], axis=2
    )


def _turn_columns(R: Array, time: Array) -> Array:
    """Derivatives (n, 3, 3) of a turning tag's position by its arm from the centre of mass.

    The position is in the camera frame, the arm in the marker frame. The derivatives are R(tau) - R(middle),
    with R(tau) the rotation from marker to camera frame at the time tau, smoothed by a polynomial, and
    R(middle) that of the middle frame.

    Args:
        R: (n, 3, 3) rotations from the marker frame to the camera frame.
        time: (n,) stated times tau since the middle of the fall [s].
    """
    middle = Rotation.from_matrix(R[len(R) // 2])
    turns = (Rotation.from_matrix(R) * middle.inv()).as_rotvec()
    u = time / max(float(np.abs(time).max()), 1e-12)
    degree = min(TURN_DEGREE, max(1, len(u) // 6))
    fit = np.polynomial.polynomial.polyfit(u, turns, degree)
    smooth = np.stack([np.polynomial.polynomial.polyval(u, fit[:, i]) for i in range(3)], axis=1)
    return (Rotation.from_rotvec(smooth) * middle).as_matrix() - middle.as_matrix()


def _drag(speed: Array, time: Array) -> Array:
    """Double integral (n, 3) [m^2] of norm(v) v over time from the first time on, v the velocity.

    Times the drag beta [1/m] (deceleration over squared speed), it is the distance by which air holds the
    body back.

    Args:
        speed: (n, 3) velocities v [m/s].
        time: (n,) times [s].
    """
    push = np.linalg.norm(speed, axis=1, keepdims=True) * speed
    once = cumulative_trapezoid(push, time, axis=0, initial=0)
    return cumulative_trapezoid(once, time, axis=0, initial=0)
