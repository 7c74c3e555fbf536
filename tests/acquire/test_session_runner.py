"""How a session waits for an object to come to rest, by the times of the images that `analyze watch` speaks of."""

from __future__ import annotations

from typing import Any

import pytest

from acquire import session_runner
from acquire.session import Recorded
from acquire.session_runner import LATE_TIMEOUT_S, REST_TIMEOUT_S, SessionRunner


class Host:
    """Time that passes in sleeps only."""

    def __init__(self) -> None:
        self.now = 100.0

    def monotonic(self) -> float:
        return self.now

    def monotonic_ns(self) -> int:
        return round(self.now * 1e9)

    def sleep(self, seconds: float) -> None:
        self.now += seconds


class Daemon:
    """Its camera is behind by `lag_s`; the object comes to rest `rest_s` after the strike, at 100 s."""

    def __init__(self, host: Host, lag_s: float, rest_s: float, *, alive: bool = True, sees: bool = True) -> None:
        self.host, self.lag_s, self.rest_s, self.alive, self.sees = host, lag_s, rest_s, alive, sees
        self.end_ns: int | None = None

    def call(self, name: str, **params: Any) -> dict[str, Any]:
        if name == "watch.latest":
            seen = self.host.now - self.lag_s
            event = {"time_ns": round(seen * 1e9), "at_rest": seen < 100 or seen > 100 + self.rest_s}
            return {"alive": self.alive, "event": event if self.sees else None}
        assert name == "window.close"
        self.end_ns = params["end_ns"]
        return {"start_ns": 1, "end_ns": 2, "frames": 3, "lost": 0}


def waited(monkeypatch: pytest.MonkeyPatch, **daemon: Any) -> tuple[float, float]:
    """Seconds that passed, and after the strike the moment at which the window may end."""
    host = Host()
    monkeypatch.setattr(session_runner, "time", host)
    rig = Daemon(host, **daemon)
    runner = SessionRunner.__new__(SessionRunner)
    runner._client, runner._anchor_ns, runner._frames, runner._lost = rig, 0, 0, 0  # type: ignore[assignment]
    assert runner._record_until_rest() == Recorded(1, 2, 3, 0)
    assert rig.end_ns is not None
    return host.now - 100, rig.end_ns / 1e9 - 100 if rig.end_ns else 0.0


def test_images_that_come_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    passed, end = waited(monkeypatch, lag_s=0.1, rest_s=1.3)
    assert passed == pytest.approx(1.4, abs=0.11)
    assert end == pytest.approx(1.3, abs=0.11)


def test_late_images_are_waited_for_and_no_more_of_them_than_are_needed(monkeypatch: pytest.MonkeyPatch) -> None:
    passed, end = waited(monkeypatch, lag_s=5.0, rest_s=1.3)
    assert passed == pytest.approx(6.3, abs=0.11)
    assert end == pytest.approx(1.3, abs=0.11)


def test_an_object_that_rolls_on_is_not_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    passed, end = waited(monkeypatch, lag_s=0.1, rest_s=100.0)
    assert passed == pytest.approx(REST_TIMEOUT_S + 0.1, abs=0.11)
    assert end == pytest.approx(REST_TIMEOUT_S, abs=0.11)


def test_images_that_never_come_are_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    passed, end = waited(monkeypatch, lag_s=1e3, rest_s=1.3)
    assert passed == pytest.approx(LATE_TIMEOUT_S, abs=0.11)
    assert not end


@pytest.mark.parametrize(("alive", "sees"), [(False, True), (False, False), (True, False)])
def test_a_tip_that_nobody_watches_is_recorded_to_its_end(monkeypatch: pytest.MonkeyPatch, alive: bool, sees: bool) -> None:
    """`analyze watch` is gone, for good or for a moment, or has only just begun: what it last saw says nothing of this strike."""
    passed, end = waited(monkeypatch, lag_s=0.1, rest_s=1.3, alive=alive, sees=sees)
    assert passed == pytest.approx(REST_TIMEOUT_S, abs=0.11)
    assert not end
