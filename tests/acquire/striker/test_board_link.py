"""A serial line that carries noise, or another program's words, instead of a striker board's."""

from __future__ import annotations

import contextlib
import os
import threading
import time
import tty
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from acquire.clock.clock import SystemClock
from acquire.errors import StrikerLost, StrikerNotFound
from acquire.striker import board_link
from acquire.striker.board_lines import BoardState
from acquire.striker.board_link import BoardLink
from acquire.virtual.striker_firmware import StrikerFirmware

NOISE = bytes(range(256)) * 4


class Line:
    """Pseudo-terminal with a board on it that says `before` each of its replies, and floods if told to."""

    def __init__(self) -> None:
        self.master, self.slave = os.openpty()
        tty.setraw(self.slave)
        os.set_blocking(self.master, False)
        self.port = os.ttyname(self.slave)
        self.board = StrikerFirmware(3, time.monotonic_ns(), lambda _speed: None, lambda: None)
        self.before, self.flood = b"", False
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self) -> None:
        while not self._end.is_set():
            with contextlib.suppress(BlockingIOError):
                if self.flood:
                    os.write(self.master, NOISE)
                data = os.read(self.master, 4096)
                if not self.flood:
                    os.write(self.master, self.before + self.board.receive(data, time.monotonic_ns()))
            time.sleep(0.0005)

    def close(self) -> None:
        self._end.set()
        self._thread.join()
        os.close(self.master)
        os.close(self.slave)


@pytest.fixture(scope="module")
def line() -> Iterator[Line]:
    line = Line()
    yield line
    line.close()


@pytest.fixture
def link(line: Line) -> Iterator[BoardLink]:
    line.before, line.flood = b"", False
    link = BoardLink(line.port, 1_000_000, SystemClock())
    link.open()
    yield link
    link.close()


@settings(
    max_examples=40,
    derandomize=True,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
@given(noise=st.binary(max_size=300))
def test_noise_before_a_reply_does_no_harm(line: Line, link: BoardLink, noise: bytes) -> None:
    """The noise ends with a line feed: otherwise the reply is part of a damaged line, and asked for again."""
    line.before = noise + b"\n"
    assert link.status("state").state is BoardState.SAFE


def test_a_flood_is_no_reply_and_ends_in_time(line: Line, link: BoardLink) -> None:
    line.flood = True
    began = time.monotonic()
    with pytest.raises(StrikerLost, match="no reply"):
        link.status("state")
    assert time.monotonic() - began < 2 * board_link.ATTEMPTS * board_link.REPLY_NS * 1e-9


def test_the_reply_to_an_earlier_request_is_not_taken_for_that_to_this_one(
    line: Line, link: BoardLink
) -> None:
    line.before = line.board.receive(b"98 arm 20000*%02X\n" % _sum(b"98 arm 20000"), time.monotonic_ns())
    assert b"armed" in line.before
    assert link.status("stop").state is BoardState.SAFE


def _sum(body: bytes) -> int:
    value = 0
    for byte in body:
        value ^= byte
    return value


def test_a_board_of_another_version_is_named(line: Line, monkeypatch: pytest.MonkeyPatch) -> None:
    line.before, line.flood = b"", False
    monkeypatch.setattr(line.board, "_reply", lambda *_: "hello percuss-striker 7 new")
    with pytest.raises(StrikerNotFound, match="version 7 of the striker protocol"):
        BoardLink(line.port, 1_000_000, SystemClock()).open()


def test_a_missing_port_and_a_file_are_named(tmp_path: Path) -> None:
    file = tmp_path / "file"
    file.write_text("")
    for port, words in ((tmp_path / "none", "no such serial port"), (file, "is not a serial port")):
        with pytest.raises(StrikerNotFound, match=words):
            BoardLink(str(port), 1_000_000, SystemClock()).open()
