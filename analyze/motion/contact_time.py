"""Contact time of a strike from its motion, for a hand or a pendulum without a contact sensor.

The fitted pendulum is extrapolated back to the tipping angle theta = 0, where the object stood until the
contact: with omega the angular speed after the impact, phi the balance angle, k the pendulum's rate [rad/s^2]
and t_c the contact time,

    theta(t) = omega (t - t_c) - 1/2 k sin(phi) (t - t_c)^2

near the start, so that t_c is the moment at which an instantaneous impact would have given this motion. A
real touch takes time; t_c lies within it, in its middle if it is symmetric. First touch is half its duration
earlier.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from analyze.types import MotionFit

MAX_TOUCH_S = 0.008
"""longest touch that counts as an impact [s]: that of a soft fingertip; a servo's steel tip touches for 3
ms"""


@dataclass(frozen=True)
class ContactTime:
    """Time of an impact on the recording's clock, estimated from the motion after it, and its sd [ns]."""

    time_ns: int
    """log_time of the impact [ns]"""
    sd_ns: float
    """standard deviation [ns] as an estimate of the first touch: error of the fit, and a touch that lasts 0
    to `MAX_TOUCH_S`"""


def contact_time(fit: MotionFit) -> ContactTime | None:
    """Time of the striker's contact, from the motion extrapolated back to tipping angle 0; or None.

    The time is given on the recording's clock (log_time), with its sd, both in ns.

    None if the fit has no rate constant k of the tip [rad/s^2], or in its first frame the object does not tip
    forward (angular speed omega0 <= 0) or lies below rest (tipping angle theta0 < 0).

    Args:
        fit: pendulum fitted to the free motion of one strike, which is extrapolated.
    """
    if fit.k is None or fit.omega0 <= 0 or fit.theta0 < 0:
        return None
    slowing = fit.k * math.sin(fit.phi)
    since_s = (
        (math.sqrt(fit.omega0**2 + 2 * slowing * fit.theta0) - fit.omega0) / slowing
        if slowing > 0
        else fit.theta0 / fit.omega0
    )
    noise_s = float(np.sqrt(np.mean(fit.residual**2))) / fit.omega0 if len(fit.residual) else 0.0
    # First touch is up to half the duration earlier; for a push that grows slowly it is up to half later.
    touch_s = MAX_TOUCH_S / 2 / math.sqrt(3)
    return ContactTime(fit.time0_ns - round(since_s * 1e9), math.hypot(noise_s, touch_s) * 1e9)
