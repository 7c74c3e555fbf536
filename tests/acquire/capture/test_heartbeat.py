"""Heartbeats: a process that stops sending is reported once; one that is slow or never sent is not."""

from __future__ import annotations

import os
import threading
import time

import pytest

from acquire.capture import heartbeat
from acquire.capture.heartbeat import Heartbeat, HeartbeatListener


@pytest.fixture
def beats(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(heartbeat, "BEAT_S", 0.02)


def test_a_living_process_and_its_normal_end_are_not_reported(beats: None) -> None:
    read_fd, write_fd = os.pipe()
    reported = threading.Event()
    listener = HeartbeatListener(read_fd, reported.set, silence_s=1.0)
    alive = Heartbeat(write_fd, lambda: True)
    assert not reported.wait(1.5)
    alive.stop()
    listener.join()
    assert not reported.is_set()


def test_an_unhealthy_process_is_reported_once(beats: None) -> None:
    read_fd, write_fd = os.pipe()
    well = threading.Event()
    well.set()
    reported: list[float] = []
    listener = HeartbeatListener(read_fd, lambda: reported.append(time.monotonic()), silence_s=0.5)
    alive = Heartbeat(write_fd, well.is_set)
    time.sleep(0.2)
    well.clear()
    since = time.monotonic()
    time.sleep(1.5)
    alive.stop()
    listener.join()
    (at,) = reported
    assert at - since > 0.45


def test_silence_before_the_first_heartbeat_is_not_reported() -> None:
    read_fd, write_fd = os.pipe()
    reported = threading.Event()
    listener = HeartbeatListener(read_fd, reported.set, silence_s=0.2)
    assert not reported.wait(0.6)
    os.close(write_fd)
    listener.join()


def test_time_without_running_does_not_count(monkeypatch: pytest.MonkeyPatch) -> None:
    """The listener itself was paused for an hour in each turn: the sender does not count as silent."""
    read_fd, write_fd = os.pipe()
    hours = iter(range(0, 3_600_000, 3600))
    monkeypatch.setattr(heartbeat.time, "monotonic", lambda: float(next(hours)))
    reported = threading.Event()
    os.write(write_fd, b".")
    listener = HeartbeatListener(read_fd, reported.set, silence_s=1.0)
    assert not reported.wait(0.35)  # three turns at most, which count for 0.6 s
    os.close(write_fd)
    listener.join()


def test_a_listener_that_does_not_read_does_not_block_the_heartbeat(beats: None) -> None:
    read_fd, write_fd = os.pipe()
    os.set_blocking(write_fd, False)
    while True:
        try:
            os.write(write_fd, b"." * 4096)
        except BlockingIOError:
            break
    alive = Heartbeat(write_fd, lambda: True)
    time.sleep(0.1)
    alive.stop()
    os.close(read_fd)
