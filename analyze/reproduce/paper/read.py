"""Session record of a virtual rig's recording; the estimate does not use the ground truth."""

from __future__ import annotations

from pathlib import Path

from analyze.pipeline.read_evidence import read_evidence, read_head
from analyze.progress import Progress, no_progress
from analyze.reading.truth import read_truth
from analyze.reproduce.paper.record import SessionRecord, ThetaSource
from analyze.reproduce.paper.session import session_record
from analyze.result.score import refuse_without_truth


def read_session(path: Path, progress: Progress = no_progress) -> SessionRecord:
    """Analyse one recording of the virtual rig into the record that tables and figures are made from.

    Args:
        path: recording with ground truth.
        progress: called with (text, done, total).

    Returns:
        Ground truth, estimates, and data of the figures.

    Raises:
        RecordingError: the recording cannot be read, or contains no ground truth.
        ShapeError: the object's shape cannot be used.
        PlanError: the plan is of another object.
        TrackingError: no marker can be tracked.
        EstimationError: too few strikes can be used, or none has verdict "good".
    """
    head = read_head(path)
    refuse_without_truth([path])
    evidence = read_evidence(head, progress=progress)
    return session_record(evidence, read_truth(path).body, ThetaSource.IMAGES, progress=progress)
