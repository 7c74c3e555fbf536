"""Dynamixel protocol 2.0 on the servo's side: parse instruction packets, build status packets.

Written from the vendor's e-manual and independent of the SDK that the striker uses, so that no mistake is
made on both sides. The example packets of the e-manual are the tests' golden vectors.
"""

from __future__ import annotations

import enum
import struct
from dataclasses import dataclass

HEADER = b"\xff\xff\xfd\x00"
BROADCAST = 0xFE
MAX_PACKET = 1100
_STUFF = (b"\xff\xff\xfd", b"\xff\xff\xfd\xfd")


class Instruction(enum.IntEnum):
    """Instruction field of a Dynamixel 2.0 packet: the instructions in use; STATUS marks an answer."""

    PING = 0x01
    READ = 0x02
    WRITE = 0x03
    REBOOT = 0x08
    STATUS = 0x55
    SYNC_WRITE = 0x83


class StatusError(enum.IntEnum):
    """Error field of a status packet (a servo's answer), without its ALERT bit (0x80, hardware error)."""

    NONE = 0
    RESULT = 1
    INSTRUCTION = 2
    CRC = 3
    RANGE = 4
    LENGTH = 5
    LIMIT = 6
    ACCESS = 7


ALERT = 0x80


@dataclass(frozen=True)
class Packet:
    """Received Dynamixel 2.0 packet: servo id, instruction, parameters, and whether its CRC is right.

    Byte stuffing (an FD inserted after FF FF FD) is undone.
    """

    id: int
    """id of the servo that it is addressed to; 254 for all servos"""
    instruction: int
    """value of the instruction field, one of Instruction or unknown"""
    parameters: bytes
    """bytes between instruction and CRC"""
    intact: bool
    """True if the CRC is right"""


def _crc_table() -> tuple[int, ...]:
    table: list[int] = []
    for byte in range(256):
        crc = byte << 8
        for _ in range(8):
            crc = ((crc << 1) ^ 0x8005 if crc & 0x8000 else crc << 1) & 0xFFFF
        table.append(crc)
    return tuple(table)


_CRC_TABLE = _crc_table()


def crc16(data: bytes) -> int:
    """CRC-16/BUYPASS check sum, as an integer, of the bytes of a Dynamixel packet without its CRC field.

    Polynomial 0x8005, start 0, not reflected (vendor's e-manual, "CRC calculation").
    """
    crc = 0
    for byte in data:
        crc = ((crc << 8) & 0xFFFF) ^ _CRC_TABLE[(crc >> 8) ^ byte]
    return crc


def encode(servo_id: int, instruction: int, parameters: bytes) -> bytes:
    """Bytes of a packet as sent: header, id, length, stuffed body, CRC.

    Args:
        servo_id: id of the servo that the packet is addressed to, or that sends it.
        instruction: value of the instruction field.
        parameters: bytes after it; byte stuffing (an FD inserted after FF FF FD) is added here.
    """
    body = (bytes([instruction]) + parameters).replace(*_STUFF)
    packet = HEADER + bytes([servo_id]) + struct.pack("<H", len(body) + 2) + body
    return packet + struct.pack("<H", crc16(packet))


class Parser:
    """Parser that splits a byte stream into packets; bytes that belong to no packet are skipped."""

    def __init__(self) -> None:
        self._buffer = b""

    def feed(self, data: bytes) -> list[Packet]:
        """Add received bytes, and return the packets that they complete, in order; empty if none.

        A packet with a wrong CRC is returned too, marked as not intact.
        """
        self._buffer += data
        packets: list[Packet] = []
        while True:
            start = self._buffer.find(HEADER)
            if start < 0:
                self._buffer = self._buffer[-3:]
                return packets
            self._buffer = self._buffer[start:]
            if len(self._buffer) < 7:
                return packets
            size = int.from_bytes(self._buffer[5:7], "little") + 7
            if not 10 <= size <= MAX_PACKET:
                self._buffer = self._buffer[4:]
                continue
            if len(self._buffer) < size:
                return packets
            raw, self._buffer = self._buffer[:size], self._buffer[size:]
            body = raw[7:-2].replace(_STUFF[1], _STUFF[0])
            packets.append(
                Packet(raw[4], body[0], body[1:], crc16(raw[:-2]) == int.from_bytes(raw[-2:], "little"))
            )
