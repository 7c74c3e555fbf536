"""Fakes of computer, disk, servo and video that pass every check of `acquire check`."""

from __future__ import annotations

import contextlib
import ipaddress
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from acquire.preflight.board import BOARD_LINE, BoardFacts
from acquire.preflight.check import Check, Outcome
from acquire.preflight.computer import FolderState, PortState, ReceiveBuffer
from acquire.preflight.firewall import FirewallState
from acquire.preflight.network import Route
from acquire.preflight.read_video import VideoContent
from acquire.preflight.servo import ServoState
from acquire.preflight.session import LINES, Probes, RunningDaemon, check_rig
from acquire.preflight.video import CheckVideo
from schemas.rig import RigConfig
from schemas.watch_lines import SeenMarker, WatchEvent
from tests.rig_text import CALIBRATION

RIG = (
    """name = "bench"
[camera]
address = "192.168.10.2"
"""
    + CALIBRATION
    + """[striker]
effective_mass_kg = 0.2
[recorder]
directory = "{folder}"
[daemon]
socket = "{folder}/run/daemon.sock"
"""
)
PIXELS_PER_S = 656 * 492 * 120


@dataclass
class FakeComputer:
    """Fake computer without any problem; models no device and no kernel."""

    port_state: PortState = field(
        default_factory=lambda: PortState(exists=True, usable=True, group="dialout", in_use=False)
    )
    folder: FolderState = field(
        default_factory=lambda: FolderState(exists=False, owned=False, private=False, can_be_made=True)
    )
    buffer: ReceiveBuffer = field(default_factory=lambda: ReceiveBuffer(16 << 20, 16 << 20))
    latency: int | None = 1

    def port(self, path: str) -> PortState:
        return self.port_state

    def socket_folder(self, folder: Path) -> FolderState:
        return self.folder

    def receive_buffer(self, asked_bytes: int) -> ReceiveBuffer:
        return self.buffer

    def latency_timer_ms(self, port: str) -> int | None:
        return self.latency


SUBNET = ipaddress.IPv4Network("192.168.10.0/24")


def route_by(interface: str = "enp3s0", mtu_bytes: int = 9000, own_address: str = "192.168.10.1") -> Route:
    return Route(interface, mtu_bytes, loopback=interface == "lo", own_address=own_address)


@dataclass
class FakeNetwork:
    """Fake network with the camera at an interface of its own; models no packet."""

    way: Route | OSError | None = field(default_factory=route_by)
    near: list[tuple[str, ipaddress.IPv4Network]] | None = field(default_factory=lambda: [("enp3s0", SUBNET)])
    speed: int | None = 1000
    filters: dict[str, int] = field(default_factory=dict)

    def route(self, address: str) -> Route | None:
        if isinstance(self.way, OSError):
            raise self.way
        return self.way

    def subnets(self, address: str) -> list[tuple[str, ipaddress.IPv4Network]] | None:
        return self.near

    def link_mbit(self, interface: str) -> int | None:
        return self.speed

    def reverse_path_filter(self, interface: str) -> int | None:
        return self.filters.get(interface)


@dataclass
class FakeProcessor:
    """Fake processors of one driver, governor and energy preference."""

    habit: tuple[str, str, str] | None = ("acpi-cpufreq", "performance", "")

    def habits(self) -> Counter[tuple[str, str, str]]:
        return Counter() if self.habit is None else Counter({self.habit: 4})


OPEN = FirewallState(ufw=False, firewalld=False, legacy=False, rules=[])


@dataclass
class FakeDisk:
    """Fake disk of fixed speed; writes nothing."""

    free: int = 100 << 30
    speed: float = 500e6
    fault: OSError | None = None

    def free_bytes(self, folder: Path) -> int:
        if self.fault is not None:
            raise self.fault
        return self.free

    def write_speed(self, folder: Path, size_bytes: int) -> float:
        return self.speed


def square_corners(edge: float) -> list[list[float]]:
    return [[100.0, 100.0 + edge], [100.0 + edge, 100.0 + edge], [100.0 + edge, 100.0], [100.0, 100.0]]


EVENT = WatchEvent(
    time_ns=1,
    markers=[SeenMarker(id=3, corners_px=square_corners(80.0))],
    at_rest=True,
    saturated_fraction=0.0,
)
CONTENT = VideoContent(np.full((48, 64), 180, np.uint8), clock_samples=5, mapping_sd_ns=25_000)
FILM = CheckVideo(seconds=1.0, frames=121, lost=0, content=CONTENT, event=EVENT)


@dataclass
class FakeVideoSource:
    """Fake source of the test video that its fields describe; sends no packet."""

    video: CheckVideo | Exception = FILM
    refusal: Exception | None = None
    closed: int = 0

    def open(self) -> str:
        if self.refusal is not None:
            raise self.refusal
        return "Maker Model (1)"

    def record(self, folder: Path) -> CheckVideo:
        if isinstance(self.video, Exception):
            raise self.video
        return self.video

    def close(self) -> None:
        self.closed += 1


@dataclass
class Bench:
    """Rig file with fakes of everything that the checks read."""

    rig_path: Path
    computer: FakeComputer = field(default_factory=FakeComputer)
    network: FakeNetwork = field(default_factory=FakeNetwork)
    firewall: FirewallState = OPEN
    processor: FakeProcessor = field(default_factory=FakeProcessor)
    disk: FakeDisk = field(default_factory=FakeDisk)
    servo: ServoState | Exception = field(
        default_factory=lambda: ServoState("XM430-W210", 12.1, 33, None, reads_per_s=600.0)
    )
    board: BoardFacts | Exception = field(default_factory=lambda: BoardFacts("demo", "contact time", 1.2))
    source: FakeVideoSource = field(default_factory=FakeVideoSource)
    stamp: float | Exception | None = 1.0
    status: dict | Exception | None = None

    def lines(self) -> dict[str, Check]:
        @contextlib.contextmanager
        def daemon(_: RigConfig) -> Iterator[RunningDaemon | None]:
            status = _given(self.status)
            yield None if status is None else RunningDaemon(status, self.source)

        probes = Probes(
            self.computer,
            self.network,
            lambda: self.firewall,
            self.processor,
            self.disk,
            lambda _: _given(self.servo),
            lambda _: _given(self.board),
            lambda _: self.source,
            lambda _: _given(self.stamp),
            daemon,
        )
        found = list(check_rig(self.rig_path, probes))
        names = [line.name for line in found]
        assert len(names) == len(set(names))
        assert set(names) <= {*LINES, BOARD_LINE}
        for line in found:
            assert "\n" not in line.found + line.remedy
            if line.outcome is Outcome.FAIL:
                assert line.remedy
        return {line.name: line for line in found}

    def failures(self) -> set[str]:
        return {name for name, line in self.lines().items() if line.outcome is Outcome.FAIL}


def _given(value: Any) -> Any:
    """The value; if it is an exception, it is raised."""
    if isinstance(value, Exception):
        raise value
    return value
