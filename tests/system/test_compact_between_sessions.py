"""Recordings compacted by the daemon between the sessions of a whole rig, and never beside one."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import pytest

from acquire.virtual.pace import read_pace
from analyze.compact.part_file import part_path
from analyze.reading.indexed_file import open_finished
from analyze.reading.verify import refuse_changed_content
from schemas.compaction import COMPACTED_NAME
from tests.system.fault_rig import Frames, add_row, child, wait_until
from tests.system.session_rig import SessionRig, session_rig

pytestmark = [pytest.mark.slow, pytest.mark.timeout(1200)]

FOUND_S = 300.0
"""time within which a recording of a few strikes is compacted on a busy computer [s]"""
ENDED_S = 5.0
"""time after the beginning of a session within which a compaction has ended on a busy computer [s]"""
BUSY_S = 0.5
"""delay of an image from which on the computer was too busy for the virtual rig [s]"""


def is_compact(path: Path) -> bool:
    with closing(open_finished(path)) as file:
        return COMPACTED_NAME in file.metadata


@contextmanager
def watched(rig: SessionRig) -> Iterator[list[float]]:
    """Yield the times since the beginning at which a compaction runs [s], filled until the end."""
    seen: list[float] = []
    begun, ended = time.monotonic(), threading.Event()

    def look() -> None:
        while not ended.wait(0.05):
            if child(rig.daemon.pid, "compact"):
                seen.append(time.monotonic() - begun)

    thread = threading.Thread(target=look)
    thread.start()
    try:
        yield seen
    finally:
        ended.set()
        thread.join()


def run(rig: SessionRig, name: str) -> tuple[Path, Frames]:
    """Carry out a session; its recording and frames."""
    report = rig.session(lambda text, _done, _total: rig.said.append(text), name=name)
    assert not report.aborted, rig.said
    return report.path, Frames.of(report.path)


def test_a_session_is_not_disturbed_by_the_compaction_of_the_one_before():
    with session_rig(recorder='compact = "after-session"') as rig:
        first, first_frames = run(rig, "a.mcap")
        original = first.stat().st_size
        wait_until(part_path(first).exists, FOUND_S)
        with watched(rig) as seen:
            second, second_frames = run(rig, "b.mcap")
        assert max(seen, default=0.0) < ENDED_S
        assert not part_path(first).exists()
        refuse_changed_content(first)
        wait_until(lambda: is_compact(first) and is_compact(second), FOUND_S, pause_s=0.5)
        for path, frames in ((first, first_frames), (second, second_frames)):
            refuse_changed_content(path)
            assert Frames.of(path) == frames
        assert first.stat().st_size < 0.6 * original
        assert "compact" not in rig.daemon.complaints
        rig.daemon.end()
        rig.camera.terminate()
        rig.camera.wait(60)
        pace = read_pace(rig.folder)
    figures = (
        f"{first_frames.lost} and {second_frames.lost} of {first_frames.arrived}, {second_frames.arrived}"
    )
    add_row(
        "the next session begins while the recording before is compacted",
        f"frames lost in the session before and in this: {figures}; images up to {pace.camera_s:.1f} s late",
        f"the compaction had ended after {max(seen, default=0.0):.1f} s, and was done after the session",
    )
    assert first_frames.lost == second_frames.lost == 0 or pace.camera_s > BUSY_S, (figures, pace)
