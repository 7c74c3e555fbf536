"""Ports, registers, slots, clock, faults of the virtual camera; clients are in tests/acquire/camera."""

from __future__ import annotations

import re
import socket
import struct
import threading
import time
from collections.abc import Iterator

import numpy as np
import pytest

from acquire.camera.discovery import identify_camera, is_controlled
from acquire.clock.clock import SystemClock
from acquire.errors import CameraError
from acquire.virtual.device_clock import DeviceClock
from acquire.virtual.gige_camera import VirtualGigeCamera
from acquire.virtual.gige_sockets import descriptors, free_address, udp_socket
from acquire.virtual.image_source import StreamSettings
from tests.acquire.virtual.pattern_source import PatternSource, noise, read_stamp, stamped
from tests.loopback import loopback

ADDRESS = loopback(71)
PRIVILEGE, PERIOD, LATCH, LATCH_HIGH, LATCH_LOW = 0xA00, 0x138, 0x944, 0x948, 0x94C
STREAM_PORT, PACKET_SIZE, STREAM_ADDRESS, ACQUISITION = 0xD00, 0xD04, 0xD18, 0x124
WIDTH, HEIGHT, HEARTBEAT_TIMEOUT = 0x100, 0x104, 0x938


class Client:
    """Minimal GVCP client: reads and writes registers."""

    def __init__(self, address: str) -> None:
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.settimeout(1.0)
        self.socket.connect((address, 3956))
        self.number = 0

    def _ask(self, command: int, payload: bytes) -> bytes:
        self.number += 1
        self.socket.send(struct.pack(">BBHHH", 0x42, 1, command, len(payload), self.number) + payload)
        answer = self.socket.recv(2048)
        assert struct.unpack_from(">HHHH", answer) == (0, command + 1, len(answer) - 8, self.number)
        return answer[8:]

    def read(self, register: int) -> int:
        return struct.unpack(">I", self._ask(0x80, struct.pack(">I", register)))[0]

    def write(self, register: int, value: int) -> None:
        self._ask(0x82, struct.pack(">II", register, value))


def stream_socket() -> socket.socket:
    stream = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    stream.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4 << 20)
    stream.bind(("127.0.0.1", 0))
    stream.settimeout(2.0)
    return stream


def start_streaming(client: Client, stream: socket.socket) -> None:
    """Start a stream of 64 x 48 pixels at 120 fps: one data packet per frame."""
    port = stream.getsockname()[1]
    here = int.from_bytes(socket.inet_aton("127.0.0.1"))
    settings = [
        (PRIVILEGE, 2),
        (WIDTH, 64),
        (HEIGHT, 48),
        (PERIOD, 8_333),
        (STREAM_ADDRESS, here),
        (STREAM_PORT, port),
        (PACKET_SIZE, 8192),
    ]
    for register, value in [*settings, (ACQUISITION, 1)]:
        client.write(register, value)


def read_frames(stream: socket.socket, count: int) -> tuple[list[int], list[int]]:
    """Receive `count` frames: camera times of their leader packets [ns], and numbers in their pixels."""
    stamps: list[int] = []
    numbers: list[int] = []
    while len(numbers) < count:
        packet = stream.recv(9000)
        if packet[4] & 0xF == 1:
            stamps.append(struct.unpack_from(">Q", packet, 12)[0])
        elif packet[4] & 0xF == 3:
            numbers.append(read_stamp(np.frombuffer(packet[8:], np.uint8))[1])
    return stamps, numbers


@pytest.fixture
def nothing_left() -> Iterator[None]:
    threads, files = threading.active_count(), len(descriptors())
    yield
    assert threading.active_count() == threads
    assert len(descriptors()) == files


@pytest.fixture
def camera(nothing_left) -> Iterator[VirtualGigeCamera]:
    clock = SystemClock()
    camera = VirtualGigeCamera(ADDRESS, "S1", PatternSource(clock, 7), clock)
    yield camera
    camera.close()


@pytest.fixture
def client(nothing_left) -> Iterator[Client]:
    client = Client(ADDRESS)
    with client.socket:
        yield client


def test_camera_answers_discovery_and_is_not_controlled(camera: VirtualGigeCamera) -> None:
    info = identify_camera(ADDRESS)
    assert info is not None
    assert (info.vendor, info.serial, info.address) == ("Allied Vision Technologies", "S1", ADDRESS)
    assert not is_controlled(ADDRESS)
    assert identify_camera(loopback(72), 0.05) is None
    assert not is_controlled(loopback(72), 0.05)


def test_port_in_use_is_one_line(camera: VirtualGigeCamera) -> None:
    clock = SystemClock()
    with pytest.raises(
        CameraError,
        match=rf"port 3956 of {re.escape(ADDRESS)} is in use: another virtual camera runs; stop it",
    ):
        VirtualGigeCamera(ADDRESS, "S2", PatternSource(clock, 7), clock)
    assert identify_camera(ADDRESS) is not None  # the first one is unharmed


def test_a_free_address_is_one_where_no_camera_runs() -> None:
    first = free_address()
    with udp_socket(first, 3956):
        assert free_address() != first


