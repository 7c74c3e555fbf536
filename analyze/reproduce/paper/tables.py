"""Tables of the reproduction: Tables 1 and 2, error over stated sd, the paper's strikes, all sessions."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from analyze.reproduce.paper import scores
from analyze.reproduce.paper.published import (
    OBJECTS,
    PublishedCentre,
    PublishedMasses,
    published_centres,
    published_masses,
    volume_ratio,
)
from analyze.reproduce.paper.record import Condition, SessionRecord

Value = str | float | int | None
P = TypeVar("P", PublishedCentre, PublishedMasses)
_METHODS = (
    ("the paper's method here", Condition.EXACT, True),
    ("the paper's method, calibration drawn", Condition.DRAWN, True),
    ("ours", Condition.EXACT, False),
    ("ours, calibration drawn", Condition.DRAWN, False),
)
"""Rows of Tables 1 and 2: name of the method, condition, and True for the paper's method."""


@dataclass(frozen=True)
class Column:
    """Column of a table: its heading, and the number of digits shown."""

    name: str
    """Heading of the column."""
    digits: int | None = None
    """Digits after the decimal point; None for text or a count."""


@dataclass(frozen=True)
class Table:
    """Table of the reproduction's page, also written as a CSV file."""

    name: str
    """File name without suffix."""
    title: str
    """Heading on the page."""
    columns: tuple[Column, ...]
    rows: tuple[tuple[Value, ...], ...]
    """Cells of each row, in the order of `columns`; None for an empty cell."""
    note: str = ""
    """Text below the table."""


def all_tables(records: Sequence[SessionRecord]) -> list[Table]:
    """Tables of the page on the paper's reproduction, in its order, without those that have no rows.

    Two are not among them: `targets_table` (largest error allowed and errors reached) and `moments_table`
    (moments of inertia).
    """
    found = [
        table1(records),
        table2(records),
        stated_errors_table(records),
        papers_choice_table(records),
        sessions_table(records),
    ]
    return [table for table in found if table.rows]


def table1(records: Sequence[SessionRecord]) -> Table:
    """Table 1: errors of the centre of mass [mm], by object and method, next to the paper's."""
    rows: list[tuple[Value, ...]] = []
    for name, mine, printed in _by_object(records, published_centres()):
        if printed:
            rows.append(
                _centre_row(
                    name,
                    "the paper, published",
                    [each.distance_m for each in printed],
                    [each.volume_ratio for each in printed],
                )
            )
        for method, condition, paper in _METHODS:
            pairs = [(scores.distance(a, r), r) for a, r in scores.answers(mine, condition, paper=paper)]
            rows.append(
                _centre_row(
                    name, method, [d for d, _ in pairs], [volume_ratio(d, r.volume_m3) for d, r in pairs]
                )
            )
        naive = [float(np.linalg.norm(np.subtract(r.centroid_m, r.true_com_m))) for r in mine]
        rows.append(
            _centre_row(
                name,
                "naive: centroid of the volume",
                naive,
                [volume_ratio(d, r.volume_m3) for d, r in zip(naive, mine, strict=True)],
            )
        )
    return Table(
        "table1",
        "Table 1: centre of mass",
        (
            Column("object"),
            Column("method"),
            Column("results"),
            Column("mean distance [mm]", 2),
            Column("median [mm]", 2),
            Column("worst [mm]", 2),
            Column("sphere over volume, mean [%]", 3),
        ),
        tuple(rows),
        "The paper's method uses one strike per axis for each result, as the paper did; ours uses all nine. "
        "Both use angles from our tracking: Fig. 9(a) shows their scatter. The paper's own angles scattered "
        "by 1.85 degrees.",
    )


def _by_object(
    records: Sequence[SessionRecord], published: Sequence[P]
) -> Iterator[tuple[str, list[SessionRecord], list[P]]]:
    """Yield each object's name, its sessions, and the paper's published results of it, as two lists.

    Of the sessions only those are taken that our method planned, not the paper's.

    Args:
        records: sessions.
        published: published results of all objects.
    """
    ours = scores.with_our_plan(records)
    for name in objects_of(ours):
        mine = [record for record in ours if record.object == name]
        yield name, mine, [each for each in published if each.object == name]


