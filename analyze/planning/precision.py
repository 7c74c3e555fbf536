"""How well one strike will tell phi and k: the information of a tip seen at the camera's rate (Fisher 1922; METHOD section 3)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from analyze.planning.impact import release_rate
from analyze.planning.pivots import Swing
from analyze.types import Array

FRAME_RATE = 120.0
"""Hz, of the nominal camera"""
FINE_RATE = 120.0
"""Hz, steps of the motion: slower frames are picked from among them"""
DENSE_RATE = 240.0
"""Hz, beyond which twice the frames tell just twice as much"""
UNKNOWN = 1.0
"""1 sigma (rad, or relative) of each unknown before the strike: only where the frames are too few to tell them does it matter"""
FRAME_SD = np.radians(0.03)
"""rad per frame, of a tag `FRAME_PX` wide that is seen along the pivot axis; a plain square-marker pose has 0.07 degrees"""
FRAME_PX = 80.0
BEST_FRAME_SD = np.radians(0.01)
"""however large the tag: blur, lens"""
PAST_BALANCE = np.radians(25.0)
"""where the window of the fit ends: friction gives out"""
LONGEST = 1.5
"""s"""
STEP = 1e-4
"""of the difference quotients, relative or rad"""
SLOWEST_OVER = 1.01
"""energy ratio below which the motion is taken as one that just comes over: nearer the top it lasts for ever"""


def frame_sd(tag_px: float) -> float:
    """1 sigma [rad] of the tip angle in one frame for a tag whose edge is `tag_px` wide."""
    return max(FRAME_SD * FRAME_PX / max(tag_px, 1.0), BEST_FRAME_SD)


@dataclass(frozen=True)
class SeenSwing:
    """A strike as the camera sees it."""

    expected: Swing
    """phi and k count"""
    energy: float
    """E at release"""
    angle_sd: float
    """rad per frame"""


def strike_covariances(strikes: Sequence[SeenSwing], frame_rate: float = FRAME_RATE) -> list[Array]:
    """Covariance (2, 2) of phi [rad] and ln k from each strike; theta and theta' at release are unknown too.

    Args:
        strikes: n, integrated together.
        frame_rate: Hz.
    """
    if not strikes:
        return []
    taken = min(frame_rate, DENSE_RATE)
    between = max(1, int(np.ceil(FINE_RATE / taken)))
    time = np.arange(0.0, LONGEST, 1 / (taken * between))
    # The motion itself, then with phi, ln k, theta_0 and ln omega_0 a little larger and smaller.
    steps = np.vstack([np.zeros(4), STEP * np.eye(4), -STEP * np.eye(4)])
    starts: list[Array] = []
    for each in strikes:
        rate = release_rate(each.expected, max(each.energy, SLOWEST_OVER))
        swing = each.expected
        starts.append(np.stack([swing.phi + steps[:, 0], swing.k * np.exp(steps[:, 1]), steps[:, 2], rate * np.exp(steps[:, 3])]))
    paths = _motion(time, *np.hstack(starts))[::between].reshape(-1, len(strikes), len(steps))
    return [_told(paths[:, i], each, frame_rate / taken) for i, each in enumerate(strikes)]


def _told(theta: Array, strike: SeenSwing, frames_per_row: float) -> Array:
    """Covariance (2, 2) from the motion (times, 9): itself, and with each unknown a little larger and smaller."""
    seen = np.cumsum(theta[:, 0] > strike.expected.phi + PAST_BALANCE) == 0
    rows = (theta[seen, 1:5] - theta[seen, 5:]) / (2 * STEP)
    known = rows.T @ rows / strike.angle_sd**2 * frames_per_row + np.eye(4) / UNKNOWN**2
    return np.asarray(np.linalg.inv(known)[:2, :2], dtype=np.float64)


def _motion(time: Array, phi: Array, k: Array, theta: Array, omega: Array) -> Array:
    """Theta (times, n) of theta'' = -k*sin(phi - theta) at even `time` steps, by Runge and Kutta's fourth order; the rest (n,) each."""

    def rates(a: Array, b: Array) -> tuple[Array, Array]:
        return b, -k * np.sin(phi - a)

    path = [theta]
    for h in np.diff(time).tolist():
        a1, b1 = rates(theta, omega)
        a2, b2 = rates(theta + h / 2 * a1, omega + h / 2 * b1)
        a3, b3 = rates(theta + h / 2 * a2, omega + h / 2 * b2)
        a4, b4 = rates(theta + h * a3, omega + h * b3)
        theta = theta + h / 6 * (a1 + 2 * a2 + 2 * a3 + a4)
        omega = omega + h / 6 * (b1 + 2 * b2 + 2 * b3 + b4)
        path.append(theta)
    return np.array(path)
