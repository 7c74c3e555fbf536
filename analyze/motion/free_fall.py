"""How long a second of a film's times truly is, from a tag that falls freely before the camera.

In the stated time tau, with t = q tau the true one,

    p(tau) = p0 + v0 tau + 1/2 a tau^2 + R(tau) r - drag + shutter,    |a| = q^2 g

g's size is known, its direction is not asked for. The tag may turn: r is the arm from the centre of mass to the tag, unknown to
`ARM_SD`. Air slows by beta |v| v, beta = 1/2 rho C_d A / m, which is the same in either time; a rolling shutter sees a row later by its
line time. Both are unknowns with what is known of them beforehand, so that the error of q holds them. Lengths are the tag's: q goes with
the root of its size.
"""

# scipy is only partly typed; its unknowns are no mistakes of ours.
# pyright: reportMissingTypeStubs=false, reportUnknownVariableType=false, reportUnknownArgumentType=false, reportUnknownMemberType=false

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from analyze.errors import EstimationError
from analyze.least_squares.robust import huber_weights
from analyze.motion.fall_window import LEAST_FALL, LEAST_FRAMES, FallWindow
from analyze.types import Array, MarkerTrack

ARM_SD = 0.05
"""m, of the arm from the centre of mass to the tag"""
AIR_DENSITY = 1.2
DRAG_COEFFICIENT = 1.2
"""of a plate that falls face on; edge on it is nearly nothing"""
CARD = 1.5
"""edge of the card over that of the tag"""
TURN_DEGREE = 2
"""of the polynomial that follows the tag's turn: free turning is smooth, a pose of one frame is not"""
ROUNDS = 8
TURNING_POINT = 2.5
SETTLED = 1.5
"""over the root of the frames, above 1, of the residuals over the corners' noise: a stretch is cut at its ends until it fits so well"""
NO_FALL = 3.0
"""the same, of a stretch that is no fall"""
GAINED = 0.97
"""of the misfit, that a cut must reach: what a lens or a codec bends is no end that was touched"""
MARGIN = 0.05
"""of its frames, left out at either end of what then fits"""
CUT = 0.06
"""of its frames, at a time"""
MIDDLE, NINTH = 0.89, 1.44
"""of the root of a third of chi squared with 3 degrees of freedom: its middle, and what one in ten is above"""
MOST_ALIKE = 0.9
LINE_TIME_KNOWN = 0.1
"""relative, of a line time that the camera file states"""
READ_OUT = 1 / np.sqrt(3.0)
"""of a frame's duration, 1 sigma of how long an unknown shutter takes over all rows: anything up to the whole of it"""
FOCAL_SD = 0.005
"""relative, of the focal length: only what moves along the line of sight feels it"""


@dataclass(frozen=True)
class Film:
    """What the fit must know beside the track."""

    size: float
    """m, of the tag"""
    size_sd: float
    gravity: float
    gravity_sd: float
    mass: float
    """kg, of what falls"""
    line_time: float | None
    """s, true; 0 where all rows are read at once, None where nobody knows"""
    rows: int
    """of the image"""
    time_sd: float
    """s, of a frame's stated time"""

    @property
    def drag(self) -> tuple[float, float]:
        """Beta [1/m] and 1 sigma: between a card that falls face on and one that falls edge on."""
        most = 0.5 * AIR_DENSITY * DRAG_COEFFICIENT * (CARD * self.size) ** 2 / self.mass
        return most / 2, most / 2


@dataclass(frozen=True)
class Fall:
    """One fall."""

    start_ns: int
    end_ns: int
    frames: int
    dropped: float
    """m, 1/2 a T^2: what a body would fall in the time from its first to its last frame"""
    frame_s: float
    """stated time between frames"""
    slower: float
    """q, true seconds in a stated one"""
    noise_sd: float
    """1 sigma of q from this fall's own noise"""
    shared_sd: float
    """the same from what all falls share: air, shutter, arm"""
    scatter: float
    """of the residuals over what the corners' noise would have, by the middle one; more where neighbours share their errors"""
    misfit: float
    """of the residuals alone, by the ninth of ten"""
    residual: float
    """m, rms across the line of sight"""
    drag_share: float
    """what air takes of g at the fall's end"""
    blur_px: float
    """fastest move per frame, px"""