def _centre_row(
    name: str, method: str, distances: Sequence[float], ratios: Sequence[float]
) -> tuple[Value, ...]:
    """Row of Table 1: object, method, count, distance [mm] (mean, median, worst), mean ratio [%].

    Without results the count is 0 and the numbers after it are None.

    Args:
        name: name of the object.
        method: name of the method.
        distances: distances of the centres of mass from the true ones [m].
        ratios: for each distance, volume of a sphere with this radius over the object's volume.
    """
    d = 1e3 * np.array(distances)
    if not len(d):
        return (name, method, 0, None, None, None, None)
    return (
        name,
        method,
        len(d),
        float(d.mean()),
        float(np.median(d)),
        float(d.max()),
        float(100 * np.mean(ratios)),
    )


def table2(records: Sequence[SessionRecord]) -> Table:
    """Table 2: errors of the masses of shell and inner parts, by object and method, next to the paper's.

    They are the mean error of a region, and the mass in the wrong region, in % of the object's mass.
    """
    rows: list[tuple[Value, ...]] = []
    for name, mine, printed in _by_object(records, published_masses()):
        if printed:
            rows.append(
                _masses_row(
                    name,
                    "the paper, published",
                    [(each.metric, each.misplaced) for each in printed],
                    len(printed),
                )
            )
        for method, condition, paper in _METHODS:
            found = [(a.masses_kg, r) for a, r in scores.answers(mine, condition, paper=paper)]
            pairs = [
                (scores.metric(m, r), scores.mass_in_wrong_region(m, r)) for m, r in found if m is not None
            ]
            rows.append(_masses_row(name, method, pairs, len(found)))
        for key in sorted(mine[0].naive_kg):
            pairs = [
                (scores.metric(r.naive_kg[key], r), scores.mass_in_wrong_region(r.naive_kg[key], r))
                for r in mine
            ]
            rows.append(_masses_row(name, f"naive: {key.replace('_', ' ')}", pairs, len(pairs)))
    return Table(
        "table2",
        "Table 2: mass distribution",
        (
            Column("object"),
            Column("method"),
            Column("results"),
            Column("without an answer"),
            Column("paper's metric, mean [%]", 1),
            Column("median [%]", 1),
            Column("worst [%]", 1),
            Column("mass in the wrong region, mean [%]", 1),
        ),
        tuple(rows),
        "Paper's metric: mean of |dm| over shell, upper and lower part, divided by M. Naive answers: all "
        "mass in the shell; uniform density; the mix of these two that fits the moments best.",
    )


def _masses_row(
    name: str, method: str, pairs: Sequence[tuple[float, float]], asked: int
) -> tuple[Value, ...]:
    """Row of Table 2: object, method, answers, those without masses, and four errors [%].

    The errors are mean, median and worst of the paper's metric, and the mean fraction of mass in the wrong
    region; None if no answer has masses.

    Args:
        name: name of the object.
        method: name of the method.
        pairs: of each answer with masses, the paper's metric (mean absolute error of a region's mass over
            the total mass) and the fraction of mass in the wrong region.
        asked: number of answers, with or without masses.
    """
    if not pairs:
        return (name, method, asked, asked, None, None, None, None)
    both = 100 * np.array(pairs)
    first = both[:, 0]
    return (
        name,
        method,
        asked,
        asked - len(pairs),
        float(first.mean()),
        float(np.median(first)),
        float(first.max()),
        float(both[:, 1].mean()),
    )


def stated_errors_table(records: Sequence[SessionRecord]) -> Table:
    """Table of achieved errors over stated standard deviations, by condition of calibration and quantity.

    Only sessions planned by our method count; rows without values are omitted.
    """
    rows: list[tuple[Value, ...]] = []
    ours = scores.with_our_plan(records)
    for condition, label in (
        (Condition.EXACT, "as calibrated"),
        (Condition.DRAWN, "calibration errors drawn"),
    ):
        found: list[tuple[scores.Standardised, float | None]] = [
            (each, None) for each in scores.standardised(ours, condition)
        ]
        for name in objects_of(scores.on_paper_objects(ours)):
            of_it = [record for record in ours if record.object == name]
            of_mean = scores.scatter_of_mean(of_it, condition) if len(of_it) > 1 else None
            found.append((scores.standardised_masses(of_it, condition, f"region masses, {name}"), of_mean))
        rows += [
            (label, each.name, len(each.scores), each.scatter, of_mean, 100 * float(each.held.mean()))
            for each, of_mean in found
            if len(each.scores)
        ]
    note = (
        "Scatter: root mean square of error over stated sd; 1 is ideal, below 1 the stated sd is "
        "conservative. As calibrated: the rig's files state calibration errors that the virtual rig does not "
        "have. Scatter of the mean: the part that repeats in every session of an object. Region "
        "masses are means over all dividing planes and fillings that fit: for one body their error is below "
        "the sd, for another above it; over many bodies the scatter is right (`make coverage` draws them)."
    )
    columns = ("calibration", "quantity of the result", "values")
    last = (
        Column("scatter", 2),
        Column("scatter of the mean", 2),
        Column("held by the 95 % interval [%]", 0),
    )
    title = "Achieved error over the stated standard deviation"
    return Table("honesty", title, (*map(Column, columns), *last), tuple(rows), note)


