"""Predicted precision of a design: sd of results, sources of c's error, gain of more strikes.

c is the centre of mass. The predicted balance angle phi of one strike is in pivots.py, its standard deviation
in examine.py.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from analyze.planning.design import Design, choose_design
from analyze.planning.information import COM, INERTIA, MASS, Candidate, Information, moment_row
from analyze.types import TENSOR_ENTRIES, Array
from schemas.wording import counted

MIN_GAIN_PER_DOUBLING = 0.10
"""Relative decrease of c's error, for each doubling of the number of strikes, above which more strikes
pay."""
MAX_STRIKES = 36
"""Largest number of strikes tried for a target, unless more are requested."""
UNLIMITED_STRIKES = 100_000
"""Strikes per axis that represent any number."""
MOMENT_DETERMINED = 0.5
"""Fraction of the shape's prior sd below which a moment counts as determined."""
SHAPE_MOMENT_SD = 0.25
"""Relative 1 sigma of a moment estimated from the shape alone."""
REMEDIES = {
    "tilt of gravity": (
        "strike an edge turned as well (`analyze plan --gravity`), or write what a level shows into the rig "
        "file's [level]"
    ),
    "radius of the edges": "measure edge_radius_m",
    "place of the edges": "a better scan",
    "scale of the shape": "measure a length of the object and correct the shape's scale",
    "angle error of an axis": "strike other edges as well",
    "mass": "a better balance",
    "gravity": "give g_m_s2 of your place in the rig file",
}
"""Remedies by error source."""


@dataclass(frozen=True)
class AxisForecast:
    """Predicted 1 sigma of phi, k and two moments of inertia for one struck axis.

    phi [rad] is the balance angle, k = m g R / I_edge the rate constant of the tip, whose sigma is relative
    (m mass, g gravity, R distance of c from the edge), I_edge [kg m^2] the moment of inertia about the edge,
    c the centre of mass. The second moment is about the parallel axis through c.
    """

    axis_id: str
    """Id of the pivot axis."""
    phi_sd: float
    """1 sigma of phi from one strike [rad]."""
    k_sd: float
    """Relative 1 sigma of k from one strike."""
    i_edge: float
    """1 sigma of I_edge from one strike [kg m^2]."""
    i_com: float
    """1 sigma of the moment about the parallel axis through c, from all strikes [kg m^2]."""
    i_com_determined: bool
    """True if the strikes determine that moment clearly better than the shape alone."""


@dataclass(frozen=True)
class Advice:
    """Predicted error of the centre of mass c for several numbers of strikes, and whether to strike more.

    The error is the rms distance [m] of the estimated c from the true one.
    """

    curve: tuple[tuple[int, float], ...]
    """Pairs of number of (further) strikes and error of c [m]."""
    floor: float
    """Error of c with any number of strikes on the chosen axes [m]."""
    sources: dict[str, float]
    """Error of c that each source causes [m]; the squares add up to the planned design's."""
    stop: bool
    """True if more strikes do not pay."""
    text: str
    """Advice in words."""


def axis_forecasts(information: Information, design: Design) -> list[AxisForecast]:
    """Predicted standard deviations of the results on each chosen axis, in the design's order.

    They are those of the balance angle phi [rad], the rate constant k of the tip (relative), and the moments
    of inertia [kg m^2] about the edge and about the parallel axis through the centre of mass; the last is
    from all strikes, the others are from one strike.

    Args:
        information: Candidates, prior knowledge and errors.
        design: Chosen axes with their numbers of strikes and the predicted covariance.
    """
    P = design.covariance
    result: list[AxisForecast] = []
    for i in design.chosen:
        each = information.candidates[i]
        swing = each.expected
        phi_sd = float(np.sqrt(each.noise[0, 0] + information.errors.strike_angle**2))
        k_sd = float(np.sqrt(each.noise[1, 1]))
        outwards = -np.sin(swing.phi) * each.axis.tip + np.cos(swing.phi) * each.axis.plane.up
        by = np.zeros(len(P))
        by[COM], by[MASS] = outwards / swing.distance, 1.0
        shared = float(by @ P @ by) + information.errors.gravity**2 + information.errors.axis_k**2
        own = moment_row(each.axis.direction)
        i_com = float(np.sqrt(own @ P[INERTIA, INERTIA] @ own))
        guess = SHAPE_MOMENT_SD * float(
            each.axis.direction @ information.belief.inertia @ each.axis.direction
        )
        determined = i_com < MOMENT_DETERMINED * guess
        result.append(
            AxisForecast(
                each.axis.id, phi_sd, k_sd, swing.i_edge * float(np.sqrt(k_sd**2 + shared)), i_com, determined
            )
        )
    return result


