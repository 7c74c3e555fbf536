"""sd_notify datagrams, received by a socket in place of the service manager."""

from __future__ import annotations

import os
import socket
from collections.abc import Iterator
from pathlib import Path

import pytest

from acquire.daemon.service import ServiceManager


@pytest.fixture(params=["path", "abstract"])
def manager(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[tuple[socket.socket, str]]:
    name = str(tmp_path / "notify") if request.param == "path" else f"@percuss-test-{os.getpid()}"
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as listener:
        listener.bind(name.replace("@", "\0", 1))
        listener.settimeout(1.0)
        yield listener, name


def _heard(listener: socket.socket) -> list[str]:
    words = []
    listener.setblocking(False)
    while True:
        try:
            words.append(listener.recv(1000).decode())
        except BlockingIOError:
            return words


def test_ready_four_keep_alives_per_watchdog_time_and_stopping(manager: tuple[socket.socket, str]) -> None:
    listener, name = manager
    now_ns = 0
    environment = {"NOTIFY_SOCKET": name, "WATCHDOG_USEC": "8000000", "WATCHDOG_PID": "7"}
    with ServiceManager(environment, 7, lambda: now_ns).running("a camera") as alive:
        assert _heard(listener) == ["READY=1\nSTATUS=a camera"]
        for _ in range(81):
            alive()
            now_ns += 100_000_000
        assert _heard(listener) == ["WATCHDOG=1"] * 5
    assert [word.partition("\n")[0] for word in _heard(listener)] == ["STOPPING=1"]


@pytest.mark.parametrize(
    "watchdog", [{}, {"WATCHDOG_USEC": "8000000", "WATCHDOG_PID": "8"}, {"WATCHDOG_USEC": "soon"}]
)
def test_no_keep_alive_without_a_watchdog_for_this_process(
    manager: tuple[socket.socket, str], watchdog: dict[str, str]
) -> None:
    listener, name = manager
    with ServiceManager({"NOTIFY_SOCKET": name, **watchdog}, 7, lambda: 0).running("") as alive:
        alive()
    assert [word.partition("\n")[0] for word in _heard(listener)] == ["READY=1", "STOPPING=1"]


def test_stopping_is_sent_after_an_error(manager: tuple[socket.socket, str]) -> None:
    listener, name = manager
    with pytest.raises(ZeroDivisionError), ServiceManager({"NOTIFY_SOCKET": name}, 7, lambda: 0).running(""):
        _ = 1 / 0
    assert _heard(listener)[-1].startswith("STOPPING=1")


def test_children_do_not_inherit_the_address_and_a_missing_manager_is_no_error(tmp_path: Path) -> None:
    environment = {
        "NOTIFY_SOCKET": str(tmp_path / "gone"),
        "WATCHDOG_USEC": "1",
        "WATCHDOG_PID": str(os.getpid()),
        "HOME": "/",
    }
    service = ServiceManager.from_environment(environment)
    assert environment == {"HOME": "/"}
    with service.running("") as alive:
        alive()
    with ServiceManager.from_environment({}).running("") as alive:
        alive()