def papers_choice_table(records: Sequence[SessionRecord]) -> Table:
    """Table of errors of the centre of mass [mm] from strikes that the paper's planner chooses, by object.

    Errors are those of the paper's method and of ours, with the sd that ours states, the directions that the
    strikes determine, and the friction that they need. Without such strikes a row gives only the reason.
    """
    rows: list[tuple[Value, ...]] = []
    ours = scores.with_our_plan(records)
    for name in objects_of(ours):
        found = [
            record.own_choice for record in ours if record.object == name and record.own_choice is not None
        ]
        if not found:
            continue
        one = found[0]
        if one.refused is not None:
            rows.append((name, f"no plan: {one.refused.partition(':')[0]}", None, None, None, None, None))
            continue
        observable = "every direction"
        if one.open_direction is not None:
            direction = ", ".join(f"{abs(value):.0f}" for value in one.open_direction)
            observable = f"singular: not along ({direction})"
        rows.append(
            (
                name,
                observable,
                max(each.friction_needed for each in found),
                *(
                    1e3 * float(np.median(_present(values)))
                    for values in ([e.paper_off_m for e in found], [e.ours_off_m for e in found])
                ),
                1e3 * float(np.max(_present([each.paper_off_m for each in found]))),
                1e3 * float(np.median(_present([each.ours_sd_m for each in found]))),
            )
        )
    return Table(
        "own_choice",
        "The paper's own choice of strikes",
        (
            Column("object"),
            Column("observable"),
            Column("friction needed", 1),
            Column("paper's method, median [mm]", 1),
            Column("ours on its strikes, median [mm]", 1),
            Column("paper's method, worst [mm]", 1),
            Column("sd stated by ours [mm]", 1),
        ),
        tuple(rows),
        "The first three impact points by force (3.1.3), with angles without error. Along a direction that "
        "is not observable, our answer reports this and the sd of its prior; the paper's method has no such "
        "report. Friction needed: the least at which no edge slides; plans assume 0.4.",
    )


def _present(values: Iterable[float | None]) -> list[float]:
    return [value for value in values if value is not None]


def sessions_table(records: Sequence[SessionRecord]) -> Table:
    """Table of the errors of every session, with true and estimated masses of shell and interior parts."""
    rows: list[tuple[Value, ...]] = []
    for record in records:
        exact, drawn = record.ours[Condition.EXACT], record.ours[Condition.DRAWN]
        paper = [scores.distance(a, record) for a in record.paper.get(Condition.EXACT, [])]
        masses = exact.masses_kg or [float("nan")] * 3
        rows.append(
            (
                record.object,
                record.seed,
                record.source.value,
                record.method.value,
                record.strikes,
                record.axes,
                1e3 * scores.distance(exact, record),
                1e3 * scores.distance(drawn, record),
                1e3 * float(np.mean(paper)) if paper else None,
                *(1e3 * mass for mass in record.true_masses_kg),
                *(1e3 * mass for mass in masses),
                100 * scores.metric(masses, record),
                record.cpu_s,
            )
        )
    columns = ("object", "seed", "source", "strikes by", "strikes", "axes")
    numbers = ("c [mm]", "c, calibration drawn [mm]", "c, paper's method [mm]")
    masses_of = ("true shell [g]", "true upper [g]", "true lower [g]", "shell [g]", "upper [g]", "lower [g]")
    return Table(
        "sessions",
        "Every session",
        (
            *(Column(name) for name in columns),
            *(Column(name, 3) for name in numbers),
            *(Column(name, 1) for name in masses_of),
            Column("paper's metric [%]", 1),
            Column("estimation time [s]", 2),
        ),
        tuple(rows),
    )


def objects_of(records: Iterable[SessionRecord]) -> list[str]:
    """Names of the objects in `records`, each once: the paper's in its order, then the others sorted."""
    there = {record.object for record in records}
    return [name for name in OBJECTS if name in there] + sorted(there - set(OBJECTS))
