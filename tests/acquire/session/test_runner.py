"""The session's client: waiting for the object to come to rest, and the recording after an interruption."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from acquire.errors import DaemonSilent, StrikerLost, StrikerStopped
from acquire.session import runner as session_runner
from acquire.session.machine import Recorded, StopRequested, StrikerFailed
from acquire.session.runner import LATE_TIMEOUT_S, REST_TIMEOUT_S, SessionRunner
from acquire.session.session_input import SessionInput
from tests.acquire.session.test_machine import POSE
from tests.system.complaints import spec_and_plan, write


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

    def __init__(
        self, host: Host, lag_s: float, rest_s: float, *, alive: bool = True, sees: bool = True
    ) -> None:
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


def test_late_images_are_waited_for_and_no_more_of_them_than_are_needed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
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
def test_a_tip_that_nobody_watches_is_recorded_to_its_end(
    monkeypatch: pytest.MonkeyPatch, alive: bool, sees: bool
) -> None:
    """`analyze watch` has ended, for good or for a moment, or has just started: its last event is too old."""
    passed, end = waited(monkeypatch, lag_s=0.1, rest_s=1.3, alive=alive, sees=sees)
    assert passed == pytest.approx(REST_TIMEOUT_S, abs=0.11)
    assert not end


class Interrupted(Daemon):
    """Fake daemon with a servo that raises `reason` during the call `at`, like Ctrl-C or an error."""

    def __init__(self, folder: Path, at: str, reason: BaseException) -> None:
        super().__init__(Host(), 0.1, 1.0)
        self.file = folder / "r.mcap"
        self.at, self.reason = at, reason

    def call(self, name: str, **params: Any) -> dict[str, Any]:
        if name == "recording.open":
            assert params["path"] == str(
                self.file
            )  # whole: the daemon lives in another folder, and asks this one's disk for space
            self.file.write_bytes(b"images")
            return {"wall_anchor_ns": 0}
        if name == self.at:
            raise self.reason
        answers: dict[str, dict[str, Any]] = {
            "prompt": {"ok": True},
            "rig": {"speeds_m_s": None, "reach_m": None, "T_world_camera": POSE},
            "watch.expect": {"now_ns": 0},
            "watch.latest": {"alive": False, "event": None},
            "striker.strike": {
                "contact_time_ns": 5,
                "contact_time_sd_ns": 1.0,
                "tip_speed_m_s": 0.3,
                "contacts": 1,
            },
            "window.close": {"start_ns": 1, "end_ns": 2, "frames": 3, "lost": 0},
            "watch.judge": {"verdict": None},
            "recording.close": {"files": [str(self.file)]},
        }
        return answers.get(name, {})

    @contextlib.contextmanager
    def another(self) -> Iterator[Interrupted]:
        yield self


def interrupted(
    monkeypatch: pytest.MonkeyPatch, folder: Path, at: str, reason: BaseException
) -> tuple[Path, list[str]]:
    """The recording, and what was said in lines of their own."""
    daemon, said = Interrupted(folder, at, reason), []
    monkeypatch.setattr(session_runner, "time", daemon.host)
    monkeypatch.chdir(folder)
    toml, plan = spec_and_plan()
    object_path, plan_path = (
        write(folder / "object.toml", toml),
        write(folder / "plan.json", plan.model_dump_json()),
    )
    runner = SessionRunner(
        daemon, SessionInput(object_path, plan_path), Path("r.mcap"), lambda text, *_: said.append(text)
    )  # type: ignore[arg-type]
    with pytest.raises(type(reason)):
        runner.run()
    return daemon.file, [text for text in said if text.startswith(("kept", "discarded"))]


REASONS = [KeyboardInterrupt(), DaemonSilent("the daemon hangs")]


@pytest.mark.parametrize("reason", REASONS)
@pytest.mark.parametrize("at", ["striker.strike", "window.close", "watch.judge", "recording.strike"])
def test_a_session_that_ends_in_its_first_strike_keeps_it(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, at: str, reason: BaseException
) -> None:
    """Contact and images happen once: without a verdict too they are somebody's data."""
    file, said = interrupted(monkeypatch, tmp_path, at, reason)
    assert file.exists()
    assert said == [f"kept: 0 strikes, and 1 without a verdict in {file}"]


@pytest.mark.parametrize("reason", REASONS)
@pytest.mark.parametrize("at", ["striker.home", "prompt", "striker.arm", "window.open"])
def test_a_recording_in_which_nothing_was_struck_goes_and_is_named(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, at: str, reason: BaseException
) -> None:
    file, said = interrupted(monkeypatch, tmp_path, at, reason)
    assert not file.exists()
    assert said == [f"discarded: {file}: no strike was ordered yet"]


class Stopped:
    """A daemon whose striker somebody stopped, while its servo was away."""

    def __init__(self) -> None:
        self.asked: list[bool] = []

    def call(self, name: str, **params: Any) -> dict[str, Any]:
        if name == "status":
            return {"striker": "fault"}
        assert name == "striker.home"
        self.asked.append(params["after_stop"])
        raise StrikerLost("unplugged") if len(self.asked) < 3 else StrikerStopped


def test_a_session_that_waits_for_its_servo_hears_a_stop(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(session_runner, "time", Host())
    runner, daemon = SessionRunner.__new__(SessionRunner), Stopped()
    runner._client, runner._progress = daemon, lambda *_: None  # type: ignore[assignment]
    runner._machine = SimpleNamespace(progress=(0, 1))  # type: ignore[assignment]
    assert isinstance(runner._clear_fault(), StopRequested)
    assert daemon.asked == [False, False, False]
    assert isinstance(runner._striker_failed(StrikerStopped()), StopRequested)
    assert isinstance(runner._striker_failed(StrikerLost("unplugged")), StrikerFailed)
