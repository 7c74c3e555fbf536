"""Design of the few strikes that measure the size of the moments of an object that is tossed, too."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from analyze.planning.design import Design
from analyze.planning.information import INERTIA, moment_row

if TYPE_CHECKING:
    from analyze.planning.information import Information

TOSSED_COM_SD = 3e-4
"""1 sigma of c along each direction by tosses [m]."""


def choose_scale_design(information: Information, strikes: int) -> Design | None:
    """Design for a body whose tosses give all but the size of its tensor: all strikes on the best axis.

    The best axis is the one about which the moment is determined best, over its size, with the centre of
    mass known to `TOSSED_COM_SD`.

    Args:
        information: Candidates, prior knowledge and errors.
        strikes: Number of strikes.

    Returns:
        The design; None without a candidate or strike.
    """
    belief = replace(information.belief, com_sd=min(TOSSED_COM_SD, information.belief.com_sd))
    known = replace(information, belief=belief)

    def relative_sd(number: int) -> float:
        line = known.candidates[number].axis.direction
        covariance = known.covariance([known.candidates[number]], (strikes,))
        by = moment_row(line)
        return float(np.sqrt(by @ covariance[INERTIA, INERTIA] @ by) / (line @ belief.inertia @ line))

    if not known.candidates or strikes < 1:
        return None
    best = min(range(len(known.candidates)), key=relative_sd)
    return Design((best,), (strikes,), known.covariance([known.candidates[best]], (strikes,)))
