"""The Aravis client with cameras that hang, fall silent, lose packets or are taken."""

from __future__ import annotations

import contextlib
import copy
import json
import re
import socket
import threading
import time

import numpy as np
import pytest

from acquire.camera import aravis
from acquire.camera.aravis import AravisCamera
from acquire.camera.discovery import is_controlled
from acquire.clock.clock import SystemClock
from acquire.errors import CameraError, CameraLost
from acquire.virtual.gige_camera import VirtualGigeCamera
from tests.acquire.camera.falls_silent import falls_silent
from tests.acquire.camera.test_aravis import SEED, next_frame, read_for_ever
from tests.acquire.virtual.pattern_source import PatternSource, noise, read_stamp, stamped
from tests.loopback import loopback


def test_a_killed_camera_is_lost_and_closing_it_does_not_block(pattern_camera, camera_config) -> None:
    with pattern_camera(loopback(36)) as process:
        camera = AravisCamera(camera_config(loopback(36), stall_s=0.5), SystemClock())
        camera.open()
        camera.start()
        image = next_frame(camera).image
        process.kill()
        killed = time.monotonic()
        with pytest.raises(CameraLost, match=rf"{re.escape(loopback(36))} was lost: no frame for \d\.\d s"):
            read_for_ever(camera)
        assert time.monotonic() - killed < 5.0  # Aravis itself notices after 6 s
        assert camera.latch_clock() is None
        closing = time.monotonic()
        camera.close()
        assert time.monotonic() - closing < 5.0  # a dead camera's time-outs take 7.5 s
        assert image.shape == (492, 656)  # a frame still held stays readable
        assert image.sum() > 0
    with pattern_camera(loopback(36)):  # it comes back: a new client object has frames at once
        for thread in threading.enumerate():
            if thread.name == "aravis-close":
                thread.join()
        again = AravisCamera(camera_config(loopback(36)), SystemClock())
        again.open()
        again.start()
        assert next_frame(again).lost_before == 0
        again.close()


def test_open_waits_for_the_control_of_a_killed_client(pattern_camera, camera_config) -> None:
    with pattern_camera(loopback(40)):
        take_control = bytes.fromhex("42010082000800010000 0a00 00000002".replace(" ", ""))
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as killed:
            killed.sendto(take_control, (loopback(40), 3956))
            assert killed.recv(64)[2:4] == b"\x00\x83"
        began = time.monotonic()
        camera = AravisCamera(camera_config(loopback(40)), SystemClock())
        camera.open()
        assert 3.0 < time.monotonic() - began < 9.0
        camera.close()


def test_a_second_client_is_refused(camera_config) -> None:
    clock = SystemClock()
    server = VirtualGigeCamera(loopback(37), "V", PatternSource(clock, SEED), clock)
    first = AravisCamera(camera_config(loopback(37)), clock)
    second = AravisCamera(camera_config(loopback(37)), clock)
    try:
        first.open()
        with pytest.raises(CameraError, match="controlled by another program"):
            second.open()
    finally:
        second.close()
        first.close()
        server.close()


def test_a_clock_that_jumps_is_a_lost_camera_and_no_frame(camera_config) -> None:
    clock = SystemClock()
    server = VirtualGigeCamera(loopback(39), "V", PatternSource(clock, SEED), clock)
    library, jump_ns = server._library, [0]
    server._library = copy.copy(library)
    server._library.buffer_set_timestamp = lambda buffer, time_ns: library.buffer_set_timestamp(
        buffer, time_ns + jump_ns[0]
    )
    camera = AravisCamera(camera_config(loopback(39)), clock)
    try:
        camera.open()
        camera.start()
        next_frame(camera).buffer.release()
        jump_ns[0] = 20_000_000_000
        with pytest.raises(
            CameraLost, match=r"its clock jumped by 20 s: check power and cable, then connect again"
        ):
            read_for_ever(camera)
    finally:
        camera.close()
        server.close()


