"""Client of a session: the wait until the object rests, and the recording after an interruption."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from acquire.errors import DaemonSilent, StrikerLost, StrikerStopped
from acquire.session import runner as session_runner
from acquire.session.events import PoseChecked, Recorded, StopRequested, StrikerFailed
from acquire.session.options import SessionOptions
from acquire.session.runner import SessionRunner
from acquire.session.session_input import SessionInput
from acquire.session.waits import LATE_TIMEOUT_S, REST_TIMEOUT_S
from schemas.object_spec import parse_object_spec
from tests.acquire.session.test_machine import POSE
from tests.system.complaints import spec_and_plan, write


class Host:
    """Fake clock whose time passes only in sleeps."""

    def __init__(self) -> None:
        self.now = 100.0

    def monotonic(self) -> float:
        return self.now

    def monotonic_ns(self) -> int:
        return round(self.now * 1e9)

    def sleep(self, seconds: float) -> None:
        self.now += seconds


class Daemon:
    """Fake daemon: images are late by `lag_s`; the object rests `rest_s` after the strike at 100 s."""

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


def wait_for_rest(monkeypatch: pytest.MonkeyPatch, **daemon: Any) -> tuple[float, float]:
    """Run the wait for rest: its duration [s], and the requested end of the window [s], from the strike.

    The end is 0 if the window is closed without one.
    """
    host = Host()
    monkeypatch.setattr(session_runner, "time", host)
    rig = Daemon(host, **daemon)
    runner = SessionRunner.__new__(SessionRunner)
    runner._client, runner._anchor_ns, runner._frames, runner._lost = rig, 0, 0, 0  # type: ignore[assignment]
    assert runner._record_until_rest() == Recorded(1, 2, 3, 0)
    assert rig.end_ns is not None
    return host.now - 100, rig.end_ns / 1e9 - 100 if rig.end_ns else 0.0


def test_window_with_images_that_arrive_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    passed, end = wait_for_rest(monkeypatch, lag_s=0.1, rest_s=1.3)
    assert passed == pytest.approx(1.4, abs=0.11)
    assert end == pytest.approx(1.3, abs=0.11)


def test_window_waits_for_late_images_only_as_long_as_needed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    passed, end = wait_for_rest(monkeypatch, lag_s=5.0, rest_s=1.3)
    assert passed == pytest.approx(6.3, abs=0.11)
    assert end == pytest.approx(1.3, abs=0.11)


def test_window_closes_while_an_object_still_rolls(monkeypatch: pytest.MonkeyPatch) -> None:
    passed, end = wait_for_rest(monkeypatch, lag_s=0.1, rest_s=100.0)
    assert passed == pytest.approx(REST_TIMEOUT_S + 0.1, abs=0.11)
    assert end == pytest.approx(REST_TIMEOUT_S, abs=0.11)


def test_window_closes_if_images_never_arrive(monkeypatch: pytest.MonkeyPatch) -> None:
    passed, end = wait_for_rest(monkeypatch, lag_s=1e3, rest_s=1.3)
    assert passed == pytest.approx(LATE_TIMEOUT_S, abs=0.11)
    assert not end


@pytest.mark.parametrize(("alive", "sees"), [(False, True), (False, False), (True, False)])
def test_tip_is_recorded_for_a_fixed_time_without_analyze_watch(
    monkeypatch: pytest.MonkeyPatch, alive: bool, sees: bool
) -> None:
    """`analyze watch` has ended, for good or for a moment, or has just started: its last event is too old."""
    passed, end = wait_for_rest(monkeypatch, lag_s=0.1, rest_s=1.3, alive=alive, sees=sees)
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
            assert params["path"] == str(self.file)  # absolute: the daemon runs in another folder
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
    """Run an interrupted session; returns the recording's path and the lines about it."""
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
def test_recording_is_kept_if_the_session_ends_in_its_first_strike(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, at: str, reason: BaseException
) -> None:
    """Contact and images cannot be made again, so they are kept even without a verdict."""
    file, said = interrupted(monkeypatch, tmp_path, at, reason)
    assert file.exists()
    assert said == [f"kept: 0 strikes, and 1 without a verdict in {file}"]


