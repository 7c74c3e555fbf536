"""Steps of a toss against a daemon that answers from a script, and the keys of the terminal's prompt.

Not modelled: the wall clock (each look takes no time) and the recorder.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from acquire.console import session as terminal
from acquire.session import actions, events, toss_steps, waits
from acquire.session.toss_steps import TossSteps
from schemas.planned_toss import PlannedToss
from schemas.toss_result import TossVerdict
from schemas.watch_lines import TossJudgement, TossRequest
from tests.schemas.test_planned_toss import TOSS

PLANNED = PlannedToss.model_validate(TOSS)
LOOK_NS = 90_000_000


class Daemon:
    """Answers a session's requests; the object is held, flies from look 5 to 10, and lies still."""

    def __init__(self, *, alive: bool = True, stop_at: int = 10**6, flies: bool = True) -> None:
        self.requests: list[tuple[str, dict[str, Any]]] = []
        self.verdict: dict[str, Any] | None = None
        self._alive, self._stop_at, self._flies, self.looks = alive, stop_at, flies, 0

    def __call__(self, method: str, **params: Any) -> dict[str, Any]:
        self.requests.append((method, params))
        match method:
            case "window.open":
                return {"start_ns": 0}
            case "status":
                return {"striker_trouble": toss_steps.STOPPED if self.looks >= self._stop_at else ""}
            case "watch.latest":
                return self._look()
            case "window.close":
                return {"start_ns": 0, "end_ns": params.get("end_ns", 0), "frames": 100, "lost": 0}
            case _:
                prompted = {"ok": True, "text": "", "order": "skip"}
                return {"watch.judge_toss": {"verdict": self.verdict}, "prompt": prompted}.get(method, {})

    def _look(self) -> dict[str, Any]:
        self.looks += 1
        flown = self._flies * min(max(self.looks - 5, 0), 5)
        x = 50.0 * flown
        event = {
            "time_ns": LOOK_NS * self.looks,
            "markers": [{"id": 0, "corners_px": [[x, 0.0], [x + 9, 0], [x + 9, 9], [x, 9]]}],
            "at_rest": flown in {0, 5},
            "saturated_fraction": 0.0,
        }
        return {"event": event, "alive": self._alive}


@pytest.fixture(autouse=True)
def _no_waiting(monkeypatch: pytest.MonkeyPatch) -> None:
    now = iter(range(10**6))
    monkeypatch.setattr(toss_steps.time, "sleep", lambda _: None)
    monkeypatch.setattr(toss_steps.time, "monotonic", lambda: 0.05 * next(now))


def steps(daemon: Daemon) -> TossSteps:
    return TossSteps(daemon, lambda _: None, lambda: None)


def test_the_window_ends_half_a_second_after_the_flight() -> None:
    event = steps(Daemon()).execute(actions.RecordToss(PLANNED))
    assert isinstance(event, events.Tossed)
    still_ns = LOOK_NS * 10
    assert 0 <= event.recorded.window_end_ns - still_ns - 1e9 * waits.TOSS_REST_S < LOOK_NS


def test_without_a_flight_the_window_ends_at_the_limit_of_recorded_time() -> None:
    event = steps(Daemon(flies=False)).execute(actions.RecordToss(PLANNED))
    assert isinstance(event, events.Tossed)
    assert 0 < event.recorded.window_end_ns - 1e9 * waits.TOSS_TIMEOUT_S <= LOOK_NS


def test_without_analyze_watch_a_fixed_time_is_recorded() -> None:
    daemon = Daemon(alive=False)
    event = steps(daemon).execute(actions.RecordToss(PLANNED))
    assert isinstance(event, events.Tossed)
    assert daemon.looks == pytest.approx(waits.TOSS_TIMEOUT_S / 0.05, abs=3)


def test_a_stop_closes_the_window_and_ends_the_session() -> None:
    daemon = Daemon(stop_at=7)
    event = steps(daemon).execute(actions.RecordToss(PLANNED))
    assert isinstance(event, events.StopRequested)
    assert daemon.requests[-1][0] == "window.close"


def test_the_prompt_has_the_planned_toss_and_the_record_its_ids() -> None:
    daemon = Daemon()
    tossing = steps(daemon)
    assert tossing.execute(actions.AskToToss(PLANNED)) == events.Ordered(events.Order.SKIP)
    prompt = dict(daemon.requests)["prompt"]
    assert PlannedToss.model_validate(prompt["toss"]) == PLANNED
    verdict = TossJudgement(toss_id="t1.2", code=TossVerdict.SLOW, reason="1.1 turns a second")
    tossing.execute(actions.WriteToss(PLANNED, 2, events.Recorded(1, 2, 100, 0), verdict))
    assert daemon.requests[-1] == (
        "recording.toss",
        {
            "toss_id": "t1.2",
            "plan_toss_id": "t1",
            "attempt": 2,
            "window_start_ns": 1,
            "window_end_ns": 2,
            "verdict_code": "slow",
            "verdict_text": "1.1 turns a second",
        },
    )
    assert tossing.kept == 1


@pytest.mark.parametrize("answered", [True, False])
def test_a_toss_is_judged_by_the_images_of_its_window(answered) -> None:
    daemon = Daemon()
    daemon.verdict = {"toss_id": "t1.2", "code": "short", "reason": "0.2 s"} if answered else None
    event = steps(daemon).execute(actions.JudgeToss(PLANNED, 2, events.Recorded(1, 2, 100, 0)))
    assert isinstance(event, events.TossJudged)
    assert (event.verdict is not None) is answered
    assert event.verdict is None or event.verdict.code is TossVerdict.SHORT
    asked = dict(daemon.requests)["watch.judge_toss"]
    timeout_s = asked.pop("timeout_s")
    assert timeout_s == waits.TOSS_JUDGE_TIMEOUT_S
    assert TossRequest(**asked).toss_id == "t1.2"


@pytest.mark.parametrize(
    ("kind", "typed", "answer"),
    [
        ("toss", "\n", (True, "placed")),
        ("toss", "s\n", (True, "skip")),
        ("toss", "A\n", (True, "again")),
        ("toss", "q\n", (False, "placed")),
        ("place", "s\n", (True, "placed")),
    ],
)
def test_keys_at_the_terminal(
    monkeypatch: pytest.MonkeyPatch, kind: str, typed: str, answer: tuple[bool, str]
) -> None:
    answers: list[tuple[bool, str]] = []
    shown: list[str] = []

    class Operator:
        """Client with one prompt."""

        def __init__(self, _: Path) -> None: ...

        def events(self) -> list[dict[str, Any]]:
            return [{"event": "prompt", "prompt_id": 1, "kind": kind, "text": "card"}]

        def answer(self, _: int, *, ok: bool, text: str, order: str) -> None:
            assert text == ("" if ok else "stopped at the terminal")
            answers.append((ok, order))

    class Progress:
        """Progress line on which `typed` is answered."""

        def ask(self, text: str) -> str:
            shown.append(text)
            return typed

    monkeypatch.setattr(terminal, "OperatorClient", Operator)
    terminal.ConsoleOperator(Path("d.sock"), Progress())._run()
    assert answers == [answer]
    assert ("skip this toss" in shown[0]) == (kind == "toss")
