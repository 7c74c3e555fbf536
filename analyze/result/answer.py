"""Answer: an estimate with its Result document, the input of reports, replays, exports and archives."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from analyze.pipeline.estimate import estimate_evidence, estimate_recordings
from analyze.result.document import result_document, result_json

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from analyze.pipeline.estimate import Estimate, EstimateOptions
    from analyze.pipeline.evidence import Evidence
    from analyze.progress import Progress
    from schemas.result import Result


@dataclass(frozen=True)
class Answer:
    """Estimate of one object, with the Result document built from it."""

    estimate: Estimate
    result: Result

    @classmethod
    def from_estimate(cls, estimate: Estimate) -> Answer:
        """Build the Result document of an estimate."""
        return cls(estimate, result_document(estimate))

    def json(self) -> str:
        """The Result document as one line of JSON; the same recordings give the same bytes."""
        return result_json(self.result)


def answer_recordings(
    paths: Sequence[Path], options: EstimateOptions | None = None, progress: Progress | None = None
) -> Answer:
    """Estimate one object from one or several recordings and build the Result document.

    Args:
        paths: recordings (MCAP).
        options: choices of the user.
        progress: called with (text, done, total) before each strike.

    Raises:
        RecordingError, MergeError, ShapeError, PlanError, EstimationError: see `estimate_recordings`.
    """
    return Answer.from_estimate(estimate_recordings(paths, options, progress))


def answer_evidence(evidence: Evidence, options: EstimateOptions | None = None) -> Answer:
    """Estimate one object from fitted motions and build the Result document; no files are read.

    Raises:
        EstimationError: fewer than three strikes can be used.
    """
    return Answer.from_estimate(estimate_evidence(evidence, options))
