"""Plans for another rig are refused before the first strike."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import pytest

from acquire.config import RigLimits
from acquire.errors import SessionError
from acquire.session.plan_fit import camera_pose_problem, striker_limit_problem
from acquire.session.runner import SessionRunner
from acquire.session.session_input import SessionInput
from schemas.rig import RigConfig, StrikerConfig
from schemas.strike_plan import Range
from tests.acquire.session.test_machine import plan, planned
from tests.system.complaints import spec_and_plan

HERE = [[1.0, 0.0, 0.0, 0.03], [0.0, 0.0, 1.0, -0.55], [0.0, -1.0, 0.0, 0.08], [0.0, 0.0, 0.0, 1.0]]


def limits(**striker: Any) -> RigLimits:
    calibration = {
        "width": 656,
        "height": 492,
        "K": [[1430, 0, 328], [0, 1430, 246], [0, 0, 1]],
        "T_world_camera": HERE,
    }
    camera = {"address": "1", "calibration": calibration}
    config = RigConfig.model_validate({"camera": camera, "striker": StrikerConfig(**striker).model_dump()})
    return RigLimits.from_dict(json.loads(json.dumps(RigLimits.from_config(config).as_dict())))


def strike(name: str, **changes: Any):
    return planned(name).model_copy(update={"camera_pose": HERE} | changes)


def test_plan_exactly_at_the_limits_is_accepted() -> None:
    speeds = limits(arm_length_m=0.1).speeds
    assert speeds is not None
    edge = Range(min=speeds.slowest_m_s, target=0.4, max=speeds.fastest_m_s)
    assert striker_limit_problem(plan(strike("s1", tip_speed_m_s=edge)), limits(arm_length_m=0.1)) == ""


def test_too_fast_and_too_slow_strikes_are_named() -> None:
    """An arm of 0.1 m reaches 0.05 to 0.8 m/s (0.5 to 8 rad/s); planned strikes may need 0.1 to 0.9."""
    said = striker_limit_problem(
        plan(*(strike(f"s{number}") for number in range(1, 7))), limits(arm_length_m=0.1)
    )
    assert said == (
        "s1, s2, s3, s4 and 2 more may need 0.1 to 0.9 m/s, the striker swings at 0.05 to 0.8 m/s "
        "(an arm of 113 mm would do)"
    )
    assert striker_limit_problem(
        plan(strike("s1", tip_speed_m_s=Range(min=0.05, target=0.2, max=0.3))), limits(arm_length_m=0.12)
    )


def test_impact_points_out_of_reach_are_named() -> None:
    low, high, fine = strike("s1", impact_height_m=0.01), strike("s2", impact_height_m=0.5), strike("s3")
    assert (
        striker_limit_problem(plan(fine, low), limits())
        == "s1: impact point 10 mm over the table, the striker reaches 15 to 400 mm"
    )
    assert "s1, s2: impact point 10 to 500 mm" in striker_limit_problem(plan(low, high, fine), limits())


def test_manual_striker_has_no_limits() -> None:
    assert (
        striker_limit_problem(
            plan(strike("s1", impact_height_m=0.5)), limits(kind="manual", arm_length_m=0.05)
        )
        == ""
    )


def test_moved_or_turned_camera_is_reported() -> None:
    assert camera_pose_problem(plan(strike("s1")), limits()) == ""
    nearer = [[*row[:3], row[3] + shift] for row, shift in zip(HERE, (0.0, 0.05, 0.0, 0.0), strict=True)]
    assert "the camera stands 50 mm and 0 deg off the plan's position" in camera_pose_problem(
        plan(strike("s1", camera_pose=nearer)), limits()
    )
    c, s = math.cos(0.1), math.sin(0.1)
    tilted = [[c, s, 0.0, 0.03], [0.0, 0.0, 1.0, -0.55], [s, -c, 0.0, 0.08], [0.0, 0.0, 0.0, 1.0]]
    assert "0 mm and 6 deg" in camera_pose_problem(plan(strike("s1", camera_pose=tilted)), limits())


class Daemon:
    """Fake daemon that answers the request `rig` with given limits; opens no recording."""

    def __init__(self, answer: RigLimits) -> None:
        self.answer, self.calls = answer, []

    def call(self, name: str, **params: Any) -> dict[str, Any]:
        self.calls.append(name)
        assert name == "rig"
        return self.answer.as_dict()


def test_unsuitable_plan_is_refused_before_the_recording_is_opened(tmp_path: Path) -> None:
    toml, made = spec_and_plan()
    object_path, path = tmp_path / "object.toml", tmp_path / "plan.json"
    object_path.write_text(toml)
    path.write_text(made.model_dump_json())
    daemon = Daemon(limits(arm_length_m=0.05))
    with pytest.raises(SessionError) as caught:
        SessionRunner(daemon, SessionInput(object_path, path), tmp_path / "r.mcap").run()
    line = str(caught.value)
    problem = "s1, s2, s3, s4 may need 0.1 to 1 m/s, the striker swings at 0.025 to 0.4 m/s"
    assert line.startswith(f"{path}: does not fit this rig's striker: {problem}")
    assert line.endswith(f": plan for this rig: `analyze plan {object_path} --rig RIG.toml -o {path}`")
    assert daemon.calls == ["rig"]


def test_heading_of_a_strike_does_not_count_as_a_moved_camera() -> None:
    turned = [[-1.0, 0.0, 0.0, -0.03], [0.0, 0.0, -1.0, 0.55], [0.0, -1.0, 0.0, 0.08], [0.0, 0.0, 0.0, 1.0]]
    assert camera_pose_problem(plan(strike("s1", camera_pose=turned, heading_rad=math.pi)), limits()) == ""
    assert "180 deg off" in camera_pose_problem(plan(strike("s1", camera_pose=turned)), limits())
