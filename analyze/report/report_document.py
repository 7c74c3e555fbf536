"""Report of an estimate as a JSON document."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from analyze.report.sensitivity_plot import source_rows, worst_direction
from analyze.result.rounding import rounded
from schemas.document import canonical_json
from schemas.report import ErrorShare, InfluenceResult, Report, ReportRecording, SensitivityResult

if TYPE_CHECKING:
    from collections.abc import Mapping

    from analyze.pipeline.estimate import Estimate
    from analyze.pipeline.evidence import RecordingHead
    from analyze.result.answer import Answer


def report_json(answer: Answer, verdict: str, score: Mapping[str, Any] | None = None) -> str:
    """Report of an estimate as one line of JSON: recordings, result, sensitivity and score.

    Args:
        answer: estimate and its result.
        verdict: summary of the estimate in sentences, as on the HTML page.
        score: errors against ground truth (`score_answer`); None if the recordings are not virtual.
    """
    estimate = answer.estimate
    document = Report(
        object=estimate.evidence.spec.name,
        verdict=verdict,
        recordings=[
            report_recording(number, head) for number, head in enumerate(estimate.evidence.recordings, 1)
        ],
        result=answer.result,
        sensitivity=_sensitivity(estimate),
        score=None if score is None else dict(score),
    )
    return canonical_json(rounded(document))


def report_recording(number: int, head: RecordingHead) -> ReportRecording:
    """Entry of one recording in a report: files, ids, start time, program, camera, source of frame times.

    Args:
        number: number of the recording by start time, from 1.
        head: the recording.
    """
    manifest = head.manifest
    camera = manifest.cameras[0]
    return ReportRecording(
        number=number,
        files=list(head.files),
        recording_id=manifest.recording_id,
        content_id=head.content_id,
        created=manifest.created,
        software=manifest.software,
        camera=f"{camera.vendor} {camera.model}".strip(),
        frame_rate_hz=camera.frame_rate_hz,
        time_source=manifest.time_source.value,
    )


def _sensitivity(estimate: Estimate) -> SensitivityResult:
    covariance = estimate.com.covariance
    shares = {each.source: each.covariance for each in estimate.sensitivity.shares}
    return SensitivityResult(
        worst_direction=worst_direction(covariance).tolist(),
        strikes=[
            InfluenceResult(
                strike_id=each.strike_id,
                axis_id=each.axis_id,
                com_by_phi=each.by_phi.tolist(),
                com_by_log_k=each.by_log_k.tolist(),
            )
            for each in estimate.sensitivity.strikes
        ],
        sources=[
            ErrorShare(
                source=row.source.value,
                covariance=shares[row.source].tolist(),
                half95_worst_m=row.half,
                share_worst=row.share,
            )
            for row in source_rows(estimate.sensitivity, covariance)
        ],
    )
