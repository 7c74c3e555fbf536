"""Clients from which the daemon takes orders."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from types import SimpleNamespace

import pytest

from acquire.clock.clock import SystemClock
from acquire.daemon.adviser import Adviser
from acquire.daemon.attendance import Attendance
from acquire.daemon.compactor import Compactor
from acquire.daemon.daemon import Daemon
from acquire.daemon.prompts import Prompts
from acquire.daemon.session_board import SessionBoard
from acquire.daemon.striker_control import StrikerControl
from acquire.errors import SessionError, StrikerStopped
from acquire.striker.base import StrikerState
from acquire.striker.manual import ManualStriker
from schemas.proto import percuss_pb2 as pb
from schemas.rig import RecorderConfig, StrikerConfig


class Recording:
    owner: object = None


@pytest.fixture
def daemon() -> Daemon:
    daemon = Daemon.__new__(Daemon)
    daemon._recording = Recording()  # type: ignore[assignment]
    daemon._attendance = Attendance(lambda *_: None, lambda: False)
    daemon._board = SessionBoard(lambda *_: None)
    return daemon


def test_during_a_session_only_its_client_gives_orders(daemon: Daemon) -> None:
    heard = []
    order = daemon._for_owner(lambda connection, params: heard.append((connection, params)) or {})
    order("anybody", {"a": 1})
    daemon._recording.owner = "session"  # type: ignore[misc]
    order("session", {"b": 2})
    with pytest.raises(SessionError, match=r"another program's session is open: .* `acquire stop`"):
        order("anybody", {})
    assert heard == [("anybody", {"a": 1}), ("session", {"b": 2})]


def test_other_clients_may_stop_the_striker(daemon: Daemon, monkeypatch: pytest.MonkeyPatch) -> None:
    names = ("status", "shutdown", "recording.close", "striker.stop", "watch.latest", "prompt.answer")
    wrapped = []
    monkeypatch.setattr(daemon, "_for_owner", lambda handler: wrapped.append(handler) or "owned")
    daemon._prompts = type("Prompts", (), {"ask": None, "answer": None})()  # type: ignore[assignment]
    handlers = daemon._handlers()
    assert all(handlers[name] != "owned" for name in names)
    assert all(
        handlers[name] == "owned"
        for name in ("striker.home", "striker.arm", "striker.cock", "striker.strike", "window.open")
    )


class Arm(ManualStriker):
    """Striker without a motor; the tests ask only whether it would accept an order to move."""

    def __init__(self) -> None:
        super().__init__(StrikerConfig(), lambda _: None, lambda _: None, lambda _: None, SystemClock())


class Disk(Recording):
    """Fake recording that calls `meanwhile` during its check of the disk space."""

    def __init__(self, meanwhile: Callable[[], object]) -> None:
        self.meanwhile = meanwhile

    def require_space(self) -> None:
        self.meanwhile()

    def log(self, *_: object) -> None:
        pass


@pytest.fixture
def rig(daemon: Daemon) -> Daemon:
    daemon._prompts = Prompts(lambda *_: None)
    daemon._recording = disk = Disk(lambda: None)  # type: ignore[assignment]
    daemon._control = StrikerControl(Arm(), disk.require_space)
    return daemon


STRIKE = {"strike_id": "s1", "tip_speed_m_s": 0.3}


def test_a_stop_during_the_check_of_disk_space_holds(rig: Daemon) -> None:
    rig._control.home({})
    rig._recording.meanwhile = rig._stop_striker  # type: ignore[attr-defined]
    for order in (rig._control.arm, rig._control.cock, lambda: rig._control.strike(STRIKE)):
        with pytest.raises(StrikerStopped):
            order()
        assert rig._control.striker.state is StrikerState.HOMED


def test_a_stop_during_arming_disarms(rig: Daemon, monkeypatch: pytest.MonkeyPatch) -> None:
    rig._control.home({})
    arm = rig._control.striker.arm

    def stopped_meanwhile() -> None:
        rig._stop_striker()
        arm()

    monkeypatch.setattr(rig._control.striker, "arm", stopped_meanwhile)
    with pytest.raises(StrikerStopped):
        rig._control.arm()
    assert rig._control.striker.state is StrikerState.DISARMED


def test_after_a_stop_only_a_person_homes_it_again(rig: Daemon) -> None:
    rig._stop_striker()
    with pytest.raises(StrikerStopped):
        rig._control.home({"after_stop": False})
    rig._control.home({})
    rig._control.home({"after_stop": False})
    rig._control.arm()
    assert rig._control.striker.state is StrikerState.ARMED


def test_a_stop_between_agreement_and_homing_holds(rig: Daemon) -> None:
    """The stop came after the person agreed to the motion: it is refused, and the person is asked again."""
    rig._stop_striker()
    seen = rig._control.stops
    rig._stop_striker()
    with pytest.raises(StrikerStopped):
        rig._control.home({"stops_seen": seen})
    with pytest.raises(StrikerStopped):
        rig._control.arm()
    rig._control.home({"stops_seen": rig._control.stops})
    rig._control.arm()


def test_a_stop_after_homing_was_ordered_comes_first(rig: Daemon, monkeypatch: pytest.MonkeyPatch) -> None:
    home = rig._control.striker.home

    def stopped_meanwhile(stopped: Callable[[], bool]) -> None:
        rig._stop_striker()
        home(stopped)

    monkeypatch.setattr(rig._control.striker, "home", stopped_meanwhile)
    with pytest.raises(StrikerStopped):
        rig._control.home({})
    assert rig._control.striker.state is StrikerState.DISARMED


def test_a_stop_answers_the_question_that_is_open(rig: Daemon) -> None:
    connection = type("Connection", (), {"gone": False})()
    answers: list[dict] = []
    asking = threading.Thread(
        target=lambda: answers.append(rig._prompts.ask(connection, {"kind": "place", "text": "place it"}))
    )
    asking.start()
    while not rig._prompts._answers:
        time.sleep(0.01)
    with rig._prompts._changed:  # the asking thread wakes only after the second answer
        rig._stop_striker()
        with pytest.raises(SessionError, match="answered already"):
            rig._prompts.answer(connection, {"prompt_id": 1, "ok": True})
    asking.join(5)
    assert answers == [{"ok": False, "text": "stopped on request"}]


@pytest.mark.parametrize(
    "question", [{}, {"text": "place it"}, {"kind": 5, "text": "place it"}, {"kind": "place"}]
)
def test_a_question_without_kind_or_text_is_refused(rig: Daemon, question: dict) -> None:
    """It would end the console that shows it."""
    connection = SimpleNamespace(gone=False)
    with pytest.raises(SessionError, match=r'a question needs "(kind|text)"'):
        rig._prompts.ask(connection, question)


def test_a_stop_since_a_session_was_opened_holds(rig: Daemon, monkeypatch: pytest.MonkeyPatch) -> None:
    connection = SimpleNamespace(on_close=[])
    rig._camera = None  # type: ignore[assignment]
    manifest = SimpleNamespace(recording_id="r", wall_anchor_ns=0)
    rig._adviser = Adviser(lambda _: None)
    rig._compactor = Compactor(RecorderConfig(), lambda _: None)
    rig._stop_striker()
    monkeypatch.setattr(rig._recording, "open", lambda *_: manifest, raising=False)
    rig._open_recording(connection, {})
    rig._control.home({"after_stop": False})
    monkeypatch.setattr(rig._recording, "open", lambda *_: rig._stop_striker() and manifest)
    rig._open_recording(connection, {})
    with pytest.raises(StrikerStopped):
        rig._control.home({"after_stop": False})


def test_a_strikers_fault_is_reported_until_it_is_homed(
    rig: Daemon, capsys: pytest.CaptureFixture[str]
) -> None:
    events = []
    rig._server = type(
        "Server", (), {"publish": staticmethod(lambda event, data: events.append((event, data)))}
    )()  # type: ignore[assignment]
    rig._recording.write = lambda *_: None  # type: ignore[method-assign]
    rig._on_event(
        pb.StrikerEvent(kind=pb.StrikerEvent.FAULT, text="the servo reports overload", host_time_ns=1)
    )
    assert rig._control.trouble == "the servo reports overload"
    assert ("trouble", {"text": "the striker is in a fault: the servo reports overload"}) in events
    assert "overload" in capsys.readouterr().err
    rig._control.home({})
    assert not rig._control.trouble
