"""Score of one session: what the answer says about contents that move, and of its centre of mass."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any
from unittest import mock

import numpy as np

from analyze.errors import AnalyzeError
from analyze.estimation.energy_test import EnergyTest
from analyze.estimation.joint import solve_joint
from analyze.estimation.joint_model import COM
from analyze.estimation.mass_properties import MassDistribution
from analyze.estimation.pose_test import PoseShift
from analyze.estimation.priors import ComPrior
from analyze.estimation.region_masses import mass_distribution
from analyze.estimation.rigidity import Rigidity, check_rigidity
from analyze.pipeline.equiplanes import equiplanes, systematic_errors
from analyze.pipeline.estimate import estimate_evidence
from analyze.pipeline.evidence import Evidence
from analyze.pipeline.loose_contents import LooseContents, energy_ratios, jolted_motions
from analyze.pipeline.solved import MIN_STRIKES, usable_motions
from analyze.result.document import result_document
from schemas.result import Result
from tests.benchmarks.contents.sessions import Session
from tests.benchmarks.honesty.verdicts import statuses

UNTESTED = Rigidity(
    EnergyTest((), 0.0, 0, np.inf, 0.0, 1.0, 1.0, np.inf), PoseShift((), 0.0, 0.0, 0, np.inf, np.inf)
)
"""tests of a session that were not made"""


@dataclass(frozen=True)
class Score:
    """One session, answered or refused."""

    cell: str
    seed: int
    answer: str
    """"not_rigid", "nothing_moves", "not_tested" or "refused" """
    by_energies: bool = False
    by_poses: bool = False
    share: float = np.inf
    """smallest share of a liquid that the answer says it would have found"""
    wrong: bool = False
    """True if the centre of mass of a pose lies outside the stated intervals"""
    trusted: bool = False
    """True if the answer trusts the centre of mass"""
    trusted_before: bool = False
    """True if it would without the tests of contents"""
    refusal: str = ""
    whole: bool = True
    """True if the whole answer was made, False if only the tests were"""


def score_tests(cell: str, seed: int, evidence: Evidence) -> Score:
    """Score of the tests of contents alone, which take a hundredth of the time of the whole answer."""
    used = usable_motions(evidence)
    if len(used) < MIN_STRIKES:
        return Score(cell, seed, "refused", refusal="too few strikes", whole=False)
    planes, errors = equiplanes(evidence, used), systematic_errors(evidence)
    prior = ComPrior.from_bounds(*evidence.model.bounds)
    com = solve_joint(planes, errors, prior).x[COM]
    jolted = jolted_motions(evidence)
    further = equiplanes(evidence, jolted), energy_ratios(jolted)
    found = check_rigidity(planes, energy_ratios(used), com, errors, prior, further)
    moves = found.energies.moves, found.poses.moves
    return Score(cell, seed, found.answer.value, *moves, found.share, whole=False)


def score_session(cell: str, session: Session, evidence: Evidence) -> Score:
    """Estimate a session, with and without the tests of contents, and compare it with the truth."""
    try:
        # Regions are not compared, and averaging them over walls takes most of the time.
        with mock.patch("analyze.pipeline.estimate.region_masses", _over_one_wall):
            estimate = estimate_evidence(evidence)
    except AnalyzeError as error:
        return Score(cell, session.seed, "refused", refusal=str(error))
    rigidity = estimate.contents.rigidity
    result = result_document(estimate)
    before = result_document(replace(estimate, contents=LooseContents(UNTESTED)))
    return Score(
        cell,
        session.seed,
        rigidity.answer.value,
        rigidity.energies.moves,
        rigidity.poses.moves,
        rigidity.share,
        _is_wrong(session, result),
        _trusts(result),
        _trusts(before),
    )


def _over_one_wall(
    _spec: object, _model: object, cells: Any, parameters: Any, rng: np.random.Generator
) -> MassDistribution:
    return mass_distribution(parameters, cells, rng)


def _trusts(result: Result) -> bool:
    return statuses(result)["c"] == "trust"


def _is_wrong(session: Session, result: Result) -> bool:
    """True if an interval of the centre of mass does not hold that of a pose in which the body rested."""
    ends = np.array(result.centre_of_mass.interval95)
    poses = {made.edge.pose for made in session.strikes}
    coms = np.array([session.box.resting_com(pose) for pose in poses])
    return bool(np.any((coms < ends[:, 0]) | (coms > ends[:, 1])))
