"""Recordings are compacted between sessions, and never beside one."""

import time
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path

import pytest

from acquire.daemon.compactor import Compactor
from schemas.rig import RecorderConfig
from tests.quick_archive import body_of, quick_session

COMPACTING = RecorderConfig(compact="after-session", disk_reserve_bytes=0)


@pytest.fixture
def complaints() -> list[str]:
    return []


@pytest.fixture
def compactor(complaints) -> Iterator[Compactor]:
    with closing(Compactor(COMPACTING, complaints.append, wait_s=0.1)) as running:
        yield running


def session(path: Path) -> int:
    quick_session(path, body_of(1), 1, 1, raw=True)
    return path.stat().st_size


def until(reached: Callable[[], bool]) -> bool:
    end = time.monotonic() + 60
    while not reached() and time.monotonic() < end:
        time.sleep(0.05)
    return reached()


def test_it_waits_for_the_end_of_the_next_session(tmp_path, compactor, complaints):
    path = tmp_path / "s.mcap"
    size = session(path)
    compactor.enqueue([str(path)])
    compactor.pause()
    time.sleep(1.0)
    assert path.stat().st_size == size
    compactor.enqueue([])
    assert until(lambda: path.stat().st_size < 0.5 * size)
    assert complaints == []


def test_a_session_that_ends_at_once_loses_no_recording(tmp_path, compactor, complaints):
    path = tmp_path / "s.mcap"
    size = session(path)
    compactor.enqueue([str(path)])
    assert until(lambda: compactor._process is not None)
    compactor.pause()
    compactor.enqueue([])
    assert until(lambda: path.stat().st_size < 0.5 * size)
    assert complaints == []
    assert list(tmp_path.iterdir()) == [path]


def test_a_recording_that_cannot_be_is_named_and_the_next_one_is(tmp_path, compactor, complaints):
    path = tmp_path / "s.mcap"
    size = session(path)
    (tmp_path / "bad.mcap").write_bytes(b"no recording")
    compactor.enqueue([str(tmp_path / "bad.mcap"), str(path)])
    assert until(lambda: path.stat().st_size < 0.5 * size)
    [complaint] = complaints
    assert "bad.mcap" in complaint


def test_the_recorders_reserve_stays_free(tmp_path, complaints):
    path = tmp_path / "s.mcap"
    size = session(path)
    recorder = COMPACTING.model_copy(update={"disk_reserve_bytes": 1 << 60})
    with closing(Compactor(recorder, complaints.append, wait_s=0.1)) as reserved:
        reserved.enqueue([str(path)])
        assert until(lambda: bool(complaints))
    [complaint] = complaints
    assert "MB are to stay free" in complaint
    assert path.stat().st_size == size


def test_without_the_setting_nothing_happens(tmp_path):
    path = tmp_path / "s.mcap"
    size = session(path)
    with closing(Compactor(RecorderConfig(), print, wait_s=0.0)) as idle:
        idle.enqueue([str(path)])
        time.sleep(0.3)
    assert path.stat().st_size == size