def settled_fall(track: MarkerTrack, covariance: Array, window: FallWindow, film: Film) -> Fall | None:
    """`fit_fall`, without the ends of a stretch that reaches into the hand or the ground; None where no fall is left."""
    fall = fit_fall(track, covariance, window, film)
    while fall.misfit > 1.0 + SETTLED / np.sqrt(fall.frames):
        cut = max(1, round(CUT * fall.frames))
        if fall.frames - cut < LEAST_FRAMES:
            break
        ends = (replace(window, start=window.start + cut), replace(window, stop=window.stop - cut))
        tried = [(fit_fall(track, covariance, end, film), end) for end in ends]
        best, end = min(tried, key=lambda each: each[0].misfit)
        if best.misfit > GAINED * fall.misfit:
            break
        fall, window = best, end
    # A hand lets go, and a fall ends, a little before that shows.
    margin = max(1, round(MARGIN * fall.frames))
    if fall.frames - 2 * margin >= LEAST_FRAMES:
        fall = fit_fall(
            track, covariance, FallWindow(window.start + margin, window.stop - margin, window.fall), film
        )
    return fall if fall.misfit <= NO_FALL and fall.dropped >= LEAST_FALL else None


def fit_fall(track: MarkerTrack, covariance: Array, window: FallWindow, film: Film) -> Fall:
    """Generalised least squares with robust weights.

    Args:
        track: of the tag, as a camera whose rows are read at once would give it.
        covariance: (n, 3, 3) m^2 of its positions.
        window: the frames of the fall.
        film: tag, gravity, camera.

    Raises:
        EstimationError: the stretch does not tell.
    """
    part = slice(window.start, window.stop)
    stated = 1e-9 * (track.time_ns[part] - (track.time_ns[window.start] + track.time_ns[window.stop - 1]) / 2)
    p, P, seen = track.p_camera_marker[part], covariance[part], track.corners_px[part].mean(axis=1)
    turned = _turned(track.R_camera_marker[part], stated)
    frame_s = _frame_s(stated)
    seen = seen - seen[len(seen) // 2]
    beta, beta_sd = film.drag
    q, v, a = 1.0, np.zeros(3), np.zeros(3)
    weight = np.ones(len(p))
    time, scatter, solution, inverse = stated, 1.0, np.zeros(15), np.eye(15)
    off, each = np.zeros((len(p), 3)), np.ones(len(p))
    for number in range(ROUNDS):
        speed = v + a * stated[:, None]
        # A stated line time is in true seconds.
        known = 0.0 if film.line_time is None else film.line_time / q
        time = stated + known * seen[:, 1]
        shutter_sd = (
            READ_OUT * frame_s / film.rows if film.line_time is None else abs(known) * LINE_TIME_KNOWN
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
        if film.line_time is not None:
            sd[14] = 1e-12
        whole = P + film.time_sd**2 * speed[:, :, None] * speed[:, None, :]
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
        rms = max(1.0, float(np.median(each)) / MIDDLE)
        weight = huber_weights(each, TURNING_POINT, rms) ** 2
        scatter = rms * _alike(standardised * np.sqrt(weight)[:, None])
        v, a = solution[3:6], solution[6:9]
        q = float(np.sqrt(np.linalg.norm(a) / film.gravity))
        if not np.isfinite(q) or q <= 0:
            break
    if not np.isfinite(q) or q <= 0:
        raise EstimationError(
            "a stretch that looked like a fall has no acceleration: film the tag while it falls by 0.3 m or more"
        )
    return _fall(
        track,
        window,
        stated,
        solution,
        inverse,
        q,
        scatter,
        float(np.quantile(each, 0.9)) / NINTH,
        off,
        weight,
    )


def _fall(
    track: MarkerTrack,
    window: FallWindow,
    stated: Array,
    solution: Array,
    inverse: Array,
    q: float,
    scatter: float,
    misfit: float,
    off: Array,
    weight: Array,
) -> Fall:
    v, a = solution[3:6], solution[6:9]
    size = float(np.linalg.norm(a))
    along = a / size
    variance = float(along @ inverse[6:9, 6:9] @ along)
    # With the nuisances known the rest is this fall's own noise.
    nuisances = slice(9, 15)
    block = inverse[nuisances, nuisances]
    cross = inverse[6:9, nuisances]
    own = float(
        along @ (inverse[6:9, 6:9] - cross @ np.linalg.solve(block + 1e-30 * np.eye(6), cross.T)) @ along
    )
    own = min(max(own, 0.0), variance)
    to_q = q / (2 * size)
    sighted = float(along[2] ** 2)
    shared = variance - own + (FOCAL_SD * sighted * size) ** 2
    last = v + a * stated[-1]
    moves = np.linalg.norm(np.diff(track.corners_px[window.start : window.stop].mean(axis=1), axis=0), axis=1)
    return Fall(
        start_ns=int(track.time_ns[window.start]),
        end_ns=int(track.time_ns[window.stop - 1]),
        frames=window.stop - window.start,
        dropped=0.5 * size * float(stated[-1] - stated[0]) ** 2,
        frame_s=_frame_s(stated),
        slower=q,
        noise_sd=to_q * float(np.sqrt(own)),
        shared_sd=to_q * float(np.sqrt(shared)),
        scatter=scatter,
        misfit=misfit,
        residual=float(np.sqrt(np.average(np.sum(off[:, :2] ** 2, axis=1) / 2, weights=weight))),
        drag_share=float(solution[12] * (last @ last) / size),
        blur_px=float(moves.max()),
    )


def _alike(residuals: Array) -> float:
    """By how much errors that neighbours share (n, 3), of a codec or a lens, weigh more than as many that they do not."""
    size = float(np.sum(residuals**2))
    r = float(np.sum(residuals[1:] * residuals[:-1])) / size if size > 0 else 0.0
    r = min(max(r, 0.0), MOST_ALIKE)
    return float(np.sqrt((1 + r) / (1 - r)))


def _frame_s(stated: Array) -> float:
    """Mean time between frames [s], of stamps that may be rounded and frames that may be missing."""
    steps = np.diff(stated)
    return float(stated[-1] - stated[0]) / float(np.sum(np.round(steps / np.median(steps))))


def _powers(time: Array) -> Array:
    """(n, 3, 9): of p0, v0, a."""
    eye = np.eye(3)
    return np.concatenate(
        [each[:, None, None] * eye for each in (np.ones_like(time), time, 0.5 * time**2)], axis=2
    )


def _turned(R: Array, time: Array) -> Array:
    """(n, 3, 3): the tag's turn R(tau) - R(0), smooth in time."""
    middle = Rotation.from_matrix(R[len(R) // 2])
    turns = (Rotation.from_matrix(R) * middle.inv()).as_rotvec()
    u = time / max(float(np.abs(time).max()), 1e-12)
    degree = min(TURN_DEGREE, max(1, len(u) // 6))
    fit = np.polynomial.polynomial.polyfit(u, turns, degree)
    smooth = np.stack([np.polynomial.polynomial.polyval(u, fit[:, i]) for i in range(3)], axis=1)
    return (Rotation.from_rotvec(smooth) * middle).as_matrix() - middle.as_matrix()


def _drag(speed: Array, time: Array) -> Array:
    """(n, 3): how far drag of beta = 1 would have moved it, up to a straight line."""
    push = np.linalg.norm(speed, axis=1, keepdims=True) * speed
    steps = np.diff(time)[:, None]
    once = np.vstack([np.zeros(3), np.cumsum((push[1:] + push[:-1]) / 2 * steps, axis=0)])
    return np.vstack([np.zeros(3), np.cumsum((once[1:] + once[:-1]) / 2 * steps, axis=0)])


@dataclass(frozen=True)
class TrueTime:
    """What all falls tell together."""

    slower: float
    """q, true seconds in a stated one"""
    sd: float
    """1 sigma, all together"""
    by_noise: float
    """1 sigma from the falls' scatter, air, shutter and arm"""
    by_size: float
    """1 sigma from the tag's size"""
    by_gravity: float
    """1 sigma from g"""
    apart: float
    """rms of the falls' differences over their own noise; 1 is usual"""


def true_time(falls: list[Fall], film: Film) -> TrueTime:
    """Weighted mean; what falls share is not averaged out, and falls that scatter more than they should are widened (Birge 1932)."""
    noise = np.array([fall.noise_sd for fall in falls])
    shared = np.array([fall.shared_sd for fall in falls])
    weight = 1 / (noise**2 + shared**2)
    weight = weight / weight.sum()
    each = np.array([fall.slower for fall in falls])
    q = float(weight @ each)
    apart = (
        float(np.sqrt(np.sum(((each - q) ** 2) / (noise**2 + shared**2)) / (len(falls) - 1)))
        if len(falls) > 1
        else 1.0
    )
    own = float(np.sqrt(np.sum((weight * noise) ** 2))) * max(1.0, apart)
    together = float(np.hypot(own, weight @ shared))
    by_size, by_gravity = q * film.size_sd / film.size / 2, q * film.gravity_sd / film.gravity / 2
    return TrueTime(
        q, float(np.sqrt(together**2 + by_size**2 + by_gravity**2)), together, by_size, by_gravity, apart
    )
