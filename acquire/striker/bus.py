"""Register access to one Dynamixel servo on one serial port; one transaction at a time."""

from __future__ import annotations

import contextlib
import select
import termios
import threading
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

from dynamixel_sdk import COMM_SUCCESS

from acquire.errors import StrikerError, StrikerLost, StrikerNotFound, StrikerRefused
from acquire.striker.packets import ALERT, POLL_S, BlockingPort, StrictPacketHandler, never
from acquire.striker.port_problem import port_problem

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from acquire.striker.control_table import Register

MIN_ATTEMPTS = 3
MIN_RETRY_S = 0.5
"""time [s], beside MIN_ATTEMPTS requests, without an answer after which a servo counts as lost; it allows for
a busy host or a USB hub that restarts"""
QUIET_S = 0.02
"""silence on the line required after a time-out before the next request [s]; longer than FTDI's 16 ms
latency"""
MAX_QUIET_WAIT_NS = 200_000_000
"""longest wait for the silence of QUIET_S [ns]; the next request is sent after it in any case"""
_SYNC_WRITE = 0x83
_ALL = 0xFE
_STATUS_TEXT = {
    1: "could not execute the instruction",
    2: "does not know the instruction",
    3: "received a damaged packet",
    4: "reports that the value is out of range",
    5: "reports that the value has the wrong size",
    6: "reports that the value exceeds a limit register",
    7: "does not allow access now (EEPROM is locked while torque is on)",
}


class MonotonicClock(Protocol):
    """Clock that the striker uses; injected so that tests can replace it."""

    def monotonic_ns(self) -> int:
        """Host monotonic time [ns]."""
        ...


def attempts(clock: MonotonicClock) -> Iterator[int]:
    """Yield the number (0, 1, ...) of each attempt at a request to the servo; end when they suffice.

    That is once MIN_ATTEMPTS (3) numbers were yielded and MIN_RETRY_S (0.5 s) have passed on `clock`. The
    caller leaves the loop when an attempt succeeds.
    """
    end_ns = clock.monotonic_ns() + round(MIN_RETRY_S * 1e9)
    count = 0
    while count < MIN_ATTEMPTS or clock.monotonic_ns() < end_ns:
        yield count
        count += 1


@dataclass(frozen=True)
class Block:
    """Bytes of consecutive registers of the servo, read at one instant; the host's times before and after.

    The times are host monotonic [ns]. A flag marks that the servo reports a hardware error.
    """

    data: bytes
    """bytes of the control table"""
    host_before_ns: int
    """host monotonic time before the request was sent [ns]"""
    host_after_ns: int
    """host monotonic time after the answer arrived [ns]"""
    alert: bool
    """True if the servo reports a hardware error"""


