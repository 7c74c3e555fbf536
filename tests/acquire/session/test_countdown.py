"""Countdown before the striker is armed: it ends early for hands, for a stop and for a hold."""

from __future__ import annotations

from typing import Any

import pytest

from acquire.session import countdown
from tests.acquire.session.test_runner import Host


class Daemon:
    """Fake daemon in which something happens a given time after the countdown began.

    Args:
        host: fake clock.
        what: "hands", "stop" or "hold"; "dead" if `analyze watch` has ended, and its last report showed
            hands; "" for nothing.
        after_s: time from the beginning until then [s].
    """

    def __init__(self, host: Host, what: str, after_s: float) -> None:
        self.host, self.what, self.at_s = host, what, host.now + after_s

    def call(self, name: str, **_: Any) -> dict[str, Any]:
        happened = self.what if self.host.now > self.at_s else ""
        if name == "status":
            return {"stops": int(happened == "stop")}
        if name == "hold.status":
            return {"held": happened == "hold"}
        assert name == "watch.latest"
        moving = 0.3 if happened == "hands" or self.what == "dead" else 0.001
        now_ns = 1 if self.what == "dead" else self.host.monotonic_ns()
        event = {"time_ns": now_ns, "markers": [], "at_rest": True, "saturated_fraction": 0.0}
        return {"event": event | {"moving_fraction": moving}}


class Clock(Host):
    """Fake clock with wall time, and the ends of countdowns that were reported [s]."""

    def __init__(self) -> None:
        super().__init__()
        self.reported: list[float | None] = []

    def time_ns(self) -> int:
        return self.monotonic_ns()

    def count_down(self, arms_at_ns: int | None) -> None:
        self.reported.append(None if arms_at_ns is None else arms_at_ns * 1e-9)


@pytest.mark.parametrize(
    ("what", "undisturbed", "passed_s"),
    [("", True, 3.0), ("dead", True, 3.0), ("hands", False, 1.2), ("stop", True, 1.2), ("hold", True, 1.2)],
)
def test_the_countdown_waits_unless_something_happens(
    monkeypatch: pytest.MonkeyPatch, what: str, undisturbed: bool, passed_s: float
) -> None:
    clock = Clock()
    monkeypatch.setattr(countdown, "time", clock)
    daemon = Daemon(clock, what, after_s=1.15)
    assert countdown.count_down(daemon.call, clock, 3.0) is undisturbed  # type: ignore[arg-type]
    assert clock.now - 100 == pytest.approx(passed_s, abs=0.06)
    assert clock.reported == [pytest.approx(103), None]


def test_without_a_countdown_nothing_is_asked_or_reported() -> None:
    def call(name: str, **_: Any) -> dict[str, Any]:
        raise AssertionError(name)

    clock = Clock()
    assert countdown.count_down(call, clock, 0.0)  # type: ignore[arg-type]
    assert not clock.reported
