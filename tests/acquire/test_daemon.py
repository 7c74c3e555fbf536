"""Whose orders the daemon takes."""

from __future__ import annotations

import pytest

from acquire.daemon import Daemon
from acquire.errors import SessionError


class Recording:
    owner: object = None


@pytest.fixture
def daemon() -> Daemon:
    daemon = Daemon.__new__(Daemon)
    daemon._recording = Recording()  # type: ignore[assignment]
    return daemon


def test_in_a_session_its_client_alone_gives_orders(daemon: Daemon) -> None:
    heard = []
    order = daemon._for_owner(lambda connection, params: heard.append((connection, params)) or {})
    order("anybody", {"a": 1})
    daemon._recording.owner = "session"  # type: ignore[misc]
    order("session", {"b": 2})
    with pytest.raises(SessionError, match=r"another program's session is open: .* `acquire stop`"):
        order("anybody", {})
    assert heard == [("anybody", {"a": 1}), ("session", {"b": 2})]


def test_who_does_not_own_the_session_may_still_stop_it(daemon: Daemon, monkeypatch: pytest.MonkeyPatch) -> None:
    names = ("status", "shutdown", "recording.close", "striker.stop", "watch.latest", "prompt.answer")
    wrapped = []
    monkeypatch.setattr(daemon, "_for_owner", lambda handler: wrapped.append(handler) or "owned")
    daemon._prompts = type("Prompts", (), {"ask": None, "answer": None})()  # type: ignore[assignment]
    handlers = daemon._handlers()
    assert all(handlers[name] != "owned" for name in names)
    assert all(handlers[name] == "owned" for name in ("striker.home", "striker.arm", "striker.cock", "striker.strike", "window.open"))
