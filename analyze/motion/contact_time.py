"""When a strike came, from the motion it left behind: for a hand or a pendulum, whose touch nobody feels.

The fitted pendulum is followed back to theta = 0, where it stood until then:

    theta(t) = omega (t - t_c) - 1/2 k sin(phi) (t - t_c)^2

near the start, so that t_c is the moment at which one blow would have given this motion. A touch takes its time; t_c lies within it,
for one that is symmetric in its middle. First touch is half its duration earlier.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from analyze.types import MotionFit

TOUCH_S = 0.008
"""the longest touch that is taken for a blow: a soft fingertip's; a servo's steel tip has 3 ms"""


@dataclass(frozen=True)
class ContactTime:
    """The moment of a blow."""

    time_ns: int
    """on the clock of the fit"""
    sd_ns: float
    """1 sigma, as the time of first touch: fit, and a touch of 0 to `TOUCH_S`"""


def contact_time(fit: MotionFit) -> ContactTime | None:
    """Contact of the motion that `fit` follows; None where it does not begin with a tip out of rest."""
    if fit.k is None or fit.omega0 <= 0 or fit.theta0 < 0:
        return None
    slowing = fit.k * math.sin(fit.phi)
    since_s = (
        (math.sqrt(fit.omega0**2 + 2 * slowing * fit.theta0) - fit.omega0) / slowing
        if slowing > 0
        else fit.theta0 / fit.omega0
    )
    noise_s = float(np.sqrt(np.mean(fit.residual**2))) / fit.omega0 if len(fit.residual) else 0.0
    touch_s = (
        TOUCH_S / 2 / math.sqrt(3)
    )  # first touch is up to half of it earlier, later by as much for a push that swells
    return ContactTime(fit.time0_ns - round(since_s * 1e9), math.hypot(noise_s, touch_s) * 1e9)
