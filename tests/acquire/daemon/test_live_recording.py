"""Messages that the capture process does not take are never lost without a word."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import pytest

from acquire.clock.clock import SystemClock
from acquire.daemon.live_recording import LiveRecording
from acquire.errors import RecorderError
from schemas import topics
from schemas.proto import percuss_pb2 as pb


class Capture:
    """Capture process that takes messages, or does not."""

    takes = True

    def write(self, *_: object) -> bool:
        return self.takes

    def status(self) -> None:
        pass

    def close_recording(self) -> SimpleNamespace:
        return SimpleNamespace(path=Path("a.mcap"), frames=1, lost=0, content_id="")


def test_messages_that_are_not_taken_are_reported():
    complaints: list[str] = []
    capture = Capture()
    live = LiveRecording(
        SimpleNamespace(),  # type: ignore[arg-type]
        "",
        capture,  # type: ignore[arg-type]
        SystemClock(),
        lambda _: None,
        complaints.append,
    )
    live._open = SimpleNamespace(  # type: ignore[assignment]
        broken="",
        refused=0,
        manifest=SimpleNamespace(wall_anchor_ns=0),
        refuse_earlier_file=lambda _: None,
        salvages=[],
        path=Path("a.mcap"),
        watch=SimpleNamespace(stop=lambda: None),
    )
    live.write_record(topics.SESSION_STRIKE, pb.StrikeRecord(plan_strike_id="s1"))
    assert not complaints
    capture.takes = False
    with pytest.raises(RecorderError, match="the strike or toss was not recorded"):
        live.write_record(topics.SESSION_STRIKE, pb.StrikeRecord(plan_strike_id="s1"))
    live.log("striker armed")
    assert not complaints
    capture.takes = True
    live.log("striker homed")
    live.log("striker armed")
    assert [text[:26] for text in complaints] == ["2 messages of striker and s"[:26]]
    capture.takes = False
    live.log("striker homed")
    live.close()
    assert len(complaints) == 2
    assert complaints[1].startswith("1 message of striker")
