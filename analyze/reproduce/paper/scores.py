"""Errors of many sessions, ready to be counted: the one place where estimates meet the truth in the tables."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from analyze.reproduce.paper.published import OBJECTS
from analyze.reproduce.paper.record import Answer, Condition, SessionRecord
from analyze.types import Array
from schemas.strike_plan import PlanMethod

CHI2_95 = 7.815
"""three dimensions"""
EMPTY = 0.01
"""of the whole's mass, below which a region's is at its bound"""


def designed(records: Iterable[SessionRecord]) -> list[SessionRecord]:
    """Sessions on axes of our design."""
    return [record for record in records if record.method is PlanMethod.OURS]


def within_class(records: Iterable[SessionRecord]) -> list[SessionRecord]:
    """Of the paper's four objects: a shell and two even parts."""
    return [record for record in records if record.object in OBJECTS]


def outside_class(records: Iterable[SessionRecord]) -> list[SessionRecord]:
    """Of the others."""
    return [record for record in records if record.object not in OBJECTS]


def distance(answer: Answer, record: SessionRecord) -> float:
    """Of c from the truth [m]."""
    return float(np.linalg.norm(np.subtract(answer.com_m, record.true_com_m)))


def metric(masses: Sequence[float], record: SessionRecord) -> float:
    """The paper's, of region masses: mean |dm| / M."""
    return float(np.abs(np.subtract(masses, record.true_masses_kg)).mean() / record.mass_kg)


def misplaced(masses: Sequence[float], record: SessionRecord) -> float:
    """Mass in the wrong region, over M."""
    return float(np.abs(np.subtract(masses, record.true_masses_kg)).sum() / 2 / record.mass_kg)


def answers(records: Iterable[SessionRecord], condition: Condition, *, paper: bool) -> Iterator[tuple[Answer, SessionRecord]]:
    """One of ours per session, or the paper's of every round."""
    for record in records:
        for answer in record.paper.get(condition, []) if paper else [record.ours[condition]]:
            yield answer, record


def best_naive(record: SessionRecord) -> float:
    """The metric of the best naive answer."""
    return min(metric(masses, record) for masses in record.naive_kg.values())


@dataclass(frozen=True)
class Standardised:
    """Errors over their stated sd."""

    name: str
    scores: Array
    held: Array
    """of the 95 % interval, 0 or 1"""

    @property
    def scatter(self) -> float:
        """Root mean square; 1 would be right."""
        return float(np.sqrt(np.mean(self.scores**2)))


def standardised(records: Sequence[SessionRecord], condition: Condition) -> list[Standardised]:
    """Of c (root of a third of its Mahalanobis distance squared), moments, and region masses above their bound."""
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
        Standardised("centre of mass", np.array(centre), (3 * np.array(centre) ** 2 < CHI2_95).astype(float)),
        Standardised("I about the edge", np.array(edge), (np.abs(edge) < 1.96).astype(float)),
        Standardised("I about c", np.array(about_com), (np.abs(about_com) < 1.96).astype(float)),
        standardised_masses(within_class(records), condition, "region masses"),
    ]


def standardised_masses(records: Iterable[SessionRecord], condition: Condition, name: str) -> Standardised:
    """Of region masses above their bound; intervals of all of them."""
    found: list[float] = []
    held: list[float] = []
    for record in records:
        for true, mass, sd, low, high in _masses(record.ours[condition], record):
            if true > EMPTY * record.mass_kg:
                found.append((mass - true) / max(sd, 1e-9))
            held.append(float(low <= true <= high))
    return Standardised(name, np.array(found), np.array(held))


def repeated(records: Sequence[SessionRecord], condition: Condition) -> float:
    """Of one object's sessions: root mean square of what its region masses' errors over stated sd are in the mean of its sessions."""
    rows = [list(_masses(record.ours[condition], record)) for record in records]
    means = [
        float(np.mean([(mass - true) / max(sd, 1e-9) for true, mass, sd, _, _ in sessions]))
        for sessions in zip(*rows, strict=True)
        if np.mean([true for true, *_ in sessions]) > EMPTY * records[0].mass_kg
    ]
    return float(np.sqrt(np.mean(np.square(means)))) if means else float("nan")


def _masses(answer: Answer, record: SessionRecord) -> Iterator[tuple[float, float, float, float, float]]:
    rows = (record.true_masses_kg, answer.masses_kg, answer.masses_sd_kg, answer.masses_low_kg, answer.masses_high_kg)
    yield from zip(*(row or [] for row in rows), strict=True)
