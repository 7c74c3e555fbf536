"""Earlier results that a plan of strikes starts from: recordings, estimated jointly, and Result files."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from pathlib import Path

import numpy as np

from analyze.errors import PlanError
from analyze.geometry.edge_line import EdgeLine
from analyze.motion.next_line import planned_axis
from analyze.pipeline.evidence import RecordingHead
from analyze.pipeline.merge import edge_line
from analyze.pipeline.read_evidence import read_head
from analyze.planning.earlier_results import EarlierResult, StrikeMade, merge_results
from analyze.planning.striker_update import Touch
from analyze.result.answer import Answer, answer_recordings
from schemas.document import validate
from schemas.input_file import read_text
from schemas.result import Result
from schemas.rig import RigConfig

RECORDING_SUFFIX = ".mcap"
"""suffix that distinguishes recordings from printed results"""


@dataclass(frozen=True)
class EarlierResults:
    """Earlier results of an object, from which its next plan of strikes starts.

    They are centre of mass, inertia and strikes made, merged from all files, and the striker's recorded
    impacts.
    """

    given: EarlierResult
    """centre of mass, inertia and strikes made, merged from all files"""
    touches: tuple[Touch, ...]
    """impacts of recorded strikes by the striker that the plan is for"""


def read_given(
    paths: Sequence[Path], object_sha256: str, mass: float, rig: RigConfig | None
) -> EarlierResults:
    """Read earlier results of an object for its next plan; return them merged into one.

    Recordings among the files are estimated jointly.

    Args:
        paths: recordings (.mcap) and results (JSON), at least one.
        object_sha256: hash of the object to plan for.
        mass: mass of that object [kg].
        rig: rig to plan for; None for that of the latest recording. Only impacts by its striker are returned.

    Returns:
        Merged from all files, centre of mass [m], inertia per kilogram [m²], both in the object frame O, and
        the strikes made; and the impacts that recordings measured.

    Raises:
        RecordingError, MergeError, ShapeError, TrackingError, EstimationError: the recordings cannot be
            estimated together.
        PlanError: a file is no result, is of another object, holds a recording that another holds too, or
            holds no strike that was used.
        DocumentError: a result holds an entry that cannot be used.
    """
    recordings = [path for path in paths if path.suffix == RECORDING_SUFFIX]
    together_name = ", ".join(map(str, recordings))
    found = [(str(path), read_result(path)) for path in paths if path not in recordings]
    held = [(name, _recordings(result)) for name, result in found]
    if recordings:
        heads = [read_head(path) for path in recordings]
        held.insert(0, (together_name, {head.manifest.recording_id for head in heads}))
        for head in heads:  # before the estimate, which takes minutes
            _refuse_other_object(str(head.path), head.manifest.object_sha256, object_sha256)
    for (one, first), (other, second) in combinations(held, 2):
        if first & second:
            raise PlanError(
                f"{one} and {other} hold the same recording: no strike may count twice: give one of them"
            )
    touches: tuple[Touch, ...] = ()
    edges: dict[str, EdgeLine] = {}
    if recordings:
        answer = answer_recordings(recordings)
        found.insert(0, (together_name, answer.result))
        touches = recorded_touches(answer, rig)
        edges = {strike.axis_id: edge_line(strike) for strike in answer.estimate.evidence.plan.strikes}
    for name, result in found:
        _refuse_other_object(name, result.inputs.object_sha256, object_sha256)
    given = [given_from_result(result, name, mass) for name, result in found]
    if recordings:
        given[0] = replace(given[0], edges=edges)
    return EarlierResults(merge_results(given), touches)


def _refuse_other_object(name: str, found: str, wanted: str) -> None:
    """Raise PlanError unless the recording or result `name` is of the object to plan for.

    `found` and `wanted` are the hashes of the two objects.
    """
    if found != wanted:
        raise PlanError(
            f"{name}: is of another object, or of this one before its file was changed: give a result of this"
            " object file"
        )


def recorded_touches(answer: Answer, rig: RigConfig | None) -> tuple[Touch, ...]:
    """Measured impact and its outcome for each strike used that was made by the rig's striker.

    A strike is listed if speed and height of the striker's tip were measured, and balance angle, rate
    constant k, moment about the edge and energy ratio (energy of the hit over that needed to tip) are
    positive. Its striker must equal the rig's in rig name, kind and arm length.

    Args:
        answer: answer from the recordings.
        rig: rig to plan for; None for that of the latest recording.

    Returns:
        One entry per such strike, in recording order; empty if there is none.
    """
    evidence = answer.estimate.evidence
    wanted = (
        _device(evidence.recordings[-1])
        if rig is None
        else (rig.name, rig.striker.kind, rig.striker.arm_length_m)
    )
    # Over a line that took over, the motion that was fitted began long after the impact.
    energy = {
        motion.strike_id: motion.energy_ratio if motion.carried_by is None else None
        for motion in evidence.motions
    }
    found: list[Touch] = []
    for strike in answer.result.strikes:
        impact, ratio = evidence.impacts.get(strike.id), energy[strike.id]
        if (
            not strike.used
            or impact is None
            or ratio is None
            or strike.phi is None
            or strike.k is None
            or strike.i_edge is None
        ):
            continue
        phi, k, i_edge = (
            _scalar_or(value, 0.0) for value in (strike.phi.value, strike.k.value, strike.i_edge.value)
        )
        if min(phi, k, i_edge, ratio) > 0 and _device(evidence.recording_of(strike.id)) == wanted:
            found.append(Touch(strike.axis_id, impact.tip_speed, impact.height, i_edge, phi, k, ratio))
    return tuple(found)


def given_from_result(result: Result, name: str, mass: float) -> EarlierResult:
    """Convert a Result document to the form that the planner starts from.

    Args:
        result: an earlier result of the object.
        name: name of the result, for messages.
        mass: mass of the object [kg], by which its inertia is divided.

    Returns:
        Centre of mass [m] with covariance, and inertia per kilogram [m²], both in the object frame O; the
        inertia is None if the result has none. Also the strikes used, each with the sd [rad] of its balance
        angle (0.001 if not given) and the relative sd of its rate constant k, and the directions of the
        struck axes by id.

    Raises:
        PlanError: the result holds no strike that was used, or no centre of mass.
    """
    com, inertia = result.centre_of_mass, result.inertia
    if result.fixture is not None:  # the plan is for what is struck
        com, inertia = result.fixture.struck_centre_of_mass, result.fixture.struck_inertia
    strikes = [
        StrikeMade(
            planned_axis(strike.axis_id),
            _scalar_or(strike.phi.sd, 1e-3),
            (
                None
                if strike.k is None or strike.k.sd is None
                else _scalar_or(strike.k.sd, 0.0) / max(_scalar_or(strike.k.value, 1.0), 1e-9)
            ),
            strike.heading_rad,
        )
        for strike in result.strikes
        if strike.used and strike.phi is not None
    ]
    if not strikes or com.value is None or com.covariance is None:
        raise PlanError(f"{name}: holds no strike that was used: plan from the first strike, without --given")
    unit_inertia = None if inertia.value is None else np.array(inertia.value, dtype=np.float64) / mass
    return EarlierResult(
        name,
        np.array(com.value, dtype=np.float64),
        np.array(com.covariance),
        unit_inertia,
        tuple(strikes),
        {
            planned_axis(moment.axis_id): np.array(moment.direction, dtype=np.float64)
            for moment in result.moments
        },
    )


def _device(head: RecordingHead) -> tuple[object, object, object]:
    """Rig name, kind and arm length [m] of the striker that made a recording; None where not stated."""
    manifest = head.manifest
    return manifest.rig.get("name"), manifest.striker.get("kind"), manifest.striker.get("arm_length_m")


def read_result(path: Path) -> Result:
    """Read the Result document that `analyze estimate --json` printed to the file at `path`; return it.

    Raises:
        PlanError: the file does not exist, cannot be read, or is no JSON.
        DocumentError: the result holds an entry that cannot be used.
    """
    try:
        data = json.loads(read_text(path))
    except FileNotFoundError:
        raise PlanError(
            f"{path}: no such file: give a recording (.mcap) or what `analyze estimate --json` printed"
        ) from None
    except OSError as error:
        raise PlanError(f"{path}: cannot be read: {error.strerror}") from None
    except (ValueError, RecursionError):
        raise PlanError(
            f"{path}: is no result: give a recording (.mcap) or what `analyze estimate --json` printed"
        ) from None
    return validate(Result, data, str(path))


def _recordings(result: Result) -> set[str]:
    """Ids (`recording_id` of the manifest) of the recordings that a result was estimated from."""
    inputs = result.inputs
    return (
        {inputs.recording_id}
        if inputs.recordings is None
        else {each.recording_id for each in inputs.recordings}
    )


def _scalar_or(value: float | list[float] | list[list[float]] | None, otherwise: float) -> float:
    """The value of a quantity if it is a number; `otherwise` if it is a list or None."""
    return value if isinstance(value, float | int) else otherwise
