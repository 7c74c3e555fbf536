"""Scores of one session: each quantity's error and interval beside the truth, and what the verdict says."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from analyze.least_squares.intervals import SIGMAS_95
from analyze.pipeline.evidence import Evidence
from analyze.types import TENSOR_ENTRIES, tensor_entry_name
from schemas.quantity import Quantity
from schemas.strike_result import Verdict
from tests.benchmarks.honesty.disturbances import DISTURBANCES
from tests.benchmarks.honesty.session import StrikeTruth, Trial
from tests.benchmarks.honesty.verdicts import false_doubts, statuses

WRONG_LINE = 2e-3
"""distance [m] of the line that a strike counts for from the line that carried it, above which it is wrong,
besides the effect of a wrong radius; errors of the scan are smaller"""


@dataclass(frozen=True)
class Score:
    """One quantity of one session, in the unit that its name states."""

    quantity: str
    """group of quantities, with the unit"""
    name: str
    """the quantity itself"""
    status: str
    """what the verdict says of it"""
    truth: float
    value: float
    low: float
    high: float

    @property
    def half(self) -> float:
        """Half width of the interval."""
        return 0.5 * (self.high - self.low)

    @property
    def holds(self) -> bool:
        """True if the interval holds the truth."""
        slack = 1e-9 * max(abs(self.truth), 1e-12)
        return self.low - slack <= self.truth <= self.high + slack

    @property
    def half_widths_off(self) -> float:
        """Distance of the truth from the interval's middle, in half widths."""
        off = abs(self.truth - 0.5 * (self.low + self.high))
        return 0.0 if off == 0 else off / max(self.half, 1e-12)


@dataclass
class SessionScore:
    """Scores of one session."""

    body: str
    disturbance: str
    seed: int
    scores: list[Score] = field(default_factory=list)
    refusal: str = ""
    crash: str = ""
    wrong_lines: int = 0
    """strikes that balanced over another line than the planned one"""
    wrong_lines_good: int = 0
    """number of strikes called good for a line that did not carry them"""
    strikes: int = 0
    mislabelled: int = 0
    """strikes recorded under another strike's name"""
    recognised: int = 0
    """number of mislabelled strikes whose verdict is a wrong placement"""
    misplaced: int = 0
    """strikes under their own name whose verdict is a wrong placement"""
    verdicts: list[str] = field(default_factory=list)
    doubts: list[str] = field(default_factory=list)
    """false doubts, where the stated errors cover the disturbance"""
    repeats: int = 0
    """number of strikes that the answer wants repeated"""
    seconds: float = 0.0
    images: bool = False
    """True if the session went through images"""

    @property
    def cell(self) -> str:
        """Name with which the session can be repeated."""
        return f"{self.body}:{self.disturbance}:{self.seed}"


def score_session(trial: Trial, body: str, disturbance: str, seed: int) -> SessionScore:
    """Compare the answer of a session with the truth."""
    found = SessionScore(body, disturbance, seed, refusal=trial.refusal, strikes=len(trial.truths))
    if trial.evidence is not None:
        _lines(trial, trial.evidence, found)
    if trial.result is None:
        return found
    said = statuses(trial.result)
    for score in (*_strikes(trial), *_com(trial, said), *_moments(trial), *_tensor(trial, said)):
        found.scores.append(score)
    found.scores += [*_regions(trial, said), *_parts(trial, said)]
    found.verdicts = list(trial.result.verdict)
    found.repeats = sum(sentence.startswith("repeat") for sentence in found.verdicts)
    if DISTURBANCES[disturbance].covered:
        found.doubts = false_doubts(trial.result)
    return found


def _lines(trial: Trial, evidence: Evidence, found: SessionScore) -> None:
    """Count strikes that balanced over another line than planned, and those called good for a wrong one."""
    planes = {} if trial.estimate is None else {p.strike_id: p for p in trial.estimate.fitted_planes}
    by_plan = {strike.id: strike for strike in evidence.plan.strikes}
    for motion in evidence.motions:
        truth = trial.truths[motion.strike_id]
        wrong = motion.verdict is Verdict.WRONG_PLACEMENT
        found.mislabelled += truth.mislabelled
        found.recognised += truth.mislabelled and wrong
        found.misplaced += wrong and not truth.mislabelled
        pivot = by_plan[motion.plan_strike_id].pivot
        found.wrong_lines += _is_off(np.array(pivot.point), np.array(pivot.direction), pivot.radius_m, truth)
        plane = planes.get(motion.strike_id)
        if plane is not None and motion.verdict is Verdict.GOOD:
            found.wrong_lines_good += _is_off(plane.point, plane.direction, plane.edge_radius, truth)


def _is_off(point: np.ndarray, direction: np.ndarray, radius: float, truth: StrikeTruth) -> bool:
    """True if a line is not the one that carried the strike; an error of the radius moves it too."""
    limit = WRONG_LINE + math.sqrt(2) * abs(radius - truth.tip.radius)
    off = point - truth.tip.line
    off = off - truth.tip.direction * (off @ truth.tip.direction)
    return bool(np.linalg.norm(off) > limit or direction @ truth.tip.direction < math.cos(0.2))


