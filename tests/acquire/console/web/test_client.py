"""Client of the console for scripts: the same orders as the page, and its presence as operator."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

import acquire
from acquire.console.web.client import ConsoleClient, ConsoleRefused
from acquire.console.web.command import key_path
from acquire.errors import DaemonNotRunning
from tests.acquire.console.web.served import Console, console


@pytest.fixture
def served() -> Iterator[Console]:
    with console() as each:
        yield each


@pytest.fixture
def client(served: Console, tmp_path: Path) -> Iterator[ConsoleClient]:
    socket = tmp_path / "daemon.sock"
    key = served.visitors.new_key()
    key_path(socket).write_text(json.dumps({"url": f"http://{served.host}", "key": key, "pid": 1}))
    with acquire.connect_console(socket) as each:
        yield each


def test_without_a_console_the_error_names_the_command(tmp_path: Path) -> None:
    with pytest.raises(DaemonNotRunning, match="acquire console"):
        acquire.connect_console(tmp_path / "daemon.sock")


def test_a_script_looks_and_stops_and_gives_orders_only_as_operator(
    served: Console, client: ConsoleClient
) -> None:
    assert client.state().role == "watcher"
    assert client.stop().state == "disarmed"
    with pytest.raises(ConsoleRefused, match="take over first"):
        client.pause()
    client.take_over()
    client.pause("after_strike")
    client.answer(4, order="skip")
    assert client.state().role == "operator"
    assert served.backend.orders[:2] == ["stop", "after_strike"]
    assert client.curve("s1.1").phi_deg == 24.5
    assert client.preview().startswith(b"\xff\xd8\xff")
    assert client.archive()[0].id == "r1"
    assert client.estimate("r1")["strikes"] == 7


def test_the_presence_of_a_script_ends_with_it(served: Console, client: ConsoleClient) -> None:
    client.take_over()
    end_s = time.monotonic() + 5
    while not any(each.streams for each in served.visitors._visitors.values()):
        assert time.monotonic() < end_s
        time.sleep(0.01)
    assert served.visitors.operator_present
    client.close()
    while served.visitors.operator_present:
        assert time.monotonic() < end_s + 5
        time.sleep(0.05)


def test_states_are_followed(served: Console, client: ConsoleClient) -> None:
    states = client.events()
    assert next(states).session is None
    served.backend.state = "placing"
    session = next(states).session
    assert session is not None
    assert session.state == "placing"
    states.close()  # pyright: ignore[reportAttributeAccessIssue]
