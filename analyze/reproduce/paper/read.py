"""A recording of the virtual rig read for the reproduction: what its strikes showed, and apart from it the truth."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from analyze.pipeline.evidence import read_evidence, read_head
from analyze.pipeline.score import refuse_without_truth
from analyze.reading.recording import read_truth
from analyze.reproduce.paper.record import SessionRecord, Source
from analyze.reproduce.paper.session import session_record

if TYPE_CHECKING:
    from analyze.pipeline.evidence import Progress


def read_session(path: Path, progress: Progress | None = None) -> SessionRecord:
    """What one recording gives.

    Raises:
        RecordingError: it cannot be read, or holds no truth.
        EstimationError: too few good strikes.
    """
    head = read_head(path)
    refuse_without_truth([path])
    evidence = read_evidence(head, progress=progress)
    return session_record(evidence, read_truth(path).body, Source.IMAGES, progress=progress)
