"""What keeps each quantity that has a target from being smaller: physics in words, with the sessions' own figures."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from analyze.reproduce.paper import scores
from analyze.reproduce.paper.record import Condition, SessionRecord

FRAME = "A frame's angle is as good as its corners: blur over the exposure, focus and the size of the marker in the image."
REPEAT = "A strike that turns back far from the balance, or whose edge slips, says less of φ; its stated sd says so."
CENTRE = "What strikes of one axis share does not average out: the edge's place and rounding, and the height of the marker over the edge."
DRAWN = "0.2° of gravity over the height of c, and 0.3 mm at every edge, go into c whole: strikes on the same edge share them."
NOISY = "Nine angles, three on each of three axes: 1.85° over the distance to the edge, over the root of three, is what they say."
EDGE = (
    "I about the edge is m g R / k: it takes over the relative error of R, 2 mm/R, and that of k, which hangs on how far past φ frames go."
)
ABOUT_CENTRE = "It is a difference, I about the edge less m R²: the relative error of either is magnified by R² m over it."
SCAN = "Edges are made of the scan's points: c moves with them."
TIME = "The border's chains take most of it, in one thread; a slower core takes longer."


def masses(records: Sequence[SessionRecord], condition: Condition) -> str:
    """Of region masses."""
    pairs = scores.answers(records, condition, paper=False)
    off: dict[str, list[float]] = {}
    for answer, record in pairs:
        if answer.masses_kg is not None:
            off.setdefault(record.object, []).append(scores.metric(answer.masses_kg, record))
    if not off:
        return ""
    c = 1e3 * float(np.median([scores.distance(answer, record) for answer, record in scores.answers(records, condition, paper=False)]))
    stated = next(each for each in scores.standardised(records, condition) if each.name == "region masses")
    worst = max(off, key=lambda name: float(np.mean(off[name])))
    cause = "0.2° of gravity and 0.3 mm at every edge put c" if condition is Condition.DRAWN else "c is"
    scatter = f" The answer says so: errors are {stated.scatter:.2f} of the stated sd." if len(stated.scores) else ""
    return (
        f"Masses live of I about c = I about the edge − m R², a small difference: {cause} {c:.1f} mm off in the median, which R² passes on "
        f"magnified; most on the {worst} (mean {100 * float(np.mean(off[worst])):.1f} %).{scatter} "
        "What helps: level the table, measure the edges, strike about more than three axes."
    )


def naive(name: str, records: Sequence[SessionRecord]) -> str:
    """Of region masses, over the best naive answer's."""
    if not records:
        return ""
    best = 100 * float(np.mean([scores.best_naive(record) for record in records]))
    mean = {key: np.mean([scores.metric(record.naive_kg[key], record) for record in records]) for key in records[0].naive_kg}
    key = min(mean, key=lambda each: mean[each])
    wall = 100 * float(np.mean([record.true_masses_kg[0] / record.mass_kg for record in records]))
    stated = [sd[0] for record in records if (sd := record.ours[Condition.EXACT].masses_sd_kg) is not None]
    states = f"; the sd that the answer states of the wall's mass is {1e3 * float(np.mean(stated)):.1f} g" if stated else ""
    return (
        f"The naive answer “{key.replace('_', ' ')}” happens to be nearly right of the {name}, off by {best:.1f} %: {wall:.0f} % of its "
        f"mass is in its wall. Half of that, {best / 2:.1f} % of M, is {_grams(best / 2, records)} per region{states}: wall and filling "
        "beside it have nearly the same moments."
    )


def _grams(percent: float, records: Sequence[SessionRecord]) -> str:
    return f"{10 * percent * float(np.mean([record.mass_kg for record in records])):.1f} g"
