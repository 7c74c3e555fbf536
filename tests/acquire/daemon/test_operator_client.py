"""Prompts reach whoever answers them, and answers the session, while many other programs connect."""

from __future__ import annotations

import contextlib
import socket
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from acquire.daemon.operator_client import OperatorClient
from acquire.daemon.prompts import Prompts
from acquire.daemon.server import ApiServer
from acquire.errors import DaemonNotRunning

FLOOD = 400
"""connections that send nothing; the door keeps 256"""


class Rig:
    """Server with prompts, as the daemon has it, and a session that asks one question."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.stopped = False
        self.prompts = Prompts(self.publish, lambda: self.stopped)
        handlers = {"prompt.answer": self.prompts.answer, "prompt": self.prompts.ask}
        self.server = ApiServer(path, handlers, greet=self.prompts.repeat)
        self.answers: list[dict[str, Any]] = []

    def publish(self, event: str, data: dict[str, Any]) -> None:
        self.server.publish(event, data)

    def ask(self, text: str) -> threading.Thread:
        session = SimpleNamespace(gone=False)

        def run() -> None:
            question = {"kind": "place", "text": text}
            self.answers.append(self.prompts.ask(session, question))  # pyright: ignore[reportArgumentType]

        thread = threading.Thread(target=run)
        thread.start()
        return thread


@pytest.fixture
def rig(tmp_path: Path) -> Iterator[Rig]:
    found = Rig(tmp_path / "d" / "d.sock")
    yield found
    found.prompts.close()
    found.server.close()


@contextlib.contextmanager
def flooded(path: Path) -> Iterator[None]:
    with contextlib.ExitStack() as held:
        for _ in range(FLOOD):
            idle = held.enter_context(socket.socket(socket.AF_UNIX))
            end = time.monotonic() + 10.0
            while time.monotonic() < end:
                try:
                    idle.connect(str(path))
                    break
                except BlockingIOError:
                    time.sleep(0.001)
        yield


def test_an_answer_arrives_after_a_flood_of_connections(rig: Rig) -> None:
    """A connection kept for the answer was sent away, and the session waited for ever."""
    operator = OperatorClient(rig.path)
    events = operator.events()
    asked = rig.ask("place it")
    prompt = next(events)
    with flooded(rig.path):
        operator.answer(prompt["prompt_id"], ok=True)
        asked.join(10.0)
    operator.close()
    assert rig.answers == [{"ok": True, "text": ""}]


def test_who_subscribes_late_or_again_gets_the_open_prompt_once(rig: Rig) -> None:
    asked = rig.ask("place it")
    while not rig.prompts._answers:
        time.sleep(0.001)
    operator = OperatorClient(rig.path)
    events = operator.events()
    first = next(events)
    assert (first["event"], first["text"]) == ("prompt", "place it")
    for connection in rig.server._connections():
        connection.close()
    again = rig.ask("place it again")
    second = next(events)
    assert second["text"] == "place it again"
    for event in (first, second):
        operator.answer(event["prompt_id"], ok=True)
        operator.answer(event["prompt_id"], ok=True)  # no longer open: nothing happens
    for thread in (asked, again):
        thread.join(10.0)
    operator.close()
    assert len(rig.answers) == 2


def test_after_a_stop_nobody_is_asked(rig: Rig) -> None:
    """A stop between two questions ends the session as one during a question does."""
    rig.stopped = True
    rig.ask("place it").join(5.0)
    assert rig.answers == [{"ok": False, "text": "stopped on request"}]


def test_the_events_end_with_the_daemon(tmp_path: Path) -> None:
    rig = Rig(tmp_path / "e" / "d.sock")
    operator = OperatorClient(rig.path)
    events = operator.events()
    closer = threading.Timer(0.2, rig.server.close)
    closer.start()
    assert list(events) == []
    closer.join()
    with pytest.raises(DaemonNotRunning):
        operator.answer(1, ok=True)
    operator.close()
