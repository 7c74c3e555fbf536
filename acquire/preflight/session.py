"""All checks of `acquire check` in order; a failed check does not stop the others."""

from __future__ import annotations

import contextlib
import math
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from acquire.camera.factory import make_camera
from acquire.clock.clock import Clock, SystemClock
from acquire.config import read_rig
from acquire.daemon.client import DaemonClient
from acquire.errors import AcquireError, ConfigError, DaemonNotRunning
from acquire.preflight.blur import BLUR_LINE, check_blur
from acquire.preflight.board import ReadBoard, check_board, check_held_board, read_board
from acquire.preflight.camera import CAMERA_LINES, check_camera
from acquire.preflight.check import Check, Outcome, failed_by_error, failed_check, passed_check, skipped_check
from acquire.preflight.computer import (
    Computer,
    check_latency_timer,
    check_lock,
    check_port,
    check_receive_buffer,
    check_socket,
)
from acquire.preflight.disk import Disk, check_disk
from acquire.preflight.firewall import ReadFirewall, read_firewall
from acquire.preflight.network import NETWORK_LINES, Network, check_network
from acquire.preflight.processor import GOVERNOR_LINE, Processor, check_governor
from acquire.preflight.servo import SERVO_LINES, ReadServo, check_held_servo, check_servo, read_servo
from acquire.preflight.stamps import STAMP_LINE, MeasureStamp, check_stamp, measure_stamp
from acquire.preflight.usb import check_usb_bandwidth
from acquire.preflight.video import DaemonCapture, OwnCapture, VideoSource
from schemas.rig import RigConfig, StrikerConfig
from schemas.wording import counted

LINES = (
    "rig file",
    "daemon",
    "daemon socket",
    "level",
    "serial port",
    "port lock",
    "USB latency",
    "receive buffer",
    *NETWORK_LINES,
    GOVERNOR_LINE,
    "disk space",
    "disk speed",
    *SERVO_LINES,
    BLUR_LINE,
    *CAMERA_LINES,
    STAMP_LINE,
)
"""names of all checks of a rig with a servo, in order"""


@dataclass(frozen=True)
class RunningDaemon:
    """Daemon that listens on the rig's socket: its status, and its camera as a source of test videos."""

    status: dict[str, Any]
    """the daemon's answer to `status`"""
    source: VideoSource
    """the daemon's camera, which records the test video"""

    @property
    def busy(self) -> bool:
        """True while the daemon has a recording open for a session."""
        return self.status["recording"] is not None


@dataclass(frozen=True)
class Probes:
    """Objects and functions through which the checks read computer, disk, servo, camera and daemon.

    Tests put substitutes in their place.
    """

    computer: Computer
    network: Network
    firewall: ReadFirewall
    """function that reads the packet filter"""
    processor: Processor
    disk: Disk
    servo: ReadServo
    """function that reads the servo"""
    board: ReadBoard
    """function that reads the striker board"""
    capture: Callable[[RigConfig], VideoSource]
    """function that returns the rig's camera, for use without a daemon"""
    stamp: MeasureStamp
    """function that finds out which instant of a frame the camera stamps, without a daemon"""
    daemon: Callable[[RigConfig], contextlib.AbstractContextManager[RunningDaemon | None]]
    """context that yields the running daemon; None if none runs"""


def real_probes(clock: Clock | None = None) -> Probes:
    """Probes that read this computer, its disk and the rig's devices for the checks.

    Args:
        clock: clock of the host; None for the system's.
    """
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
        computer=Computer(),
        network=Network(),
        firewall=read_firewall,
        processor=Processor(),
        disk=Disk(clock.monotonic_ns),
        servo=lambda config: read_servo(config, clock),
        board=lambda config: read_board(config, clock),
        capture=lambda rig: OwnCapture(rig, clock),
        stamp=lambda config: measure_stamp(lambda each: make_camera(each, clock), config),
        daemon=daemon,
    )


def check_rig(path: Path, probes: Probes) -> Iterator[Check]:
    """Yield each check of the rig that a rig file describes as it finishes; all take about ten seconds.

    If the rig file cannot be used, its check fails and the remaining ones are yielded as not checked. Camera
    and servo are checked through the daemon if one runs; while it records, the camera's only check is that of
    the frame rate.

    Args:
        path: the rig file.
        probes: sources of everything that the checks read.
    """
    try:
        rig = read_rig(path)
    except ConfigError as error:
        yield failed_check("rig file", str(error), "correct it; docs/how-to/rig.md shows a complete rig file")
        yield from (skipped_check(name, "the rig file must be correct first") for name in LINES[1:])
        return
    yield passed_check("rig file", f'{path}: "{rig.name}"')
    with contextlib.ExitStack() as cleanup:
        try:
            daemon = cleanup.enter_context(probes.daemon(rig))
        except AcquireError as error:
            daemon = None
            yield failed_by_error("daemon", error)
        else:
            yield _check_daemon(rig, daemon)
        yield check_socket(probes.computer, rig.daemon.socket_path())
        yield check_level(rig)
        yield from _check_connections(probes, rig, daemon)
        yield check_governor(probes.processor)
        yield from check_disk(probes.disk, rig)
        if daemon is None:
            yield from _check_striker(probes, rig.striker)
            yield check_blur(rig)
            yield from _check_camera(probes, rig)
        else:
            yield from _check_held_striker(daemon.status, rig.striker)
            yield check_blur(rig)
            yield from _check_held_camera(daemon, rig)
            yield skipped_check(STAMP_LINE, "the daemon holds the camera: check without it")


