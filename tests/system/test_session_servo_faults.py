"""Sessions on the virtual rig during which the servo is unplugged or switches its torque off.

Each is a row of docs/reference/faults.md.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import pytest

from schemas import topics
from schemas.proto import percuss_pb2 as pb
from tests.acquire.virtual.world_link import WorldLink
from tests.system.fault_rig import Frames, add_row, messages
from tests.system.session_rig import SessionRig, session_rig

pytestmark = [pytest.mark.slow, pytest.mark.timeout(180)]
AWAY_S = 2.0
SWINGING_RAD_S = 1.0


@pytest.fixture
def rig() -> Iterator[SessionRig]:
    with session_rig() as rig:
        yield rig


@dataclass
class Breaker:
    """Fault injector: calls `act` in the first swing of a session, and keeps the session's progress lines."""

    world: WorldLink
    act: Callable[[WorldLink], None]
    said: list[tuple[float, str]] = field(default_factory=list)
    acted: list[float] = field(default_factory=list)
    thread: threading.Thread | None = None

    def progress(self, text: str, _done: int, _total: int) -> None:
        self.said.append((time.monotonic(), text))
        if " striking" in text and self.thread is None:
            self.thread = threading.Thread(target=self._run, name="breaker")
            self.thread.start()

    def _run(self) -> None:
        end = time.monotonic() + 10.0
        while self.world.state()["arm_velocity"] < SWINGING_RAD_S and time.monotonic() < end:
            time.sleep(0.002)
        self.act(self.world)
        self.acted.append(time.monotonic())

    def lines(self, word: str) -> list[tuple[float, str]]:
        return [(when, text) for when, text in self.said if word in text]


def unplug_and_plug_in(world: WorldLink) -> None:
    world.servo("unplug")
    time.sleep(AWAY_S)
    world.servo("plug in")


def overload(world: WorldLink) -> None:
    world.servo("overload")


@pytest.mark.parametrize(
    ("what", "act", "line"),
    [
        (
            "servo's adapter unplugged in a session's first swing, 2 s later plugged in again",
            unplug_and_plug_in,
            "plug the adapter in again",
        ),
        (
            "servo in ALERT (overload, torque off) in a session's first swing",
            overload,
            "overload; check that the arm moves freely",
        ),
    ],
    ids=["unplugged", "overload"],
)
def test_a_session_outlives_its_servo(
    rig: SessionRig, what: str, act: Callable[[WorldLink], None], line: str
) -> None:
    breaker = Breaker(rig.world(), act)
    report = rig.session(breaker.progress)
    assert breaker.thread is not None
    breaker.thread.join()
    assert not report.aborted, report.text
    # one clear line, and then the same planned strike again
    failed = breaker.lines(line)
    assert failed, breaker.said
    assert all("\n" not in text and "Traceback" not in text for _, text in breaker.said)
    (reset,) = breaker.lines("the striker was reset")
    back_s = reset[0] - breaker.acted[0]
    assert back_s < 5.0
    # the recording went on, and lacks nothing
    frames = Frames.of(report.path)
    assert frames.lost == 0
    assert abs(frames.unaccounted) < 2.0
    events = [event for _, event in messages(report.path, topics.STRIKER_EVENT)]
    faults = [event for event in events if event.kind == pb.StrikerEvent.FAULT]
    assert faults[0].strike_id
    assert line in faults[0].text
    strikes = [record for _, record in messages(report.path, topics.SESSION_STRIKE)]
    planned = {record.plan_strike_id for record in strikes}
    good = {record.plan_strike_id for record in strikes if record.verdict_code == "good"}
    assert len(planned) >= 3
    assert faults[0].strike_id.partition(".")[0] in planned
    assert len(good) >= len(planned) - 1, [
        (record.strike_id, record.verdict_code, record.verdict_text) for record in strikes
    ]
    add_row(
        what,
        f"this attempt, reported in one line; {frames.lost} of {frames.arrived} frames; {len(good)} of "
        f"{len(planned)} planned strikes good",
        f"{back_s:.1f} s later the session continues by itself with the same strike",
    )
