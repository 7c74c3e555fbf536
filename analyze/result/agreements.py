"""Sentences about disagreements between a strike's estimators, and with the paper's centre of mass.

The paper is VISAPP 2013.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Iterator

    from analyze.estimation.agreement import EstimatorDisagreement
    from analyze.pipeline.estimate import Agreements


def disagreement_texts(agreements: Agreements) -> Iterator[str]:
    """Yield one sentence per pair of estimators that disagree on a strike, and one on the centres of mass.

    The last is yielded only if the centre of mass by the paper's method (VISAPP 2013) differs from the joint
    estimate by more than 3 sd. Nothing is yielded if all agree.
    """
    for each in agreements.estimators:
        yield f"strike {each.strike_id}: {estimator_difference_text(each)}"
    centres = agreements.centres
    if centres is not None and not centres.agree:
        yield (
            f"the paper's centre of mass lies {1e3 * centres.distance:.1f} mm from ours, {centres.sigmas:.1f}"
            " combined sd: it uses one instant of each strike, ours the whole motion"
        )


def estimator_difference_text(each: EstimatorDisagreement) -> str:
    """Clause on the difference between two estimators of one strike's motion, with its size in sd.

    It states the relative difference [%] of the rate constant k if `each.k_off` is given, otherwise the
    difference [°] of the balance angle φ: the other estimator minus the one used. The motion of the tipping
    angle θ is θ'' = -k sin(φ - θ).
    """
    if each.k_off is not None:
        return (
            f"k by {each.other} differs from {each.used}'s by {100 * each.k_off:+.1f} %, {each.sigmas:.1f}"
            " combined sd"
        )
    return (
        f"φ by {each.other} differs from {each.used}'s by {np.degrees(each.phi_off):+.2f}°, {each.sigmas:.1f}"
        " combined sd"
    )
