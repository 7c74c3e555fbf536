"""Signs of life: who sends none is found out once, who is slow or was never heard is left alone."""

from __future__ import annotations

import os
import threading
import time

import pytest

from acquire.capture.heartbeat import Heart, Listener
from acquire.capture.process import heartbeat as heart


@pytest.fixture
def beats(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(heart, "BEAT_S", 0.02)


def test_a_living_process_is_left_alone_and_its_end_is_no_silence(beats: None) -> None:
    hear, beat = os.pipe()
    told = threading.Event()
    listener = Listener(hear, told.set, silence_s=1.0)
    alive = Heart(beat, lambda: True)
    assert not told.wait(1.5)
    alive.stop()
    listener.join()
    assert not told.is_set()


def test_one_that_is_not_well_is_told_of_once(beats: None) -> None:
    hear, beat = os.pipe()
    well = threading.Event()
    well.set()
    told: list[float] = []
    listener = Listener(hear, lambda: told.append(time.monotonic()), silence_s=0.5)
    alive = Heart(beat, well.is_set)
    time.sleep(0.2)
    well.clear()
    since = time.monotonic()
    time.sleep(1.5)
    alive.stop()
    listener.join()
    (at,) = told
    assert at - since > 0.45


def test_who_was_never_heard_is_still_starting() -> None:
    hear, beat = os.pipe()
    told = threading.Event()
    listener = Listener(hear, told.set, silence_s=0.2)
    assert not told.wait(0.6)
    os.close(beat)
    listener.join()


def test_time_in_which_nobody_ran_does_not_count(monkeypatch: pytest.MonkeyPatch) -> None:
    """A machine that stood still: each turn of the listener took an hour."""
    hear, beat = os.pipe()
    hours = iter(range(0, 3_600_000, 3600))
    monkeypatch.setattr(heart.time, "monotonic", lambda: float(next(hours)))
    told = threading.Event()
    os.write(beat, b".")
    listener = Listener(hear, told.set, silence_s=1.0)
    assert not told.wait(0.35)  # three turns at most, which count for 0.6 s
    os.close(beat)
    listener.join()


def test_nobody_who_does_not_listen_holds_the_heart_up(beats: None) -> None:
    hear, beat = os.pipe()
    os.set_blocking(beat, False)
    while True:
        try:
            os.write(beat, b"." * 4096)
        except BlockingIOError:
            break
    alive = Heart(beat, lambda: True)
    time.sleep(0.1)
    alive.stop()
    os.close(hear)
