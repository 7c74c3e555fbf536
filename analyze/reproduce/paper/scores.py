"""Errors of the estimates of many sessions against the ground truth, for the tables.

A session is one virtual recording on one object; its record contains estimates and ground truth.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from analyze.least_squares.intervals import SIGMAS_95
from analyze.reproduce.paper.published import OBJECTS
from analyze.reproduce.paper.record import Condition, MethodAnswer, SessionRecord
from analyze.types import Array
from schemas.strike_plan import PlanMethod

CHI2_95_3D = 7.815
"""95 % quantile of chi squared with three degrees of freedom."""
EMPTY_REGION_FRACTION = 0.01
"""Fraction of the total mass below which a region's mass counts as being at its lower bound, zero."""


def with_our_plan(records: Iterable[SessionRecord]) -> list[SessionRecord]:
    """Sessions whose strikes were planned by this project's method, not by that of the VISAPP 2013 paper.

    The method is described in docs/explanation/method.md, 1.6.
    """
    return [record for record in records if record.method is PlanMethod.OURS]


def on_paper_objects(records: Iterable[SessionRecord]) -> list[SessionRecord]:
    """Sessions on the paper's four objects, each of which is a shell and two uniform parts."""
    return [record for record in records if record.object in OBJECTS]


def distance(answer: MethodAnswer, record: SessionRecord) -> float:
    """Distance [m] of the estimated centre of mass from the true one."""
    return float(np.linalg.norm(np.subtract(answer.com_m, record.true_com_m)))


def metric(masses: Sequence[float], record: SessionRecord) -> float:
    """The paper's metric of region masses: mean absolute error of a region's mass, over the total mass.

    Args:
        masses: estimated masses of shell, upper and lower part [kg].
        record: session, with the true masses.
    """
    return float(np.abs(np.subtract(masses, record.true_masses_kg)).mean() / record.mass_kg)


def mass_in_wrong_region(masses: Sequence[float], record: SessionRecord) -> float:
    """Fraction of the total mass that is attributed to a wrong region.

    It is half the sum of the regions' absolute errors, over the total mass.

    Args:
        masses: estimated masses of shell, upper and lower part [kg].
        record: session, with the true masses.
    """
    return float(np.abs(np.subtract(masses, record.true_masses_kg)).sum() / 2 / record.mass_kg)


def answers(
    records: Iterable[SessionRecord], condition: Condition, *, paper: bool
) -> Iterator[tuple[MethodAnswer, SessionRecord]]:
    """Yield answers with their sessions: ours of each session, or the paper's of each round of strikes.

    A round is one strike on each pivot axis.

    Args:
        records: sessions.
        condition: calibration under which they were analysed.
        paper: True for the answers of the paper's method, False for ours.
    """
    for record in records:
        for answer in record.paper.get(condition, []) if paper else [record.ours[condition]]:
            yield answer, record


def distances_mm(records: Iterable[SessionRecord], condition: Condition, *, paper: bool) -> list[float]:
    """Distances [mm] of the estimated centres of mass from the true ones, one per answer.

    Args:
        records: sessions.
        condition: calibration under which they were analysed.
        paper: True for the answers of the paper's method, False for ours.
    """
    return [1e3 * distance(answer, record) for answer, record in answers(records, condition, paper=paper)]


def region_masses(
    records: Iterable[SessionRecord], condition: Condition, *, paper: bool
) -> list[tuple[Sequence[float], SessionRecord]]:
    """Estimated masses (3) [kg] of shell, upper and lower part, one pair (masses, session) per answer.

    Answers without region masses are left out.

    Args:
        records: sessions.
        condition: calibration under which they were analysed.
        paper: True for the answers of the paper's method, False for ours.
    """
    found = answers(records, condition, paper=paper)
    return [(answer.masses_kg, record) for answer, record in found if answer.masses_kg is not None]


def best_naive(record: SessionRecord) -> float:
    """Smallest error of a session's naive answers, in the paper's metric.

    The metric is the mean absolute error of a region's mass, over the total mass; regions are the shell
    (outer wall) and two parts of the interior. A naive answer assumes the distribution, for example all mass
    in the shell.
    """
    return min(metric(masses, record) for masses in record.naive_kg.values())


