"""Every make of camera and kind of striker, simulated: what discovery, check and use give.

`make bench-devices` prints two tables. A refusal states its reason. Each device is used by itself, where
faults are among them: cameras stream for two seconds, strikers strike and stop once. Then each make and model
has a struck session on the whole virtual rig. The webcam needs root.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

import click
import pytest
from rich.console import Console
from rich.table import Table

from acquire.camera.base import Camera
from acquire.camera.discovery import identify_camera
from acquire.camera.factory import discover_cameras, make_camera
from acquire.camera.v4l2_discovery import list_v4l2_cameras
from acquire.clock.clock import SystemClock
from acquire.errors import AcquireError
from acquire.preflight.stamps import measure_stamp
from acquire.virtual.camera_makes import MAKES, CameraMake
from acquire.virtual.device_kinds import DeviceKinds
from acquire.virtual.gige_camera import VirtualGigeCamera
from acquire.virtual.gige_faults import USUAL, CameraHabits, GigeFaults
from acquire.virtual.usb3_features import Usb3Habits, device_id
from acquire.virtual.usb_device import ACCESS
from schemas.camera_kind import CAMERA_KINDS
from schemas.rig import CameraConfig
from tests.acquire.camera.video_device import pattern_video
from tests.acquire.capture.synthetic_rig import CALIBRATION
from tests.acquire.virtual.pattern_source import PatternSource
from tests.benchmarks.device_boards import board_rows
from tests.benchmarks.device_servos import STEPS, servo_rows
from tests.benchmarks.device_sessions import session_cell
from tests.usb_bus import SERIAL, bus_folder, pattern_usb3

MakeRow = Callable[[], dict[str, str]]
"""function that uses a device; returns what each step gave"""
ADDRESS = "127.0.0.93"
FRAMES = 240
CAMERA_STEPS = ("discover", "open", "stream", "stamps", "session")
LOCKED = GigeFaults(left_streaming=True, left_locked=True)
FAULTS = {
    "left streaming": GigeFaults(left_streaming=True),
    "hides its clock's frequency": GigeFaults(hides_ticks=True),
    "network of 1500 B": GigeFaults(mtu=1500),
}
USB3 = {
    "USB3 Vision": Usb3Habits(),
    "USB3 Vision, left streaming, end stamped": Usb3Habits(left_streaming=True, stamps_end=True),
    "USB3 Vision, limited to 20 MB/s": Usb3Habits(limit_bytes_s=20_000_000),
    "USB3 Vision, limit locked": Usb3Habits(limit_bytes_s=20_000_000, limit_locked=True),
    "USB3 Vision, may not be opened": Usb3Habits(open_status=ACCESS),
    "USB3 Vision, loses trailers": Usb3Habits(lacks_trailer_every=60),
}


def camera_rows() -> Iterator[tuple[str, MakeRow]]:
    """Rows of a table: name of a camera, and a function that finds out what each of CAMERA_STEPS gives."""
    yield "Aravis's own", lambda: _row(USUAL) | _session(DeviceKinds())
    for make, known in MAKES.items():
        kinds, habits = DeviceKinds(make=make), CameraHabits(make=known)
        yield f"{known.vendor} {known.model}", partial(_row_and_session, kinds, habits)
    for name, faults in FAULTS.items():
        yield f"Mako, {name}", partial(_row, CameraHabits(make=MAKES["mako"], faults=faults))
    blackfly = CameraHabits(make=MAKES["blackfly-s"], faults=LOCKED)
    yield "Blackfly S, left streaming and locked", partial(_row, blackfly)
    for name, usb_habits in USB3.items():
        yield name, partial(_usb_row, usb_habits)
    for pixel_format in CAMERA_KINDS["v4l2"].pixel_formats:
        yield f"webcam (V4L2), {pixel_format}", partial(_webcam_row, pixel_format)


def _row_and_session(kinds: DeviceKinds, habits: CameraHabits) -> dict[str, str]:
    return _row(habits) | _session(kinds)


def _session(kinds: DeviceKinds) -> dict[str, str]:
    return {"session": session_cell(kinds)}


def _webcam_row(pixel_format: str) -> dict[str, str]:
    with TemporaryDirectory() as folder:
        found = _webcam_used(Path(folder), pixel_format)
    return found | (_session(DeviceKinds(camera="v4l2")) if pixel_format == "Mono8" else {})


def _webcam_used(folder: Path, pixel_format: str) -> dict[str, str]:
    address = folder / "video0"
    config = CameraConfig.model_validate(
        {
            "kind": "v4l2",
            "address": str(address),
            "buffers": 64,
            "pixel_format": pixel_format,
            "calibration": CALIBRATION,
        }
    )
    try:
        with pattern_video(address):
            found = {"discover": "; ".join(camera.model for camera in list_v4l2_cameras(folder))}
            return found | _used(config, "exposure_start")
    except pytest.skip.Exception as reason:
        return {"discover": f"not run: {reason}"}


def _usb_row(habits: Usb3Habits) -> dict[str, str]:
    with pattern_usb3(habits):
        names = [camera.model for camera in discover_cameras()[0] if camera.kind == "usb3"]
        found = {"discover": ", ".join(names) or "nothing answers"}
        config = CameraConfig(kind="usb3", address=device_id(SERIAL), buffers=64, calibration=CALIBRATION)
        found |= _used(config, "exposure_end" if habits.stamps_end else "exposure_start")
    return found | (_session(DeviceKinds(camera="usb3")) if habits == Usb3Habits() else {})


def _row(habits: CameraHabits) -> dict[str, str]:
    clock = SystemClock()
    server = VirtualGigeCamera(ADDRESS, "BENCH", PatternSource(clock, 1), clock, habits=habits)
    try:
        identity = identify_camera(ADDRESS)
        found = {"discover": "nothing answers" if identity is None else identity.model}
        config = CameraConfig(address=ADDRESS, buffers=64, calibration=CALIBRATION)
        return found | _used(config, _stated(habits.make))
    finally:
        server.close()


def _used(config: CameraConfig, stated: str) -> dict[str, str]:
    """Results of opening, streaming and measuring the stamp, beside the instant that the camera stamps."""
    clock = SystemClock()
    found: dict[str, str] = {}
    try:
        found |= _streamed(make_camera(config, clock))
        slope = measure_stamp(lambda each: make_camera(each, clock), config)
    except AcquireError as error:
        return found | {"open": f"refused: {error}"}
    return found | {"stamps": "unknown: no clock" if slope is None else f"slope {slope:.2f} ({stated})"}


def _streamed(camera: Camera) -> dict[str, str]:
    try:
        camera.open()
        camera.start()
        lost = 0
        for _ in range(FRAMES):
            frame = camera.read(5.0)
            if frame is None:
                return {"open": "; ".join(camera.warnings) or "as set", "stream": "ended"}
            lost += frame.lost_before
            frame.buffer.release()
        camera.stop()
        return {"open": "; ".join(camera.warnings) or "as set", "stream": f"{FRAMES} frames, {lost} lost"}
    finally:
        camera.close()


def _stated(make: CameraMake | None) -> str:
    return "exposure_start" if make is None else make.stamp_at


@click.command()
@click.option("--only", default="", help="Devices whose name contains this text.")
def main(only: str) -> None:
    """Print both tables; each row is shown as soon as it is known."""
    bus_folder()  # before Aravis is loaded
    strikers = itertools.chain(servo_rows(), board_rows())
    for title, steps, rows in (("camera", CAMERA_STEPS, camera_rows()), ("striker", STEPS, strikers)):
        table = Table(title, *steps)
        for name, make_row in rows:
            if only.lower() in name.lower():
                found = make_row()
                click.echo(f"{name}: {found}", err=True)
                table.add_row(name, *(found.get(step, "") for step in steps))
        Console(width=200).print(table)


if __name__ == "__main__":
    main()
