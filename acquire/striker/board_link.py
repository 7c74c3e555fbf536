"""Requests to a striker board on a serial port and its replies; one exchange at a time."""

from __future__ import annotations

import contextlib
import errno
import os
import select
import termios
import threading
from typing import TYPE_CHECKING, TypeVar

import serial

from acquire.errors import StrikerFault, StrikerLost, StrikerNotFound
from acquire.striker.board_lines import (
    MAX_NUMBER,
    PROTOCOL,
    BoardIdentity,
    BoardRefusal,
    BoardReply,
    BoardStatus,
    BoardTime,
    LineReader,
    parse_reply,
    request_line,
)
from acquire.striker.port_problem import port_problem

if TYPE_CHECKING:
    from acquire.striker.bus import MonotonicClock

START_NS = 4_000_000_000
"""longest wait for a board that opening the port has reset [ns]; an Uno's boot loader takes 1 to 2 s"""
HELLO_NS = 250_000_000
"""longest wait for one reply to `hello` [ns]"""
REPLY_NS = 80_000_000
"""longest wait for any other reply [ns]: a tenth of it is needed, FTDI's 16 ms latency included"""
ATTEMPTS = 4
"""number of times that a request which may be repeated is sent"""

_Reply = TypeVar("_Reply", BoardIdentity, BoardTime, BoardStatus)


