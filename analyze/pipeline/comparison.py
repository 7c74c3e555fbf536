"""Repeated sessions of one object side by side: each one's answer, whether they agree, and which stands out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from scipy.special import chdtrc

from analyze.errors import EstimationError
from analyze.estimation.agreement import Agreement, agreement
from analyze.estimation.stated import ComPrior
from analyze.pipeline.estimate import Estimate, EstimateOptions, equiplanes, estimate_evidence, systematic_errors
from analyze.pipeline.evidence import Evidence, read_evidence, read_head
from analyze.pipeline.merge import in_order, join, joint_axes, refuse_apart, strikes_to_leave_out
from schemas.document import canonical_json

if TYPE_CHECKING:
    from analyze.pipeline.evidence import Progress, RecordingHead

STANDS_OUT = 1e-3
"""chance at which one of the sessions is said to stand out"""


@dataclass(frozen=True)
class Session:
    """One session by itself, and against all others."""

    head: RecordingHead
    estimate: Estimate
    """its axes are called as in the joint; its strikes as it names them itself"""
    setup: int
    """number of the set-up, from 0: rig, its level and the camera's calibration"""
    apart: Agreement
    """from all other sessions, which count as one"""

    @property
    def chance(self) -> float:
        """Of being as far off all others, or farther, if nothing is wrong."""
        return chance_of(self.apart.chi_squared, 3)


@dataclass(frozen=True)
class SessionComparison:
    """Two or more sessions of one object."""

    sessions: tuple[Session, ...]
    """by time"""
    together: Agreement
    joint: Estimate
    """of all strikes as one body of evidence"""

    @property
    def chance(self) -> float:
        """Of sessions as far apart, or farther, if they mean one centre of mass."""
        return chance_of(self.together.chi_squared, self.freedom)

    @property
    def freedom(self) -> int:
        """Degrees of freedom of the sessions' chi squared."""
        return 3 * (len(self.sessions) - 1)

    @property
    def stands_out(self) -> int | None:
        """Place of the session that is farther off the others than chance has it, if one is; of two neither stands out."""
        chances = [session.chance for session in self.sessions]
        worst = int(np.argmin(chances))
        return worst if len(chances) > 2 and chances[worst] < STANDS_OUT / len(chances) else None

    @property
    def may_join(self) -> bool:
        """One centre of mass will do for all."""
        return self.together.holds


def compare_recordings(
    paths: Sequence[Path], options: EstimateOptions | None = None, progress: Progress | None = None
) -> SessionComparison:
    """Each recording's answer, and how they agree.

    Args:
        paths: two or more recordings (MCAP) of one object.
        options: what the user changes.
        progress: called with (text, done, total) before each strike and each estimate.

    Raises:
        RecordingError: a file cannot be read.
        JoinError: the recordings are not of one object, or one is named twice.
        EstimationError: a session has too few good strikes for an answer of its own.
    """
    options = options or EstimateOptions()
    heads = in_order([read_head(path) for path in paths])
    refuse_apart(heads, options.object_path is not None)
    options = replace(options, exclude=strikes_to_leave_out(heads, options.exclude))
    strikes = sum(len(head.strike_ids) for head in heads)
    total, done = strikes + len(heads) + 1, 0

    def tell(text: str, more: int = 0) -> None:
        if progress is not None:
            progress(text, done + more, total)

    read: list[Evidence] = []
    for head in heads:
        name = head.path.name
        read.append(read_evidence(head, options.object_path, lambda text, of, _, name=name: tell(f"{name}, {text}", of)))
        done += len(head.strike_ids)
    return compare_evidence(read, options, lambda text, of, _: tell(text, of))


def compare_evidence(
    read: Sequence[Evidence], options: EstimateOptions | None = None, progress: Progress | None = None
) -> SessionComparison:
    """The same from fitted motions; `options.exclude` names strikes as the joint does, where there are several recordings.

    Raises:
        JoinError: they are not of one object.
        EstimationError: a session has too few good strikes for an answer of its own.
    """
    options = options or EstimateOptions()
    evidence = join(read)
    ordered = [next(each for each in read if each.recordings[0].content_id == head.content_id) for head in evidence.recordings]
    steps = len(ordered) + 1
    alone: list[Estimate] = []
    for number, (each, names) in enumerate(zip(ordered, joint_axes(ordered), strict=True), 1):
        head = each.recordings[0]
        if progress is not None:
            progress(f"{head.path.name}, its answer", number - 1, steps)
        plan = each.plan.model_copy(
            update={"strikes": [strike.model_copy(update={"axis_id": names[strike.axis_id]}) for strike in each.plan.strikes]}
        )
        own = frozenset(name.partition(":")[2] for name in options.exclude if name.startswith(f"{number}:"))
        try:
            alone.append(estimate_evidence(replace(each, plan=plan), replace(options, exclude=own)))
        except EstimationError as error:
            raise EstimationError(f"{head.path}: {error}: leave this recording out of the comparison") from None
    if progress is not None:
        progress("all together", steps - 1, steps)
    joint = estimate_evidence(evidence, options)
    numbers = [evidence.recorded_in[plane.strike_id] for plane in joint.planes]
    setups = _setups(evidence.recordings)
    sessions = tuple(
        Session(each.recordings[0], estimate, setups[i], _apart(joint, [int(number == i) for number in numbers]))
        for i, (each, estimate) in enumerate(zip(ordered, alone, strict=True))
    )
    return SessionComparison(sessions, _apart(joint, numbers), joint)


def chance_of(chi_squared: float, freedom: int) -> float:
    """Of such a chi squared or a larger one."""
    return float(chdtrc(freedom, max(chi_squared, 0.0)))


def _apart(joint: Estimate, numbers: Sequence[int]) -> Agreement:
    """How much better the strikes fit if each number has a centre of mass of its own."""
    evidence = joint.evidence
    motions = {motion.strike_id: motion for motion in evidence.motions}
    planes = equiplanes(evidence, [motions[plane.strike_id] for plane in joint.planes])
    return agreement(planes, numbers, joint.com_struck, systematic_errors(evidence), ComPrior.from_bounds(*evidence.model.bounds))


def _setups(heads: Sequence[RecordingHead]) -> list[int]:
    """Which set-up each session was made with, numbered as they come: what is stated of rig, level and cameras tells."""
    found: list[tuple[str, ...]] = []
    for head in heads:
        manifest = head.manifest
        level = "" if manifest.level is None else canonical_json(manifest.level)
        cameras = [canonical_json(camera.calibration) for camera in manifest.cameras]
        found.append((str(manifest.rig.get("name", "")), str(manifest.gravity_tilt_sd_rad), level, *cameras))
    kinds = list(dict.fromkeys(found))
    return [kinds.index(each) for each in found]
