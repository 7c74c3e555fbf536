"""All checks of a rig in their order, one line after the other; none stops the others."""

from __future__ import annotations

import contextlib
import math
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from acquire.clock.clock import Clock, SystemClock
from acquire.config import RigConfig, read_rig
from acquire.daemon.api import DaemonClient
from acquire.errors import AcquireError, ConfigError, DaemonNotRunning
from acquire.preflight.camera import CAMERA_LINES, check_camera
from acquire.preflight.check import Check, failed, failed_as, not_checked, passed
from acquire.preflight.computer import (
    Computer,
    LinuxComputer,
    check_latency_timer,
    check_lock,
    check_packet_size,
    check_port,
    check_receive_buffer,
    check_socket,
)
from acquire.preflight.disk import Disk, RealDisk, check_disk
from acquire.preflight.film import DaemonCapture, Filming, OwnCapture
from acquire.preflight.servo import SERVO_LINES, ReadServo, check_held_servo, check_servo, read_servo

LINES = (
    *("rig file", "daemon", "daemon socket", "level", "serial port", "port lock", "USB latency", "receive buffer", "packet size"),
    *("disk space", "disk speed", *SERVO_LINES, *CAMERA_LINES),
)


@dataclass(frozen=True)
class RunningDaemon:
    """A daemon that listens on the rig's socket."""

    status: dict[str, Any]
    filming: Filming

    @property
    def busy(self) -> bool:
        """A session is open."""
        return self.status["recording"] is not None


@dataclass(frozen=True)
class Probes:
    """Everything the checks learn from outside."""

    computer: Computer
    disk: Disk
    servo: ReadServo
    capture: Callable[[RigConfig], Filming]
    daemon: Callable[[RigConfig], contextlib.AbstractContextManager[RunningDaemon | None]]


def real_probes(clock: Clock | None = None) -> Probes:
    """The computer, its disk, and the devices of the rig."""
    clock = clock or SystemClock()

    @contextlib.contextmanager
    def daemon(rig: RigConfig) -> Iterator[RunningDaemon | None]:
        try:
            client = DaemonClient(rig.daemon.socket_path())
        except DaemonNotRunning:
            yield None
            return
        with client:
            yield RunningDaemon(client.call("status"), DaemonCapture(rig, client, clock))

    return Probes(
        computer=LinuxComputer(),
        disk=RealDisk(clock.monotonic_ns),
        servo=lambda config: read_servo(config, clock),
        capture=lambda rig: OwnCapture(rig, clock),
        daemon=daemon,
    )


def check_rig(path: Path, probes: Probes) -> Iterator[Check]:
    """Check the rig of a rig file; lines come as they are known, about ten seconds in all."""
    try:
        rig = read_rig(path)
    except ConfigError as error:
        yield failed("rig file", str(error), "correct it: docs/guide.md shows a whole one")
        yield from (not_checked(name, "the rig file comes first") for name in LINES[1:])
        return
    yield passed("rig file", f'{path}: "{rig.name}"')
    with contextlib.ExitStack() as cleanup:
        try:
            daemon = cleanup.enter_context(probes.daemon(rig))
        except AcquireError as error:
            daemon = None
            yield failed_as("daemon", error)
        else:
            yield _check_daemon(rig, daemon)
        yield check_socket(probes.computer, rig.daemon.socket_path())
        yield check_level(rig)
        yield from _check_wires(probes.computer, rig, daemon)
        yield from check_disk(probes.disk, rig)
        if daemon is None:
            yield from check_servo(probes.servo, rig.striker)
            yield from check_camera(probes.capture(rig), rig.camera, _film_folder(rig))
        else:
            told = daemon.status
            yield from check_held_servo(rig.striker, str(told["striker"]), told.get("servo"), str(told.get("striker_trouble", "")))
            yield from _check_held_camera(daemon, rig)


def _check_daemon(rig: RigConfig, daemon: RunningDaemon | None) -> Check:
    if daemon is None:
        return passed("daemon", "none runs on this rig: its devices are asked directly")
    status = daemon.status
    who = f'runs (pid {status["pid"]}, rig "{status["rig"]}")'
    if status["rig"] != rig.name:
        return failed(
            "daemon", f'{who}, and this is rig "{rig.name}"', "give the rig file it was started with, or stop it: acquire stop --daemon"
        )
    if daemon.busy:
        return passed("daemon", f"{who} and records {status['recording']}: only what does not disturb that is checked")
    return passed("daemon", f"{who}: camera and servo are checked through it")


def _check_wires(computer: Computer, rig: RigConfig, daemon: RunningDaemon | None) -> Iterator[Check]:
    striker, camera = rig.striker, rig.camera
    if striker.kind == "dynamixel":
        yield check_port(computer, striker.port)
        yield check_lock(computer, striker.port, None if daemon is None else int(daemon.status["pid"]))
        yield check_latency_timer(computer, striker.port)
    yield check_receive_buffer(computer, camera.receive_buffer_bytes)
    yield check_packet_size(computer, camera.address, camera.packet_size)


def check_level(rig: RigConfig) -> Check:
    """Gravity against the table: as measured, or the prior."""
    degrees = math.degrees(rig.gravity_tilt_sd_rad)
    if rig.level is not None:
        rise, sd = math.degrees(rig.level.towards_x_rad), math.degrees(rig.level.towards_x_sd_rad)
        return passed("level", f"read by {rig.level.read_by}: the table rises by {rise:.3g} +- {sd:.2g} deg towards +x (1 sigma)")
    if "gravity_tilt_sd_rad" in rig.model_fields_set:
        return passed("level", f"the rig file says 0 +- {degrees:.2g} deg (1 sigma)")
    return passed(
        "level", f"no reading in the rig file: the prior is 0 +- {degrees:.2g} deg (1 sigma); level the table and write [level] into it"
    )


def _check_held_camera(daemon: RunningDaemon, rig: RigConfig) -> Iterator[Check]:
    if not daemon.busy:
        yield from check_camera(daemon.filming, rig.camera, _film_folder(rig))
        return
    fps, lost = float(daemon.status["fps"]), int(daemon.status["lost"])
    yield passed("camera", "held by the daemon")
    yield not_checked("camera settings", "the daemon set them when it started")
    found = f"{fps:.1f} Hz of {rig.camera.frame_rate_hz:g} Hz set, {lost} lost since the daemon's start"
    slow = abs(fps - rig.camera.frame_rate_hz) > 0.05 * rig.camera.frame_rate_hz
    yield failed("frames", found, "see `acquire status` and the daemon's output") if slow else passed("frames", found)
    yield from (not_checked(name, "a session is open: check again after it") for name in CAMERA_LINES[3:])


def _film_folder(rig: RigConfig) -> Path:
    """The recording folder, so that the film takes a session's way; where there is none, any other."""
    folder = Path(rig.recorder.directory)
    return folder if folder.is_dir() else Path(tempfile.gettempdir())
