"""Sentences on the physical limit of each quantity that has a target, shown if the target is missed."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from analyze.reproduce.paper import scores
from analyze.reproduce.paper.record import Condition, SessionRecord

FRAME = "A frame's angle is limited by its marker: motion blur, focus and the marker's size in the image."
REPEAT = (
    "A strike that turns back far before the balance, or whose edge slips, determines φ less precisely; its "
    "stated sd is larger accordingly."
)
CENTRE = (
    "Errors that all strikes of one axis share do not average out: the edge's position and radius, and the "
    "height of the marker above the edge."
)
DRAWN = (
    "A tilt of gravity of 0.2° times the height of c, and 0.3 mm at every edge, shift c in full: all strikes "
    "on one edge share them."
)
NOISY = (
    "Nine angles, three on each of three axes, locate c only to 1.85° times the distance to the edge, "
    "divided by the root of three."
)
EDGE = (
    "I about the edge is m g R / k. It inherits the relative error of R (2 mm/R) and of k, which depends on "
    "how far past φ the frames reach."
)
ABOUT_CENTRE = (
    "I about c is a difference, I about the edge − m R²: the relative error of either term is magnified by "
    "the ratio of m R² to I about c."
)
SCAN = "The edges are fitted to the scan's points: c moves with them."
TIME = "Most of the time is spent on sampling the dividing plane, in one thread; a slower core takes longer."


def masses_bound(records: Sequence[SessionRecord], condition: Condition) -> str:
    """Sentences on why the error of the region masses is not smaller; "" if no session has region masses.

    The regions are the shell (outer wall) and the interior's two parts, above and below a dividing plane.

    Args:
        records: results of the sessions.
        condition: calibration under which they were analysed.
    """
    off: dict[str, list[float]] = {}
    for masses, record in scores.region_masses(records, condition, paper=False):
        off.setdefault(record.object, []).append(scores.metric(masses, record))
    if not off:
        return ""
    c = float(np.median(scores.distances_mm(records, condition, paper=False)))
    stated = next(each for each in scores.standardised(records, condition) if each.name == "region masses")
    worst = max(off, key=lambda name: float(np.mean(off[name])))
    cause = (
        "a tilt of 0.2° and 0.3 mm at every edge shift c by"
        if condition is Condition.DRAWN
        else "c is off by"
    )
    scatter = (
        f" The stated sd covers this: the errors are {stated.scatter:.2f} of it."
        if len(stated.scores)
        else ""
    )
    return (
        f"The masses are computed from I about c = I about the edge − m R², a small difference: {cause} "
        f"{c:.1f} mm in the median, and R² magnifies this. The largest error is on the {worst} (mean "
        f"{100 * float(np.mean(off[worst])):.1f} %).{scatter} Remedies: level the table, measure the edges, "
        "strike about more than three axes."
    )


def naive_bound(name: str, records: Sequence[SessionRecord]) -> str:
    """Sentences on why an object's region masses are not much better than the best naive answer.

    Regions are the shell (outer wall) and two parts of the interior. A naive answer assumes how the mass is
    distributed among them, for example all in the shell. The text is "" without records.

    Args:
        name: name of the object.
        records: results of the sessions on this object.
    """
    if not records:
        return ""
    best = 100 * float(np.mean([scores.best_naive(record) for record in records]))
    mean = {
        key: np.mean([scores.metric(record.naive_kg[key], record) for record in records])
        for key in records[0].naive_kg
    }
    key = min(mean, key=lambda each: mean[each])
    shell = 100 * float(np.mean([record.true_masses_kg[0] / record.mass_kg for record in records]))
    stated = [sd[0] for record in records if (sd := record.ours[Condition.EXACT].masses_sd_kg) is not None]
    states = f"; the stated sd of the shell's mass is {1e3 * float(np.mean(stated)):.1f} g" if stated else ""
    return (
        f"The naive answer “{key.replace('_', ' ')}” happens to be nearly right for the {name}: its error is "
        f"{best:.1f} %, because {shell:.0f} % of the mass is in the shell. Half of that error, "
        f"{best / 2:.1f} % of M, is {_grams(best / 2, records)} per region{states}: the shell and the "
        "filling next to it have nearly the same moments."
    )


def _grams(percent: float, records: Sequence[SessionRecord]) -> str:
    return f"{10 * percent * float(np.mean([record.mass_kg for record in records])):.1f} g"
