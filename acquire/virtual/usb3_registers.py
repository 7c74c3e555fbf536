"""Registers of a virtual USB3 Vision camera, and the commands that read and write them.

Addresses and layouts: GenCP 1.0 (bootstrap registers, commands, status codes), USB3 Vision 1.0 (registers of
the stream), as Aravis 0.8.26 reads them (arvuvcpprivate.h). All numbers have their least significant byte
first.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from typing import Final

_MANUFACTURER, _MODEL, _FAMILY, _VERSION, _NOTE, _SERIAL = 0x04, 0x44, 0x84, 0xC4, 0x104, 0x144
_RESPONSE_MS, _MANIFEST_ADDRESS, _TECHNOLOGY_ADDRESS = 0x1CC, 0x1D0, 0x1D8
TIMESTAMP, TIMESTAMP_LATCH = 0x1F0, 0x1F8
TEXTS: Final = {
    "DeviceVendorName": _MANUFACTURER,
    "DeviceModelName": _MODEL,
    "DeviceFamilyName": _FAMILY,
    "DeviceVersion": _VERSION,
    "DeviceManufacturerInfo": _NOTE,
    "DeviceID": _SERIAL,
}
"""bootstrap registers that hold text, by their standard feature"""
TEXT_BYTES = 64
_TECHNOLOGY, _STREAM, _MANIFEST, FEATURES, _XML = 0x10000, 0x20000, 0x30000, 0x40000, 0x100000
"""start of the registers of USB3 Vision, of the stream, of the table of descriptions, of the features, and of
the description itself"""
STREAM_ENABLE = _STREAM + 0x4
_PAYLOAD_BYTES, _LEADER_BYTES, _TRAILER_BYTES = _STREAM + 0x8, _STREAM + 0x10, _STREAM + 0x14
_BOOTSTRAP_LENGTH, _BLOCK_LENGTH, _FEATURES_LENGTH = 0x400, 0x100, 0x1000
MAX_TRANSFER: Final = 1024
"""largest command and answer [bytes]"""
RESPONSE_MS: Final = 300
"""longest time to an answer that the camera states [ms]"""
_ALIGNMENT_BITS = 2
"""transfers are multiples of 4 bytes"""
LEADER: Final = struct.Struct("<4sHHQHHQIIIIIHH")
"""leader of a frame: magic, 0, size, number, 0, payload type, stamp [ns], pixel format, width, height, two
offsets, padding, 0"""
TRAILER: Final = struct.Struct("<4sHHQHHQI")
"""trailer of a frame: magic, 0, size, number, status, 0, payload [bytes], rows"""

INVALID_ADDRESS, WRITE_PROTECT, ACCESS_DENIED = 0x8003, 0x8004, 0x8006
_NOT_IMPLEMENTED = 0x8001
_READ, _WRITE, _PENDING = 0x800, 0x802, 0x805
_HEAD: Final = struct.Struct("<4sHHHH")
"""head of a command and of an answer: magic, flags or status, command, size, number"""
_PENDING_MS: Final = 500


class RegisterError(Exception):
    """A register cannot be read or written.

    Args:
        status: status code of the answer.
    """

    def __init__(self, status: int) -> None:
        super().__init__(f"status {status:#x}")
        self.status = status


class Registers:
    """Memory of the camera: bootstrap registers, those of the stream, features, and the description.

    Args:
        xml: description of the camera (GenICam).
        texts: names of the maker, the model and so on, by the standard name of their feature.
    """

    def __init__(self, xml: str, texts: dict[str, str]) -> None:
        description = xml.encode()
        self._blocks = {
            0: bytearray(_BOOTSTRAP_LENGTH),
            _TECHNOLOGY: bytearray(_BLOCK_LENGTH),
            _STREAM: bytearray(_BLOCK_LENGTH),
            _MANIFEST: bytearray(_BLOCK_LENGTH),
            FEATURES: bytearray(_FEATURES_LENGTH),
            _XML: bytearray(description),
        }
        for name, text in texts.items():
            self.write(TEXTS[name], text.encode()[: TEXT_BYTES - 1])
        put = self._put
        put("<I", (0, 0x10000), (_RESPONSE_MS, RESPONSE_MS), (TIMESTAMP_LATCH + 4, 1))
        put("<Q", (_MANIFEST_ADDRESS, _MANIFEST), (_TECHNOLOGY_ADDRESS, _TECHNOLOGY))
        put(
            "<I",
            (_TECHNOLOGY, 0x10000),
            (_TECHNOLOGY + 0x14, MAX_TRANSFER),
            (_TECHNOLOGY + 0x18, MAX_TRANSFER),
        )
        put("<I", (_TECHNOLOGY + 0x1C, 1), (_TECHNOLOGY + 0x28, _BLOCK_LENGTH), (_TECHNOLOGY + 0x40, 8))
        put("<Q", (_TECHNOLOGY + 0x20, _STREAM), (_MANIFEST, 1))
        put(
            "<I",
            (_STREAM, _ALIGNMENT_BITS << 24),
            (_LEADER_BYTES, LEADER.size),
            (_TRAILER_BYTES, TRAILER.size),
        )
        self.write(_MANIFEST + 8, struct.pack("<HBBIQQ", 0, 0, 1, 0, _XML, len(description)))

    def integer(self, address: int) -> int:
        """Value of the 32-bit register at `address`."""
        return struct.unpack("<I", self.read(address, 4))[0]

    def set_integer(self, address: int, value: int) -> None:
        """Write the 32-bit register at `address`."""
        self._put("<I", (address, value))

    def set_timestamp(self, time_ns: int) -> None:
        """Store a time [ns] as the latched one."""
        self._put("<Q", (TIMESTAMP, time_ns))

    def set_payload(self, size: int) -> None:
        """State the size of an image [bytes] to the client."""
        self._put("<Q", (_PAYLOAD_BYTES, size))

    def read(self, address: int, length: int) -> bytes:
        """Content of `length` bytes at `address`.

        Raises:
            RegisterError: there is no such register.
        """
        block, start = self._block(address, length)
        return bytes(block[start : start + length])

    def write(self, address: int, data: bytes) -> None:
        """Write bytes at `address`.

        Raises:
            RegisterError: there is no such register.
        """
        block, start = self._block(address, len(data))
        block[start : start + len(data)] = data

    def _put(self, layout: str, *values: tuple[int, int]) -> None:
        for address, value in values:
            self.write(address, struct.pack(layout, value))

    def _block(self, address: int, length: int) -> tuple[bytearray, int]:
        for start, block in self._blocks.items():
            if start <= address and address + length <= start + len(block):
                return block, address - start
        raise RegisterError(INVALID_ADDRESS)


class ControlChannel:
    """Answers to the commands of the control channel.

    Args:
        registers: memory of the camera.
        on_write: called before a client's write, with address and value (of the first 4 bytes); it may raise
            RegisterError, and returns True if the camera asks for more time before the answer.
    """

    def __init__(self, registers: Registers, on_write: Callable[[int, int], bool]) -> None:
        self._registers, self._on_write = registers, on_write

    def answer(self, command: bytes) -> list[bytes]:
        """Packets that answer a command: one, or a request for more time and one."""
        _, _, code, _, number = _HEAD.unpack_from(command)
        packets: list[bytes] = []
        try:
            if code == _READ:
                address, _, length = struct.unpack_from("<QHH", command, _HEAD.size)
                content = self._registers.read(address, length)
            elif code == _WRITE:
                address = struct.unpack_from("<Q", command, _HEAD.size)[0]
                data = command[_HEAD.size + 8 :]
                if address >= _XML or address < TIMESTAMP_LATCH:
                    raise RegisterError(WRITE_PROTECT)
                if self._on_write(address, int.from_bytes(data[:4], "little")):
                    packets.append(_packet(0, _PENDING, number, struct.pack("<HH", 0, _PENDING_MS)))
                self._registers.write(address, data)
                content = struct.pack("<HH", 0, len(data))
            else:
                raise RegisterError(_NOT_IMPLEMENTED)
        except RegisterError as error:
            return [_packet(error.status, code + 1, number, b"")]
        return [*packets, _packet(0, code + 1, number, content)]


def _packet(status: int, command: int, number: int, content: bytes) -> bytes:
    return _HEAD.pack(b"U3VC", status, command, len(content), number) + content
