"""Predicted covariance of balance angle phi and k from one strike, by Fisher information (method 3).

k = m g R / I_edge [rad/s^2] is the rate constant of a tip: theta'' = -k sin(phi - theta).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from analyze.planning.impact import release_rate
from analyze.planning.pivots import Swing
from analyze.types import Array
from schemas.rig_limits import GOOD_TAG_EDGE_PX

FRAME_RATE = 120.0
"""Frame rate of the nominal camera [Hz]."""
FINE_RATE = 120.0
"""Smallest rate of integration steps [Hz]; slower frames are picked from among them."""
DENSE_RATE = 240.0
"""Frame rate [Hz] above which the information is proportional to the number of frames."""
PRIOR_SD = 1.0
"""Prior 1 sigma ([rad], or relative) of each unknown; it matters only where the frames are too few."""
FRAME_SD = np.radians(0.03)
"""1 sigma [rad] of the tip angle per frame for a tag of `FRAME_PX` seen along the pivot axis.

A plain square-marker pose has 0.07 degrees."""
FRAME_PX = 80.0
"""Edge in the image [px] of the tag that `FRAME_SD` belongs to."""
BEST_FRAME_SD = np.radians(0.01)
"""Smallest 1 sigma [rad] of the tip angle per frame, however large the tag: blur, lens."""
PAST_BALANCE = np.radians(25.0)
"""Angle [rad] past phi up to which a tip is tracked and fitted; beyond, friction no longer holds the edge."""
MAX_DURATION = 1.5
"""Longest motion [s]."""
STEP = 1e-4
"""Step of the numerical derivatives, relative or [rad]."""
MIN_ENERGY_RATIO = 1.01
"""Smallest energy ratio simulated; nearer to 1 the motion past balance lasts arbitrarily long."""


def frame_sd(tag_px: float) -> float:
    """1 sigma [rad] of the tip angle in one frame for a tag whose edge is `tag_px` [px] wide in the image.

    It is inversely proportional to the width, below `GOOD_TAG_EDGE_PX` to its square, and at least
    `BEST_FRAME_SD`.
    """
    width = max(tag_px, 1.0)
    return max(FRAME_SD * FRAME_PX / width * max(GOOD_TAG_EDGE_PX / width, 1.0), BEST_FRAME_SD)


@dataclass(frozen=True)
class TrackedSwing:
    """Expected swing of one strike, and the noise with which its tipping angle is tracked.

    The swing is theta'' = -k sin(phi - theta), with theta the tipping angle, phi the balance angle and k the
    rate constant.
    """

    expected: Swing
    """Expected swing, of which phi and k are used."""
    energy: float
    """Energy ratio E at release: energy over that needed to reach balance."""
    angle_sd: float
    """1 sigma of the tip angle per frame [rad]."""


def strike_covariances(strikes: Sequence[TrackedSwing], frame_rate: float = FRAME_RATE) -> list[Array]:
    """Covariance (2, 2) of balance angle phi [rad] and ln k that each strike gives (Fisher 1922).

    k is the rate constant of the tip, theta'' = -k sin(phi - theta), with theta the tipping angle. The angle
    and its rate at release are unknown too, and integrated out. Energy ratios (energy over that needed to
    reach balance) are raised to at least `MIN_ENERGY_RATIO`.

    Args:
        strikes: Strikes, integrated together.
        frame_rate: Frame rate of the camera [Hz].

    Returns:
        One covariance for each strike, in their order.
    """
    if not strikes:
        return []
    taken = min(frame_rate, DENSE_RATE)
    between = max(1, int(np.ceil(FINE_RATE / taken)))
    time = np.arange(0.0, MAX_DURATION, 1 / (taken * between))
    # The motion itself, then with phi, ln k, theta_0 and ln omega_0 increased and decreased.
    steps = np.vstack([np.zeros(4), STEP * np.eye(4), -STEP * np.eye(4)])
    rates = [release_rate(each.expected, max(each.energy, MIN_ENERGY_RATIO)) for each in strikes]
    phi = np.add.outer([each.expected.phi for each in strikes], steps[:, 0])
    k = np.multiply.outer([each.expected.k for each in strikes], np.exp(steps[:, 1]))
    theta, omega = np.tile(steps[:, 2], (len(strikes), 1)), np.multiply.outer(rates, np.exp(steps[:, 3]))
    paths = _motion(time, *(each.ravel() for each in (phi, k, theta, omega)))[::between]
    paths = paths.reshape(-1, len(strikes), len(steps))
    return [_covariance(paths[:, i], each, frame_rate / taken) for i, each in enumerate(strikes)]


def _covariance(theta: Array, strike: TrackedSwing, frames_per_row: float) -> Array:
    """Covariance (2, 2) of balance angle phi [rad] and ln k (rate constant of the tip) from one strike.

    The unknowns are phi, ln k, and theta_0 and ln omega_0 (tip angle and rate at release); derivatives of the
    motion by them are differences of motions with one unknown changed.

    Args:
        theta: (times, 9) tip angles [rad]: of the expected motion, then with phi, ln k, theta_0 and ln
            omega_0 each increased by `STEP`, then each decreased.
        strike: Expected swing and noise of the tip angle.
        frames_per_row: Number of camera frames that a row of `theta` stands for.
    """
    seen = np.cumsum(theta[:, 0] > strike.expected.phi + PAST_BALANCE) == 0
    rows = (theta[seen, 1:5] - theta[seen, 5:]) / (2 * STEP)
    known = rows.T @ rows / strike.angle_sd**2 * frames_per_row + np.eye(4) / PRIOR_SD**2
    return np.asarray(np.linalg.inv(known)[:2, :2], dtype=np.float64)


def _motion(time: Array, phi: Array, k: Array, theta: Array, omega: Array) -> Array:
    """Tipping angles theta (times, n) [rad] of n tips, by fourth-order Runge-Kutta.

    The equation of motion is theta'' = -k*sin(phi - theta).

    Args:
        time: (times,) times since release [s].
        phi: (n,) balance angles [rad].
        k: (n,) rate constants k [rad/s^2].
        theta: (n,) initial angles [rad].
        omega: (n,) initial rates [rad/s].
    """

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
