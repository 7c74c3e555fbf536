"""An estimate with its Result document: input of reports, replays, exports and archives."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from analyze.pipeline.estimate import estimate_evidence, estimate_recordings
from analyze.result.document import build, result_json

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from analyze.pipeline.estimate import Estimate, EstimateOptions
    from analyze.pipeline.evidence import Evidence
    from analyze.progress import Progress
    from schemas.result import Result


@dataclass(frozen=True)
class Answer:
    """Numbers about one object, and the document that presents them."""

    estimate: Estimate
    result: Result

    @classmethod
    def from_estimate(cls, estimate: Estimate) -> Answer:
        """Build the document of an estimate."""
        return cls(estimate, build(estimate))

    def json(self) -> str:
        """The document as one line; the same recordings give the same bytes."""
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
        RecordingError, JoinError, ShapeError, PlanError, EstimationError: see `estimate_recordings`.
    """
    return Answer.from_estimate(estimate_recordings(paths, options, progress))


def answer_evidence(evidence: Evidence, options: EstimateOptions | None = None) -> Answer:
    """Estimate one object from fitted motions and build the Result document; no files are read.

    Raises:
        EstimationError: fewer than three strikes can be used.
    """
    return Answer.from_estimate(estimate_evidence(evidence, options))
