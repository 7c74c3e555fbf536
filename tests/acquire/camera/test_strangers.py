"""Packets of strangers at the port of the images: none is used, all are counted.

Before packets were checked by their sender, one attempt every fifth frame at 120 fps did this in 5 s: garbage
cost 330 to 644 frames; frames without pixels, 4 s ahead, counted 9 550 lost ones within 192, and then ended
the connection; 108 of 109 forged images came out as the camera's. A leader of 60000 x 60000 pixels ended the
thread at once, one of another time the connection.
"""

from __future__ import annotations

import os
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np
import pytest

from acquire.camera.aravis import AravisCamera
from acquire.camera.aravis_link import GigeLink
from acquire.camera.sender_filter import SenderFilter
from acquire.camera.stream import CameraStream
from acquire.clock.clock import SystemClock
from acquire.frames.frame import Frame
from acquire.virtual.gige_camera import VirtualGigeCamera
from tests.acquire.camera.stranger import headless_packets, image_packets, spoofed
from tests.acquire.virtual.pattern_source import PatternSource, noise, read_stamp, stamped
from tests.loopback import loopback

FRAMES, WIDTH, HEIGHT = 120, 656, 492
PERIOD_NS = 8_333_000
PATTERN = noise(WIDTH, HEIGHT, 7)
BLACK = np.zeros((HEIGHT, WIDTH), np.uint8)
PACKET_SIZE = 8192


def wrapped(frame_id: int) -> int:
    return (frame_id - 1) % 65535 + 1


def garbage(frame: Frame) -> list[bytes]:
    rng = np.random.default_rng(frame.frame_id)
    return [rng.bytes(int(size)) for size in rng.integers(1, 1500, 20)]


def far_ahead(frame: Frame) -> list[bytes]:
    return headless_packets(wrapped(frame.frame_id + 480), frame.device_time_ns + 4 * 10**9, WIDTH, HEIGHT)


def too_large(frame: Frame) -> list[bytes]:
    return headless_packets(wrapped(frame.frame_id + 3), frame.device_time_ns + 3 * PERIOD_NS, 60_000, 60_000)


def other_time(frame: Frame) -> list[bytes]:
    return headless_packets(wrapped(frame.frame_id + 3), frame.device_time_ns + 10**11, WIDTH, HEIGHT)


def forged(frame: Frame) -> list[bytes]:
    """The image after next, black, before the camera has sent it."""
    next_time_ns = frame.device_time_ns + 2 * PERIOD_NS
    return image_packets(wrapped(frame.frame_id + 2), next_time_ns, BLACK, PACKET_SIZE)


def is_the_cameras(frame: Frame) -> bool:
    return np.array_equal(frame.image, stamped(PATTERN, *read_stamp(frame.image)))


def stream_address(camera: AravisCamera) -> tuple[str, int]:
    """Address and port at which the images of the camera arrive, as any user of this host can list them."""
    assert camera._connection is not None
    return "127.0.0.1", camera._connection.stream.get_port()


@contextmanager
def streaming(camera: AravisCamera) -> Iterator[AravisCamera]:
    camera.open()
    try:
        camera.start()
        yield camera
    finally:
        camera.close()


def read_frames(camera: AravisCamera, attack: Callable[[Frame], None]) -> tuple[int, int]:
    """Read FRAMES frames and attack at every fifth; numbers of lost frames, and of those not the camera's."""
    lost = foreign = 0
    for count in range(FRAMES):
        frame = camera.read(20.0)
        assert frame is not None
        lost += frame.lost_before
        foreign += not is_the_cameras(frame)
        if count % 5 == 4:
            attack(frame)
        frame.buffer.release()
    return lost, foreign


PACKETS = (garbage, far_ahead, too_large, other_time, forged)
OFTEN = {False: PACKETS, True: (garbage, forged)}
"""packets of the short tests, by whether the stranger has the camera's address: what they hold is not read"""