def test_no_stale_frame_after_a_camera_was_lost(camera_config) -> None:
    clock = SystemClock()
    server = VirtualGigeCamera(loopback(39), "V", PatternSource(clock, SEED), clock)
    camera = AravisCamera(camera_config(loopback(39), stall_s=1.0), clock)
    times: list[int] = []
    try:
        camera.open()
        camera.start()
        closer = threading.Timer(0.3, server.close)
        closer.start()
        with pytest.raises(CameraLost, match=r"no frame for|no longer answers"):
            read_for_ever(camera, times)
        closer.join()
    finally:
        camera.close()
        server.close()
    assert len(times) > 10
    assert max(np.diff(times)) < 1_000_000_000


def test_lost_packets_are_requested_again(pattern_camera, camera_config) -> None:
    pattern = noise(656, 492, SEED)
    with pattern_camera(loopback(38), "0.002") as process:
        camera = AravisCamera(camera_config(loopback(38), frame_rate_hz=60.0), SystemClock())
        camera.open()
        camera.start()
        lost = 0
        for _ in range(120):
            frame = next_frame(camera)
            lost += frame.lost_before
            assert np.array_equal(frame.image, stamped(pattern, *read_stamp(frame.image)))
            frame.buffer.release()
        camera.stop()
        camera.close()
        counts = json.loads(process.communicate()[0])
    assert counts["dropped"] > 0
    assert counts["resent"] > 0
    assert lost == 0


def test_opening_that_hangs_is_abandoned_and_closed_when_it_returns(
    camera_config, pattern_camera, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A fake that blocks stands for Aravis: opening is abandoned, and a late connection is closed."""
    monkeypatch.setattr(aravis, "OPEN_S", 0.2)
    goes_on = threading.Event()
    camera = AravisCamera(camera_config(loopback(48)), SystemClock())
    connect = camera._open
    monkeypatch.setattr(camera, "_open", lambda: (goes_on.wait(), connect())[1])
    with pattern_camera(loopback(48)):
        with pytest.raises(
            CameraError,
            match=rf"camera {re.escape(loopback(48))} is not set up after 0\.2 s: switch it off and on",
        ):
            camera.open()
        goes_on.set()
        wait_for_threads("aravis-open")
        assert not is_controlled(loopback(48))
        with pytest.raises(CameraError, match="is not open"):
            camera.read(0.1)


def wait_for_threads(name: str) -> None:
    for thread in threading.enumerate():
        if thread.name == name:
            thread.join(20.0)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("answers", "says"),
    [
        (0, r"no camera answers at .*check power, cable and address"),
        (2, r"no camera answers at .*check power, cable and address"),
        (20, r"no camera answers at .*check power, cable and address"),
        (38, r"stopped answering while it was set up .*timeout\): try again"),
        (45, r"stopped answering while it was set up .*timeout\): try again"),
    ],
    ids=[
        "before discovery",
        "before control",
        "while it describes itself",
        "before its settings",
        "between its settings",
    ],
)
def test_a_camera_that_falls_silent_while_it_is_opened(camera_config, answers: int, says: str) -> None:
    with falls_silent(49, answers) as address:
        camera = AravisCamera(camera_config(address), SystemClock())
        start = time.monotonic()
        with pytest.raises(CameraError, match=says) as caught:
            camera.open()
        took_s = time.monotonic() - start
    assert "\n" not in str(caught.value)
    assert address in str(caught.value)
    assert took_s < aravis.OPEN_S + 2.0
    camera.close()


@pytest.mark.slow
def test_a_camera_with_a_dead_control_channel(camera_config) -> None:
    """The camera answers discovery, but its control channel is dead."""
    address = loopback(51)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as answering:
        answering.bind((address, 3956))
        answering.settimeout(0.1)
        ended = threading.Event()

        def answer() -> None:
            while not ended.is_set():
                with contextlib.suppress(TimeoutError):
                    request, client = answering.recvfrom(2048)
                    if request[2:4] == b"\x00\x02":
                        answering.sendto(b"\x00\x00\x00\x03\x00\xf8" + request[6:8] + bytes(0xF8), client)

        thread = threading.Thread(target=answer, name="half-dead")
        thread.start()
        try:
            with pytest.raises(
                CameraError,
                match=rf"camera {re.escape(address)} answers discovery, but refuses .*off and on",
            ):
                AravisCamera(camera_config(address), SystemClock()).open()
        finally:
            ended.set()
            thread.join()
