"""Handle of `analyze advise`: answers, publication without waiting, and a child that is killed."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from acquire.daemon.adviser import Adviser
from schemas.watch_lines import AdviceRequest, SessionEstimate
from tests.places import FIRST_SAMPLE

PATIENCE_S = 60.0


@pytest.fixture
def published() -> list[SessionEstimate]:
    return []


@pytest.fixture
def adviser(published: list[SessionEstimate]) -> Iterator[Adviser]:
    handle = Adviser(published.append)
    yield handle
    handle.close()


def wait_for(published: list[SessionEstimate]) -> None:
    end = time.monotonic() + PATIENCE_S
    while not published and time.monotonic() < end:
        time.sleep(0.05)


def ask(adviser: Adviser, number: int, path: Path = FIRST_SAMPLE, part: int = 1) -> SessionEstimate | None:
    request = AdviceRequest(number=number, target_com_m=1e-3, left=5)
    return adviser.ask(path, part, request, PATIENCE_S)


def test_answers_without_and_with_a_target_and_from_a_child_started_again(
    adviser: Adviser, published: list[SessionEstimate]
) -> None:
    """One child answers as long as it lives: to start it takes longer than to answer."""
    adviser.inform(FIRST_SAMPLE, 1, "")
    assert not adviser.asked
    wait_for(published)
    (informed,) = published
    assert informed.com_m is not None
    assert not informed.target.met
    assert informed.next is None
    published.clear()
    first = ask(adviser, 11)
    assert first is not None
    assert first.number == 11
    assert first.com_m is not None
    assert adviser.latest == first
    wait_for(published)
    assert published == [first]
    assert adviser.asked
    assert adviser._process is not None
    os.kill(adviser._process.pid, signal.SIGKILL)
    second = ask(adviser, 12)
    assert second is not None
    assert second.com_m == first.com_m
    assert adviser.asked


def test_a_child_that_cannot_read_the_recording_gives_no_answer(adviser: Adviser, tmp_path: Path) -> None:
    path = tmp_path / "r.mcap"
    path.write_bytes(b"no recording at all")
    began = time.monotonic()
    assert ask(adviser, 1, path) is None
    assert time.monotonic() - began < PATIENCE_S
