"""Lines of the striker board's protocol: what the emulator sends is understood, anything else is refused."""

from __future__ import annotations

import itertools

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from acquire.striker.board_lines import (
    MAX_LINE_BYTES,
    BoardIdentity,
    BoardRefusal,
    BoardState,
    BoardStatus,
    BoardTime,
    LineReader,
    checksum,
    parse_reply,
    request_line,
)
from acquire.virtual.striker_firmware import StrikerFirmware

QUICK = settings(max_examples=200, derandomize=True, deadline=None)


def framed(body: str) -> bytes:
    return f"{body}*{checksum(body.encode()):02X}".encode()


def ask(board: StrikerFirmware, *words: object) -> object:
    (line,) = board.receive(request_line(7, *words), 1_000_000_000).splitlines()
    found = parse_reply(line)
    assert found is not None
    assert found[0] == 7
    return found[1]


@pytest.mark.parametrize(
    ("line", "reply"),
    [
        (
            "1 hello percuss-striker 1 reference 100 600 contact",
            BoardIdentity(1, "reference", 100, 600, senses_contact=True, measures_speed=False),
        ),
        ("99 time 4294967295", BoardTime(4_294_967_295)),
        ("3 safe 0 0 0 0 0", BoardStatus(BoardState.SAFE)),
        ("3 fired 52 1 80052 301 4", BoardStatus(BoardState.FIRED, 52, 1, 80_052, 301, 4)),
        ("4 fault overload", BoardStatus(BoardState.FAULT, reason="overload")),
        ("5 refused not-armed", BoardRefusal("not-armed")),
        (
            "6 hello percuss-striker 2 whatever follows",
            BoardIdentity(2, "", 0, 0, senses_contact=False, measures_speed=False),
        ),
    ],
)
def test_lines_of_the_page(line: str, reply: object) -> None:
    found = parse_reply(framed(line))
    assert found is not None
    assert found[1] == reply
    assert parse_reply(framed(line) + b"\r") == found


@pytest.mark.parametrize(
    "line",
    [
        "",
        "1",
        "1 time",
        "1 time -1",
        "1 time 4294967296",
        "1 time 1 2",
        "1 time \u0661",
        "1 armed 0 0 0 0",
        "1 armed 0 0 0 0 0 0",
        "1 ARMED 0 0 0 0 0",
        "1 fault",
        "1 fault two words",
        "1 hello percuss-striker 1 x 600 100 contact",
        "1 hello percuss-striker 1 x 0 100 contact",
        "1 hello percuss-striker 1 x 100 600 touch",
        "1 hello another-program 1 x 100 600 none",
        "123 time 5",
        "a time 5",
    ],
)
def test_what_is_no_reply_is_refused(line: str) -> None:
    assert parse_reply(framed(line)) is None


@QUICK
@given(data=st.binary(max_size=120), cuts=st.lists(st.integers(0, 120), max_size=4))
def test_any_bytes_in_any_pieces_give_only_short_lines(data: bytes, cuts: list[int]) -> None:
    reader = LineReader()
    ends = [0, *sorted(cuts), len(data)]
    lines = [line for a, b in itertools.pairwise(ends) for line in reader.feed(data[a:b])]
    assert all(len(line) <= MAX_LINE_BYTES and b"\n" not in line for line in lines)
    for line in lines:
        parse_reply(line)


@QUICK
@given(
    number=st.integers(0, 99),
    fields=st.tuples(
        st.sampled_from(["safe", "loading", "armed", "fired"]),
        st.integers(0, (1 << 32) - 1),
        st.integers(0, 999),
        st.integers(0, (1 << 32) - 1),
        st.integers(0, 99_999),
        st.integers(0, 99_999),
    ),
    place=st.integers(0, 200),
    byte=st.integers(1, 255),
)
def test_one_changed_byte_is_noticed(number: int, fields: tuple[object, ...], place: int, byte: int) -> None:
    line = framed(f"{number} {' '.join(map(str, fields))}")
    found = parse_reply(line)
    assert found is not None
    assert found[0] == number
    at = place % len(line)
    changed = line[:at] + bytes([line[at] ^ byte]) + line[at + 1 :]
    assert parse_reply(changed) is None


@QUICK
@given(data=st.binary(max_size=200))
def test_the_virtual_board_takes_any_bytes(data: bytes) -> None:
    fired: list[int] = []
    board = StrikerFirmware(1, 0, fired.append, lambda: None)
    board.receive(data + b"\n", 5)
    assert fired == []
    assert ask(board, "state") == BoardStatus(BoardState.SAFE)


@QUICK
@given(
    words=st.lists(st.text(st.characters(codec="ascii", exclude_characters="*\n"), max_size=12), max_size=4)
)
def test_the_virtual_board_answers_every_whole_request(words: list[str]) -> None:
    board = StrikerFirmware(1, 0, lambda _speed: None, lambda: None)
    reply = board.receive(request_line(9, *words)[:64], 5)
    for line in reply.splitlines():
        assert parse_reply(line) is not None


def test_interlocks_of_the_virtual_board() -> None:
    fired: list[int] = []
    board = StrikerFirmware(1, 0, fired.append, lambda: None)
    at = 1_000_000_000

    def state(*words: object) -> object:
        found = parse_reply(board.receive(request_line(1, *words), at).strip())
        assert found is not None
        return found[1].state.value if isinstance(found[1], BoardStatus) else found[1]

    assert state("fire", 300) == BoardRefusal("not-armed")
    assert state("arm", 20_000) == "armed"
    at += 390_000_000
    assert state("state") == "armed"
    at += 410_000_000
    assert state("fire", 300) == BoardRefusal("not-armed")  # silent for more than 0.4 s
    assert state("arm", 300) == "armed"
    at += 310_000_000
    assert state("fire", 300) == BoardRefusal("not-armed")  # the arming expired
    assert state("arm", 20_000) == "armed"
    assert state("fire", 79) == BoardRefusal("speed")
    assert state("fire", 300) == "fired"
    assert state("fire", 300) == BoardRefusal("not-armed")  # one strike per arming
    assert fired == [300]
