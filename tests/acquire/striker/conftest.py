from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from acquire.clock.clock import SystemClock
from acquire.striker.dynamixel import DynamixelStriker
from schemas.proto import percuss_pb2 as pb
from schemas.rig import StrikerConfig
from tests.acquire.striker.plant import Plant


@dataclass
class Heard:
    """Samples, events and clock samples that a striker has published."""

    samples: list[pb.StrikerSample] = field(default_factory=list)
    events: list[pb.StrikerEvent] = field(default_factory=list)
    clocks: list[pb.ClockSample] = field(default_factory=list)

    def kinds(self) -> list[str]:
        return [pb.StrikerEvent.Kind.Name(event.kind) for event in self.events]

    def striker(self, config: StrikerConfig) -> DynamixelStriker:
        return DynamixelStriker(
            config, self.samples.append, self.events.append, self.clocks.append, SystemClock()
        )

    @contextlib.contextmanager
    def opened(self, config: StrikerConfig) -> Iterator[DynamixelStriker]:
        """Open a striker for the block and close it afterwards."""
        striker = self.striker(config)
        striker.open()
        try:
            yield striker
        finally:
            striker.close()


def home_arm_and_cock(striker: DynamixelStriker) -> None:
    """Home, arm and cock a striker."""
    striker.home()
    striker.arm()
    striker.cock()


def wait_for(condition: Callable[[], bool], timeout_s: float, pause_s: float = 0.005) -> bool:
    """Wait for a condition; True if it came true in time."""
    end = time.monotonic() + timeout_s
    while not condition() and time.monotonic() < end:
        time.sleep(pause_s)
    return condition()


@pytest.fixture
def plant(tmp_path: Path) -> Iterator[Plant]:
    with Plant(tmp_path) as plant:
        yield plant


@pytest.fixture
def heard() -> Heard:
    return Heard()