def inertia_forecast(information: Information, design: Design) -> tuple[Array, Array]:
    """Predicted precision of the inertia tensor about the centre of mass, in the object frame.

    Args:
        information: Prior knowledge, of which the expected inertia is used.
        design: Chosen axes with their predicted covariance.

    Returns:
        1 sigma (3, 3) [kg m^2] of the tensor's entries, and mask (3, 3) of those that count as determined:
        their 1 sigma is below `MOMENT_DETERMINED` of the one that the shape alone gives.
    """
    sd = np.sqrt(np.diag(design.covariance)[INERTIA])
    mean = information.belief.inertia
    matrix, determined = np.zeros((3, 3)), np.zeros((3, 3), dtype=bool)
    for (i, j), value in zip(TENSOR_ENTRIES, sd, strict=True):
        guess = SHAPE_MOMENT_SD * float(np.sqrt(mean[i, i] * mean[j, j]))
        matrix[i, j] = matrix[j, i] = value
        determined[i, j] = determined[j, i] = value < MOMENT_DETERMINED * guess
    return matrix, determined


def strikes_for(
    information: Information,
    target: float,
    least: int,
    most: int = MAX_STRIKES,
    most_axes: int | None = None,
) -> tuple[int, Design] | None:
    """Smallest number of strikes that reaches a target error of the centre of mass c, and its design.

    The error is the predicted rms distance of the estimated c from the true one. The number is found by
    bisection, as more strikes lower the error.

    Args:
        information: Candidates, prior knowledge and errors.
        target: Error of c to reach [m].
        least: Smallest number of strikes.
        most: Largest number of strikes.
        most_axes: Largest number of different axes; None for the limit of `choose_design`.

    Returns:
        Number of strikes, and the design: axes to tip about and strikes on each. None if `most` strikes do
        not reach the target.
    """

    def design_of(many: int) -> Design | None:
        design = choose_design(information, many, most_axes)
        return design if design is not None and design.com_rms <= target else None

    best = design_of(most)
    if best is None:
        return None
    low, high = least - 1, most
    while high - low > 1:
        middle = (low + high) // 2
        design = design_of(middle)
        if design is None:
            low = middle
        else:
            high, best = middle, design
    return high, best


def advice(
    information: Information,
    design: Design,
    made: int,
    exact_shape: bool = False,
    before: Information | None = None,
) -> Advice:
    """Compare a design with fewer and with more strikes, on other axes too where they are better.

    Args:
        information: Candidates, prior knowledge and errors.
        design: Planned design.
        made: Number of strikes made before; if any, the gain of more is judged relative to them.
        exact_shape: True if the shape is given by its dimensions, which no scan improves.
        before: Information without the strike turned by 180 deg that the plan adds to measure the table's
            tilt, where `information` counts it as made; None if there is no such strike.

    Returns:
        Predicted rms errors of the centre of mass [m] by number of strikes, and with any number on these
        axes; the error [m] caused by each source; and whether to stop, with advice in words.
    """
    planned = int(sum(design.repeats))
    members = [information.candidates[i] for i in design.chosen]
    numbers = sorted({3, 6, planned, 2 * planned, 4 * planned} | ({1, made, 3 * made} if made else set()))
    designs = [(many, design if many == planned else choose_design(information, many)) for many in numbers]
    curve = [(many, other.com_rms) for many, other in designs if other is not None]
    floor = _rms(information, members, [UNLIMITED_STRIKES] * len(members))
    sources = information.sources(members, design.repeats)
    have, rms = (made, error_so_far(before or information)) if made else (planned, design.com_rms)
    more = [(many if made else many - planned, other) for many, other in curve]
    paying = [
        (many, other)
        for many, other in more
        if many > 0 and other < rms * (1 - MIN_GAIN_PER_DOUBLING) ** max(1.0, np.log2((have + many) / have))
    ]
    stop = not paying
    further, twice = min(paying) if paying else (planned, dict(curve).get(2 * planned, floor))
    ordered = sorted(sources, key=lambda name: -sources[name])
    worst = next(name for name in ordered if name in REMEDIES)
    parts = ", ".join(f"{name} {1000 * sources[name]:.2f} mm" for name in ordered[:4] if sources[name] > 0)
    head = (
        f"c to {1000 * design.com_rms:.2f} mm with {counted(planned, 'more strike' if made else 'strike')} "
        f"({parts})"
    )
    if stop:
        text = (
            f"{head}; {planned} more would only reach {1000 * twice:.2f} mm, any number on these axes "
            f"{1000 * floor:.2f} mm: "
            "errors that strikes share dominate, more strikes no longer pay; instead: "
            f"{_remedy(worst, exact_shape)}"
        )
    else:
        text = head if made else f"{head}; {further} more would reach {1000 * twice:.2f} mm"
    if made:
        so_far = f"the {counted(made, 'strike', 'so far gives')} c to {1000 * rms:.2f} mm"
        text = f"{so_far}: stop striking. {text}" if stop else f"{so_far}; {text}"
    return Advice(tuple(curve), floor, sources, stop, text)


def error_so_far(information: Information) -> float:
    """Expected rms error [m] of the centre of mass before any further strike.

    It follows from the priors and the strikes made, which `information` holds. The axes that could be struck
    next, its candidates, do not matter.
    """
    return _rms(information, [], [])


def _remedy(cause: str, exact_shape: bool) -> str:
    if cause == "place of the edges" and exact_shape:
        return "measure how square the object is, or give a scan of it"
    return REMEDIES[cause]


def _rms(information: Information, members: Sequence[Candidate], repeats: Sequence[int]) -> float:
    return float(np.sqrt(np.trace(information.covariance(members, repeats)[COM, COM])))
