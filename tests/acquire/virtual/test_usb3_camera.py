"""Commands, transfers and library of the virtual USB3 Vision camera, without Aravis."""

from __future__ import annotations

import socket
import struct
from collections.abc import Iterator
from pathlib import Path

import pytest

from acquire.errors import CameraError
from acquire.virtual.usb3_registers import (
    ACCESS_DENIED,
    FEATURES,
    INVALID_ADDRESS,
    WRITE_PROTECT,
    ControlChannel,
    RegisterError,
    Registers,
)
from acquire.virtual.usb_device import CONTROL_IN, CONTROL_OUT, STREAM_IN, UsbDevice
from acquire.virtual.usb_library import compile_library

READ, WRITE, PENDING, NOT_THERE = 0x800, 0x802, 0x805, 0x900
OUT, IN, CANCEL = 7, 8, 9
COMPLETED, CANCELLED, OVERFLOW = 0, 3, 6
XML = "<RegisterDescription/>"


def command(code: int, address: int, content: bytes) -> bytes:
    body = struct.pack("<Q", address) + content
    return struct.pack("<4sHHHH", b"U3VC", 1 << 14, code, len(body), 7) + body


def answers(packets: list[bytes]) -> list[tuple[int, int, bytes]]:
    """Status, command and content of each packet."""
    heads = [struct.unpack_from("<4sHHHH", packet) for packet in packets]
    assert all((head[0], head[4]) == (b"U3VC", 7) for head in heads)
    return [(head[1], head[2], packet[12:]) for head, packet in zip(heads, packets, strict=True)]


@pytest.fixture
def channel() -> ControlChannel:
    def on_write(address: int, value: int) -> bool:
        if value == 13:
            raise RegisterError(ACCESS_DENIED)
        return address == FEATURES + 4

    return ControlChannel(Registers(XML, {"DeviceModelName": "M1"}), on_write)


def test_commands_are_answered_with_content_or_status(channel: ControlChannel) -> None:
    def asked(code: int, address: int, content: bytes) -> list[tuple[int, int, bytes]]:
        return answers(channel.answer(command(code, address, content)))

    assert asked(READ, 0x44, struct.pack("<HH", 0, 4)) == [(0, READ + 1, b"M1\0\0")]
    assert asked(WRITE, FEATURES, b"\1\0\0\0") == [(0, WRITE + 1, struct.pack("<HH", 0, 4))]
    assert asked(READ, FEATURES, struct.pack("<HH", 0, 4)) == [(0, READ + 1, b"\1\0\0\0")]
    assert asked(WRITE, FEATURES, b"\x0d\0\0\0") == [(ACCESS_DENIED, WRITE + 1, b"")]
    assert asked(WRITE, 0x44, b"M2\0\0") == [(WRITE_PROTECT, WRITE + 1, b"")]
    assert asked(READ, 0x9000, struct.pack("<HH", 0, 4)) == [(INVALID_ADDRESS, READ + 1, b"")]
    assert [each[1] for each in asked(WRITE, FEATURES + 4, b"\1\0\0\0")] == [PENDING, WRITE + 1]
    assert asked(NOT_THERE, 0, b"")[0][0] == 0x8001


class Transfers:
    """The stand-in's side of a device's socket."""

    def __init__(self, path: Path) -> None:
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        self._socket.settimeout(5.0)
        self._socket.connect(str(path))

    def ask(self, operation: int, number: int, argument: int, length: int, content: bytes = b"") -> None:
        self._socket.sendall(struct.pack("<IIII", operation, number, argument, length) + content)

    def end(self) -> tuple[int, int, bytes]:
        """Id, status and data of the next transfer that ends."""
        number, status, length = struct.unpack("<IiI", self._socket.recv(12, socket.MSG_WAITALL))
        return number, status, self._socket.recv(length, socket.MSG_WAITALL) if length else b""

    def close(self) -> None:
        self._socket.close()


@pytest.fixture
def device(tmp_path: Path) -> Iterator[UsbDevice]:
    made = UsbDevice(tmp_path / "bus.sock", ("maker",), lambda data: [data.upper()])
    yield made
    made.close()
    made.close()


@pytest.fixture
def transfers(device: UsbDevice, tmp_path: Path) -> Iterator[Transfers]:
    made = Transfers(tmp_path / "bus.sock")
    yield made
    made.close()


def test_transfers_take_packets_in_order_and_wait_for_them(device: UsbDevice, transfers: Transfers) -> None:
    transfers.ask(IN, 1, STREAM_IN, 2048)
    transfers.ask(IN, 2, STREAM_IN, 1024)
    transfers.ask(OUT, 3, CONTROL_OUT, 2, b"ab")
    assert transfers.end() == (3, COMPLETED, b"")
    transfers.ask(IN, 4, CONTROL_IN, 64)
    assert transfers.end() == (4, COMPLETED, b"AB")
    device.send(STREAM_IN, b"x" * 2100, b"y")
    assert transfers.end() == (1, COMPLETED, b"x" * 2048)
    assert transfers.end() == (2, COMPLETED, b"x" * 52)
    assert device.unsent_packets(STREAM_IN) == 1
    transfers.ask(IN, 5, STREAM_IN, 64)
    assert transfers.end() == (5, COMPLETED, b"y")
    transfers.ask(IN, 6, STREAM_IN, 64)
    transfers.ask(CANCEL, 6, 0, 0)
    assert transfers.end() == (6, CANCELLED, b"")


def test_a_usb_packet_that_does_not_fit_is_lost(device: UsbDevice, transfers: Transfers) -> None:
    device.send(STREAM_IN, b"a" * 1024 + b"b" * 1024 + b"c" * 10)
    transfers.ask(IN, 1, STREAM_IN, 1500)
    transfers.ask(IN, 2, STREAM_IN, 1500)
    assert transfers.end() == (1, OVERFLOW, b"a" * 1024)
    assert transfers.end() == (2, COMPLETED, b"c" * 10)


def test_a_missing_compiler_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(CameraError, match="needs a C compiler: install Debian's gcc"):
        compile_library(tmp_path / "usb")
