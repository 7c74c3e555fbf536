"""Strikes and estimates from the cache, where the same strikes were read or estimated before.

A strike is identified by the recording's content and files, the object, its shape, the plan and the markers;
an estimate by its evidence and options. Neither depends on the name or the folder of the recording.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from functools import partial
from typing import TYPE_CHECKING

from analyze.errors import TrackingError
from analyze.flight.toss import TossMotion
from analyze.pipeline.contact_properties import with_contact_properties
from analyze.pipeline.estimate import Estimate, EstimateOptions, estimate_evidence
from analyze.pipeline.evidence import Evidence, StrikeReading
from analyze.pipeline.read_evidence import read_strike
from analyze.pipeline.tosses import read_toss
from analyze.reading.recording import Recording
from analyze.tracking.track import TrackingReport
from analyze.types import TipMotion
from schemas.object_spec import ObjectSpec
from schemas.strike_plan import StrikePlan
from schemas.wording import counted

if TYPE_CHECKING:
    from analyze.cache.results import ResultCache
    from analyze.pipeline.evidence import RecordingHead, StrikeReader, StrikeSource, StruckObject, TossReader
    from analyze.pipeline.toss_marks import TossMarks
    from analyze.types import Marker
    from schemas.proto import percuss_pb2 as pb


@dataclass(frozen=True)
class KeptReading:
    """Result of reading one strike (motion, tracking, frames lost) as cached: without the strike's record."""

    motion: TipMotion
    """motion and fits"""
    report: TrackingReport | None
    """markers as tracked; None if none could be"""
    problem: str | None
    """reason why no marker could be tracked; None otherwise"""
    frames_lost: int
    """frames lost within the strike's window"""


@dataclass(frozen=True)
class KeptEstimate:
    """Estimate without evidence and options, and what the estimate changed in the evidence."""

    estimate: Estimate
    """the estimate"""
    spec: ObjectSpec
    """object file in the estimate's evidence"""
    plan: StrikePlan
    """strike plan in the estimate's evidence"""


def cached_strike_reader(cache: ResultCache | None) -> StrikeReader:
    """Function that reads one strike (tracks its markers, fits its motion), or takes it from the cache.

    Only strikes of recordings that are finished, sealed and undamaged are kept in the cache.

    Args:
        cache: cache of results; None to read every strike from its images.
    """
    return read_strike if cache is None else partial(_read_strike, cache)


def cached_toss_reader(cache: ResultCache | None) -> TossReader:
    """Function that reads one toss (tracks its markers, fits its flight), or takes it from the cache.

    Args:
        cache: cache of results; None to read every toss from its images.
    """
    return read_toss if cache is None else partial(_read_toss, cache)


def estimate_with_cache(
    cache: ResultCache | None, evidence: Evidence, options: EstimateOptions | None = None
) -> Estimate:
    """Joint estimate from all strikes, taken from the cache if the same one was computed before.

    It includes friction and restitution on the table.

    Args:
        cache: cache of results; None to compute every estimate.
        evidence: fitted motions of all strikes, with object, shape and plan.
        options: choices of the user; None for the defaults.

    Raises:
        EstimationError: fewer than three strikes can be used, or parts or filling cannot be estimated.
        ShapeError: a label of the object file names a part that the shape does not have.
    """
    options = options or EstimateOptions()
    if cache is None:
        return with_contact_properties(estimate_evidence(evidence, options))

    def compute() -> KeptEstimate:
        estimate = with_contact_properties(estimate_evidence(evidence, options))
        return KeptEstimate(estimate, estimate.evidence.spec, estimate.evidence.plan)

    kept = cache.get(
        KeptEstimate,
        inputs_of_estimate(evidence, options),
        f"estimate of {evidence.spec.name} from {counted(len(evidence.motions), 'strike')}",
        compute,
        {Evidence: evidence, EstimateOptions: options},
    )
    return replace(kept.estimate, evidence=replace(evidence, spec=kept.spec, plan=kept.plan))


def _read_strike(
    cache: ResultCache,
    recording: StrikeSource,
    struck: StruckObject,
    markers: list[Marker],
    record: pb.StrikeRecord,
) -> StrikeReading:
    inputs = _inputs_of_reading(recording, struck, markers, record)
    if inputs is None:
        return read_strike(recording, struck, markers, record)

    def compute() -> KeptReading:
        reading = read_strike(recording, struck, markers, record)
        problem = None if reading.problem is None else str(reading.problem)
        return KeptReading(reading.motion, reading.report, problem, reading.frames_lost)

    kept = cache.get(KeptReading, inputs, f"strike {record.strike_id} of {recording.path.name}", compute)
    problem = None if kept.problem is None else TrackingError(kept.problem)
    return StrikeReading(record, kept.motion, kept.report, problem, kept.frames_lost)


def _read_toss(
    cache: ResultCache,
    recording: StrikeSource,
    struck: StruckObject,
    marks: TossMarks,
    record: pb.TossRecord,
) -> TossMotion:
    inputs = _inputs_of_reading(recording, struck, marks, record)
    if inputs is None:
        return read_toss(recording, struck, marks, record)
    label = f"toss {record.toss_id} of {recording.path.name}"
    return cache.get(TossMotion, inputs, label, lambda: read_toss(recording, struck, marks, record))


def _inputs_of_reading(
    recording: StrikeSource,
    struck: StruckObject,
    followed: list[Marker] | TossMarks,
    record: pb.StrikeRecord | pb.TossRecord,
) -> tuple[object, ...] | None:
    """Values that the reading of one strike or toss depends on; together they are its key in the cache.

    None for a recording whose readings are not kept: one that grows, is damaged, or whose file is gone.

    The images are identified by the files' sealed hashes. Size and time of change of the files show whether
    one was damaged since it was sealed.
    """
    if not isinstance(recording, Recording) or recording.content_id is None or recording.damaged_chunks:
        return None
    try:
        states = [part.path.stat() for part in recording.parts]
    except OSError:  # a file was renamed or removed meanwhile; it is still open
        return None
    return (
        [part.content_id for part in recording.parts],
        [(state.st_size, state.st_mtime_ns) for state in states],
        list(recording.missing_parts),
        recording.manifest,
        struck.spec,
        struck.sha256,
        struck.plan,
        followed,
        record.SerializeToString(deterministic=True).hex(),
    )


def inputs_of_estimate(evidence: Evidence, options: EstimateOptions) -> tuple[object, ...]:
    """Values that an estimate depends on: evidence without names of files and program, and options.

    Together they are the estimate's key in the cache.

    An object file that replaces the recording's is part of the evidence.
    """
    return (
        [_fields_of(head, "path", "files") for head in evidence.recordings],
        _fields_of(evidence, "recordings", "software"),
        _fields_of(options, "object_path"),
    )


def _fields_of(value: Evidence | EstimateOptions | RecordingHead, *without: str) -> dict[str, object]:
    """Fields of a dataclass by name, except those named in `without`."""
    return {field.name: getattr(value, field.name) for field in fields(value) if field.name not in without}
