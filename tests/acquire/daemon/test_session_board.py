"""Progress of a session, for clients that connect late."""

from __future__ import annotations

from typing import Any

import pytest

from acquire.daemon.session_board import SessionBoard
from acquire.errors import SessionError
from schemas.strike_result import Verdict
from schemas.watch_lines import StrikeCurve, StrikeVerdict

REPORT: dict[str, Any] = {
    "object": "carton",
    "plan": "p.json",
    "file": "/r.mcap",
    "began_ns": 1,
    "total": 9,
    "state": "placing",
}


def test_the_last_report_is_published_and_kept() -> None:
    events: list[tuple[str, dict[str, Any]]] = []
    board = SessionBoard(lambda name, data: events.append((name, data)))
    assert board.status() == {"session": None, "curves": []}
    board.report(None, REPORT)
    assert events[0][0] == "session"
    assert events[0][1]["session"] == board.status()["session"]
    board.begin_session()
    assert board.status()["session"] is None


@pytest.mark.parametrize("change", [{"state": "dancing"}, {"total": "many"}, {"unknown": 1}])
def test_a_report_of_another_kind_is_refused(change: dict[str, Any]) -> None:
    with pytest.raises(SessionError, match=r"session\.report: "):
        SessionBoard(lambda *_: None).report(None, REPORT | change)


def test_the_curve_of_a_strike_is_kept() -> None:
    board = SessionBoard(lambda *_: None)
    verdict = StrikeVerdict(strike_id="s1.1", code=Verdict.GOOD, reason="")
    board.keep_curve(None)
    board.keep_curve(verdict)
    with pytest.raises(SessionError, match=r"s1\.1: no curve"):
        board.curve(None, {"strike_id": "s1.1"})
    curve = StrikeCurve(time_s=[0.0, 0.1], theta_rad=[0.0, 0.2])
    board.keep_curve(verdict.model_copy(update={"curve": curve}))
    assert board.status()["curves"] == ["s1.1"]
    assert board.curve(None, {"strike_id": "s1.1"})["theta_rad"] == [0.0, 0.2]
