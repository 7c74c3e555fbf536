"""Serial port and packet handler of dynamixel_sdk that sleep while waiting and reject late answers.

dynamixel_sdk builds the packets; the protocol is written out in acquire/virtual/dynamixel_protocol.py.
"""

from __future__ import annotations

import contextlib
import errno
import os
import select
import termios
import time
from typing import TYPE_CHECKING, Any, Literal

import serial
from dynamixel_sdk import COMM_SUCCESS, Protocol2PacketHandler
from dynamixel_sdk.port_handler import PortHandler

if TYPE_CHECKING:
    from collections.abc import Callable

ALERT = 0x80
"""bit of an answer's error byte with which the servo reports a hardware error"""
ANSWER_MARGIN_MS = 36.0
"""time-out [ms] beyond the transmission of the bytes: FTDI's default latency of 16 ms, twice, and a busy host
(the SDK's LATENCY_TIMER = 16 counts twice as well)"""
POLL_S = 0.001
"""interval at which a wait for an answer checks whether it was interrupted [s]"""
_ID, _LENGTH, _INSTRUCTION, _PARAMETERS = 4, 5, 7, 8
"""offsets in a packet; a status packet has its error where an instruction has its first parameter"""
_PING, _READ = 1, 2


def never() -> bool:
    """Return False always: stands for an `interrupted` function where a wait cannot be interrupted."""
    return False


class BlockingPort(PortHandler):
    """Serial port of dynamixel_sdk that sleeps while it waits and times out by monotonic time.

    The SDK polls without sleeping and times out by `time.time()`, so that a step of the wall clock ends or
    stretches a wait (port_handler.py of 4.1.0: readPort, getCurrentTime).

    Args:
        port_name: path of the serial port.
        baud_rate: baud rate [bit/s].
    """

    def __init__(self, port_name: str, baud_rate: int) -> None:
        super().__init__(port_name)
        self.baudrate = baud_rate
        self.ser: Any = None
        self.interrupted: Callable[[], bool] = never
        """called while waiting for an answer; True ends the wait like a time-out"""
        self._received = b""

    def setupPort(self, cflag_baud: int) -> Literal[True]:  # noqa: N802 - the SDK's name
        """Open the port for this program alone; return True.

        A port that is open already is closed before. Other programs are kept out by an flock on the device,
        which ends with the process in any case.

        Args:
            cflag_baud: baud rate [bit/s].

        Raises:
            serial.SerialException: the port cannot be opened or is in use; an OSError.
        """
        if self.is_open:
            self.closePort()
        self.ser = serial.Serial(self.port_name, cflag_baud, timeout=0, exclusive=True)
        # FTDI collects bytes for 16 ms by default, which limits it to 59 reads per second. The call fails on
        # a pty and on other adapters; udev can set it as well.
        with contextlib.suppress(OSError, ValueError, NotImplementedError, AttributeError):
            self.ser.set_low_latency_mode(True)
        self.is_open = True
        self.tx_time_per_byte = 10_000.0 / cflag_baud
        self.clearPort()
        return True

    def clearPort(self) -> None:  # noqa: N802 - the SDK's name
        """Discard all received bytes, those waiting in the operating system included."""
        self._received = b""
        termios.tcflush(self.ser.fileno(), termios.TCIFLUSH)

    def readPort(self, length: int) -> bytes:  # noqa: N802 - the SDK's name
        """Wait for and return `length` received bytes; fewer if the wait times out or is interrupted.

        The time-out is the one that `setPacketTimeout` started. Further received bytes are kept for the next
        call.

        Raises:
            OSError: the port hung up.
        """
        descriptor = self.ser.fileno()
        while len(self._received) < length:
            left_s = (self.packet_timeout - self.getTimeSinceStart()) * 1e-3
            if self.interrupted():
                break
            # Bytes that arrived are read even after the time-out: then this host was late, not the servo.
            if not select.select([descriptor], [], [], max(0.0, min(left_s, POLL_S)))[0]:
                if left_s <= 0:
                    break
                continue
            data = os.read(descriptor, 1024)
            if not data:
                raise OSError(errno.EIO, "the port hung up")
            self._received += data
        result, self._received = self._received[:length], self._received[length:]
        return result

    def isPacketTimeout(self) -> bool:  # noqa: N802 - the SDK's name
        """True if the wait for the servo's answer timed out or was interrupted."""
        return self.interrupted() or bool(super().isPacketTimeout())

    def setPacketTimeout(self, packet_length: int) -> None:  # noqa: N802 - the SDK's name
        """Start the time-out for an answer of `packet_length` bytes: their transmission time and 36 ms."""
        self.setPacketTimeoutMillis(self.tx_time_per_byte * packet_length + ANSWER_MARGIN_MS)

    def getCurrentTime(self) -> float:  # noqa: N802 - the SDK's name
        """Host monotonic time [ms], in place of the SDK's wall-clock time."""
        return time.monotonic_ns() * 1e-6


class StrictPacketHandler(Protocol2PacketHandler):
    """Packet handler of dynamixel_sdk that also checks id and length of the answers.

    The SDK takes any next packet as the answer to its last request. A late answer (a loaded host, a USB
    hiccup) would then confirm a write that the servo never received. Packets carry no sequence numbers, so
    after a time-out a ping is sent first: a servo answers in order, and the ping's answer has a length that
    no other answer has. Once it has arrived, no answer to an earlier request can follow.
    """

    def __init__(self) -> None:
        self.unanswered = False
        """True if the last packet that requires an answer got none in time"""

    # The SDK's name; it has no types.
    def txRxPacket(  # noqa: N802  # pyright: ignore[reportIncompatibleMethodOverride]
        self, port: Any, txpacket: list[int]
    ) -> tuple[Any, int, int]:
        """Send a packet and wait for its status packet (the servo's answer); late answers are skipped.

        If the last request got no answer in time, a ping is sent and answered first.

        Args:
            port: the open serial port, a BlockingPort.
            txpacket: bytes of the packet; the SDK fills in header, CRC and stuffing.

        Returns:
            Bytes of the status packet (None or empty if none arrived in time), the SDK's result code
            (COMM_SUCCESS or an error), and the status packet's error byte (0 if none arrived).
        """
        if self.unanswered and txpacket[_INSTRUCTION] != _PING:
            _, result, _ = self.ping(port, txpacket[_ID])
            if result != COMM_SUCCESS:
                return None, result, 0
        result = self.txPacket(port, txpacket)
        if result != COMM_SUCCESS:
            return None, result, 0
        instruction = txpacket[_INSTRUCTION]
        data = {_PING: 3, _READ: 0}.get(instruction, 0)
        if instruction == _READ:
            data = txpacket[_PARAMETERS + 2] | txpacket[_PARAMETERS + 3] << 8
        port.setPacketTimeout(data + 11)  # header, id, length, instruction, error and CRC are 11 bytes
        while True:
            answer, result = self.rxPacket(port, False)
            self.unanswered = result != COMM_SUCCESS
            if result != COMM_SUCCESS:
                return answer, result, 0
            error = answer[_PARAMETERS]
            length = answer[_LENGTH] | answer[_LENGTH + 1] << 8
            if answer[_ID] == txpacket[_ID] and (length == data + 4 or (length == 4 and error & ~ALERT)):
                return answer, result, error