@pytest.mark.parametrize(
    ("own_address", "packets"),
    [
        pytest.param(own, packets, marks=[pytest.mark.slow] * (packets not in OFTEN[own]))
        for own in (False, True)
        for packets in PACKETS
    ],
    ids=lambda each: {False: "other_address", True: "other_port"}[each] if isinstance(each, bool) else None,
)
def test_no_packet_of_a_stranger_is_used(pattern_camera, camera_config, packets, own_address: bool) -> None:
    address = loopback(71)
    config = camera_config(address, packet_size=PACKET_SIZE)
    with (
        pattern_camera(address),
        streaming(AravisCamera(config, SystemClock())) as camera,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger,
    ):
        stranger.bind((address if own_address else loopback(72), 0))
        sent = 0

        def attack(frame: Frame) -> None:
            nonlocal sent
            for packet in packets(frame):
                stranger.sendto(packet, stream_address(camera))
                sent += 1

        assert read_frames(camera, attack) == (0, 0)
        assert camera.incomplete_frames == 0
        found = camera.take_foreign_packets()
        assert (found.count, found.sender) == (sent, stranger.getsockname())
        assert camera.take_foreign_packets().count == 0


def test_a_sender_that_forges_address_and_port_passes(pattern_camera, camera_config) -> None:
    """The limit that SECURITY.md states: GVSP has no signature, and raw sockets send under any address."""
    address = loopback(73)
    config = camera_config(address, packet_size=PACKET_SIZE)
    with pattern_camera(address), streaming(AravisCamera(config, SystemClock())) as camera:
        assert isinstance(camera._link, GigeLink)
        assert camera._link.senders is not None
        sender = address, camera._link.senders.port

        def attack(frame: Frame) -> None:
            try:
                spoofed(sender, stream_address(camera), forged(frame))
            except PermissionError:
                pytest.skip("raw sockets need CAP_NET_RAW")

        _, foreign = read_frames(camera, attack)
        assert foreign > 0
        assert camera.take_foreign_packets().count == 0


def test_a_camera_that_reports_a_wrong_port_is_checked_by_address(camera_config) -> None:
    clock, texts, arrived = SystemClock(), [], threading.Event()
    address = loopback(74)
    server = VirtualGigeCamera(address, "V", PatternSource(clock, 7), clock)
    server._library.write_register(server._fake, 0xD1C, 9)
    stream = CameraStream(
        lambda: AravisCamera(camera_config(address, stall_s=1.0), clock),
        camera_config(address),
        clock,
        lambda _frame: arrived.set(),
        lambda _reading: None,
        texts.append,
    )
    try:
        stream.start()
        assert arrived.wait(20.0)
        assert stream.status().foreign_packets == 0
        assert stream.status().warnings[-1] == texts[0]
        assert texts[0].endswith("but reports 9: packets are checked by their address alone")
    finally:
        stream.stop()
        server.close()


def test_foreign_packets_are_reported_once_a_minute(pattern_camera, camera_config) -> None:
    address, clock, texts = loopback(75), SystemClock(), []
    cameras: list[AravisCamera] = []

    def make() -> AravisCamera:
        cameras.append(AravisCamera(camera_config(address), clock))
        return cameras[-1]

    with pattern_camera(address), socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
        stranger.bind((loopback(76), 0))
        stream = CameraStream(
            make, camera_config(address), clock, lambda _: None, lambda _: None, texts.append
        )
        stream.start()
        try:
            for batch in range(1, 4):
                for _ in range(1000):
                    stranger.sendto(b"x" * 1000, stream_address(cameras[0]))
                end = time.monotonic() + 20.0
                while stream.status().foreign_packets < 1000 * batch and time.monotonic() < end:
                    time.sleep(0.05)
                assert stream.status().foreign_packets == 1000 * batch
            assert stream.status().lost == 0
        finally:
            stream.stop()
    sender = f"{loopback(76)}:{stranger_port(texts)}"
    assert len(texts) == 1
    assert f"packets at the camera's image port came from {sender}, not from the camera: not used" in texts[0]


def stranger_port(texts: list[str]) -> str:
    return texts[0].split(f"{loopback(76)}:")[1].split(",")[0]


def udp(address: str) -> socket.socket:
    result = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    result.bind((address, 0))
    return result


def test_more_packets_than_the_count_reads_are_counted_and_the_port_is_not_shared() -> None:
    with udp("127.0.0.1") as stream, udp(loopback(77)) as camera, udp(loopback(78)) as stranger:
        stream.setblocking(False)
        filtered = SenderFilter(stream, *camera.getsockname())
        assert not os.get_blocking(stream.fileno())
        for _ in range(5000):
            stranger.sendto(b"x" * 1000, stream.getsockname())
        camera.sendto(b"image", stream.getsockname())
        assert stream.recv(100) == b"image"
        assert filtered.take_foreign_packets().count == 5000
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as thief:
            thief.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            with pytest.raises(OSError, match="in use"):
                thief.bind(stream.getsockname())
        filtered.close()
