"""Lines between host and striker board: requests, replies, checksum (docs/reference/striker-protocol.md).

A line is printable ASCII, `NUMBER WORDS*CHECKSUM` and a line feed. The checksum is the exclusive or of all
bytes before the asterisk, as two hexadecimal digits. A reply repeats the number of its request.
"""

from __future__ import annotations

import enum
import re
from dataclasses import dataclass

PROTOCOL = 1
"""version of the protocol that this program implements"""
MAX_LINE_BYTES = 96
"""longest line, without its end [bytes]; longer ones are noise"""
MAX_NUMBER = 99
"""largest number of a request; 0 is that of requests whose reply nobody waits for"""
MAX_MICROSECONDS = (1 << 32) - 1
"""largest time on the board's clock [us], which wraps to 0 after it"""
_NAME = re.compile(r"[A-Za-z0-9._-]{1,32}")
_FRAME = re.compile(rb"([0-9]{1,2}) ([ -)+-~]{1,80})\*([0-9A-F]{2})")


class BoardState(enum.Enum):
    """State of the board.

    SAFE: nothing is driven, and nothing can be fired. LOADING: armed, but the striker is not drawn back yet.
    ARMED: one strike can be fired. FIRED: that strike was fired. FAULT: the board refuses to be armed.
    """

    SAFE = "safe"
    LOADING = "loading"
    ARMED = "armed"
    FIRED = "fired"
    FAULT = "fault"


@dataclass(frozen=True)
class BoardIdentity:
    """Reply to `hello`: protocol version, name, speeds that can be fired, and what the board measures."""

    protocol: int
    """version of the protocol"""
    name: str
    """name that the board's program gives itself"""
    slowest_mm_s: int
    """slowest tip speed that it takes [mm/s]"""
    fastest_mm_s: int
    """fastest tip speed that it takes [mm/s]"""
    senses_contact: bool
    """True if it measures the time of contact"""
    measures_speed: bool
    """True if it also measures the tip speed just before contact"""


@dataclass(frozen=True)
class BoardTime:
    """Reply to `time`: the board's clock [us], which wraps at 2^32."""

    microseconds: int
    """reading of the clock [us]"""


@dataclass(frozen=True)
class BoardStatus:
    """Reply to all other requests: state, and the measurements of the strike fired last."""

    state: BoardState
    """state after the request"""
    fired_us: int = 0
    """board's clock when the drive was switched on [us]; valid in state FIRED"""
    contacts: int = 0
    """number of contacts since then; 0 if none, or if the board senses none"""
    contact_us: int = 0
    """board's clock at the first of them [us]"""
    speed_mm_s: int = 0
    """measured tip speed just before contact [mm/s]; 0 if it was not measured"""
    speed_sd_mm_s: int = 0
    """standard deviation of it [mm/s]"""
    reason: str = ""
    """name of the fault in state FAULT"""


@dataclass(frozen=True)
class BoardRefusal:
    """Reply to a request that the board does not carry out, with the reason in one word."""

    reason: str
    """reason, for example not-armed"""


BoardReply = BoardIdentity | BoardTime | BoardStatus | BoardRefusal


def request_line(number: int, *words: object) -> bytes:
    """Bytes of a request, with checksum and line feed.

    Args:
        number: number of the request, 0 to MAX_NUMBER.
        *words: verb and arguments.
    """
    body = " ".join(map(str, (number, *words))).encode("ascii")
    return body + b"*%02X\n" % checksum(body)


def checksum(body: bytes) -> int:
    """Exclusive or of all bytes of a line before its asterisk."""
    value = 0
    for byte in body:
        value ^= byte
    return value


def parse_reply(line: bytes) -> tuple[int, BoardReply] | None:
    """Number and content of a reply; None if the line is damaged or is no reply of this protocol.

    Args:
        line: bytes of the line without its line feed; a carriage return at the end is ignored.
    """
    frame = _FRAME.fullmatch(line.removesuffix(b"\r"))
    if frame is None or checksum(line.partition(b"*")[0]) != int(frame[3], 16):
        return None
    first, *words = frame[2].decode("ascii").split(" ")
    reply: BoardReply | None
    match first:
        case "hello":
            reply = _identity(words)
        case "time":
            numbers = _numbers(words, (MAX_MICROSECONDS,))
            reply = None if numbers is None else BoardTime(*numbers)
        case "refused":
            reply = BoardRefusal(words[0]) if len(words) == 1 and _NAME.fullmatch(words[0]) else None
        case _:
            reply = _status(first, words)
    return None if reply is None else (int(frame[1]), reply)


def _identity(words: list[str]) -> BoardIdentity | None:
    """Identity from the words after `hello`; None if they are not one.

    Of another version of the protocol only the first two words are read.
    """
    if len(words) < 2 or words[0] != "percuss-striker":
        return None
    version = _numbers(words[1:2], (9999,))
    if version is None:
        return None
    if version[0] != PROTOCOL:
        return BoardIdentity(version[0], "", 0, 0, senses_contact=False, measures_speed=False)
    speeds = _numbers(words[3:5], (99_999, 99_999))
    if len(words) != 6 or speeds is None or not _NAME.fullmatch(words[2]):
        return None
    if words[5] not in {"none", "contact", "speed"} or not 0 < speeds[0] <= speeds[1]:
        return None
    return BoardIdentity(
        PROTOCOL,
        words[2],
        *speeds,
        senses_contact=words[5] != "none",
        measures_speed=words[5] == "speed",
    )


def _status(name: str, words: list[str]) -> BoardStatus | None:
    state = next((each for each in BoardState if each.value == name), None)
    if state is BoardState.FAULT:
        valid = len(words) == 1 and _NAME.fullmatch(words[0])
        return BoardStatus(state, reason=words[0]) if valid else None
    numbers = _numbers(words, (MAX_MICROSECONDS, 999, MAX_MICROSECONDS, 99_999, 99_999))
    if state is None or numbers is None:
        return None
    fired_us, contacts, contact_us, speed, speed_sd = numbers
    return BoardStatus(state, fired_us, contacts, contact_us, speed, speed_sd)


def _numbers(words: list[str], largest: tuple[int, ...]) -> list[int] | None:
    """Numbers in decimal digits, one per word; None if there are more or fewer, or one exceeds its limit."""
    if len(words) != len(largest):
        return None
    if not all(word.isascii() and word.isdecimal() and len(word) <= 10 for word in words):
        return None
    numbers = [int(word) for word in words]
    return numbers if all(a <= b for a, b in zip(numbers, largest, strict=True)) else None


class LineReader:
    """Lines cut from received bytes; an overlong one is dropped up to its end."""

    def __init__(self) -> None:
        self._rest = b""
        self._overlong = False

    def feed(self, data: bytes) -> list[bytes]:
        """Lines that are complete with these bytes, without their line feeds."""
        *lines, rest = (self._rest + data).split(b"\n")
        if lines and self._overlong:
            self._overlong = False
            del lines[0]
        if len(rest) > MAX_LINE_BYTES:
            self._overlong, rest = True, b""
        self._rest = rest
        return [line for line in lines if len(line) <= MAX_LINE_BYTES]
