"""Features that a camera denies while it streams, while it is locked, or while a trigger is on.

A program that does not keep the client's order is denied them, then the client sets the same camera.
"""

from __future__ import annotations

import socket
import struct
import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest

from acquire.camera.aravis_library import aravis_and_glib
from acquire.virtual.camera_makes import (
    ACQUISITION,
    BINNING_X,
    MAKES,
    RATE_ENABLE,
    TL_LOCK,
    TRIGGER_MODE,
    USER_SET_LOAD,
    WIDTH,
)
from acquire.virtual.gige_camera import VirtualGigeCamera
from acquire.virtual.gige_faults import CameraHabits, GigeFaults
from schemas.rig import CameraConfig
from tests.acquire.camera.test_makes import connected, periods_ns, register
from tests.loopback import loopback

ADDRESS = loopback(54)
PRIVILEGE, HEARTBEAT_MS = 0xA00, 0x938
CONTROL = 2
MakeConfig = Callable[..., CameraConfig]
LOCKING = [name for name, make in MAKES.items() if make.locks_payload]


class OtherProgram:
    """Program that controls a camera by registers alone, and ends without a word when it is closed."""

    def __init__(self) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.connect((ADDRESS, 3956))
        self._socket.settimeout(2.0)
        self._identity = 0

    def write(self, register: int, value: int) -> int:
        """Status of a WRITEREG; 0 is success."""
        self._identity += 1
        request = struct.pack(">BBHHHII", 0x42, 1, 0x82, 8, self._identity, register, value)
        self._socket.send(request)
        status, _, _, identity = struct.unpack_from(">HHHH", self._socket.recv(64))
        assert identity == self._identity
        return status

    def close(self) -> None:
        self._socket.close()


def all_denied(*attempts: Callable[[Any], object]) -> bool:
    """True if the camera denies each attempt by Aravis alone, without the client's order."""
    Aravis, _ = aravis_and_glib()
    raw = Aravis.Camera.new(ADDRESS)
    return all(_is_denied(attempt, raw) for attempt in attempts)


def _is_denied(attempt: Callable[[Any], object], raw: Any) -> bool:
    Aravis, GLib = aravis_and_glib()
    try:
        attempt(raw)
    except GLib.Error as error:
        return error.matches(Aravis.device_error_quark(), Aravis.DeviceError.PROTOCOL_ERROR_ACCESS_DENIED)
    return False


def stop_and(attempt: Callable[[Any], object]) -> Callable[[Any], object]:
    def stopped(raw: Any) -> object:
        raw.stop_acquisition()
        return attempt(raw)

    return stopped


def await_control(server: VirtualGigeCamera) -> None:
    """Wait until the camera notices that its program has ended."""
    end = time.monotonic() + 5.0
    while register(server, PRIVILEGE) and time.monotonic() < end:
        time.sleep(0.02)
    assert register(server, PRIVILEGE) == 0


@pytest.mark.parametrize("name", LOCKING)
def test_a_crashed_program_leaves_a_camera_that_streams_and_is_locked(
    camera_config: MakeConfig, name: str
) -> None:
    """What it left outlasts its control: only a stop, then the release of the lock, opens the settings."""
    with connected(camera_config(ADDRESS), CameraHabits(make=MAKES[name])) as (camera, server):
        other = OtherProgram()
        for address, value in ((PRIVILEGE, CONTROL), (HEARTBEAT_MS, 300), (TL_LOCK, 1), (ACQUISITION, 1)):
            assert other.write(address, value) == 0
        assert other.write(WIDTH, 320) != 0, "the camera is locked while it streams"
        other.close()
        await_control(server)
        assert periods_ns(camera) == {8_333_000}
        assert register(server, TL_LOCK) == 0
        assert register(server, BINNING_X) == 1
        assert register(server, HEARTBEAT_MS) == 3000


@pytest.mark.parametrize("left_ms", [300, 300_000])
def test_a_time_out_that_another_program_left_is_the_default_again(
    camera_config: MakeConfig, left_ms: int
) -> None:
    with connected(camera_config(ADDRESS), CameraHabits(make=MAKES["mako"])) as (camera, server):
        server._library.write_register(server._fake, HEARTBEAT_MS, left_ms)
        camera.open()
        assert register(server, HEARTBEAT_MS) == 3000


@pytest.mark.parametrize("name", LOCKING)
def test_stop_alone_does_not_release_the_lock_and_the_client_releases_it(
    camera_config: MakeConfig, name: str
) -> None:
    habits = CameraHabits(make=MAKES[name], faults=GigeFaults(left_locked=True))
    with connected(camera_config(ADDRESS), habits) as (camera, server):
        assert all_denied(
            stop_and(lambda raw: raw.set_integer("Width", 320)),
            lambda raw: raw.gv_set_packet_size(1500),
            lambda raw: raw.execute_command("UserSetLoad"),
        )
        assert register(server, WIDTH) == 656
        assert periods_ns(camera) == {8_333_000}


@pytest.mark.parametrize("name", LOCKING)
def test_settings_are_written_again_after_the_clients_own_stream(
    camera_config: MakeConfig, name: str
) -> None:
    """The lock of a stream ends with it: a second client finds nothing denied."""
    with connected(camera_config(ADDRESS), CameraHabits(make=MAKES[name])) as (camera, server):
        camera.open()
        camera.start()
        camera.close()  # without a stop
        assert periods_ns(camera) == {8_333_000}
        assert register(server, ACQUISITION) == 0


def test_an_alvium_denies_its_frame_rate_while_a_trigger_is_on(camera_config: MakeConfig) -> None:
    """As Aravis #778 and #879 report; the client clears triggers first, also where no user set is loaded."""
    faults = GigeFaults(locked=frozenset({USER_SET_LOAD}))
    habits = CameraHabits(make=MAKES["alvium-g1"], faults=faults)
    with connected(camera_config(ADDRESS), habits) as (camera, server):
        assert all_denied(
            lambda raw: raw.set_boolean("AcquisitionFrameRateEnable", False),
            lambda raw: raw.set_float("AcquisitionFrameRate", 50.0),
        )
        assert periods_ns(camera) == {8_333_000}
        assert (register(server, TRIGGER_MODE), register(server, RATE_ENABLE)) == (0, 1)


@pytest.mark.parametrize("name", ["alvium-g1", "basler-ace"])
def test_a_rate_that_was_left_on_is_switched_off_before_pulses_count(
    camera_config: MakeConfig, name: str
) -> None:
    left = replace(MAKES[name], remembered={TRIGGER_MODE: 1, RATE_ENABLE: 1})
    habits = CameraHabits(left, GigeFaults(locked=frozenset({USER_SET_LOAD})), pulses_hz=80.0)
    config = camera_config(ADDRESS, trigger="Line1", frame_rate_hz=80.0)
    with connected(config, habits) as (camera, server):
        assert periods_ns(camera) == {12_500_000}
        assert register(server, RATE_ENABLE) == 0
