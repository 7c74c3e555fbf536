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
    BINNING_X,
    BINNING_Y,
    CHUNKS,
    DEFAULTS,
    EXPOSURE_US,
    GAIN,
    HEIGHT,
    PACKET_SIZE,
    PERIOD_US,
    PIXEL_FORMAT,
    RATE_ENABLE,
    TL_LOCK,
    TRIGGER_MODE,
    USER_SET,
    USER_SET_LOAD,
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
"""registers that cannot be written in a camera that was left streaming"""
PAYLOAD: Final = frozenset(
    {WIDTH, HEIGHT, PIXEL_FORMAT, BINNING_X, BINNING_Y, CHUNKS, PACKET_SIZE, USER_SET, USER_SET_LOAD}
)
"""registers that decide the size of images and packets, which TLParamsLocked locks (SFNC, Transport Layer
Control)"""


@dataclass(frozen=True)
class GigeFaults:
    """Faults of a camera or its network."""

    left_streaming: bool = False
    """True if another program has left it streaming: settings are denied until it is stopped"""
    left_locked: bool = False
    """True if another program has left TLParamsLocked at 1, for a make that has it"""
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

    def remembered(self, register: int) -> int:
        """Value of a register that another program has left."""
        left = DEFAULTS if self.make is None else DEFAULTS | self.make.remembered
        return left.get(register, 0)

    @property
    def stamps_end(self) -> bool:
        """True if it stamps the end of an exposure, not its start."""
        return self.make is not None and self.make.stamp_at == "exposure_end"


USUAL: Final = CameraHabits()


class FaultyRegisters:
    """Answers of a faulty camera, or of one of a make, in place of the fake camera's.

    Does not model: locks of offsets, of exposure and gain, and of what other makes lock while they stream.

    Args:
        habits: make, and what is wrong.
    """

    def __init__(self, habits: CameraHabits) -> None:
        self._faults, self._make = habits.faults, habits.make
        self._left_streaming = self._streams = habits.faults.left_streaming
        self._locked = habits.faults.left_locked
        self._triggered = habits.remembered(TRIGGER_MODE) != 0
        self._client: tuple[str, int] = ("", 0)

    def refusal(self, command: int, register: int, value: int) -> int:
        """Status code with which a request is refused; 0 if it is not, and what it changes is kept."""
        if command not in (_WRITEREG, _WRITEMEM):
            return INVALID_ADDRESS if self._faults.hides_ticks and register in _TICKS else 0
        if self._is_denied(register):
            return ACCESS_DENIED
        if register in self._faults.locked:
            return WRITE_PROTECT
        if register == ACQUISITION:
            self._streams = value != 0
            self._left_streaming &= self._streams
        elif register == TL_LOCK:
            self._locked = value != 0
        elif register == TRIGGER_MODE:
            self._triggered = value != 0
        elif register == USER_SET_LOAD:
            self._triggered = False
        return 0

    def _is_denied(self, register: int) -> bool:
        """True if the camera's present state denies a write to the register."""
        make = self._make
        if self._left_streaming and register in LOCKED:
            return True
        if make is None:
            return False
        if make.locks_payload and (self._streams or self._locked) and register in PAYLOAD:
            return True
        return make.trigger_locks_rate and self._triggered and register in (PERIOD_US, RATE_ENABLE)

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