def _strikes(trial: Trial) -> Iterator[Score]:
    """Yield phi and k of the strikes that were fitted, good ones and those that rocked back."""
    assert trial.result is not None
    for row in trial.result.strikes:
        if row.verdict not in (Verdict.GOOD, Verdict.ROCKED_BACK) or row.phi is None:
            continue
        truth, kind = trial.truths[row.id], "good" if row.verdict is Verdict.GOOD else "back"
        yield _score(f"phi {kind} (deg)", row.id, "not mentioned", row.phi, truth.phi, math.degrees(1))
        if row.k is not None:
            yield _score(f"k {kind} (%)", row.id, "not mentioned", row.k, truth.tip.k, 100 / truth.tip.k)


def _score(group: str, name: str, status: str, quantity: Quantity, truth: float, unit: float) -> Score:
    low, high = quantity.interval_ends()
    value = quantity.as_scalar()
    return Score(group, name, status, unit * truth, unit * value, unit * low, unit * high)


def _com(trial: Trial, said: dict[str, str]) -> Iterator[Score]:
    assert trial.result is not None
    com = trial.result.centre_of_mass
    group = "c (mm)" if com.observed else "c open (mm)"
    values, ends = np.array(com.value), np.array(com.interval95)
    for i, axis in enumerate("xyz"):
        numbers = 1e3 * np.array([trial.specimen.com[i], values[i], *ends[i]])
        yield Score(group, f"c{axis}", said["c"], *map(float, numbers))


def _moments(trial: Trial) -> Iterator[Score]:
    """Yield moments about edges and about their parallels through c, with the mass as it is."""
    assert trial.result is not None
    tips = {row.axis_id: trial.truths[row.id].tip for row in trial.result.strikes if row.used}
    for moment in trial.result.moments:
        tip = tips[moment.axis_id]
        yield _score(
            "I_edge (%)", moment.axis_id, "not mentioned", moment.i_edge, tip.i_edge, 100 / tip.i_edge
        )
        yield _score("I_c (%)", moment.axis_id, "not mentioned", moment.i_com, tip.i_com, 100 / tip.i_com)


def _tensor(trial: Trial, said: dict[str, str]) -> Iterator[Score]:
    assert trial.result is not None
    value, ends = np.array(trial.result.inertia.value), np.array(trial.result.inertia.interval95)
    truth = trial.specimen.inertia
    unit = 300 / float(np.trace(truth))
    for i, j in TENSOR_ENTRIES:
        name = tensor_entry_name((i, j))
        measured = trial.result.inertia_measured[i][j]
        group = f"I {'diag' if i == j else 'prod'} (%)" if measured else "I prior (%)"
        numbers = unit * np.array([truth[i, j], value[i, j], *ends[3 * i + j]])
        yield Score(group, name, said[name], *map(float, numbers))


def _regions(trial: Trial, said: dict[str, str]) -> Iterator[Score]:
    """Yield region masses and their limits, and the wall's thickness where it was estimated.

    The answer states the masses of the wall and of the interior on either side of its own plane. True masses
    are therefore cut along that plane, whatever divides the body.
    """
    assert trial.result is not None
    specimen, regions = trial.specimen, trial.result.regions
    if specimen.body.labels or regions.dividing_plane_normal is None:
        return
    normal, offset = np.array(regions.dividing_plane_normal), regions.dividing_plane_offset_m or 0.0
    above, inside = specimen.points @ normal > offset, ~specimen.in_shell
    parts = (specimen.in_shell, inside & above, inside & ~above)
    true = np.array([specimen.masses[part].sum() for part in parts])
    unit = 100 / float(specimen.masses.sum())
    group = "unexplained (%)" if regions.explained is False else "regions (%)"
    for region, mass in zip(regions.regions, true, strict=True):
        yield _score(group, region.name, said["regions"], region.mass, float(mass), unit)
        if region.limits_kg is not None:
            low, high = map(float, unit * np.array(region.limits_kg))
            yield Score(
                "limits (%)", region.name, "not mentioned", unit * mass, 0.5 * (low + high), low, high
            )
    if regions.shell_thickness is not None:
        wall = specimen.body.wall
        yield _score("wall (mm)", "wall", "not mentioned", regions.shell_thickness, wall, 1e3)


def _parts(trial: Trial, said: dict[str, str]) -> Iterator[Score]:
    assert trial.result is not None
    unit = 100 / float(trial.specimen.masses.sum())
    for part in () if trial.result.parts is None else trial.result.parts.parts:
        if part.mass.value is not None:
            yield _score(
                "parts (%)", part.name, said["parts"], part.mass, trial.specimen.parts[part.name], unit
            )


SIGMAS = SIGMAS_95
"""half width of a 95 % interval in standard deviations"""
