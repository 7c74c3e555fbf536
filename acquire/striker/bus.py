"""One servo on one serial port: the SDK's packet handler behind a lock. The only import of dynamixel_sdk and serial."""

from __future__ import annotations

import contextlib
import errno
import os
import select
import termios
import threading
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Protocol

import serial
from dynamixel_sdk import COMM_SUCCESS, Protocol2PacketHandler
from dynamixel_sdk.port_handler import PortHandler

from acquire.errors import StrikerError, StrikerLost, StrikerNotFound, StrikerRefused

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from acquire.striker.control_table import Register

ALERT = 0x80
ANSWER_MARGIN_MS = 36.0
"""Beyond the bytes' own time: FTDI's default latency of 16 ms, twice, and a busy host. (The SDK: LATENCY_TIMER = 16, likewise twice.)"""
ATTEMPTS = 3
PATIENCE_S = 0.5
"""and for no less than so long a servo is asked again before it counts as lost: a busy host, a USB hub that starts anew"""
QUIET_S = 0.02
"""of silence on the line after a time-out, before anything is asked again: longer than FTDI's own 16 ms latency"""
LATE_NS = 200_000_000
GLANCE_S = 0.001
"""how often a wait for an answer looks whether it is still wanted"""
_ID, _LENGTH, _INSTRUCTION, _PARAMETERS = 4, 5, 7, 8
"""places in a packet; a status packet has its error where an instruction has its first parameter"""
_PING, _READ, _SYNC_WRITE = 1, 2, 0x83
_ALL = 0xFE
_STATUS_TEXT = {
    1: "could not carry it out",
    2: "does not know the instruction",
    3: "got a damaged packet",
    4: "says the value is out of range",
    5: "says the value has the wrong size",
    6: "says the value is beyond a limit register",
    7: "does not allow access now (EEPROM is locked while torque is on)",
}


class MonotonicClock(Protocol):
    """What this package needs of a clock."""

    def monotonic_ns(self) -> int:
        """Host monotonic time."""
        ...


def _never() -> bool:
    return False


def attempts(clock: MonotonicClock) -> Iterator[int]:
    """Counts how often to ask before a servo is lost: ATTEMPTS times, and for PATIENCE_S at least."""
    end_ns = clock.monotonic_ns() + round(PATIENCE_S * 1e9)
    count = 0
    while count < ATTEMPTS or clock.monotonic_ns() < end_ns:
        yield count
        count += 1


class BlockingPort(PortHandler):
    """The SDK's port, but it sleeps while it waits, and its time-outs count monotonic time.

    The SDK polls without sleeping and times out by `time.time()`, so a step of the wall clock ends or stretches a wait
    (port_handler.py of 4.1.0: readPort, getCurrentTime).
    """

    def __init__(self, port_name: str, baud_rate: int) -> None:
        super().__init__(port_name)
        self.baudrate = baud_rate
        self.ser: Any = None
        self.interrupted: Callable[[], bool] = _never
        """asked while an answer is waited for; True ends the wait as if the time were up"""
        self._received = b""

    def setupPort(self, cflag_baud: int) -> Literal[True]:  # noqa: N802 - the SDK's name
        """Open for ourselves alone (flock on the device: gone with the process, whatever happens)."""
        if self.is_open:
            self.closePort()
        self.ser = serial.Serial(self.port_name, cflag_baud, timeout=0, exclusive=True)
        # FTDI gathers bytes for 16 ms by default: 59 reads a second. Fails on a pty and on other adapters; udev can set it as well.
        with contextlib.suppress(OSError, ValueError, NotImplementedError, AttributeError):
            self.ser.set_low_latency_mode(True)
        self.is_open = True
        self.tx_time_per_byte = 10_000.0 / cflag_baud
        self.clearPort()
        return True

    def clearPort(self) -> None:  # noqa: N802 - the SDK's name
        """Forget what came in unasked."""
        self._received = b""
        termios.tcflush(self.ser.fileno(), termios.TCIFLUSH)

    def readPort(self, length: int) -> bytes:  # noqa: N802 - the SDK's name
        """`length` bytes, or fewer when the time is up."""
        descriptor = self.ser.fileno()
        while len(self._received) < length:
            left_s = (self.packet_timeout - self.getTimeSinceStart()) * 1e-3
            if self.interrupted():
                break
            # Time that is up is no reason to leave what has come: it was this host that was late.
            if not select.select([descriptor], [], [], max(0.0, min(left_s, GLANCE_S)))[0]:
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
        """Whether to wait no longer."""
        return self.interrupted() or bool(super().isPacketTimeout())

    def setPacketTimeout(self, packet_length: int) -> None:  # noqa: N802 - the SDK's name
        """Start the clock for an answer of this many bytes."""
        self.setPacketTimeoutMillis(self.tx_time_per_byte * packet_length + ANSWER_MARGIN_MS)

    def getCurrentTime(self) -> float:  # noqa: N802 - the SDK's name
        """Milliseconds, monotonic."""
        return time.monotonic_ns() * 1e-6


