"""Terminal output of `acquire discover`: cameras, or servos."""

from __future__ import annotations

import json
from dataclasses import asdict

from acquire.errors import CameraNotFound, StrikerNotFound
from schemas.plain_text import echo
from schemas.terminal import Terminal


def list_cameras(*, as_json: bool) -> None:
    """Print the cameras that answer: GigE and USB3 Vision, and video devices (V4L2).

    Args:
        as_json: True to print JSON.

    Raises:
        CameraNotFound: none answers.
    """
    from acquire.camera.factory import discover_cameras

    cameras, notes = discover_cameras()
    if as_json:
        echo(json.dumps([vars(camera) for camera in cameras]))
    for camera in [] if as_json else cameras:
        kind = "" if camera.kind == "gige" else f'  kind = "{camera.kind}"'
        echo(f"{camera.address:16} {camera.vendor} {camera.model} ({camera.serial}){kind}")
    for note in notes:
        Terminal(stderr=True).print(note)
    if not cameras:
        raise CameraNotFound(
            "no camera answers: check power and cable, that host and camera are in one subnet "
            "(`ip address`), that no firewall drops UDP port 3956, and that this user may open USB cameras "
            "(`sudo usermod -aG video $USER`)"
        )


def list_servos(ports: list[str], *, as_json: bool) -> None:
    """Print the servos that answer, with the lines for the rig file, or why they cannot be used.

    Args:
        ports: serial ports to search; empty for those of all USB adapters.
        as_json: True to print JSON.

    Raises:
        StrikerNotFound: no port, or no servo answers.
        StrikerError: a port cannot be opened.
    """
    from acquire.striker.discovery import discover_servos, serial_ports

    searched = ports or serial_ports()
    if not searched:
        raise StrikerNotFound(
            "no serial port of a USB adapter is there: connect it, or name a port with --port"
        )
    console = Terminal(stderr=True)
    found = list(discover_servos(searched, lambda text: console.print(f"asking {text}")))
    if as_json:
        echo(json.dumps([asdict(servo) | {"model": servo.name, "remedy": servo.remedy} for servo in found]))
    for servo in [] if as_json else found:
        where = f"{servo.port} at {servo.baud_rate} bit/s, id {servo.id}, protocol {servo.protocol}"
        echo(f"{servo.name}: {where}")
        echo(servo.remedy or servo.rig_lines().rstrip())
    if not found:
        raise StrikerNotFound(
            f"no servo answers at {', '.join(searched)}: check its power and cable; other baud rates and ids "
            "above 20 with protocol 1 are not searched"
        )
