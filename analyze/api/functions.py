"""Functions of the public API: load a recording, estimate an object, plan strikes."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from analyze.api.object_estimate import ObjectEstimate
from analyze.api.recording import Recording
from analyze.api.strike_plan import Plan
from analyze.pipeline.estimate import EstimateOptions
from analyze.pipeline.merge import merge_evidence, resolve_exclusions
from analyze.result.answer import answer_evidence

if TYPE_CHECKING:
    from collections.abc import Collection

    from analyze.progress import Progress


def load(
    path: str | Path, object_file: str | Path | None = None, progress: Progress | None = None
) -> Recording:
    """Open a recording of strikes; markers are tracked when its strikes are first used.

    Args:
        path: the recording (MCAP), or one file of a recording that was split into a series of files.
        object_file: object file (TOML: name, mass, shape, markers) that replaces the recording's; None to
            use the recording's.
        progress: called with (text, strikes done, strikes in all) before each strike is tracked; None for
            silence.

    Returns:
        The recording; only its description is read so far.

    Raises:
        RecordingError: the file cannot be read.
    """
    return Recording(Path(path), None if object_file is None else Path(object_file), progress)


def estimate(
    *recordings: Recording | str | Path,
    object_file: str | Path | None = None,
    exclude: Collection[str] = (),
    estimator: str | None = None,
    seed: int = 0,
    progress: Progress | None = None,
) -> ObjectEstimate:
    """Estimate centre of mass, inertia tensor and region masses of one object from its strikes.

    The regions are the object's shell and its interior above and below a dividing plane. Strikes that a
    loaded recording has tracked already are not tracked again. All errors but ValueError are subclasses of
    `AnalyzeError` in `analyze.errors`.

    Args:
        recordings: one or several recordings of the object, loaded or as paths; their order does not matter.
        object_file: object file (TOML) that replaces the recordings'; only for recordings given as paths.
        exclude: ids of strikes to leave out, such as `s3.1`; of several recordings `2:s3.1`, strike s3.1 of
            the second by start time. A bare id is enough where one recording alone holds it.
        estimator: estimator of phi, the balance angle, and k, the rate constant of the tipping motion:
            pivot_fit, rolling_fit, moment_balance or sign_change. Strikes that it did not fit, and all
            strikes if None, use the estimator chosen for their motion.
        seed: seed of the random draws behind intervals of region masses, labelled parts and fillings.
        progress: called with (text, strikes done, strikes in all) before each strike of a recording given as
            a path is tracked; the count starts again with each recording.

    Returns:
        The estimate with its uncertainties and verdict.

    Raises:
        ValueError: no recording is given, or a loaded one together with `object_file`.
        RecordingError: a file cannot be read.
        MergeError: the recordings are not of one object, or one is given twice.
        ShapeError: the object file or the object's shape cannot be used, or a label of the file names a part
            that the shape does not have.
        PlanError: a recording's strike plan is of another object or shape, or does not hold a strike.
        TrackingError: no marker of any strike of one recording can be tracked.
        EstimationError: fewer than three strikes can be used, `exclude` holds an id that no strike, or more
            than one, has, or labelled parts or a filling cannot be estimated.
    """
    if not recordings:
        raise ValueError("no recording: give one or several, as in analyze.estimate('strikes.mcap')")
    if object_file is not None and any(isinstance(each, Recording) for each in recordings):
        raise ValueError("object_file is for recordings given as paths: give it to analyze.load instead")
    loaded = [
        each if isinstance(each, Recording) else load(each, object_file, progress) for each in recordings
    ]
    evidence = merge_evidence([each.evidence for each in loaded])
    options = EstimateOptions(
        object_path=None if object_file is None else Path(object_file),
        exclude=resolve_exclusions(evidence.recordings, frozenset(exclude)),
        estimator=estimator,
        seed=seed,
    )
    return ObjectEstimate(answer_evidence(evidence, options))


def plan(
    object_file: str | Path,
    rig: str | Path | None = None,
    strikes: int | None = None,
    target_com_mm: float | None = None,
    given: Collection[str | Path] = (),
) -> Plan:
    """Plan the strikes that determine an object's centre of mass and inertia best.

    Args:
        object_file: object file (TOML: name, mass, shape, markers).
        rig: rig file (TOML) of striker and camera; None for the rig stored in the latest recording of
            `given`, or for a nominal rig where there is none.
        strikes: number of strikes to plan, in addition to those in `given`; None for nine. With a target it
            is the number planned if the target is out of reach.
        target_com_mm: rms error of the centre of mass [mm] to reach with as few strikes as possible; None
            for a fixed number of strikes.
        given: recordings (.mcap) and results (JSON) of strikes already made, from which the plan continues.

    Returns:
        The planned strikes with the accuracy expected from them.

    Raises:
        ShapeError: the object file or its shape cannot be used.
        RecordingError, MergeError, TrackingError, EstimationError: the recordings in `given` cannot be read,
            merged, tracked or estimated.
        DocumentError: a result in `given` holds an entry that cannot be used.
        PlanError: no set of strikes determines the centre of mass, a marker is not on the object's surface,
            or the rig file or a result cannot be used.
    """
    from analyze.verbs.plan.plan_object import STRIKES, PlanOptions, plan_object

    options = PlanOptions(
        rig_path=None if rig is None else Path(rig),
        strikes=STRIKES if strikes is None else strikes,
        target_com_mm=target_com_mm,
        given=tuple(Path(each) for each in given),
    )
    return Plan(plan_object(Path(object_file), options))
