from __future__ import annotations

from typing import Any

import pytest

from acquire.clock.clock import SystemClock
from acquire.errors import StrikerRefused
from acquire.striker import manual
from acquire.striker.base import StrikerState
from acquire.striker.sample import Sample
from acquire.striker.tick import TickClock
from schemas.proto import percuss_pb2 as pb
from schemas.rig import StrikerConfig


def test_manual_striker_follows_the_same_states_without_a_contact(
    heard: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(manual, "HAND_S", 0.1)
    striker = manual.ManualStriker(
        StrikerConfig(kind="manual"),
        heard.samples.append,
        heard.events.append,
        heard.clocks.append,
        SystemClock(),
    )
    striker.open()
    with pytest.raises(StrikerRefused):
        striker.arm()
    striker.home()
    with pytest.raises(StrikerRefused):
        striker.strike("s", 0.3)
    striker.arm()
    striker.cock()
    outcome = striker.strike("s", 0.3)
    assert outcome.contact_time_ns is None
    assert outcome.impulse_n_s is None
    assert striker.state is StrikerState.DISARMED
    assert heard.kinds() == ["HOMED", "ARMED", "COCKED", "RELEASED", "DISARMED"]
    striker.arm()
    striker.stop()
    assert striker.state is StrikerState.DISARMED
    striker.close()


def test_tick_is_unwrapped_and_continues_after_a_reboot() -> None:
    sent: list[pb.ClockSample] = []
    clock = TickClock(sent.append)

    def read(host_ms: int, tick: int) -> None:
        clock.observe(
            Sample(host_ms * 1_000_000 - 100_000, host_ms * 1_000_000 + 100_000, tick, 0.0, 0.0, 0.0)
        )

    read(1000, 32700)
    read(1600, 532)  # wrapped
    read(71600, (532 + 70000) % 32768)  # two turns unseen
    offset_ms = {
        c.device_time_ns // 1_000_000 - (c.host_before_ns + c.host_after_ns) // 2_000_000 for c in sent
    }
    assert offset_ms == {31700}
    clock.restart()
    read(73600, 17)
    read(74600, 1018)
    assert abs(sent[-1].device_time_ns - (74600 + 31700) * 1_000_000) <= 2_000_000
