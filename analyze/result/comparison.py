"""Comparison of repeated sessions (recordings) of one object: their answers, agreement and outliers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from scipy.special import chdtrc

from analyze.errors import EstimationError
from analyze.estimation.agreement import Agreement, agreement
from analyze.estimation.priors import ComPrior
from analyze.pipeline.cached import estimate_with_cache
from analyze.pipeline.equiplanes import systematic_errors
from analyze.pipeline.estimate import Estimate, EstimateOptions
from analyze.pipeline.estimate_recordings import mergeable_heads, offset_progress, read_recordings
from analyze.pipeline.evidence import Evidence
from analyze.pipeline.merge import merge_evidence, merged_axis_ids
from analyze.result.answer import Answer
from schemas.document import canonical_json

if TYPE_CHECKING:
    from analyze.cache.results import ResultCache
    from analyze.pipeline.evidence import RecordingHead
    from analyze.progress import Progress

OUTLIER_P_VALUE = 1e-3
"""a session counts as an outlier if its p-value is below this over the number of sessions"""


@dataclass(frozen=True)
class Session:
    """Answer of one session (one recording) of several, and its agreement with all others."""

    head: RecordingHead
    """identity and contents of the recording"""
    answer: Answer
    """answer from this session alone; axis ids as in the joint estimate, strike ids as recorded"""
    setup: int
    """number of the set-up, from 0; a set-up is a rig, a level reading and a camera calibration"""
    against_others: Agreement
    """test of one centre of mass for this session and all others, the others taken as one"""

    @property
    def p_value(self) -> float:
        """Probability that a session's centre of mass differs as much, or more, from the others' by chance.

        It is that of chi squared with three degrees of freedom; all other sessions have one common centre of
        mass.
        """
        return chi_squared_p_value(self.against_others.chi_squared, 3)


@dataclass(frozen=True)
class SessionComparison:
    """Two or more sessions (recordings) of one object, each estimated by itself and all together.

    It includes the test of one centre of mass for all.
    """

    sessions: tuple[Session, ...]
    """sessions by start time"""
    together: Agreement
    """test of one centre of mass for all sessions against one for each"""
    joint: Answer
    """answer from the strikes of all sessions together"""

    @property
    def p_value(self) -> float:
        """Probability that sessions with one common centre of mass differ as much, or more, by chance.

        It is that of chi squared with three degrees of freedom per session but the first.
        """
        return chi_squared_p_value(self.together.chi_squared, self.degrees_of_freedom)

    @property
    def degrees_of_freedom(self) -> int:
        """Degrees of freedom of the test of one centre of mass: three per session but the first."""
        return 3 * (len(self.sessions) - 1)

    @property
    def outlier(self) -> int | None:
        """Index in `sessions` of the session whose centre of mass is an outlier, or None.

        The session is the one that differs most from the others. None if its p-value (`Session.p_value`) is
        not below `OUTLIER_P_VALUE` over the number of sessions, or if there are fewer than three sessions.
        """
        p_values = [session.p_value for session in self.sessions]
        worst = int(np.argmin(p_values))
        return worst if len(p_values) > 2 and p_values[worst] < OUTLIER_P_VALUE / len(p_values) else None

    @property
    def may_merge(self) -> bool:
        """True if one centre of mass fits all sessions, so that their recordings may be merged.

        It fits if chi squared with one centre for all exceeds that with one for each session by at most the
        critical value at a false-alarm probability of 0.001.
        """
        return self.together.holds


def compare_recordings(
    paths: Sequence[Path],
    options: EstimateOptions | None = None,
    progress: Progress | None = None,
    cache: ResultCache | None = None,
) -> SessionComparison:
    """Estimate each recording by itself and all together, and test whether their centres of mass agree.

    Args:
        paths: two or more recordings (MCAP) of one object, each one session.
        options: choices of the user; None for the defaults.
        progress: called with (text, done, total) before each strike and each estimate.
        cache: cache of strikes read and estimates made before; None to compute all anew.

    Returns:
        Answers of the sessions by start time, the joint answer, and the tests of their centres of mass.

    Raises:
        RecordingError: a file cannot be read.
        MergeError: the recordings are not of one object, or one is named twice.
        ShapeError: the object's file or shape cannot be used, or a label names a part that it does not have.
        PlanError: a plan is of another object or shape, or lacks a strike that was recorded.
        TrackingError: no marker of any strike of a recording can be tracked.
        EstimationError: a session has fewer than three usable strikes, an excluded id names no strike or
            several, or parts or filling cannot be estimated.
    """
    heads, options = mergeable_heads(paths, options)
    done, estimates = sum(len(head.strike_ids) for head in heads), len(heads) + 1
    read = read_recordings(heads, options, progress, cache, further_steps=estimates)
    return compare_evidence(read, options, offset_progress(progress, done, done + estimates), cache)


def compare_evidence(
    read: Sequence[Evidence],
    options: EstimateOptions | None = None,
    progress: Progress | None = None,
    cache: ResultCache | None = None,
) -> SessionComparison:
    """Compare sessions of one object from their fitted motions; no files are read.

    Each session is estimated by itself and all together.

    Args:
        read: evidence (fitted motions) of two or more recordings, in any order.
        options: choices of the user; `exclude` holds merged strike ids (`2:s3.1`: s3.1 of the second).
        progress: called with (text, done, total) before each estimate.
        cache: cache of estimates made before; None to compute all anew.

    Returns:
        Answers of the sessions by start time, the joint answer, and the tests of their centres of mass.

    Raises:
        MergeError: the recordings are not of one object, or one is given twice.
        EstimationError: a session has fewer than three usable strikes, or parts or filling cannot be
            estimated.
        ShapeError: a label of the object file names a part that the shape does not have.
    """
    options = options or EstimateOptions()
    evidence = merge_evidence(read)
    ordered = [
        next(each for each in read if each.recordings[0].content_id == head.content_id)
        for head in evidence.recordings
    ]
    steps = len(ordered) + 1
    alone: list[Answer] = []
    for number, (each, names) in enumerate(zip(ordered, merged_axis_ids(ordered), strict=True), 1):
        head = each.recordings[0]
        if progress is not None:
            progress(f"{head.path.name}, estimating", number - 1, steps)
        plan = each.plan.model_copy(
            update={
                "strikes": [
                    strike.model_copy(update={"axis_id": names[strike.axis_id]})
                    for strike in each.plan.strikes
                ]
            }
        )
        own = frozenset(name.partition(":")[2] for name in options.exclude if name.startswith(f"{number}:"))
        try:
            found = estimate_with_cache(cache, replace(each, plan=plan), replace(options, exclude=own))
            alone.append(Answer.from_estimate(found))
        except EstimationError as error:
            raise EstimationError(
                f"{head.path}: {error}: leave this recording out of the comparison"
            ) from None
    if progress is not None:
        progress("estimating all together", steps - 1, steps)
    joint = estimate_with_cache(cache, evidence, options)
    numbers = [evidence.recorded_in[plane.strike_id] for plane in joint.planes]
    setups = _setups(evidence.recordings)
    sessions = tuple(
        Session(
            each.recordings[0],
            answer,
            setups[i],
            _separate_centres(joint, [int(number == i) for number in numbers]),
        )
        for i, (each, answer) in enumerate(zip(ordered, alone, strict=True))
    )
    return SessionComparison(sessions, joint.agreements.recordings, Answer.from_estimate(joint))


def chi_squared_p_value(chi_squared: float, degrees_of_freedom: int) -> float:
    """Probability that a chi squared variable of `degrees_of_freedom` is at least `chi_squared`.

    A negative `chi_squared` is taken as 0.
    """
    return float(chdtrc(degrees_of_freedom, max(chi_squared, 0.0)))


def _separate_centres(joint: Estimate, numbers: Sequence[int]) -> Agreement:
    """Test whether groups of strikes have one centre of mass in common, or each group one of its own.

    It uses the balance angles of the joint estimate.

    Args:
        joint: estimate from all strikes.
        numbers: group of each strike used, in the order of `joint.planes`.

    Returns:
        Largest distance [m] of a group's centre of mass from that of the group with the smallest number;
        decrease of chi squared if each group has its own, and the critical value of the decrease.
    """
    prior = ComPrior.from_bounds(*joint.evidence.model.bounds)
    return agreement(joint.fitted_planes, numbers, joint.com_struck, systematic_errors(joint.evidence), prior)


def _setups(heads: Sequence[RecordingHead]) -> list[int]:
    """Number of each recording's set-up, counted from 0 by first appearance; equal set-ups share a number.

    A set-up is the rig's name, the sd of the table's tilt, the level reading and the cameras' calibration.
    """
    found: list[tuple[str, ...]] = []
    for head in heads:
        manifest = head.manifest
        level = "" if manifest.level is None else canonical_json(manifest.level)
        cameras = [canonical_json(camera.calibration) for camera in manifest.cameras]
        found.append((str(manifest.rig.get("name", "")), str(manifest.gravity_tilt_sd_rad), level, *cameras))
    kinds = list(dict.fromkeys(found))
    return [kinds.index(each) for each in found]
