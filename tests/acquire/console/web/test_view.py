"""Parts of the snapshot, made from what the daemon reports."""

from __future__ import annotations

import time
from typing import Any

import pytest

from acquire.console.web import view
from acquire.console.web.preview import ImageAids
from acquire.console.web.rig_link import TROUBLE_S, RigReport
from schemas.rig import RigConfig

RIG = RigConfig.model_validate(
    {
        "camera": {
            "address": "10.0.0.2",
            "calibration": {
                "width": 656,
                "height": 492,
                "K": [[1430.0, 0.0, 327.5], [0.0, 1430.0, 245.5], [0.0, 0.0, 1.0]],
                "T_world_camera": [[1, 0, 0, 0], [0, 0, 1, -0.5], [0, -1, 0, 0.1], [0, 0, 0, 1]],
            },
        },
        "striker": {},
    }
)
STATUS: dict[str, Any] = {
    "camera": {"vendor": "V", "model": "M", "serial": "1"},
    "fps": 119.987,
    "frames": 10,
    "lost": 1,
    "dropped": 2,
    "striker": "homed",
    "striker_trouble": "",
}
WATCH: dict[str, Any] = {
    "markers": [{"id": 3, "corners_px": [[0, 0], [40, 0], [40, 40], [0, 40]]}],
    "at_rest": True,
    "saturated_fraction": 0.1,
    "placement_error_rad": 0.1,
    "text": "turn it",
}
PROMPT: dict[str, Any] = {"prompt_id": 2, "kind": "place", "text": "put it", "strike_id": "s1", "edge": "e"}
SESSION: dict[str, Any] = {
    "object": "o",
    "plan": "p",
    "file": "/f",
    "began_ns": 5,
    "state": "arming",
    "text": "",
    "strike_id": "s1",
    "attempt": 1,
    "done": 0,
    "total": 3,
    "earlier": 0,
    "max_strikes": None,
    "until": "",
    "strikes": [],
}


def test_without_a_daemon_there_is_no_camera_or_striker() -> None:
    report = RigReport()
    assert view.camera_view(report, RIG, None) is None
    assert view.striker_view(report) is None
    assert view.armed_view(report) is None
    assert view.session_view(report, "") is None
    assert view.prompt_view(report, 9.0) is None


def test_the_camera_shows_its_losses_and_the_aids() -> None:
    aids = ImageAids(saturated_fraction=0.2, sharpness=55.0, tag_px=61.0)
    shown = view.camera_view(RigReport(status=STATUS), RIG, aids)
    assert shown is not None
    assert (shown.lost, shown.saturated_fraction, shown.sharpness, shown.tag_px) == (3, 0.2, 55.0, 61.0)
    watched = view.camera_view(RigReport(status=STATUS, watch=WATCH), RIG, None)
    assert watched is not None
    assert (watched.saturated_fraction, watched.tag_px, watched.sharpness) == (0.1, 40.0, None)


@pytest.mark.parametrize(
    ("state", "torque", "armed"),
    [("disarmed", None, False), ("homed", True, False), ("armed", True, True), ("fault", False, False)],
)
def test_the_striker_shows_torque_where_it_is_known(state: str, torque: bool | None, armed: bool) -> None:
    report = RigReport(status=STATUS | {"striker": state})
    striker = view.striker_view(report)
    assert striker is not None
    assert striker.torque is torque
    assert (view.armed_view(report) is not None) is armed


@pytest.mark.parametrize(
    ("state", "in_s", "shown"), [("homed", 2.0, 2.0), ("homed", -9.0, 0.0), ("armed", 2.0, None)]
)
def test_the_countdown_is_shown_until_the_striker_is_armed(
    state: str, in_s: float, shown: float | None
) -> None:
    session = SESSION | {"arms_at_ns": time.time_ns() + round(in_s * 1e9)}
    armed = view.armed_view(RigReport(status=STATUS | {"striker": state}, session=session))
    assert armed is not None
    assert armed.countdown_s == (None if shown is None else pytest.approx(shown, abs=0.15))


@pytest.mark.parametrize(
    ("offset_m", "yaw_rad", "in_place"),
    [([0.001, 0.001], 0.01, True), ([0.004, 0.0], 0.0, False), ([0.0, 0.0], 0.1, False), (None, None, None)],
)
def test_the_prompt_shows_whether_the_object_is_in_place(
    offset_m: list[float] | None, yaw_rad: float | None, in_place: bool | None
) -> None:
    watch = WATCH | {"offset_m": offset_m, "yaw_error_rad": yaw_rad, "outline_px": [[1.0, 2.0]]}
    shown = view.prompt_view(RigReport(prompt=PROMPT, watch=watch), 0.1)
    assert shown is not None
    assert shown.in_place is in_place
    assert not shown.hands_off
    assert shown.card == "/api/cards/s1"
    assert shown.angle_deg == (5.7 if yaw_rad is None else round(57.29578 * yaw_rad, 1))


def test_hands_are_off_when_nothing_moved_for_a_while() -> None:
    assert view.is_still(WATCH)
    assert not view.is_still(WATCH | {"at_rest": False})
    assert not view.is_still(WATCH | {"moving_fraction": 0.05})
    assert not view.is_still(None)
    shown = view.prompt_view(RigReport(prompt=PROMPT, watch=WATCH), view.STILL_S)
    assert shown is not None
    assert shown.hands_off


@pytest.mark.parametrize(
    ("hold", "ended", "state", "paused"),
    [
        ({}, "", "arming", None),
        ({"held": True, "text": "tea", "later": ""}, "", "arming", "tea"),
        ({"held": False, "text": "", "later": "tea"}, "", "arming", "tea"),
        ({"held": True, "text": "tea", "later": ""}, "it crashed", "aborted", None),
    ],
)
def test_a_session_shows_its_pause_and_its_sudden_end(
    hold: dict[str, Any], ended: str, state: str, paused: str | None
) -> None:
    shown = view.session_view(RigReport(session=SESSION, hold=hold), ended)
    assert shown is not None
    assert (shown.state, shown.paused) == (state, paused)
    over = view.session_view(RigReport(session=SESSION | {"state": "finished"}, hold=hold), ended)
    assert over is not None
    assert (over.state, over.paused) == ("finished", None)


def test_old_problems_are_no_longer_shown() -> None:
    report, now_s = RigReport(), time.monotonic()
    report.problems.extend([(now_s - TROUBLE_S - 1, "the servo is gone"), (now_s, "a frame was lost")])
    assert report.trouble == ["a frame was lost"]