def _check_camera(probes: Probes, rig: RigConfig) -> Iterator[Check]:
    """Yield the checks of a camera that no daemon holds."""
    works = True
    for check in check_camera(probes.capture(rig), rig.camera, _video_folder(rig)):
        works &= check.outcome is Outcome.PASS or check.name not in CAMERA_LINES[:2]
        yield check
    if works:
        yield check_stamp(probes.stamp, rig.camera)
    else:
        yield skipped_check(STAMP_LINE, "the camera must take its settings first")


def _check_daemon(rig: RigConfig, daemon: RunningDaemon | None) -> Check:
    if daemon is None:
        return passed_check("daemon", "not running: the devices are checked directly")
    status = daemon.status
    running = f'running (pid {status["pid"]}, rig "{status["rig"]}")'
    if status["rig"] != rig.name:
        remedy = "give the rig file it was started with, or stop it: acquire stop --daemon"
        return failed_check("daemon", f'{running}, but this is rig "{rig.name}"', remedy)
    if daemon.busy:
        found = f"{running} and recording {status['recording']}: checks that would disturb it are left out"
        return passed_check("daemon", found)
    return passed_check("daemon", f"{running}: camera and servo are checked through it")


def _check_connections(probes: Probes, rig: RigConfig, daemon: RunningDaemon | None) -> Iterator[Check]:
    computer, striker, camera = probes.computer, rig.striker, rig.camera
    if striker.traits.has_port:
        port = computer.port(striker.port)
        yield check_port(port, striker.port)
        yield check_lock(port, striker.port, None if daemon is None else int(daemon.status["pid"]))
        yield check_latency_timer(computer, port, striker.port)
    if camera.traits.on_network:
        yield check_receive_buffer(computer, camera.receive_buffer_bytes)
        yield from check_network(probes.network, probes.firewall, camera)
    if camera.traits.on_usb:
        yield check_usb_bandwidth(camera)


def _check_striker(probes: Probes, striker: StrikerConfig) -> Iterator[Check]:
    """Yield the checks of a striker that no daemon holds, whatever its kind."""
    if striker.traits.has_servo:
        yield from check_servo(probes.servo, striker)
    elif striker.traits.has_port:
        yield check_board(probes.board, striker)
    else:
        yield passed_check("servo", f"none: the striker is {striker.traits.description}")


def _check_held_striker(status: dict[str, Any], striker: StrikerConfig) -> Iterator[Check]:
    """Yield the checks of a striker that the daemon with this status holds, whatever its kind."""
    state, trouble = str(status["striker"]), str(status.get("striker_trouble", ""))
    if striker.traits.has_servo:
        yield from check_held_servo(striker, state, status.get("servo"), trouble)
    elif striker.traits.has_port:
        yield check_held_board(state, trouble)
    else:
        yield passed_check("servo", f"none: the striker is {striker.traits.description}")


def check_level(rig: RigConfig) -> Check:
    """Report the tilt of the table against gravity that the rig file gives; this check always passes.

    The tilt is the reading of a level (the instrument) or, without one, 0 with the standard deviation
    `gravity_tilt_sd_rad`.

    Returns:
        Passed check with the tilt and its standard deviation [deg] in words.
    """
    degrees = math.degrees(rig.gravity_tilt_sd_rad)
    if rig.level is not None:
        rise, sd = math.degrees(rig.level.towards_x_rad), math.degrees(rig.level.towards_x_sd_rad)
        reading = f"table tilt {rise:.3g} +- {sd:.2g} deg, rising towards +x (1 sigma)"
        return passed_check("level", f"read by {rig.level.read_by}: {reading}")
    if "gravity_tilt_sd_rad" in rig.model_fields_set:
        return passed_check("level", f"table tilt 0 +- {degrees:.2g} deg (1 sigma), from the rig file")
    return passed_check(
        "level",
        f"no reading in the rig file, table tilt assumed 0 +- {degrees:.2g} deg (1 sigma): "
        "level the table and enter [level]",
    )


def _check_held_camera(daemon: RunningDaemon, rig: RigConfig) -> Iterator[Check]:
    if not daemon.busy:
        yield from check_camera(daemon.source, rig.camera, _video_folder(rig))
        return
    fps, lost = float(daemon.status["fps"]), int(daemon.status["lost"])
    yield passed_check("camera", "held by the daemon")
    yield skipped_check("camera settings", "the daemon set them when it started")
    found = (
        f"{fps:.1f} Hz of {rig.camera.frame_rate_hz:g} Hz set, {counted(lost, 'frame')} lost since "
        "the daemon started"
    )
    slow = abs(fps - rig.camera.frame_rate_hz) > 0.05 * rig.camera.frame_rate_hz
    yield (
        failed_check("frames", found, "see `acquire status` and the daemon's output")
        if slow
        else passed_check("frames", found)
    )
    yield from (skipped_check(name, "a session is open: check again after it") for name in CAMERA_LINES[3:])


def _video_folder(rig: RigConfig) -> Path:
    """Folder for the test video: the recording folder, or the system's temporary one.

    The temporary folder is taken if the recording folder does not exist.
    """
    folder = Path(rig.recorder.directory)
    return folder if folder.is_dir() else Path(tempfile.gettempdir())