@pytest.mark.parametrize("reason", REASONS)
@pytest.mark.parametrize("at", ["striker.home", "prompt", "striker.arm", "window.open"])
def test_recording_without_a_strike_is_discarded_and_named(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, at: str, reason: BaseException
) -> None:
    file, said = interrupted(monkeypatch, tmp_path, at, reason)
    assert not file.exists()
    assert said == [f"discarded: {file}: no strike was ordered yet"]


class Stopped:
    """Fake daemon whose servo is unplugged, and whose striker is stopped at the third attempt to home."""

    def __init__(self) -> None:
        self.asked: list[bool] = []

    def call(self, name: str, **params: Any) -> dict[str, Any]:
        if name == "status":
            return {"striker": "fault"}
        assert name == "striker.home"
        self.asked.append(params["after_stop"])
        raise StrikerLost("unplugged") if len(self.asked) < 3 else StrikerStopped


def test_stop_ends_the_wait_for_the_servo(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(session_runner, "time", Host())
    runner, daemon = SessionRunner.__new__(SessionRunner), Stopped()
    runner._client, runner._progress = daemon, lambda *_: None  # type: ignore[assignment]
    runner._machine = SimpleNamespace(progress=(0, 1))  # type: ignore[assignment]
    runner._options = SessionOptions()
    assert isinstance(runner._clear_fault(), StopRequested)
    assert daemon.asked == [False, False, False]
    assert isinstance(runner._striker_failed(StrikerStopped()), StopRequested)
    assert isinstance(runner._striker_failed(StrikerLost("unplugged")), StrikerFailed)


class Watcher:
    """Fake daemon whose `analyze watch` sees tags at rest, and cannot compare their placement."""

    def __init__(self, host: Host, *seen: int) -> None:
        self.host, self.seen = host, seen

    def call(self, name: str, **_: Any) -> dict[str, Any]:
        now_ns = self.host.monotonic_ns()
        markers = [{"id": number, "corners_px": [[0.0, 0.0]] * 4} for number in self.seen]
        event = {
            "time_ns": now_ns,
            "markers": markers,
            "at_rest": True,
            "saturated_fraction": 0.0,
            "text": "no pose",
        }
        return {"now_ns": now_ns, "alive": True, "event": event, "trouble": ""}


@pytest.mark.parametrize(
    ("placed", "seen", "good"),
    [((), (7,), True), ((7,), (7,), False), ((7,), (7, 8), False), ((), (99,), False), ((), (), False)],
)
def test_tags_without_a_place_do_not_stop_the_strikes_that_find_it(
    monkeypatch: pytest.MonkeyPatch, placed: tuple[int, ...], seen: tuple[int, ...], good: bool
) -> None:
    """The strike is made without a check of the pose only if tags of the object, all unplaced, are seen."""
    host, said = Host(), []
    monkeypatch.setattr(session_runner, "time", host)
    runner = SessionRunner.__new__(SessionRunner)
    given = SessionInput.__new__(SessionInput)
    marker = "[[marker]]\nid = {}\nsize_m = 0.03\n"
    pose = f"T_object_marker = {POSE}\n"
    text = "".join(marker.format(number) + (pose if number in placed else "") for number in (7, 8))
    head = 'name = "b"\nmass_kg = 0.1\nmass_sd_kg = 0.001\nshape = { box = { size_m = [0.1, 0.1, 0.1] } }\n'
    given.spec = parse_object_spec(head + text, "b.toml")
    runner._client, runner._input = Watcher(host, *seen), given  # type: ignore[assignment]
    monkeypatch.setattr(runner, "_report", said.append)
    checked = runner._check_pose(SimpleNamespace(id="s1"))  # type: ignore[arg-type]
    assert isinstance(checked, PoseChecked)
    assert checked.good is good
    assert said == (["s1: placement not checked: no pose"] if good else [])
