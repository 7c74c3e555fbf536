"""Ratio q of true to stated time in a video: mean over free falls of a tag, with its error."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from analyze.motion.free_fall import Fall, FallSetup


@dataclass(frozen=True)
class TrueTime:
    """Ratio q of a video's true to stated seconds from filmed free falls of a tag, with its sd.

    The parts of the standard deviation (sd) by source of error are given too.
    """

    time_ratio: float
    """q, true seconds per stated second"""
    sd: float
    """standard deviation of q"""
    by_noise: float
    """standard deviation of q caused by the falls' scatter, air, shutter and arm"""
    by_size: float
    """standard deviation of q caused by the tag's size"""
    by_gravity: float
    """standard deviation of q caused by g"""
    birge_ratio: float
    """rms difference of the falls over their own noise; 1 is usual"""


def true_time(falls: list[Fall], setup: FallSetup) -> TrueTime:
    """Weighted mean over all falls of q, the ratio of true to stated time, with its standard deviation.

    Stated is the time by the video's time stamps. The error by the falls' own noise is widened where their q
    differ more than their errors allow (Birge 1932). Errors that the falls share do not shrink with their
    number.

    Args:
        falls: at least one fall.
        setup: tag and gravity, whose errors are added.
    """
    noise = np.array([fall.noise_sd for fall in falls])
    shared = np.array([fall.shared_sd for fall in falls])
    weight = 1 / (noise**2 + shared**2)
    weight = weight / weight.sum()
    each = np.array([fall.time_ratio for fall in falls])
    q = float(weight @ each)
    birge_ratio = (
        float(np.sqrt(np.sum(((each - q) ** 2) / (noise**2 + shared**2)) / (len(falls) - 1)))
        if len(falls) > 1
        else 1.0
    )
    own = float(np.sqrt(np.sum((weight * noise) ** 2))) * max(1.0, birge_ratio)
    together = float(np.hypot(own, weight @ shared))
    by_size, by_gravity = q * setup.size_sd / setup.size / 2, q * setup.gravity_sd / setup.gravity / 2
    return TrueTime(
        q,
        float(np.sqrt(together**2 + by_size**2 + by_gravity**2)),
        together,
        by_size,
        by_gravity,
        birge_ratio,
    )
