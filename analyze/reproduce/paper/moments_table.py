"""Table of moments of inertia about the edges: the paper's (eq. 5), those corrected (3.3.2), ours."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from analyze.reproduce.paper import scores
from analyze.reproduce.paper.record import AxisMoment, Condition, SessionRecord
from analyze.reproduce.paper.tables import Column, Table, Value, objects_of


def moments_table(records: Sequence[SessionRecord]) -> Table:
    """Table of the errors of the moments about the edges, one row per object and axis (pivot edge).

    Calibration is exact; only sessions planned by our method count.
    """
    ours = scores.with_our_plan(records)
    rows: list[tuple[Value, ...]] = []
    for name in objects_of(ours):
        mine = [record for record in ours if record.object == name]
        axes = sorted({axis.axis_id for record in mine for axis in record.ours[Condition.EXACT].moments})
        rows += [_row(name, axis_id, mine) for axis_id in axes]
    return Table(
        "moments",
        "Moments of inertia about the edges",
        (
            Column("object"),
            Column("axis"),
            Column("ground truth, median [10⁻³ kg m²]", 3),
            Column("the paper's results"),
            Column("without I"),
            Column("eq. (5): error, median [%]", 1),
            Column("worst [%]", 1),
            Column("frames left out [%]", 0),
            Column("corrected I: error, median [%]", 1),
            Column("worst, corrected [%]", 1),
            Column("ours: error, median [%]", 2),
            Column("worst, ours [%]", 2),
        ),
        tuple(rows),
        "Eq. (5) is the mean over stage two of m g R sin(θ − φ) / α, with R to the paper's own c. It leaves "
        "out frames within 5° of the balance, where it is 0/0, and frames whose α is not positive. Without "
        "I: fewer than twelve frames lie between balance and landing. Corrected I (3.3.2): the moment within "
        "5 % of eq. (5)'s whose region masses have their centre of mass closest to c; “–” if none gives "
        "positive masses.",
    )


def _row(name: str, axis_id: str, records: Sequence[SessionRecord]) -> tuple[Value, ...]:
    mine = _of_axis([record.ours[Condition.EXACT].moments for record in records], axis_id)
    rounds = [
        answer
        for record in records
        if _of_axis([record.ours[Condition.EXACT].moments], axis_id)
        for answer in record.paper.get(Condition.EXACT, [])
    ]
    paper = _of_axis([answer.moments for answer in rounds], axis_id)
    true = [axis.i_edge_kg_m2 for axis in mine if axis.i_edge_kg_m2 is not None]
    left_out = [axis.left_out for axis in paper if axis.left_out is not None]
    return (
        name,
        axis_id,
        1e3 * float(np.median(true)) if true else None,
        len(rounds),
        len(rounds) - len(paper),
        *_median_and_worst([axis.i_edge_off for axis in paper]),
        100 * float(np.mean(left_out)) if left_out else None,
        *_median_and_worst([axis.corrected_off for axis in paper if axis.corrected_off is not None]),
        *_median_and_worst([axis.i_edge_off for axis in mine]),
    )


def _of_axis(answers: Sequence[Sequence[AxisMoment]], axis_id: str) -> list[AxisMoment]:
    """Errors of the moments of inertia about the axis `axis_id`, in the order of `answers`.

    An answer holds the errors of one estimate, one entry per pivot axis; answers without this axis give no
    entry.
    """
    return [axis for moments in answers for axis in moments if axis.axis_id == axis_id]


def _median_and_worst(off: Sequence[float]) -> tuple[float | None, float | None]:
    """Median and maximum [%] of the absolute relative errors `off` of moments; (None, None) without any."""
    if not off:
        return None, None
    return 100 * float(np.median(np.abs(off))), 100 * float(np.max(np.abs(off)))
