"""Answer: an estimate with its Result document (JSON), the input of reports, replays and exports."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from analyze.pipeline.estimate import estimate_evidence
from analyze.pipeline.estimate_recordings import estimate_recordings
from analyze.result.document import result_document
from schemas.document import canonical_json

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from analyze.cache.results import ResultCache
    from analyze.pipeline.estimate import Estimate, EstimateOptions
    from analyze.pipeline.evidence import Evidence
    from analyze.progress import Progress
    from schemas.result import Result


@dataclass(frozen=True)
class Answer:
    """Joint estimate of one object, with the Result document (JSON) built from it."""

    estimate: Estimate
    """the estimate with its checks and evidence"""
    result: Result
    """the estimate's numbers with units and intervals, warnings and verdict, as a Result document"""

    @classmethod
    def from_estimate(cls, estimate: Estimate) -> Answer:
        """Answer that holds a given estimate and the Result document built from it."""
        return cls(estimate, result_document(estimate))

    def json(self) -> str:
        """The Result document as one line of JSON; the same recordings and options give the same bytes."""
        return canonical_json(self.result)


def answer_recordings(
    paths: Sequence[Path],
    options: EstimateOptions | None = None,
    progress: Progress | None = None,
    cache: ResultCache | None = None,
) -> Answer:
    """Estimate one object from one or several recordings; return it with the Result document.

    Args:
        paths: one or more recordings (MCAP), in any order.
        options: choices of the user; None for the defaults.
        progress: called with (text, done, total) before each strike, and before the estimate.
        cache: cache of strikes read and estimates made before; None to compute all anew.

    Returns:
        The estimate (centre of mass, inertia, masses of parts) with its Result document.

    Raises:
        RecordingError: a file cannot be read.
        MergeError: the recordings are not of one object, or one is named twice.
        ShapeError: the object's file or shape cannot be used, or a label names a part that it does not have.
        PlanError: a plan is of another object or shape, or lacks a strike that was recorded.
        TrackingError: no marker of any strike of a recording can be tracked.
        EstimationError: fewer than three strikes can be used, an excluded id names no strike or several, or
            parts or filling cannot be estimated.
    """
    return Answer.from_estimate(estimate_recordings(paths, options, progress, cache))


def answer_evidence(evidence: Evidence, options: EstimateOptions | None = None) -> Answer:
    """Estimate one object from fitted motions; return it with the Result document. No files are read.

    Args:
        evidence: fitted motions of all strikes, with object, shape and plan.
        options: choices of the user; None for the defaults.

    Returns:
        The estimate (centre of mass, inertia, masses of parts) with its Result document.

    Raises:
        EstimationError: fewer than three strikes can be used, or parts or filling cannot be estimated.
        ShapeError: a label of the object file names a part that the shape does not have.
    """
    return Answer.from_estimate(estimate_evidence(evidence, options))