class ServoBus:
    """Register access to one servo; may be called from any thread, one transaction at a time.

    It has a lock of its own, because the flag `is_using` of the port of dynamixel_sdk is no lock. That flag
    is reset after every exception: otherwise it would stay True once the adapter was unplugged, and every
    later call would return COMM_PORT_BUSY.

    Args:
        port: path of the serial port.
        baud_rate: baud rate [bit/s].
        servo_id: id of the servo on the bus.
        clock: host monotonic time.
    """

    def __init__(self, port: str, baud_rate: int, servo_id: int, clock: MonotonicClock) -> None:
        self.port = port
        self.baud_rate = baud_rate
        self.servo_id = servo_id
        self.alert = False
        """True if the last answer carried the servo's ALERT bit"""
        self._clock = clock
        self._handler = StrictPacketHandler()
        self._port: BlockingPort | None = None
        self._lock = threading.RLock()

    def open(self) -> int:
        """Open the port, find the servo and return its model number.

        Raises:
            StrikerNotFound: no such port, no permission, port in use, unknown baud rate, or no servo with
                this id answers at it.
        """
        port = BlockingPort(self.port, self.baud_rate)
        try:
            if not port.openPort():  # False only for an unknown baud rate; other problems raise
                raise StrikerNotFound(
                    f"{self.port}: {self.baud_rate} bit/s is not a baud rate of this servo; try 1000000"
                )
        except (OSError, termios.error, ValueError) as error:  # serial.SerialException is an OSError
            raise StrikerNotFound(f"{self.port}: {port_problem(self.port, error)}") from None
        self._port = port
        for _ in range(MIN_ATTEMPTS):
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
        """Release the port; do nothing if it is closed. Never raises for a port that failed."""
        with self._lock:
            port, self._port = self._port, None
            if port is not None and port.ser is not None:
                with contextlib.suppress(OSError, termios.error):
                    port.closePort()

    @property
    def is_open(self) -> bool:
        """True from a successful `open` to `close`, even if the port fails in between."""
        return self._port is not None

    @property
    def descriptor(self) -> int:
        """File descriptor of the open port, for a child process that inherits it.

        Raises:
            StrikerLost: the port is closed.
        """
        if self._port is None:
            raise StrikerLost(f"{self.port}: the port is closed; home the striker again")
        return int(self._port.ser.fileno())

    def _exchange(
        self,
        method: Callable[..., Any],
        *arguments: Any,
        waits: bool = True,
        interrupted: Callable[[], bool] = never,
    ) -> Any:
        with self._lock:
            if self._port is None:
                raise StrikerLost(f"{self.port}: the port is closed; home the striker again")
            try:
                if self._handler.unanswered and waits:
                    self._wait_for_quiet(self._port, interrupted)
                return method(self._port, *arguments)
            except (OSError, termios.error, TypeError) as error:  # TypeError: pyserial closed its descriptor
                self._port.is_using = False  # else COMM_PORT_BUSY for ever
                raise StrikerLost(
                    f"{self.port}: the port failed ({error}); plug the adapter in again, then home the "
                    "striker"
                ) from None

    def _wait_for_quiet(self, port: BlockingPort, interrupted: Callable[[], bool]) -> None:
        """Wait until the line was silent for 20 ms, at most 0.2 s; discard the bytes that arrive meanwhile.

        Called after a time-out: a late answer must not collide with the next request. The wait also ends when
        `interrupted` returns True.
        """
        now_ns = quiet_since_ns = self._clock.monotonic_ns()
        end_ns = now_ns + MAX_QUIET_WAIT_NS
        while (
            port.ser is not None
            and now_ns < end_ns
            and now_ns - quiet_since_ns < QUIET_S * 1e9
            and not interrupted()
        ):
            ready, _, _ = select.select([port.ser.fileno()], [], [], POLL_S)
            now_ns = self._clock.monotonic_ns()
            if ready:
                port.ser.read(4096)
                quiet_since_ns = now_ns

    def read_block(self, address: int, size: int, interrupted: Callable[[], bool] = never) -> Block | None:
        """Read consecutive bytes of the servo's control table in one transaction.

        A lost answer is not requested again, because any later reading serves as well. This is a plain read:
        sync and fast reads discard the status error, and with it ALERT (the report of a hardware error).

        Args:
            address: address of the first byte.
            size: number of bytes.
            interrupted: called while waiting; True ends the wait for the answer.

        Returns:
            The bytes, with the host times around the reading; None if no complete answer came in time, the
            wait was interrupted, or the servo refused the read.

        Raises:
            StrikerLost: the port failed or is closed.
        """

        def read(port: BlockingPort) -> Any:
            port.interrupted = interrupted
            try:
                return self._handler.readTxRx(port, self.servo_id, address, size)
            finally:
                port.interrupted = never

        with self._lock:
            before_ns = self._clock.monotonic_ns()
            data, result, error = self._exchange(read, interrupted=interrupted)
            after_ns = self._clock.monotonic_ns()
        # The length is checked because removeStuffing loses a byte of rare payloads.
        if result != COMM_SUCCESS or len(data) != size or error & ~ALERT:
            return None
        self.alert = bool(error & ALERT)
        return Block(bytes(data), before_ns, after_ns, self.alert)

    def read(self, register: Register) -> int:
        """Value of a register of the servo, as an integer; the reading is repeated if the answer is lost.

        Signed registers give signed values.

        Raises:
            StrikerLost: no answer after several attempts, or the port failed or is closed.
        """
        for _ in attempts(self._clock):
            block = self.read_block(register.address, register.size)
            if block is not None:
                return register.decode(block.data)
        raise self._unanswered(f"reading {register.name}")

    def read_if_present(self, register: Register) -> int | None:
        """Value of a register that only some servos have; None if this one refuses to read it.

        Raises:
            StrikerLost: no answer after several attempts, or the port failed or is closed.
        """
        for _ in attempts(self._clock):
            data, result, error = self._exchange(
                self._handler.readTxRx, self.servo_id, register.address, register.size
            )
            if result == COMM_SUCCESS and error & ~ALERT:
                return None
            if result == COMM_SUCCESS and len(data) == register.size:
                return register.decode(bytes(data))
        raise self._unanswered(f"reading {register.name}")

    def write(self, register: Register, value: int) -> None:
        """Write the integer `value` to one register; repeat it if the answer is lost, which is safe.

        Negative values are written as two's complement.

        Raises:
            StrikerLost: no answer after several attempts, or the port failed or is closed.
            StrikerError: the servo refuses the value.
            StrikerRefused: the SDK cannot send the value's bytes, which hold FF FF FD.
        """
        data = register.encode(value)
        _refuse_unstuffed(register, value, data)
        for _ in attempts(self._clock):
            result, error = self._exchange(
                self._handler.writeTxRx, self.servo_id, register.address, register.size, list(data)
            )
            if result == COMM_SUCCESS:
                self.alert = bool(error & ALERT)
                if error & ~ALERT:
                    reason = _STATUS_TEXT.get(error & ~ALERT, f"answers with error {error & ~ALERT}")
                    raise StrikerError(f"{self.port}: writing {register.name} = {value}: the servo {reason}")
                return
        raise self._unanswered(f"writing {register.name} = {value}")

    def _unanswered(self, request: str) -> StrikerLost:
        """Error for a request without an answer, in words as "reading Drive Mode"."""
        return StrikerLost(f"{self.port}: no answer from the servo to {request}; check its power and cable")

    def write_unanswered(self, register: Register, value: int) -> None:
        """Write `value` to one register, twice, without waiting for any answer, even to an earlier request.

        The packet is a sync write to this one servo: servos do not answer it, so that it can be repeated at
        once and a lost packet costs no time.

        Raises:
            StrikerLost: the port failed or is closed.
            StrikerRefused: the SDK cannot send the packet's bytes, which hold FF FF FD.
        """
        packet = list(self.unanswered_packet(register, value))

        def send(port: BlockingPort) -> None:
            for _ in range(2):
                self._handler.txPacket(port, list(packet))
                port.is_using = False

        self._exchange(send, waits=False)

    def unanswered_packet(self, register: Register, value: int) -> bytes:
        """Bytes of a packet that writes `value` to one register and is not answered (a sync write).

        Another process can send them as they are.

        Raises:
            StrikerRefused: the packet's bytes hold FF FF FD, which the SDK cannot send.
        """
        data = [
            register.address & 0xFF,
            register.address >> 8,
            register.size & 0xFF,
            register.size >> 8,
            self.servo_id,
        ]
        data += register.encode(value)
        _refuse_unstuffed(register, value, bytes(data))
        size = len(data) + 3
        packet = [0xFF, 0xFF, 0xFD, 0, _ALL, size & 0xFF, size >> 8, _SYNC_WRITE, *data, 0, 0]
        crc = self._handler.updateCRC(0, packet, len(packet) - 2)
        return bytes([*packet[:-2], crc & 0xFF, crc >> 8])

    def reboot(self, timeout_s: float) -> None:
        """Restart the servo, which clears a hardware error, and wait until it answers.

        Args:
            timeout_s: longest wait for its answer [s].

        Raises:
            StrikerLost: the servo does not answer in time, or the port failed or is closed.
        """
        self._exchange(self._handler.reboot, self.servo_id)
        end_ns = self._clock.monotonic_ns() + int(timeout_s * 1e9)
        while self._clock.monotonic_ns() < end_ns:
            time.sleep(0.05)
            _, result, error = self._exchange(self._handler.ping, self.servo_id)
            if result == COMM_SUCCESS:
                self.alert = bool(error & ALERT)
                return
        raise StrikerLost(
            f"{self.port}: the servo did not come back from a reboot; switch its power off and on"
        )


def _refuse_unstuffed(register: Register, value: int, data: bytes) -> None:
    """Raise StrikerRefused if `data`, the bytes sent to write `value` to `register`, holds FF FF FD.

    The protocol requires a stuffing byte after these three; the SDK's txPacket builds the stuffed packet,
    then sends the plain one (protocol2_packet_handler.addStuffing).
    """
    if b"\xff\xff\xfd" in data:
        raise StrikerRefused(
            f"{register.name} = {value} cannot be sent: the SDK does not stuff FF FF FD; choose a "
            "neighbouring value"
        )