def test_an_address_of_another_host_is_refused(nothing_left) -> None:
    clock = SystemClock()
    with pytest.raises(CameraError, match=r"cannot bind 192\.0\.2\.1:3956"):
        VirtualGigeCamera("192.0.2.1", "S", PatternSource(clock, 7), clock)


def test_two_cameras_at_different_addresses(camera: VirtualGigeCamera) -> None:
    clock = SystemClock()
    other = VirtualGigeCamera(loopback(73), "S2", PatternSource(clock, 7), clock)
    try:
        cameras = [identify_camera(address) for address in (ADDRESS, loopback(73))]
        assert [getattr(camera, "serial", None) for camera in cameras] == ["S1", "S2"]
    finally:
        other.close()


def test_the_frame_period_reads_back_as_written(camera: VirtualGigeCamera, client: Client) -> None:
    client.write(PRIVILEGE, 2)
    client.write(PERIOD, 12_345)
    assert client.read(PERIOD) == 12_345
    client.write(PRIVILEGE, 0)


def test_the_latch_is_the_device_clock(camera: VirtualGigeCamera, client: Client) -> None:
    before = camera.device_clock.now_ns()
    client.write(LATCH, 2)
    after = camera.device_clock.now_ns()
    latched = client.read(LATCH_HIGH) << 32 | client.read(LATCH_LOW)
    assert before <= latched <= after
    assert latched == client.read(LATCH_HIGH) << 32 | client.read(LATCH_LOW)  # it stays until the next latch


def test_slots_keep_their_times_if_the_source_stalls(nothing_left) -> None:
    """The source stalls for 0.3 s: frames come late, none is missing, none comes twice."""
    clock = SystemClock()

    class Stalling(PatternSource):
        stall_from = 0

        def latest_time_ns(self) -> int:
            now = clock.monotonic_ns()
            if self.stall_from == 0:
                self.stall_from = now + 200_000_000
            return min(now, self.stall_from) if now < self.stall_from + 300_000_000 else now

    camera = VirtualGigeCamera(loopback(74), "S", Stalling(clock, 7), clock)
    client = Client(loopback(74))
    try:
        with client.socket, stream_socket() as stream:
            start_streaming(client, stream)
            stamps, numbers = read_frames(stream, 90)
            client.write(ACQUISITION, 0)
            client.write(PRIVILEGE, 0)
    finally:
        camera.close()
    assert set(np.diff(stamps)) == {8_333_000}
    assert numbers == list(range(90))
    assert camera.statistics.late > 0
    assert camera.statistics.latest_ms > 200


def test_after_a_killed_client_the_next_one_gets_new_slots(camera: VirtualGigeCamera) -> None:
    with stream_socket() as stream:
        killed = Client(ADDRESS)
        with killed.socket:
            killed.write(HEARTBEAT_TIMEOUT, 300)
            start_streaming(killed, stream)
            read_frames(stream, 3)
        time.sleep(1.5)  # the heartbeat times out, nobody wrote a stop
    heir = Client(ADDRESS)
    with heir.socket, stream_socket() as stream:
        started = camera.device_clock.now_ns()
        start_streaming(heir, stream)
        stamps, _ = read_frames(stream, 5)
        heir.write(PRIVILEGE, 0)
    assert stamps[0] > started
    assert set(np.diff(stamps)) == {8_333_000}


def test_first_frame_has_its_time_if_the_start_is_reported_late(
    nothing_left, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The fake camera sends as soon as its register is set; the relay's thread hears of it later."""
    report = VirtualGigeCamera._on_acquisition

    def report_late(camera: VirtualGigeCamera, streaming: bool) -> None:
        if streaming:
            time.sleep(0.15)  # longer than the fake's pause between two looks at its registers, 0.1 s
        report(camera, streaming)

    monkeypatch.setattr(VirtualGigeCamera, "_on_acquisition", report_late)
    clock = SystemClock()
    camera = VirtualGigeCamera(loopback(75), "S", PatternSource(clock, 7), clock)
    client = Client(loopback(75))
    try:
        with client.socket, stream_socket() as stream:
            started = camera.device_clock.now_ns()
            start_streaming(client, stream)
            stamps, numbers = read_frames(stream, 5)
            client.write(ACQUISITION, 0)
            client.write(PRIVILEGE, 0)
    finally:
        camera.close()
    assert stamps[0] > started
    assert numbers == list(range(5))


def test_device_clock_drifts_and_maps_back_exactly() -> None:
    clock = SystemClock()
    device = DeviceClock(clock, drift=37e-6)
    host = clock.monotonic_ns()
    assert device.to_device(host + 10**10) - device.to_device(host) == pytest.approx(10**10 + 370_000, abs=1)
    for later in (0, 10**9, 3600 * 10**9):
        assert abs(device.to_host(device.to_device(host + later)) - host - later) <= 1


def test_pattern_stamps_are_read_back() -> None:
    settings = StreamSettings(width=64, height=48, offset_x=0, offset_y=0, exposure_us=100.0, gain_db=0.0)
    source = PatternSource(SystemClock(), 3)
    images = [source.image(1000 + n, settings) for n in range(3)]
    assert [read_stamp(image) for image in images] == [(1000, 0), (1001, 1), (1002, 2)]
    assert np.array_equal(images[2], stamped(noise(64, 48, 3), 1002, 2))
    assert source.latest_time_ns() <= time.monotonic_ns()