class StrictPacketHandler(Protocol2PacketHandler):
    """The SDK's handler, which takes whatever answer comes next for the answer to what it asked last, made to look at its length.

    An answer that comes late (a loaded host, a USB hiccup) would else confirm a write that the servo never heard. Packets carry no
    numbers, so after a time-out a ping goes first: a servo answers in order, and once the ping's answer is here, of a length that
    nothing else has, none to what was asked before it can follow.
    """

    def __init__(self) -> None:
        self.unanswered = False
        """the last packet that wanted an answer got none in time"""

    def txRxPacket(self, port: Any, txpacket: list[int]) -> tuple[Any, int, int]:  # noqa: N802  # pyright: ignore[reportIncompatibleMethodOverride] - the SDK's name; it has no types
        """Send, and wait for the status packet of the length that this instruction has; others are left overs and are passed over."""
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


@dataclass(frozen=True)
class Block:
    """Consecutive registers, read at one instant between two readings of the host's clock."""

    data: bytes
    host_before_ns: int
    host_after_ns: int
    alert: bool
    """the servo reports a hardware error"""


class ServoBus:
    """Reads and writes registers of one servo; may be called from any thread, one transaction at a time.

    `is_using` of the SDK's port is no lock, and stays True after an exception, so that everything after an unplugged adapter is
    COMM_PORT_BUSY for ever: our own lock, and the flag is reset on every exception.
    """

    def __init__(self, port: str, baud_rate: int, servo_id: int, clock: MonotonicClock) -> None:
        self.port = port
        self.baud_rate = baud_rate
        self.servo_id = servo_id
        self.alert = False
        """whether the last answer carried the servo's ALERT bit"""
        self._clock = clock
        self._handler = StrictPacketHandler()
        self._port: BlockingPort | None = None
        self._lock = threading.RLock()

    def open(self) -> int:
        """Take the port and find the servo; its model number.

        Raises:
            StrikerNotFound: no such port, port in use, or no servo answers on it at this baud rate.
        """
        port = BlockingPort(self.port, self.baud_rate)
        try:
            if not port.openPort():  # it raises for most troubles and returns False only for a baud rate it does not know
                raise StrikerNotFound(f"{self.port}: {self.baud_rate} bit/s is not a baud rate of this servo; try 1000000")
        except (OSError, termios.error, ValueError) as error:  # serial.SerialException is an OSError
            if getattr(error, "errno", None) in {errno.EAGAIN, errno.EWOULDBLOCK, errno.EBUSY}:
                raise StrikerNotFound(f"{self.port}: the port is in use by another program; `fuser {self.port}` names it") from None
            if getattr(error, "errno", None) == errno.EACCES:
                raise StrikerNotFound(f"{self.port}: no permission to open the port; add yourself to its group (dialout)") from None
            what = "is no serial port" if Path(self.port).exists() else "no such serial port"
            raise StrikerNotFound(f"{self.port}: {what}; check the cable, and `port` in the rig file") from None
        self._port = port
        for _ in range(ATTEMPTS):
            try:
                model, result, error = self._exchange(self._handler.ping, self.servo_id)
            except StrikerLost:
                break
            if result == COMM_SUCCESS:
                self.alert = bool(error & ALERT)
                return model
        self.close()
        raise StrikerNotFound(
            f"{self.port}: no servo with id {self.servo_id} answers at {self.baud_rate} bit/s; "
            "check its power, and `id` and `baud_rate` in the rig file"
        )

    def close(self) -> None:
        """Release the port. Always safe."""
        with self._lock:
            port, self._port = self._port, None
            if port is not None and port.ser is not None:
                with contextlib.suppress(OSError, termios.error):
                    port.closePort()

    @property
    def is_open(self) -> bool:
        """Whether the port is ours."""
        return self._port is not None

    @property
    def descriptor(self) -> int:
        """Of the open port, for a process that inherits it.

        Raises:
            StrikerLost: the port is closed.
        """
        if self._port is None:
            raise StrikerLost(f"{self.port}: the port is closed; home the striker again")
        return int(self._port.ser.fileno())

    def _exchange(self, method: Callable[..., Any], *arguments: Any, waits: bool = True, interrupted: Callable[[], bool] = _never) -> Any:
        with self._lock:
            if self._port is None:
                raise StrikerLost(f"{self.port}: the port is closed; home the striker again")
            try:
                if self._handler.unanswered and waits:
                    self._wait_for_quiet(self._port, interrupted)
                return method(self._port, *arguments)
            except (OSError, termios.error, TypeError) as error:  # TypeError: pyserial closes its descriptor under us
                self._port.is_using = False  # else COMM_PORT_BUSY for ever
                raise StrikerLost(f"{self.port}: the port failed ({error}); plug the adapter in again, then home the striker") from None

    def _wait_for_quiet(self, port: BlockingPort, interrupted: Callable[[], bool]) -> None:
        """After a time-out: its answer may still come, and nothing must be sent into it."""
        now_ns = quiet_since_ns = self._clock.monotonic_ns()
        end_ns = now_ns + LATE_NS
        while port.ser is not None and now_ns < end_ns and now_ns - quiet_since_ns < QUIET_S * 1e9 and not interrupted():
            ready, _, _ = select.select([port.ser.fileno()], [], [], GLANCE_S)
            now_ns = self._clock.monotonic_ns()
            if ready:
                port.ser.read(4096)
                quiet_since_ns = now_ns

    def read_block(self, address: int, size: int, interrupted: Callable[[], bool] = _never) -> Block | None:
        """Consecutive bytes; None when no whole answer came in time (nothing is repeated: the next sample is as good).

        A plain read: sync and fast reads throw the status error away, and with it ALERT.

        Args:
            address: of the first byte.
            size: bytes.
            interrupted: True ends the wait for the answer.

        Raises:
            StrikerLost: the port failed.
        """

        def read(port: BlockingPort) -> Any:
            port.interrupted = interrupted
            try:
                return self._handler.readTxRx(port, self.servo_id, address, size)
            finally:
                port.interrupted = _never

        with self._lock:
            before_ns = self._clock.monotonic_ns()
            data, result, error = self._exchange(read, interrupted=interrupted)
            after_ns = self._clock.monotonic_ns()
        if result != COMM_SUCCESS or len(data) != size or error & ~ALERT:  # removeStuffing loses a byte of rare payloads: count them
            return None
        self.alert = bool(error & ALERT)
        return Block(bytes(data), before_ns, after_ns, self.alert)

    def read(self, register: Register) -> int:
        """A register's value, signed where it is.

        Raises:
            StrikerLost: no answer.
        """
        for _ in attempts(self._clock):
            block = self.read_block(register.address, register.size)
            if block is not None:
                return register.decode(block.data)
        raise StrikerLost(f"{self.port}: the servo does not answer when asked for {register.name}; check its power and cable")

    def write(self, register: Register, value: int) -> None:
        """Write one register; asked again when the answer is lost, for a write may be repeated.

        Raises:
            StrikerLost: no answer.
            StrikerError: the servo refuses the value.
            StrikerRefused: the SDK cannot send these bytes.
        """
        data = register.encode(value)
        if (
            b"\xff\xff\xfd" in data
        ):  # txPacket builds the stuffed packet and then sends the plain one (protocol2_packet_handler.addStuffing)
            raise StrikerRefused(f"{register.name} = {value} cannot be sent: the SDK does not stuff FF FF FD; choose a neighbouring value")
        for _ in attempts(self._clock):
            result, error = self._exchange(self._handler.writeTxRx, self.servo_id, register.address, register.size, list(data))
            if result == COMM_SUCCESS:
                self.alert = bool(error & ALERT)
                if error & ~ALERT:
                    reason = _STATUS_TEXT.get(error & ~ALERT, f"answers with error {error & ~ALERT}")
                    raise StrikerError(f"{self.port}: writing {register.name} = {value}: the servo {reason}")
                return
        raise StrikerLost(f"{self.port}: the servo does not answer when told {register.name} = {value}; check its power and cable")

    def shout(self, register: Register, value: int) -> None:
        """Write one register twice and wait for nothing, not even for the answer to what was asked before.

        A sync write to this one servo: no servo answers to it, so that it can be repeated at once and a lost frame costs no time.

        Raises:
            StrikerLost: the port failed.
        """
        packet = list(self.last_words(register, value))

        def send(port: BlockingPort) -> None:
            for _ in range(2):
                self._handler.txPacket(port, list(packet))
                port.is_using = False

        self._exchange(send, waits=False)

    def last_words(self, register: Register, value: int) -> bytes:
        """The packet that writes one register and is not answered, for whoever has to send it without this class.

        Raises:
            StrikerRefused: the SDK cannot send these bytes.
        """
        data = [register.address & 0xFF, register.address >> 8, register.size & 0xFF, register.size >> 8, self.servo_id]
        data += register.encode(value)
        if b"\xff\xff\xfd" in bytes(data):
            raise StrikerRefused(f"{register.name} = {value} cannot be sent: the SDK does not stuff FF FF FD; choose a neighbouring value")
        size = len(data) + 3
        packet = [0xFF, 0xFF, 0xFD, 0, _ALL, size & 0xFF, size >> 8, _SYNC_WRITE, *data, 0, 0]
        crc = self._handler.updateCRC(0, packet, len(packet) - 2)
        return bytes([*packet[:-2], crc & 0xFF, crc >> 8])

    def reboot(self, timeout_s: float) -> None:
        """Restart the servo, which clears a hardware error, and wait until it answers.

        Raises:
            StrikerLost: it does not come back.
        """
        self._exchange(self._handler.reboot, self.servo_id)
        end_ns = self._clock.monotonic_ns() + int(timeout_s * 1e9)
        while self._clock.monotonic_ns() < end_ns:
            time.sleep(0.05)
            _, result, error = self._exchange(self._handler.ping, self.servo_id)
            if result == COMM_SUCCESS:
                self.alert = bool(error & ALERT)
                return
        raise StrikerLost(f"{self.port}: the servo did not come back from a reboot; switch its power off and on")
