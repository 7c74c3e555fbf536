"""The contract of Striker, checked on the virtual servo.

With `-m hardware` it is checked on the servo of the rig file that PERCUSS_RIG names. The arm moves: keep its
path clear.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from acquire.clock.clock import SystemClock
from acquire.errors import StrikerNotFound, StrikerRefused, StrikerStopped
from acquire.striker.base import Striker, StrikerState
from acquire.striker.dynamixel import DynamixelStriker
from schemas.proto import percuss_pb2 as pb
from schemas.rig import RigConfig, StrikerConfig
from tests.acquire.striker.plant import Plant

SLOW_M_S = 0.12
IN_SWING_S = 0.15


@dataclass
class Device:
    config: StrikerConfig
    samples: list[pb.StrikerSample] = field(default_factory=list)
    events: list[pb.StrikerEvent] = field(default_factory=list)
    clocks: list[pb.ClockSample] = field(default_factory=list)

    def striker(self) -> DynamixelStriker:
        return DynamixelStriker(
            self.config, self.samples.append, self.events.append, self.clocks.append, SystemClock()
        )


@pytest.fixture(params=["virtual", pytest.param("hardware", marks=pytest.mark.hardware)])
def device(
    request: pytest.FixtureRequest, tmp_path: Path, real_rig: Callable[[], RigConfig]
) -> Iterator[Device]:
    if request.param == "virtual":
        with Plant(tmp_path) as plant:
            yield Device(plant.config())
    else:
        yield Device(real_rig().striker)


@pytest.fixture
def striker(device: Device) -> Iterator[Striker]:
    striker = device.striker()
    striker.open()
    yield striker
    striker.close()


def test_the_whole_order_of_calls(striker: Striker, device: Device) -> None:
    assert striker.state is StrikerState.DISARMED
    striker.home()
    assert striker.state is StrikerState.HOMED
    for number in range(2):
        striker.arm()
        assert striker.state is StrikerState.ARMED
        striker.cock()
        assert striker.state is StrikerState.SETTLED
        outcome = striker.strike(f"s{number}", 0.3)
        assert striker.state is StrikerState.DISARMED
        assert outcome.contacts == 1
        assert outcome.contact_time_ns is not None
        assert outcome.released_ns < outcome.contact_time_ns
        assert outcome.tip_speed_m_s == pytest.approx(0.3, rel=0.05)
    times = [(s.host_before_ns, s.host_after_ns) for s in device.samples]
    assert all(before < after for before, after in times)
    assert times == sorted(times)
    assert all(event.host_time_ns > 0 for event in device.events)


def test_nothing_moves_without_its_permission(striker: Striker) -> None:
    for forbidden in (striker.arm, striker.cock, lambda: striker.strike("s", 0.3)):
        with pytest.raises(StrikerRefused):
            forbidden()
    striker.home()
    striker.arm()
    striker.stop()
    with pytest.raises(StrikerRefused):
        striker.cock()


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
    swung = [s for s in device.samples if s.host_before_ns < asked_ns][-20:]
    assert max(s.velocity_rad_s for s in swung) > 0.1  # it was on its way
    assert max(s.position_rad for s in device.samples) < 0
    assert took_s < 1.0
    with pytest.raises(StrikerRefused):
        striker.arm()
    striker.home()
    striker.arm()
    striker.cock()
    assert striker.strike("again", 0.3).contacts == 1


def test_a_port_has_one_owner_and_close_may_be_repeated(striker: Striker, device: Device) -> None:
    with pytest.raises(StrikerNotFound):
        device.striker().open()
    striker.close()
    striker.close()
    again = device.striker()
    again.open()
    again.close()
