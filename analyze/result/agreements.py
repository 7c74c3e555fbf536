"""Sentences on answers that should agree and do not."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Iterator

    from analyze.estimation.agreement import EstimatorDisagreement
    from analyze.pipeline.estimate import Agreements


def disagreement_texts(agreements: Agreements) -> Iterator[str]:
    """Yield a sentence for each disagreement between estimators, and with the paper's centre of mass."""
    for each in agreements.estimators:
        yield f"strike {each.strike_id}: {estimators_apart_text(each)}"
    centres = agreements.centres
    if not centres.agree:
        yield (
            f"the paper's centre of mass lies {1e3 * centres.distance:.1f} mm from ours, {centres.sigmas:.1f}"
            " sd of both together: it uses one instant of each strike, ours the whole motion"
        )


def estimators_apart_text(each: EstimatorDisagreement) -> str:
    """Difference between two estimators of one strike, in phi or k, with its significance."""
    if each.k_off is not None:
        return (
            f"{each.other} gives a k {100 * each.k_off:+.1f} % off {each.used}'s, {each.sigmas:.1f} sd of"
            " both together"
        )
    return (
        f"{each.other} gives a φ {np.degrees(each.phi_off):+.2f}° off {each.used}'s, {each.sigmas:.1f} sd of"
        " both together"
    )
