"""Records of tosses are read from finished, cut, recovered and growing recordings, and inspected."""

from __future__ import annotations

import io
from pathlib import Path

import pytest

from acquire.recorder.recover.recover import recover
from analyze.reading.live_recording import LiveRecording
from analyze.reading.recording import open_partial, open_recording
from analyze.verbs.inspect.recording import inspect_recording
from analyze.verbs.inspect.table import render_inspection
from schemas.terminal import Terminal
from tests import small_recording as small
from tests.mcap_writer import McapWriter
from tests.schemas.test_planned_toss import TOSS, plan_with


@pytest.fixture
def whole(tmp_path: Path) -> Path:
    path = tmp_path / "a.mcap"
    with McapWriter(path) as writer:
        small.write_head(writer, plan=plan_with(TOSS, TOSS | {"id": "t2"}).encode())
        small.write_body(writer)
        small.write_toss(writer)
    return path


def test_tosses_of_a_finished_recording(whole: Path) -> None:
    with open_recording(whole) as recording:
        (toss,) = recording.tosses
        assert (toss.toss_id, toss.plan_toss_id, toss.attempt) == ("t1.1", "t1", 1)
        assert (toss.window_start_ns, toss.window_end_ns) == (
            small.frame_time(0),
            small.frame_time(small.FRAMES - 1),
        )
        assert [planned.id for planned in recording.plan.tosses] == ["t1", "t2"]


def test_a_recording_without_tosses_has_none(tmp_path: Path) -> None:
    small.write_recording(tmp_path / "a.mcap")
    with open_recording(tmp_path / "a.mcap") as recording:
        assert recording.tosses == ()


def test_tosses_of_a_cut_recording_and_of_the_recovered_one(whole: Path, tmp_path: Path) -> None:
    whole.write_bytes(whole.read_bytes()[:-400])
    with open_partial(whole) as cut:
        assert [toss.toss_id for toss in cut.tosses] == ["t1.1"]
    recover(whole, tmp_path / "b.mcap")
    with open_recording(tmp_path / "b.mcap") as recovered:
        assert [toss.toss_id for toss in recovered.tosses] == ["t1.1"]


def test_tosses_of_a_growing_recording(tmp_path: Path) -> None:
    writer = McapWriter(tmp_path / "a.mcap")
    with LiveRecording(tmp_path / "a.mcap.part") as live:
        small.write_head(writer)
        small.write_body(writer)
        writer.flush()
        live.poll()
        assert live.tosses == []
        small.write_toss(writer)
        writer.flush()
        small_messages, strikes = live.poll()
        assert ([toss.toss_id for toss in live.tosses], small_messages, strikes) == (["t1.1"], [], [])
    writer.finish()


def test_inspection_lists_tosses_and_those_not_made(whole: Path) -> None:
    found = inspect_recording(whole)
    assert found["tosses"][0]["images"] == small.FRAMES
    assert found["planned_tosses"] == {"planned": ["t1", "t2"], "missing": ["t2"]}
    text = io.StringIO()
    render_inspection(found, Terminal(file=text, width=80))
    assert "t1.1" in text.getvalue()
    assert "1 planned toss was not made: t2" in text.getvalue()
