"""Golden packets: the examples of the vendor's e-manual for protocol 2.0 (XM430-W210)."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from acquire.virtual.dynamixel_protocol import Parser, crc16, encode

GOLDEN = [
    ("read", 1, 0x02, "84000400", "FFFFFD0001070002840004001D15"),
    ("read status", 1, 0x55, "00A6000000", "FFFFFD000108005500A60000008CC0"),
    ("write", 1, 0x03, "740000020000", "FFFFFD0001090003740000020000CA89"),
    ("write status", 1, 0x55, "00", "FFFFFD000104005500A10C"),
    ("reg write", 1, 0x04, "6800C8000000", "FFFFFD00010900046800C8000000AE8E"),
    ("action", 1, 0x05, "", "FFFFFD000103000502CE"),
    ("factory reset", 1, 0x06, "01", "FFFFFD000104000601A1E6"),
    ("reboot", 1, 0x08, "", "FFFFFD00010300082F4E"),
    ("clear", 1, 0x10, "0144584C22", "FFFFFD00010800100144584C22B1DC"),
    ("sync read", 0xFE, 0x82, "840004000102", "FFFFFD00FE090082840004000102CEFA"),
    ("sync read status", 2, 0x55, "001F080000", "FFFFFD0002080055001F080000BABE"),
    (
        "sync write",
        0xFE,
        0x83,
        "74000400019600000002AA000000",
        "FFFFFD00FE11008374000400019600000002AA0000008287",
    ),
]


@pytest.mark.parametrize(("name", "servo_id", "instruction", "parameters", "wire"), GOLDEN)
def test_example_packets_of_the_manual(
    name: str, servo_id: int, instruction: int, parameters: str, wire: str
) -> None:
    assert encode(servo_id, instruction, bytes.fromhex(parameters)).hex().upper() == wire
    (packet,) = Parser().feed(bytes.fromhex(wire))
    assert (packet.id, packet.instruction, packet.parameters.hex().upper(), packet.intact) == (
        servo_id,
        instruction,
        parameters,
        True,
    )


def test_the_crc_is_the_buypass_one() -> None:
    assert (
        crc16(b"123456789") == 0xFEE8
    )  # check value of CRC-16/BUYPASS in the catalogue of parametrised CRC algorithms


@given(
    st.lists(st.sampled_from([0x00, 0x01, 0xFC, 0xFD, 0xFE, 0xFF]), max_size=24).map(bytes),
    st.binary(max_size=6),
    st.integers(1, 7),
)
def test_payloads_survive_stuffing_noise_and_fragmentation(
    payload: bytes, rubbish: bytes, piece: int
) -> None:
    wire = encode(1, 0x03, payload)
    parser = Parser()
    stream = rubbish.replace(b"\xff", b"\x00") + wire
    packets = [p for k in range(0, len(stream), piece) for p in parser.feed(stream[k : k + piece])]
    assert b"\xff\xff\xfd" not in wire[4:-2].replace(b"\xff\xff\xfd\xfd", b"")
    if b"\xff\xff\xfd\xfd" not in payload:  # the protocol cannot distinguish this from a stuffed one
        assert [(p.parameters, p.intact) for p in packets] == [(payload, True)]


def test_damaged_packet_is_detected() -> None:
    wire = bytearray(encode(1, 0x02, bytes(4)))
    wire[9] ^= 0x10
    (packet,) = Parser().feed(bytes(wire))
    assert not packet.intact
