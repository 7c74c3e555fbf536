"""Where answers that should be alike are not, in words."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from analyze.estimation.agreement import Agreement, CentresApart, EstimatorsApart


@dataclass(frozen=True)
class Agreements:
    """Of all that can be compared."""

    recordings: Agreement
    centres: CentresApart
    estimators: tuple[EstimatorsApart, ...]
    """of strikes, only those that disagree"""

    def texts(self) -> Iterator[str]:
        """A sentence for each disagreement between estimators."""
        for each in self.estimators:
            yield f"strike {each.strike_id}: {apart_text(each)}"
        if not self.centres.agree:
            apart = f"{1e3 * self.centres.distance:.1f} mm from ours, {self.centres.sigmas:.1f} sd of both together"
            yield f"the paper's centre of mass lies {apart}: its angles are single moments of each strike, ours stand on whole motions"


def apart_text(each: EstimatorsApart) -> str:
    """By how much two estimators of a strike disagree."""
    if each.k_off is not None:
        return f"{each.other} makes k {100 * each.k_off:+.1f} % off {each.used}'s, {each.sigmas:.1f} sd of both together"
    return f"{each.other} puts φ {np.degrees(each.phi_off):+.2f}° off {each.used}'s, {each.sigmas:.1f} sd of both together"
