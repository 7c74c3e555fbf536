"""A short session on the whole virtual rig, and what its recording tells against the ground truth."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from acquire.virtual.pace import Pace, read_pace
from acquire.virtual.truth import merge_truth
from analyze.pipeline.read_evidence import read_evidence, read_head
from analyze.reading.truth import Truth, read_truth
from analyze.result.score import tip_truth
from schemas.strike_plan import read_strike_plan
from schemas.strike_result import Verdict
from tests.system.session_rig import session_rig

if TYPE_CHECKING:
    from acquire.virtual.device_kinds import DeviceKinds
    from analyze.types import Array, TipAngle

MOVING_RAD = (0.02, 0.3)
"""tipping angles between which frames are compared with the true motion [rad]"""


@dataclass(frozen=True)
class StruckSession:
    """Figures of a session: camera, frames, strikes against the ground truth."""

    model: str
    """model of the camera, as the recording states it"""
    frames: int
    lost: int
    pace: Pace
    """delays of the virtual rig, and images that it never sent"""
    verdicts: tuple[str, ...]
    """verdict of every strike, repeated ones too"""
    phi_errors_rad: tuple[float, ...]
    """error of the balance angle of each good strike [rad]"""
    phi_sds_rad: tuple[float, ...]
    """stated standard deviations of those angles [rad]"""
    delays_ms: tuple[float, ...]
    """time by which the frames of each good strike are stamped too late [ms]"""


def struck_session(kinds: DeviceKinds, strikes: int = 1) -> StruckSession:
    """Carry out the first `strikes` strikes of a plan, and compare its recording with the truth.

    Raises:
        AssertionError: the session broke off, or the daemon did not stop as ordered.
        PlanRefused: no strike can be planned on this rig.
    """
    with session_rig(kinds=kinds) as rig:
        _shorten(rig.folder / "plan.json", strikes)
        report = rig.session(lambda text, _done, _total: rig.said.append(text))
        assert not report.aborted, rig.said
        rig.daemon.end()
        assert rig.daemon.process.returncode == 0, rig.daemon.complaints
        rig.camera.terminate()
        rig.camera.wait(60)
        merge_truth(report.path, Path(rig.world().truth()))
        truth, head = read_truth(report.path), read_head(report.path)
        evidence = read_evidence(head)
        errors, sds, delays = [], [], []
        for motion in evidence.motions:
            if motion.verdict is Verdict.GOOD and motion.fit is not None and motion.angle is not None:
                true = tip_truth(evidence.planned(motion), truth.body)
                errors.append(motion.fit.phi - true.phi)
                sds.append(float(np.sqrt(motion.fit.covariance[0, 0])))
                delays.append(stamp_delay_ms(motion.angle, truth))
        return StruckSession(
            head.manifest.cameras[0].model or "",
            report.frames,
            report.lost,
            read_pace(rig.folder),
            tuple(motion.verdict.value for motion in evidence.motions),
            tuple(errors),
            tuple(sds),
            tuple(delays),
        )


def _shorten(plan_path: Path, strikes: int) -> None:
    plan = read_strike_plan(plan_path)
    shorter = plan.model_copy(update={"strikes": plan.strikes[:strikes]})
    plan_path.write_text(shorter.model_dump_json(), encoding="utf-8")


def stamp_delay_ms(angle: TipAngle, truth: Truth) -> float:
    """Time by which frames are stamped too late [ms], from the tipping angle against the true motion.

    Mean of measured minus true angle over the true angular speed, while the object tips.
    """
    times = truth.pose_time_ns
    near = (times > angle.time_ns[0] - 10_000_000) & (times < angle.time_ns[-1] + 10_000_000)
    poses = [pose for pose, used in zip(truth.poses, near, strict=True) if used]
    begin_ns = int(angle.time_ns[0])
    true_s = (times[near] - begin_ns) * 1e-9
    true_rad = _turned(np.array([pose.q_world_object_wxyz for pose in poses]))
    speed = np.gradient(true_rad, true_s)
    at_s = (angle.time_ns - begin_ns) * 1e-9
    expected, rate = np.interp(at_s, true_s, true_rad), np.interp(at_s, true_s, speed)
    low, high = MOVING_RAD
    # Only the way up: what follows the landing is another motion.
    used = (expected > low) & (expected < high) & (np.arange(len(at_s)) < int(np.argmax(expected)))
    weight = rate[used] ** 2
    return float(np.sum(weight * (angle.theta - expected)[used] / rate[used]) / np.sum(weight)) * -1e3


def _turned(q_world_object_wxyz: Array) -> Array:
    """(n,) angle of each of n rotations against the first one [rad]."""
    dot = np.abs(q_world_object_wxyz @ q_world_object_wxyz[0])
    return 2.0 * np.arccos(np.clip(dot, -1.0, 1.0))
