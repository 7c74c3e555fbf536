"""Results so far that a plan starts from: recordings, estimated together, and what `analyze estimate --json` printed."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np

from analyze.errors import PlanError
from analyze.geometry.edge_line import EdgeLine
from analyze.pipeline.estimate import Estimate, estimate_recordings
from analyze.pipeline.evidence import RecordingHead, read_head
from analyze.pipeline.merge import edge_line
from analyze.planning.given import Given, StrikeMade, together
from analyze.planning.striker_taught import Touch
from analyze.verbs.plan.files import RECORDING_SUFFIX
from schemas.document import validate
from schemas.result import Result
from schemas.rig import RigConfig


@dataclass(frozen=True)
class ResultsSoFar:
    """What the next plan starts from."""

    given: Given
    touches: tuple[Touch, ...]
    """strikes of the recordings whose striker is the one that is planned with"""


def read_given(paths: Sequence[Path], object_sha256: str, mass: float, rig: RigConfig | None) -> ResultsSoFar:
    """Read results so far; recordings among them become one estimate.

    Args:
        paths: recordings (.mcap) and results (JSON), at least one.
        object_sha256: of the object that is planned for.
        mass: kg, of the same.
        rig: that is planned for; None: that of the latest recording.

    Raises:
        RecordingError, JoinError, EstimationError: of the recordings.
        PlanError: a file is no result, is of another object, or holds a recording that another holds too.
    """
    recordings = [path for path in paths if path.suffix == RECORDING_SUFFIX]
    together_name = ", ".join(map(str, recordings))
    found = [(str(path), read_result(path)) for path in paths if path not in recordings]
    held = [(name, _recordings(result)) for name, result in found]
    if recordings:
        heads = [read_head(path) for path in recordings]
        held.insert(0, (together_name, {head.manifest.recording_id for head in heads}))
        for head in heads:  # before the work
            _refuse_other_object(str(head.path), head.manifest.object_sha256, object_sha256)
    for (one, first), (other, second) in combinations(held, 2):
        if first & second:
            raise PlanError(f"{one} and {other} are of the same recording: no strike may count twice, give one of them")
    touches: tuple[Touch, ...] = ()
    edges: dict[str, EdgeLine] = {}
    if recordings:
        estimate = estimate_recordings(recordings)
        found.insert(0, (together_name, estimate.result))
        touches = touches_of(estimate, rig)
        edges = {strike.axis_id: edge_line(strike) for strike in estimate.evidence.plan.strikes}
    for name, result in found:
        _refuse_other_object(name, result.inputs.object_sha256, object_sha256)
    given = [given_from_result(result, name, mass) for name, result in found]
    if recordings:
        given[0] = replace(given[0], edges=edges)
    return ResultsSoFar(together(given), touches)


def _refuse_other_object(name: str, found: str, wanted: str) -> None:
    if found != wanted:
        raise PlanError(f"{name}: is of another object, or of this one before its file was changed: give a result of this object file")


def touches_of(estimate: Estimate, rig: RigConfig | None) -> tuple[Touch, ...]:
    """What each used strike had of the striker, where it measured its speed; of the rig's striker only, or the latest recording's."""
    evidence = estimate.evidence
    wanted = _device(evidence.recordings[-1]) if rig is None else (rig.name, rig.striker.kind, rig.striker.arm_length_m)
    energy = {motion.strike_id: motion.energy_ratio for motion in evidence.motions}
    found: list[Touch] = []
    for strike in estimate.result.strikes:
        blow, ratio = evidence.blows.get(strike.id), energy[strike.id]
        if not strike.used or blow is None or ratio is None or strike.phi is None or strike.k is None or strike.i_edge is None:
            continue
        phi, k, i_edge = (_single(value, 0.0) for value in (strike.phi.value, strike.k.value, strike.i_edge.value))
        if min(phi, k, i_edge, ratio) > 0 and _device(evidence.recording_of(strike.id)) == wanted:
            found.append(Touch(strike.axis_id, blow.tip_speed, blow.height, i_edge, phi, k, ratio))
    return tuple(found)


def given_from_result(result: Result, name: str, mass: float) -> Given:
    """What a Result says to the planner.

    Raises:
        PlanError: it holds no strike that was used, or no centre of mass.
    """
    com, inertia = result.centre_of_mass, result.inertia
    strikes = [
        StrikeMade(
            strike.axis_id,
            _single(strike.phi.sd, 1e-3),
            None if strike.k is None or strike.k.sd is None else _single(strike.k.sd, 0.0) / max(_single(strike.k.value, 1.0), 1e-9),
            strike.heading_rad,
        )
        for strike in result.strikes
        if strike.used and strike.phi is not None
    ]
    if not strikes or com.value is None or com.covariance is None:
        raise PlanError(f"{name}: holds no strike that was used: plan from the first strike, without --given")
    unit_inertia = None if inertia.value is None else np.array(inertia.value, dtype=np.float64) / mass
    return Given(name, np.array(com.value, dtype=np.float64), np.array(com.covariance), unit_inertia, tuple(strikes), _directions(result))


def _device(head: RecordingHead) -> tuple[object, object, object]:
    """What tells one striker from another."""
    manifest = head.manifest
    return manifest.rig.get("name"), manifest.striker.get("kind"), manifest.striker.get("arm_length_m")


def read_result(path: Path) -> Result:
    """What `analyze estimate --json` printed.

    Raises:
        PlanError: it is not that.
        DocumentError: it is, but holds an entry that cannot be used.
    """
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise PlanError(f"{path}: no such file: give a recording (.mcap) or what `analyze estimate --json` printed") from None
    except OSError as error:
        raise PlanError(f"{path}: cannot be read: {error.strerror}") from None
    except (ValueError, RecursionError):
        raise PlanError(f"{path}: is no result: give a recording (.mcap) or what `analyze estimate --json` printed") from None
    return validate(Result, data, str(path))


def _recordings(result: Result) -> set[str]:
    """Ids of the recordings that went in."""
    inputs = result.inputs
    return {inputs.recording_id} if inputs.recordings is None else {each.recording_id for each in inputs.recordings}


def _directions(result: Result) -> dict[str, np.ndarray[Any, np.dtype[np.float64]]]:
    return {moment.axis_id: np.array(moment.direction, dtype=np.float64) for moment in result.moments}


def _single(value: float | list[float] | list[list[float]] | None, otherwise: float) -> float:
    return value if isinstance(value, float | int) else otherwise
