"""Queries to a camera without a connection: its identity, and whether a client controls it.

Packets after GigE Vision 2.0, sections 16.2 and 16.4. Aravis's own discovery broadcasts, and loopback does
not carry broadcasts. A camera does not answer a write by a client without control, which costs Aravis 2.5 s
of time-outs each: to ask first who has control costs nothing.
"""

from __future__ import annotations

import socket
import struct
from typing import TYPE_CHECKING

from acquire.camera.base import CameraInfo
from acquire.errors import CameraError

if TYPE_CHECKING:
    from acquire.clock.clock import Clock

GVCP_PORT = 3956
_DISCOVERY = bytes.fromhex("420100020000ffff")
_READ_PRIVILEGE = bytes.fromhex("4201008000040001") + struct.pack(">I", 0xA00)
_CONTROL_OR_EXCLUSIVE = 3
_HEADER_BYTES = 8
_ADDRESS, _VENDOR, _MODEL, _SERIAL = (0x24, 4), (0x48, 32), (0x68, 32), (0xD8, 16)
_ANSWER_BYTES = _HEADER_BYTES + 0xF8
_HEARTBEAT_TIMEOUT_S = 3.2
"""time after which a camera ends the control privilege of a client that died [s]: 3 s, and some margin"""


def identify_camera(address: str, timeout_s: float = 0.3) -> CameraInfo | None:
    """Identity of the camera at an IP address: vendor, model, serial number and address.

    The address in the identity is the one that the camera's answer contains. The result is None if no valid
    answer comes within `timeout_s` [s].
    """
    answer = _exchange(address, _DISCOVERY, timeout_s)
    if len(answer) < _ANSWER_BYTES or answer[2:4] != b"\x00\x03":
        return None
    registers = answer[_HEADER_BYTES:]
    return CameraInfo(
        vendor=_text(registers, *_VENDOR),
        model=_text(registers, *_MODEL),
        serial=_text(registers, *_SERIAL),
        address=socket.inet_ntoa(registers[_ADDRESS[0] : sum(_ADDRESS)]),
    )


def is_controlled(address: str, timeout_s: float = 0.3) -> bool:
    """True if a client holds the control privilege of the camera at IP address `address`.

    False if none does, or no valid answer comes within `timeout_s` [s].
    """
    answer = _exchange(address, _READ_PRIVILEGE, timeout_s)
    if len(answer) < _HEADER_BYTES + 4 or answer[:4] != b"\x00\x00\x00\x81":
        return False
    return struct.unpack_from(">I", answer, _HEADER_BYTES)[0] & _CONTROL_OR_EXCLUSIVE != 0


def wait_for_control(address: str, clock: Clock) -> None:
    """Wait 3.2 s if a client controls the camera: a killed client loses control within that time.

    The camera ends control 3 s after the last heartbeat. Returns at once if no client controls it. The camera
    is asked only twice, because Aravis's fake camera takes any client's question for the controller's
    heartbeat.

    Args:
        address: IP address of the camera.
        clock: the host's clock, for the wait.

    Raises:
        CameraError: a client still controls the camera after 3.2 s, so it is alive.
    """
    if is_controlled(address):
        clock.sleep(_HEARTBEAT_TIMEOUT_S)
        if is_controlled(address):
            raise CameraError(
                f"camera {address} is controlled by another program: close that program, then try again"
            )


def _exchange(address: str, request: bytes, timeout_s: float) -> bytes:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as client:
        client.settimeout(timeout_s)
        try:
            client.connect((address, GVCP_PORT))
            client.send(request)
            return client.recv(1024)
        except OSError:
            return b""


def _text(registers: bytes, offset: int, size: int) -> str:
    return registers[offset : offset + size].split(b"\0")[0].decode("utf-8", "replace")
