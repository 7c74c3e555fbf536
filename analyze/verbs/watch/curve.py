"""Curve of a judged strike for a drawing: tipping angle over time, measured and fitted."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from schemas.watch_lines import MAX_CURVE_POINTS, StrikeCurve

if TYPE_CHECKING:
    from analyze.types import IntArray, TipMotion

BEFORE_S, AFTER_S = 0.1, 0.4
"""time before the contact, and after the fitted part of the motion, that the curve shows [s]"""
UNFITTED_S = 1.8
"""time after the contact that the curve of a strike without a fit shows [s]"""


def strike_curve(motion: TipMotion, contact_ns: int | None) -> StrikeCurve | None:
    """Curve of a strike, thinned out to at most MAX_CURVE_POINTS points; None if the object was not followed.

    Args:
        motion: the analysed strike.
        contact_ns: log time of the contact [ns]; None if it is not known.
    """
    angle, fit = motion.angle, motion.fit
    if angle is None or not len(angle.time_ns):
        return None
    time_s = 1e-9 * (angle.time_ns - (int(angle.time_ns[0]) if contact_ns is None else contact_ns))
    end_s = UNFITTED_S if fit is None else float(time_s[fit.window[1] - 1]) + AFTER_S
    shown = _thinned(np.flatnonzero((time_s >= -BEFORE_S) & (time_s <= end_s)))
    fit_time_s: list[float] = []
    fit_rad: list[float] = []
    if fit is not None and len(fit.residual):
        start, stop = fit.window
        kept = _thinned(np.arange(start, stop))
        fit_time_s = np.round(time_s[kept], 5).tolist()
        fit_rad = np.round(angle.theta[kept] - fit.residual[kept - start], 6).tolist()
    return StrikeCurve(
        time_s=np.round(time_s[shown], 5).tolist(),
        theta_rad=np.round(angle.theta[shown], 6).tolist(),
        fit_time_s=fit_time_s,
        fit_rad=fit_rad,
    )


def _thinned(index: IntArray) -> IntArray:
    """Every n-th of the indices (k,), so that at most MAX_CURVE_POINTS remain."""
    return index[:: max(1, -(-len(index) // MAX_CURVE_POINTS))]
