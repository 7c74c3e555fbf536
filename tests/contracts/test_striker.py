"""The contract of Striker, checked on every kind: virtual servo and board, and a person who does nothing.

With `-m hardware` it is checked on the striker of the rig file that PERCUSS_RIG names. The arm moves: keep
its path clear.
"""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from acquire.clock.clock import SystemClock
from acquire.errors import StrikerNotFound, StrikerRefused, StrikerStopped
from acquire.striker import manual
from acquire.striker.base import Striker, StrikerState
from acquire.striker.kinds import CLASSES, make_striker
from schemas.proto import percuss_pb2 as pb
from schemas.rig import RigConfig, StrikerConfig
from schemas.striker_kind import STRIKER_KINDS
from tests.acquire.striker.board_bench import BoardBench
from tests.acquire.striker.plant import Plant

SLOW_M_S = 0.12
IN_SWING_S = 0.15


@dataclass
class Device:
    config: StrikerConfig
    touches: bool = True
    """True if something is struck that the striker can feel"""
    samples: list[pb.StrikerSample] = field(default_factory=list)
    events: list[pb.StrikerEvent] = field(default_factory=list)
    clocks: list[pb.ClockSample] = field(default_factory=list)

    def striker(self) -> Striker:
        return make_striker(
            self.config, self.samples.append, self.events.append, self.clocks.append, SystemClock()
        )


@pytest.fixture(params=[*STRIKER_KINDS, pytest.param("hardware", marks=pytest.mark.hardware)])
def device(
    request: pytest.FixtureRequest,
    tmp_path: Path,
    real_rig: Callable[[], RigConfig],
    monkeypatch: pytest.MonkeyPatch,
) -> Iterator[Device]:
    with contextlib.ExitStack() as cleanup:
        match request.param:
            case "dynamixel":
                yield Device(cleanup.enter_context(Plant(tmp_path)).config())
            case "serial":
                yield Device(cleanup.enter_context(BoardBench(tmp_path)).config())
            case "manual":
                monkeypatch.setattr(manual, "HAND_S", 0.4)
                yield Device(StrikerConfig(kind="manual"), touches=False)
            case _:
                config = real_rig().striker
                yield Device(config, touches=config.traits.has_servo)


@pytest.fixture
def striker(device: Device) -> Iterator[Striker]:
    striker = device.striker()
    striker.open()
    yield striker
    striker.close()


def test_every_kind_of_a_rig_file_has_a_class() -> None:
    assert set(CLASSES) == set(STRIKER_KINDS)


def test_the_whole_order_of_calls(striker: Striker, device: Device) -> None:
    assert striker.state is StrikerState.DISARMED
    striker.home()
    assert striker.state is StrikerState.HOMED
    for number in range(2):
        striker.arm()
        assert striker.state is StrikerState.ARMED
        striker.cock()
        assert striker.state is StrikerState.SETTLED
        before_ns = time.monotonic_ns()
        outcome = striker.strike(f"s{number}", 0.3)
        assert striker.state is StrikerState.DISARMED
        assert before_ns <= outcome.released_ns + 10_000_000
        if device.touches:
            assert outcome.contacts == 1
            assert outcome.contact_time_ns is not None
            assert outcome.released_ns < outcome.contact_time_ns < time.monotonic_ns()
            assert outcome.contact_time_sd_ns > 0
        else:
            assert outcome.contact_time_ns is None
            assert outcome.impulse_n_s is None
        if device.config.traits.has_servo:
            assert outcome.tip_speed_m_s == pytest.approx(0.3, rel=0.05)
        else:
            assert outcome.tip_speed_m_s is None  # what is not measured is not stated
            assert not outcome.missed
    times = [(s.host_before_ns, s.host_after_ns) for s in device.samples]
    assert bool(times) is device.config.traits.has_servo
    assert all(before < after for before, after in times)
    assert times == sorted(times)
    assert all(event.host_time_ns > 0 for event in device.events)
    kinds = [pb.StrikerEvent.Kind.Name(event.kind) for event in device.events]
    for name, count in {"HOMED": 1, "ARMED": 2, "COCKED": 2, "RELEASED": 2, "DISARMED": 2}.items():
        assert kinds.count(name) == count


def test_nothing_moves_without_its_permission(striker: Striker) -> None:
    for forbidden in (striker.arm, striker.cock, lambda: striker.strike("s", 0.3)):
        with pytest.raises(StrikerRefused):
            forbidden()
    striker.home()
    striker.arm()
    striker.stop()
    with pytest.raises(StrikerRefused):
        striker.cock()


def test_one_arming_is_one_strike(striker: Striker) -> None:
    striker.home()
    striker.arm()
    with pytest.raises(StrikerRefused):
        striker.arm()
    striker.cock()
    striker.strike("s", 0.3)
    with pytest.raises(StrikerRefused):
        striker.strike("again", 0.3)


def test_a_stop_in_mid_swing_ends_it_before_the_object(striker: Striker, device: Device) -> None:
    """After the stop the striker cannot be armed before it is homed again.

    The slowest swings take 0.4 s and more to angle 0, where the object is.
    """
    striker.home()
    striker.arm()
    striker.cock()
    raised: list[BaseException] = []

    def strike() -> None:
        try:
            striker.strike("s", SLOW_M_S)
        except StrikerRefused as error:
            raised.append(error)

    swing = threading.Thread(target=strike, name="swing")
    swing.start()
    end = time.monotonic() + 5.0
    while striker.state is not StrikerState.RELEASED and time.monotonic() < end:
        time.sleep(0.001)
    time.sleep(IN_SWING_S)
    asked_ns = time.monotonic_ns()
    striker.stop()
    swing.join()
    took_s = (time.monotonic_ns() - asked_ns) * 1e-9
    assert [type(each) for each in raised] == [StrikerStopped]
    assert striker.state is StrikerState.DISARMED
    if device.config.traits.has_servo:
        swung = [s for s in device.samples if s.host_before_ns < asked_ns][-20:]
        assert max(s.velocity_rad_s for s in swung) > 0.1  # it was on its way
        assert max(s.position_rad for s in device.samples) < 0
    assert pb.StrikerEvent.CONTACT not in [event.kind for event in device.events]
    assert took_s < 1.0
    with pytest.raises(StrikerRefused):
        striker.arm()
    striker.home()
    striker.arm()
    striker.cock()
    assert striker.strike("again", 0.3).contacts == int(device.touches)


def test_a_port_has_one_owner_and_close_may_be_repeated(striker: Striker, device: Device) -> None:
    if device.config.traits.has_port:
        with pytest.raises(StrikerNotFound):
            device.striker().open()
    striker.close()
    striker.close()
    again = device.striker()
    again.open()
    again.close()