class BoardLink:
    """Serial port of a striker board; may be used from any thread.

    Damaged lines and replies to earlier requests are ignored. A request without a reply is repeated, except
    `fire`.

    Args:
        port: path of the serial port.
        baud_rate: baud rate [bit/s].
        clock: host monotonic time.
    """

    def __init__(self, port: str, baud_rate: int, clock: MonotonicClock) -> None:
        self.port = port
        self._baud_rate, self._clock = baud_rate, clock
        self._serial: serial.Serial | None = None
        self._number = 0
        self._lock = threading.RLock()

    @property
    def is_open(self) -> bool:
        """True from a successful `open` to `close`, even if the port fails in between."""
        return self._serial is not None

    def open(self) -> BoardIdentity:
        """Open the port for this program alone, wait for the board and return its identity.

        Raises:
            StrikerNotFound: no such port, no permission, port in use, nothing on it speaks this protocol, or
                it speaks another version of it.
        """
        try:
            self._serial = serial.Serial(self.port, self._baud_rate, timeout=0, exclusive=True)
        except (OSError, termios.error, ValueError) as error:  # serial.SerialException is an OSError
            raise StrikerNotFound(f"{self.port}: {port_problem(self.port, error)}") from None
        # FTDI adapters collect bytes for 16 ms by default. The call fails on a pty and on other adapters.
        with contextlib.suppress(OSError, ValueError, NotImplementedError, AttributeError):
            self._serial.set_low_latency_mode(True)
        end_ns = self._clock.monotonic_ns() + START_NS
        reply: BoardReply | None = None
        try:
            while not isinstance(reply, BoardIdentity) and self._clock.monotonic_ns() < end_ns:
                reply = self._exchange(HELLO_NS, "hello")
        except StrikerLost as error:
            self.close()
            raise StrikerNotFound(str(error)) from None
        if not isinstance(reply, BoardIdentity):
            self.close()
            raise StrikerNotFound(
                f"{self.port}: no striker board answers at {self._baud_rate} bit/s; check that the sketch is "
                "on the board, and `port` and `baud_rate` in the rig file"
            )
        if reply.protocol != PROTOCOL:
            self.close()
            raise StrikerNotFound(
                f"{self.port}: the board speaks version {reply.protocol} of the striker protocol, this "
                f"program version {PROTOCOL}; load a sketch of version {PROTOCOL} onto the board"
            )
        return reply

    def close(self) -> None:
        """Release the port; do nothing if it is closed. Never raises for a port that failed."""
        with self._lock:
            port, self._serial = self._serial, None
            if port is not None:
                with contextlib.suppress(OSError, termios.error):
                    port.close()

    def status(self, *words: object) -> BoardStatus:
        """Send a request that is answered with the board's status, repeat it if need be, return the status.

        Args:
            *words: verb and arguments; not `fire`.

        Raises:
            StrikerLost: no reply to several requests, or the port failed or is closed.
            StrikerFault: the board refuses the request.
        """
        return self._ask(BoardStatus, *words)

    def read_time(self) -> tuple[int, int, int]:
        """Board's clock [us], with the host monotonic times before the request and after the reply [ns].

        Raises:
            StrikerLost: no reply to several requests, or the port failed or is closed.
        """
        for _ in range(ATTEMPTS):
            with self._lock:
                before_ns = self._clock.monotonic_ns()
                reply = self._exchange(REPLY_NS, "time")
                after_ns = self._clock.monotonic_ns()
            if isinstance(reply, BoardTime):
                return reply.microseconds, before_ns, after_ns
        raise self._silent("time")

    def fire(self, speed_mm_s: int) -> BoardStatus:
        """Order the strike, once: a lost order is never repeated, because it may have been carried out.

        If no reply comes, the board is asked for its state.

        Args:
            speed_mm_s: tip speed [mm/s].

        Raises:
            StrikerLost: no reply, or the port failed or is closed.
            StrikerFault: the board refuses the order.
        """
        reply = self._exchange(REPLY_NS, "fire", speed_mm_s)
        if reply is None:
            return self.status("state")
        if not isinstance(reply, BoardStatus):
            raise self._refused("fire", reply)
        return reply

    def send_stop(self) -> None:
        """Send `stop` at once, also while another thread waits for a reply; nothing is waited for or raised.

        The empty line before it ends a line that another thread may just be sending.
        """
        port = self._serial
        with contextlib.suppress(OSError, termios.error, TypeError):  # TypeError: closed meanwhile
            if port is not None:
                os.write(port.fileno(), b"\n" + request_line(0, "stop"))

    def _ask(self, kind: type[_Reply], *words: object) -> _Reply:
        for _ in range(ATTEMPTS):
            reply = self._exchange(REPLY_NS, *words)
            if isinstance(reply, kind):
                return reply
            if reply is not None:
                raise self._refused(str(words[0]), reply)
        raise self._silent(str(words[0]))

    def _exchange(self, wait_ns: int, *words: object) -> BoardReply | None:
        """Send a request and return the reply to it; None if none arrived within `wait_ns` [ns].

        Raises:
            StrikerLost: the port failed or is closed.
        """
        with self._lock:
            port = self._serial
            if port is None:
                raise StrikerLost(f"{self.port}: the port is closed; home the striker again")
            self._number = self._number % MAX_NUMBER + 1
            try:
                termios.tcflush(port.fileno(), termios.TCIFLUSH)
                os.write(port.fileno(), request_line(self._number, *words))
                return self._wait_for(port.fileno(), self._clock.monotonic_ns() + wait_ns)
            except (OSError, termios.error, TypeError) as error:  # TypeError: pyserial closed its descriptor
                raise StrikerLost(
                    f"{self.port}: the port failed ({error}); plug the board in again, then home the striker"
                ) from None

    def _wait_for(self, descriptor: int, end_ns: int) -> BoardReply | None:
        """Reply to the last request; None if it does not arrive before `end_ns` (host monotonic) [ns]."""
        reader = LineReader()
        while True:
            left_s = (end_ns - self._clock.monotonic_ns()) * 1e-9
            # Bytes that arrived are read even after the end: then this host was late, not the board.
            if not select.select([descriptor], [], [], max(0.0, left_s))[0]:
                return None
            data = os.read(descriptor, 1024)
            if not data:
                raise OSError(errno.EIO, "the port hung up")
            for line in reader.feed(data):
                found = parse_reply(line)
                if found is not None and found[0] == self._number:
                    return found[1]
            if left_s <= 0:
                return None

    def _refused(self, verb: str, reply: BoardReply) -> StrikerFault:
        if isinstance(reply, BoardRefusal):
            return StrikerFault(
                f"{self.port}: the board refuses `{verb}` ({reply.reason}); correct it, then home the striker"
            )
        return StrikerFault(f"{self.port}: the board's reply to `{verb}` does not fit; load its sketch again")

    def _silent(self, verb: str) -> StrikerLost:
        return StrikerLost(f"{self.port}: no reply of the board to `{verb}`; check its cable and supply")
