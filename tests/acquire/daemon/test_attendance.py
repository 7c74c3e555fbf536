"""Holds: a session waits before its next arming if nobody may be at the console."""

from __future__ import annotations

import threading
from typing import Any

import pytest

from acquire.daemon.attendance import BROWSER_LOST, CONSOLE_LOST, LEASE_S, Attendance
from acquire.errors import SessionError, StrikerStopped


class Rig:
    """Attendance with a clock that tests set, and a striker that they stop."""

    def __init__(self) -> None:
        self.now_s, self.stopped = 0.0, False
        self.events: list[tuple[str, dict[str, Any]]] = []
        self.attendance = Attendance(
            lambda name, data: self.events.append((name, data)), lambda: self.stopped, lambda: self.now_s
        )


class Client:
    """Connection of a console or session."""

    def __init__(self) -> None:
        self.on_close: list[Any] = []
        self.gone = False


def connection() -> Any:
    return Client()


@pytest.fixture
def rig() -> Rig:
    return Rig()


def test_without_a_console_nothing_is_held(rig: Rig) -> None:
    rig.now_s = 1e6
    rig.attendance.supervise()
    assert not rig.attendance.status()["held"]


def test_a_console_that_is_killed_holds_until_a_person_goes_on(rig: Rig) -> None:
    console = connection()
    rig.attendance.attend(console, {"present": True})
    for callback in console.on_close:
        callback()
    assert rig.attendance.status() == {"held": True, "text": CONSOLE_LOST, "later": ""}
    assert rig.events[-1][0] == "hold"
    rig.attendance.attend(connection(), {"present": True})
    assert rig.attendance.status()["held"]  # a new console does not go on by itself
    rig.attendance.release()
    assert not rig.attendance.status()["held"]


def test_a_console_that_hangs_holds(rig: Rig) -> None:
    rig.attendance.attend(connection(), {"present": True})
    rig.now_s += LEASE_S
    rig.attendance.supervise()
    assert not rig.attendance.status()["held"]
    rig.now_s += 0.1
    rig.attendance.supervise()
    assert rig.attendance.status()["text"] == CONSOLE_LOST


def test_a_browser_that_is_lost_holds_and_cannot_be_overruled_without_one(rig: Rig) -> None:
    console = connection()
    rig.attendance.attend(console, {"present": False})
    assert rig.attendance.status()["text"] == BROWSER_LOST
    with pytest.raises(SessionError, match="no browser of an operator is connected"):
        rig.attendance.release()
    rig.attendance.attend(console, {"present": True})
    rig.attendance.release()
    assert not rig.attendance.status()["held"]


def test_a_second_console_attends_in_place_of_one_that_is_lost(rig: Rig) -> None:
    first = connection()
    rig.attendance.attend(first, {"present": True})
    rig.attendance.attend(connection(), {"present": True})
    for callback in first.on_close:
        callback()
    assert not rig.attendance.status()["held"]


def test_a_console_that_ends_in_order_holds_nothing(rig: Rig) -> None:
    console = connection()
    rig.attendance.attend(console, {"present": True})
    rig.attendance.leave(console, {})
    for callback in console.on_close:
        callback()
    assert not rig.attendance.status()["held"]


def test_a_pause_after_the_strike_begins_with_its_record(rig: Rig) -> None:
    rig.attendance.hold(connection(), {"text": "tea", "when": "after_strike"})
    assert rig.attendance.status() == {"held": False, "text": "", "later": "tea"}
    rig.attendance.note_strike()
    assert rig.attendance.status() == {"held": True, "text": "tea", "later": ""}
    rig.attendance.begin_session()
    assert not rig.attendance.status()["held"]
    with pytest.raises(SessionError, match='"now" or "after_strike"'):
        rig.attendance.hold(connection(), {"when": "soon"})


def waiting(rig: Rig, session: Any) -> tuple[threading.Thread, list[Any]]:
    """A session that waits in a thread, and what its wait brought."""
    ended: list[Any] = []

    def wait() -> None:
        try:
            ended.append(rig.attendance.wait(session, {}))
        except (SessionError, StrikerStopped) as error:
            ended.append(error)

    thread = threading.Thread(target=wait)
    thread.start()
    return thread, ended


@pytest.mark.parametrize("end", ["release", "stop", "daemon", "session"])
def test_a_wait_ends(rig: Rig, end: str) -> None:
    session = connection()
    rig.attendance.hold(session, {})
    thread, ended = waiting(rig, session)
    thread.join(0.05)
    assert thread.is_alive()
    if end == "release":
        rig.attendance.release()
    elif end == "stop":
        rig.stopped = True
    elif end == "daemon":
        rig.attendance.close()
    else:
        session.gone = True
    thread.join(5.0)
    expected = {"release": dict, "stop": StrikerStopped}.get(end, SessionError)
    assert isinstance(ended[0], expected)
