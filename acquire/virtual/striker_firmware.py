"""Program of a virtual striker board: requests in, replies out, interlocks, clock (no port, no mechanics).

Written from docs/reference/striker-protocol.md and independent of the host's parser, so that no mistake is
made on both sides. Not modelled: damaged bytes, a buffer that overflows, a board that is slow to reply.
"""

from __future__ import annotations

import random
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable

NAME = "virtual-board"
SLOWEST_MM_S, FASTEST_MM_S = 80, 900
"""range of tip speeds [mm/s]"""
SILENCE_NS = 400_000_000
"""time without a request after which an armed board disarms itself [ns]"""
ARMED_MAX_MS = 60_000
"""longest arming [ms]"""
CLOCK_ERROR_MAX = 0.005
"""largest relative rate error of the clock: that of a ceramic resonator"""
CLOCK_STEP_US = 4
BOUNCE_NS = 10_000_000
"""time after a contact in which signals of the sensor count as the same contact [ns]"""
LINE_BYTES = 64
"""length of the board's line buffer [bytes]"""


class StrikerFirmware:
    """State of the board: what it was ordered, what it permits, what it timed.

    Args:
        seed: seed of clock rate and clock reading at the start.
        start_ns: host monotonic time at which it is powered [ns].
        fire: called with the tip speed [mm/s] when a strike is fired.
        end_drive: called when the drive is to be switched off.
        is_drawn_back: function that returns True if the striker is drawn back.
    """

    def __init__(
        self,
        seed: int,
        start_ns: int,
        fire: Callable[[int], None],
        end_drive: Callable[[], None],
        is_drawn_back: Callable[[], bool] = lambda: True,
    ) -> None:
        draws = random.Random(seed)  # noqa: S311 - a clock's error, not a secret
        self._rate = 1 + draws.uniform(-CLOCK_ERROR_MAX, CLOCK_ERROR_MAX)
        self._boot_ns = start_ns - draws.randrange(1 << 44)
        self._fire, self._end_drive, self._is_drawn_back = fire, end_drive, is_drawn_back
        self.senses = "contact"
        """what the board measures: none, contact or speed"""
        self.state = "safe"
        """safe, armed (reported as loading until the striker is drawn back), fired or fault"""
        self.fault = ""
        """name of the fault, if there is one"""
        self._line = b""
        self._heard_ns = self._expires_ns = 0
        self._fired_us = self._contact_us = self._contacts = 0
        self._touched_ns = 0

    def microseconds(self, time_ns: int) -> int:
        """Board's clock [us] at the host monotonic time `time_ns`; steps of 4, wraps at 2^32."""
        elapsed = round((time_ns - self._boot_ns) * self._rate / 1000)
        return (elapsed - elapsed % CLOCK_STEP_US) % (1 << 32)

    def receive(self, data: bytes, now_ns: int) -> bytes:
        """Carry out the requests in received bytes, and return the replies.

        Args:
            data: received bytes; a line may be continued by the next call.
            now_ns: host monotonic time [ns].
        """
        replies = b""
        for byte in data:
            if byte != 0x0A:
                self._line = (self._line + bytes([byte]))[: LINE_BYTES + 1]
                continue
            line, self._line = self._line, b""
            body, _, check = line.partition(b"*")
            value = 0
            for each in body:
                value ^= each
            if len(line) > LINE_BYTES or check != b"%02X" % value:
                continue  # damaged lines are not answered
            words = body.decode("ascii", "replace").split()
            if len(words) < 2 or not words[0].isdecimal():
                continue
            self.keep_interlocks(now_ns)
            self._heard_ns = now_ns
            reply = f"{words[0]} {self._reply(words[1], words[2:], now_ns)}".encode("ascii")
            value = 0
            for each in reply:
                value ^= each
            replies += reply + b"*%02X\n" % value
        return replies

    def keep_interlocks(self, now_ns: int) -> None:
        """Disarm an armed board if no request came for 0.4 s or the arming expired (host monotonic) [ns]."""
        if self.state == "armed" and (now_ns - self._heard_ns > SILENCE_NS or now_ns > self._expires_ns):
            self.state = "safe"

    def fail(self, reason: str) -> None:
        """Enter the state fault; `reason` is one word. `stop` ends it."""
        self._end_drive()
        self.state, self.fault = "fault", reason

    def reset(self, now_ns: int) -> None:
        """Start again, as after a loss of power: safe, clock at 0."""
        self._end_drive()
        self.state, self._boot_ns, self._line = "safe", now_ns, b""

    def touch(self, time_ns: int) -> None:
        """Signal of the contact sensor at the host monotonic time `time_ns`."""
        if self.state != "fired" or self.senses == "none":
            return
        if self._contacts == 0:
            self._contact_us = self.microseconds(time_ns)
        if self._contacts == 0 or time_ns - self._touched_ns > BOUNCE_NS:
            self._contacts += 1
        self._touched_ns = time_ns

    def _reply(self, verb: str, arguments: list[str], now_ns: int) -> str:
        """Carry out one request and return the words of the reply."""
        if verb == "hello":
            return f"hello percuss-striker 1 {NAME} {SLOWEST_MM_S} {FASTEST_MM_S} {self.senses}"
        if verb == "time":
            return f"time {self.microseconds(now_ns)}"
        if verb == "stop":
            self._end_drive()
            self.state, self.fault = "safe", ""
        elif verb in {"arm", "fire"} and (refusal := self._refusal(verb, arguments)):
            return f"refused {refusal}"
        elif verb == "arm":
            self.state, self._contacts, self._contact_us = "armed", 0, 0
            self._expires_ns = now_ns + 1_000_000 * min(int(arguments[0]), ARMED_MAX_MS)
        elif verb == "fire":
            self.state, self._fired_us = "fired", self.microseconds(now_ns)
            self._fire(int(arguments[0]))
        return self._status() if verb in {"stop", "arm", "fire", "state"} else "refused verb"

    def _refusal(self, verb: str, arguments: list[str]) -> str:
        """Reason for which the board does not arm or fire; "" if it does."""
        if self.state == "fault":
            return self.fault
        if verb == "fire" and (self.state != "armed" or not self._is_drawn_back()):
            return "not-armed"
        if len(arguments) != 1 or not arguments[0].isdecimal():
            return "argument"
        if verb == "fire" and not SLOWEST_MM_S <= int(arguments[0]) <= FASTEST_MM_S:
            return "speed"
        return ""

    def _status(self) -> str:
        if self.state == "fault":
            return f"fault {self.fault}"
        state = "loading" if self.state == "armed" and not self._is_drawn_back() else self.state
        return f"{state} {self._fired_us} {self._contacts} {self._contact_us} 0 0"
