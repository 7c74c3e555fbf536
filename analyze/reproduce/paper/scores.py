"""Errors of the estimates of many sessions against the ground truth, for the tables."""

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
    """Sessions whose strikes were planned by our design (method 1.6), not by the paper's rule."""
    return [record for record in records if record.method is PlanMethod.OURS]


def on_paper_objects(records: Iterable[SessionRecord]) -> list[SessionRecord]:
    """Sessions on the paper's four objects, each a shell and two uniform parts."""
    return [record for record in records if record.object in OBJECTS]


def on_other_objects(records: Iterable[SessionRecord]) -> list[SessionRecord]:
    """Sessions on objects other than the paper's four."""
    return [record for record in records if record.object not in OBJECTS]


def distance(answer: MethodAnswer, record: SessionRecord) -> float:
    """Distance [m] of the estimated c from the true c."""
    return float(np.linalg.norm(np.subtract(answer.com_m, record.true_com_m)))


def metric(masses: Sequence[float], record: SessionRecord) -> float:
    """The paper's metric of region masses: mean of |dm| / M over the regions."""
    return float(np.abs(np.subtract(masses, record.true_masses_kg)).mean() / record.mass_kg)


def mass_in_wrong_region(masses: Sequence[float], record: SessionRecord) -> float:
    """Fraction of the mass M that is attributed to a wrong region."""
    return float(np.abs(np.subtract(masses, record.true_masses_kg)).sum() / 2 / record.mass_kg)


def answers(
    records: Iterable[SessionRecord], condition: Condition, *, paper: bool
) -> Iterator[tuple[MethodAnswer, SessionRecord]]:
    """Answers with their sessions: ours of each session, or with `paper` the paper's of each round."""
    for record in records:
        for answer in record.paper.get(condition, []) if paper else [record.ours[condition]]:
            yield answer, record


def best_naive(record: SessionRecord) -> float:
    """The paper's metric of the best naive answer."""
    return min(metric(masses, record) for masses in record.naive_kg.values())


@dataclass(frozen=True)
class Standardised:
    """Errors of one quantity over their stated sd."""

    name: str
    scores: Array
    """(n,) error over stated sd."""
    held: Array
    """(m,) 1 where the 95 % interval holds the true value, else 0."""

    @property
    def scatter(self) -> float:
        """Root mean square of error over stated sd; 1 if the stated sd is right."""
        return float(np.sqrt(np.mean(self.scores**2)))


def standardised(records: Sequence[SessionRecord], condition: Condition) -> list[Standardised]:
    """Standardised errors of c, moments and region masses; c's is the Mahalanobis distance over root 3."""
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
    """Standardised errors of the region masses above their lower bound; coverage counts all regions."""
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

    It is the part of the error that repeats in every session.
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
    rows = (
        record.true_masses_kg,
        answer.masses_kg,
        answer.masses_sd_kg,
        answer.masses_low_kg,
        answer.masses_high_kg,
    )
    yield from zip(*(row or [] for row in rows), strict=True)
