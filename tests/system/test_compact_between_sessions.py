"""Recordings compacted by the daemon between the sessions of a whole rig, and never beside one."""

from __future__ import annotations

import time
from contextlib import closing
from pathlib import Path

import pytest

from acquire.virtual.pace import read_pace
from analyze.compact.part_file import part_path
from analyze.reading.indexed_file import open_finished
from analyze.reading.verify import refuse_changed_content
from schemas.compaction import COMPACTED_NAME
from tests.system.fault_rig import Frames, child, wait_until
from tests.system.session_rig import SessionRig, session_rig

pytestmark = [pytest.mark.slow, pytest.mark.timeout(1200)]

FOUND_S = 300.0
"""time within which a recording of a few strikes is compacted on a busy computer [s]"""


def is_compact(path: Path) -> bool:
    with closing(open_finished(path)) as file:
        return COMPACTED_NAME in file.metadata


def run_beside(rig: SessionRig, name: str) -> tuple[Path, list[float]]:
    """Carry out a session; times [s] at which a compaction was seen beside it."""
    seen: list[float] = []
    begun = time.monotonic()

    def look(_text: str, _done: int, _total: int) -> None:
        if child(rig.daemon.pid, "compact"):
            seen.append(time.monotonic() - begun)

    report = rig.session(look, name=name)
    assert not report.aborted
    return report.path, seen


def test_a_session_is_never_disturbed_by_the_compaction_of_the_one_before():
    with session_rig(recorder='compact = "after-session"') as rig:
        first, _ = run_beside(rig, "a.mcap")
        original = first.stat().st_size
        wait_until(part_path(first).exists, FOUND_S)
        second, seen = run_beside(rig, "b.mcap")
        assert seen == [] or max(seen) < 1.0
        frames = [Frames.of(path) for path in (first, second)]
        assert not part_path(first).exists()
        refuse_changed_content(first)
        wait_until(lambda: is_compact(first) and is_compact(second), FOUND_S, pause_s=0.5)
        for path, counted in zip((first, second), frames, strict=True):
            refuse_changed_content(path)
            assert Frames.of(path) == counted
        assert first.stat().st_size < 0.6 * original
        assert not any("compact" in line for line in rig.daemon.complaints.splitlines())
        rig.daemon.end()
        rig.camera.terminate()
        rig.camera.wait(60)
        pace = read_pace(rig.folder)
    print(f"frames {frames}, compaction seen at {seen} s, {pace}")
    assert all(each.lost == 0 for each in frames) or pace.camera_s > 0.5, (frames, pace)
