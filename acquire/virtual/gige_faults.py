"""What can be wrong with a GigE Vision camera or its network, for the virtual camera's relay.

Status codes and registers: GigE Vision 2.0, chapters 16 and 28.
"""

from __future__ import annotations

import socket
import struct
from dataclasses import dataclass
from typing import Final

from acquire.virtual.camera_makes import (
    ACQUISITION,
    DEFAULTS,
    EXPOSURE_US,
    GAIN,
    HEIGHT,
    PACKET_SIZE,
    PERIOD_US,
    WIDTH,
    CameraMake,
)

INVALID_ADDRESS, WRITE_PROTECT, ACCESS_DENIED = 0x8003, 0x8005, 0x8006
_READREG, _WRITEREG, _WRITEMEM = 0x80, 0x82, 0x86
_TICKS = (0x93C, 0x940)
_STREAM_PORT, _STREAM_ADDRESS = 0xD00, 0xD18
_FIRE_TEST_PACKET = 0x80000000
_IP_AND_UDP_BYTES = 28
LOCKED: Final = frozenset({WIDTH, HEIGHT, EXPOSURE_US, GAIN, PERIOD_US, *DEFAULTS})
"""registers that cannot be written while images are sent"""


@dataclass(frozen=True)
class GigeFaults:
    """Faults of a camera or its network."""

    left_streaming: bool = False
    """True if another program has left it streaming: settings are denied until it is stopped"""
    hides_ticks: bool = False
    """True if it lacks the registers of its clock's frequency"""
    locked: frozenset[int] = frozenset()
    """registers that cannot be written"""
    mtu: int = 9000
    """largest packet that the network carries [bytes]"""


@dataclass(frozen=True)
class CameraHabits:
    """What a virtual camera does otherwise than Aravis's fake camera."""

    make: CameraMake | None = None
    """make whose names, bounds, clock and memory it takes on; None for Aravis's own"""
    faults: GigeFaults = GigeFaults()
    """what is wrong with it or its network"""
    pulses_hz: float = 0.0
    """rate of a pulse generator at the trigger input, which sets the frame rate while the client has the
    trigger on; 0 if none is connected"""

    @property
    def ticks_hz(self) -> int:
        """Frequency of its clock [Hz]."""
        return 1_000_000_000 if self.make is None else self.make.ticks_hz

    @property
    def stamps_end(self) -> bool:
        """True if it stamps the end of an exposure, not its start."""
        return self.make is not None and self.make.stamp_at == "exposure_end"


USUAL: Final = CameraHabits()


class FaultyRegisters:
    """Answers of a faulty camera in place of the fake camera's.

    Args:
        faults: what is wrong.
    """

    def __init__(self, faults: GigeFaults) -> None:
        self._faults = faults
        self._streams = faults.left_streaming
        self._client: tuple[str, int] = ("", 0)

    def refusal(self, command: int, register: int, value: int) -> int:
        """Status code with which a request is refused; 0 if it is not."""
        if command in (_WRITEREG, _WRITEMEM):
            if register == ACQUISITION and value == 0:
                self._streams = False
            if self._streams and register in LOCKED:
                return ACCESS_DENIED
            return WRITE_PROTECT if register in self._faults.locked else 0
        return INVALID_ADDRESS if self._faults.hides_ticks and register in _TICKS else 0

    def test_packet(self, command: int, register: int, value: int) -> tuple[bytes, tuple[str, int]] | None:
        """Packet that a client asked for to test the network, and its address; None if it gets none."""
        if command not in (_WRITEREG, _WRITEMEM):
            return None
        address, port = self._client
        if register == _STREAM_ADDRESS:
            self._client = (socket.inet_ntoa(struct.pack(">I", value)), port)
        elif register == _STREAM_PORT:
            self._client = (address, value & 0xFFFF)
        elif register == PACKET_SIZE and value & _FIRE_TEST_PACKET:
            size = value & 0xFFFF
            if size <= self._faults.mtu and port:
                return bytes(size - _IP_AND_UDP_BYTES), self._client
        return None