@dataclass(frozen=True)
class Standardised:
    """Errors of one quantity over their stated standard deviations (sd), in many sessions.

    It also holds, for each 95 % interval, whether it contains the true value.
    """

    name: str
    """Name of the quantity."""
    scores: Array
    """(n,) error over stated sd."""
    held: Array
    """(m,) 1 where the 95 % interval contains the true value, else 0; m may exceed n."""

    @property
    def scatter(self) -> float:
        """Root mean square of the errors over their stated sd: 1 if these are right; NaN without errors."""
        return float(np.sqrt(np.mean(self.scores**2)))


def standardised(records: Sequence[SessionRecord], condition: Condition) -> list[Standardised]:
    """Errors over stated sd of our centre of mass, moments of inertia and region masses.

    The moments are those about the edge and about the centre of mass. The error of the centre of mass is the
    Mahalanobis distance over the root of 3. Region masses are those of the paper's four objects.

    Args:
        records: sessions.
        condition: calibration under which they were analysed.

    Returns:
        Four entries: centre of mass, I about the edge, I about c (the centre of mass), region masses. Each
        has name, errors over sd (n,), and (m,) 1 where a 95 % interval contains the true value, else 0.
    """
    centre: list[float] = []
    edge: list[float] = []
    about_com: list[float] = []
    for record in records:
        answer = record.ours[condition]
        off = np.subtract(answer.com_m, record.true_com_m)
        centre.append(float(np.sqrt(off @ np.linalg.solve(np.array(answer.com_covariance_m2), off) / 3)))
        edge += [axis.i_edge_off / axis.i_edge_sd for axis in answer.moments]
        about_com += [axis.i_com_off / axis.i_com_sd for axis in answer.moments]
    return [
        Standardised(
            "centre of mass", np.array(centre), (3 * np.array(centre) ** 2 < CHI2_95_3D).astype(float)
        ),
        Standardised("I about the edge", np.array(edge), (np.abs(edge) < SIGMAS_95).astype(float)),
        Standardised("I about c", np.array(about_com), (np.abs(about_com) < SIGMAS_95).astype(float)),
        standardised_masses(on_paper_objects(records), condition, "region masses"),
    ]


def standardised_masses(records: Iterable[SessionRecord], condition: Condition, name: str) -> Standardised:
    """Region masses by our method: errors over stated sd, and whether 95 % intervals hold the true masses.

    The regions are shell, upper and lower interior. A region that is truly empty (below
    `EMPTY_REGION_FRACTION` of the total mass) has no error here, since its mass is at its lower bound, zero;
    its interval counts all the same.

    Args:
        records: sessions.
        condition: calibration under which they were analysed.
        name: name of the quantity, for tables; copied to the result.
    """
    found: list[float] = []
    held: list[float] = []
    for record in records:
        for true, mass, sd, low, high in _masses(record.ours[condition], record):
            if true > EMPTY_REGION_FRACTION * record.mass_kg:
                found.append((mass - true) / max(sd, 1e-9))
            held.append(float(low <= true <= high))
    return Standardised(name, np.array(found), np.array(held))


def scatter_of_mean(records: Sequence[SessionRecord], condition: Condition) -> float:
    """Root mean square, over the regions of one object, of the mean standardised error over its sessions.

    A standardised error is the error of a region's mass over its stated sd. Its mean is the part that repeats
    in every session. Regions that are truly empty are left out; NaN if none remains.

    Args:
        records: sessions on one object, at least one.
        condition: calibration under which they were analysed.
    """
    rows = [list(_masses(record.ours[condition], record)) for record in records]
    means = [
        float(np.mean([(mass - true) / max(sd, 1e-9) for true, mass, sd, _, _ in sessions]))
        for sessions in zip(*rows, strict=True)
        if np.mean([true for true, *_ in sessions]) > EMPTY_REGION_FRACTION * records[0].mass_kg
    ]
    return float(np.sqrt(np.mean(np.square(means)))) if means else float("nan")


def _masses(
    answer: MethodAnswer, record: SessionRecord
) -> Iterator[tuple[float, float, float, float, float]]:
    """Yield for each region true mass, estimated mass, its sd and both ends of its 95 % interval [kg].

    The regions are shell, upper and lower part of the interior, in this order.

    Raises:
        ValueError: the answer has no masses, or none of their sd or intervals.
    """
    rows = (
        record.true_masses_kg,
        answer.masses_kg,
        answer.masses_sd_kg,
        answer.masses_low_kg,
        answer.masses_high_kg,
    )
    yield from zip(*(row or [] for row in rows), strict=True)
