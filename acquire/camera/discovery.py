"""What can be asked of a camera without being its client: who it is, and whether somebody controls it (GigE Vision 2.0, 16.2, 16.4).

Aravis's own discovery broadcasts, and loopback does not carry broadcasts. A write by a client without control is not answered at
all, which costs Aravis 2.5 s of time-outs for each: asking first costs nothing.
"""

from __future__ import annotations

import socket
import struct

from acquire.camera.base import CameraInfo

GVCP_PORT = 3956
_DISCOVERY = bytes.fromhex("420100020000ffff")
_READ_PRIVILEGE = bytes.fromhex("4201008000040001") + struct.pack(">I", 0xA00)
_CONTROL_OR_EXCLUSIVE = 3
_HEADER_BYTES = 8
_ADDRESS, _VENDOR, _MODEL, _SERIAL = (0x24, 4), (0x48, 32), (0x68, 32), (0xD8, 16)
_ANSWER_BYTES = _HEADER_BYTES + 0xF8


def ask(address: str, timeout_s: float = 0.3) -> CameraInfo | None:
    """Who answers at `address`, or None."""
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
    """Whether some client holds the control privilege of the camera at `address`; False where nobody answers."""
    answer = _exchange(address, _READ_PRIVILEGE, timeout_s)
    if len(answer) < _HEADER_BYTES + 4 or answer[:4] != b"\x00\x00\x00\x81":
        return False
    return struct.unpack_from(">I", answer, _HEADER_BYTES)[0] & _CONTROL_OR_EXCLUSIVE != 0


def _exchange(address: str, request: bytes, timeout_s: float) -> bytes:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as asker:
        asker.settimeout(timeout_s)
        try:
            asker.connect((address, GVCP_PORT))
            asker.send(request)
            return asker.recv(1024)
        except OSError:
            return b""


def _text(registers: bytes, offset: int, size: int) -> str:
    return registers[offset : offset + size].split(b"\0")[0].decode("utf-8", "replace")
