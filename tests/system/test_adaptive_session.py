"""Sessions on the virtual rig that stop themselves, and sessions that go on where an earlier one ended."""

from __future__ import annotations

import contextlib
import os
import signal
from pathlib import Path

import pytest

from acquire.daemon.client import DaemonClient
from acquire.errors import AcquireError
from acquire.session.adaptive import Target
from acquire.session.earlier import read_earlier
from analyze.pipeline.estimate_recordings import estimate_recordings
from analyze.reading.recording import open_recording
from tests.system.session_rig import SessionRig, session_rig

TARGET = Target(com_m=1e-3, max_strikes=12)


def children_of(pid: int, words: str) -> list[int]:
    """Ids of a process's children whose command line contains `words`."""
    found: list[int] = []
    for folder in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError, ValueError):
            status = (folder / "stat").read_text().rpartition(")")[2].split()
            command = (folder / "cmdline").read_bytes().replace(b"\0", b" ").decode()
            if int(status[1]) == pid and words in command:
                found.append(int(folder.name))
    return found


def kill_adviser(rig: SessionRig) -> int:
    """Kill the daemon's `analyze advise` processes; their number."""
    with DaemonClient(rig.daemon.socket) as client:
        daemon = int(client.call("status")["pid"])
    victims = children_of(daemon, "analyze advise")
    for victim in victims:
        os.kill(victim, signal.SIGKILL)
    return len(victims)


@pytest.mark.slow
def test_a_session_reaches_its_target_although_its_adviser_dies() -> None:
    killed = 0
    with session_rig(strikes=9) as rig:

        def progress(text: str, done: int, _total: int) -> None:
            nonlocal killed
            rig.said.append(text)
            if "arming" in text and done in {1, 2} and killed < 2:
                killed += kill_adviser(rig)

        report = rig.session(progress, target=TARGET)
        assert killed >= 1, rig.said
        assert not report.missed, (report.text, rig.said)
        assert "com=1mm is reached" in report.text
        with open_recording(report.path) as recording:
            strikes = list(recording.strikes)
        assert all(each.choice_text for each in strikes)
        estimate = estimate_recordings(list(report.files))
        assert 1.96 * max(estimate.com.covariance.diagonal()) ** 0.5 < 1.1e-3
        assert estimate.evidence.choices


@pytest.mark.slow
def test_a_stopped_session_is_resumed_with_the_strikes_that_are_left() -> None:
    with session_rig() as rig:
        plan_path = rig.folder / "plan.json"

        def stop_after_one(text: str, done: int, _total: int) -> None:
            rig.said.append(text)
            if done == 1 and "arming" in text:
                with DaemonClient(rig.daemon.socket) as client, contextlib.suppress(AcquireError):
                    client.call("striker.stop")

        first = rig.session(stop_after_one, name="a.mcap")
        assert first.aborted, rig.said
        before = read_earlier([first.path], plan_path.read_text(), plan_path)
        assert before.good
        second = rig.session(lambda text, *_: rig.said.append(text), name="b.mcap", earlier=before)
        assert not second.complaint, (second.complaint, rig.said)
        after = read_earlier([second.path], plan_path.read_text(), plan_path)
        assert not before.good & after.good
        assert {each.strike_id for each in before.strikes}.isdisjoint(
            each.strike_id for each in after.strikes
        )
        estimate = estimate_recordings([first.path, second.path])
        assert len(estimate.planes) >= 3
