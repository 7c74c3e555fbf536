"""Virtual USB device: the end of the transfers that the stand-in for libusb sends over a Unix socket.

What the device sends at an endpoint is a row of packets, each of which ends with a short USB packet: a
transfer takes what is left of the first one, at most its own length. Packets wait until a transfer asks for
them, and transfers until there is a packet.
"""

from __future__ import annotations

import contextlib
import os
import selectors
import socket
import struct
import threading
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from acquire.errors import CameraError

CONTROL_OUT, CONTROL_IN, STREAM_IN = 0x01, 0x81, 0x83
"""endpoints of a USB3 Vision device"""
ACCESS, BUSY = -3, -6
"""errors of libusb: the user may not open the device; another program has claimed it"""
_OPEN, _CLAIM, _RELEASE, _CLEAR_HALT, _SET_HALT, _STRING, _OUT, _IN, _CANCEL = range(1, 10)
_REQUEST: Final = struct.Struct("<IIII")
"""operation, id, argument (endpoint, interface or number of a string), length"""
_ANSWER: Final = struct.Struct("<IiI")
"""id of the request, status, length of the data"""
_COMPLETED, _CANCELLED, _OVERFLOW = 0, 3, 6
"""ends of a transfer"""
_WIRE_BYTES = 1024
"""bytes of a whole USB packet"""
_RECEIVE_BYTES = 1 << 16

Packet = bytes | memoryview


@dataclass(eq=False)
class _Client:
    """Program that has opened the device."""

    socket: socket.socket
    received: bytes = b""
    claimed: set[int] = field(default_factory=set[int])


@dataclass(eq=False)
class _Endpoint:
    """Packets that wait for transfers, and transfers that wait for packets; one of the two is empty."""

    packets: deque[Packet] = field(default_factory=deque[Packet])
    transfers: deque[tuple[_Client, int, int]] = field(default_factory=deque[tuple[_Client, int, int]])
    """program, id and length"""


class UsbDevice:
    """USB device that is plugged in from construction to `close`.

    Does not model: time on the wire, halted endpoints, several configurations.

    Args:
        path: path of its socket.
        texts: its strings by number, from 1 on.
        answer: called on the device's thread with a command of the control channel; returns what is sent
            back, packet by packet.
        open_status: status with which programs are refused; 0 if they may open it.

    Raises:
        CameraError: the socket cannot be made.
    """

    def __init__(
        self, path: Path, texts: tuple[str, ...], answer: Callable[[bytes], list[bytes]], open_status: int = 0
    ) -> None:
        self._path, self._texts, self._answer, self._open_status = path, texts, answer, open_status
        self._lock = threading.Lock()
        self._endpoints = {CONTROL_IN: _Endpoint(), STREAM_IN: _Endpoint()}
        self._clients: set[_Client] = set()
        self._claims: dict[int, _Client] = {}
        self._listener = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.unlink(missing_ok=True)
            self._listener.bind(str(path))
        except OSError as error:
            self._listener.close()
            raise CameraError(f"virtual USB device: no socket at {path} ({error}): choose a folder") from None
        self._listener.listen()
        self._selector = selectors.DefaultSelector()
        self._selector.register(self._listener, selectors.EVENT_READ)
        self._stop_read, self._stop_write = os.pipe()
        self._selector.register(self._stop_read, selectors.EVENT_READ)
        self._thread = threading.Thread(target=self._serve, name="usb-device")
        self._thread.start()

    def send(self, endpoint: int, *packets: Packet) -> None:
        """Send packets at an endpoint, as transfers ask for them."""
        with self._lock:
            self._endpoints[endpoint].packets.extend(packets)
            self._move(endpoint)

    def unsent_packets(self, endpoint: int) -> int:
        """Number of packets at an endpoint for which no transfer has asked yet."""
        return len(self._endpoints[endpoint].packets)

    def drop_packets(self, endpoint: int) -> None:
        """Drop the packets at an endpoint for which no transfer has asked yet."""
        with self._lock:
            self._endpoints[endpoint].packets.clear()

    def close(self) -> None:
        """Unplug the device: transfers fail, and programs are told that it left. May be repeated."""
        if self._thread.is_alive():
            os.write(self._stop_write, b"x")
            for client in list(self._clients):
                with contextlib.suppress(OSError):
                    client.socket.shutdown(socket.SHUT_RDWR)
            self._thread.join()
            self._path.unlink(missing_ok=True)
            for descriptor in (self._stop_read, self._stop_write):
                os.close(descriptor)

    def _serve(self) -> None:
        while True:
            for key, _ in self._selector.select():
                if key.fileobj is self._listener:
                    client = _Client(self._listener.accept()[0])
                    self._clients.add(client)
                    self._selector.register(client.socket, selectors.EVENT_READ, client)
                elif key.data is None:
                    for client in list(self._clients):
                        self._forget(client)
                    self._selector.close()
                    self._listener.close()
                    return
                elif not self._receive(key.data):
                    self._forget(key.data)

    def _receive(self, client: _Client) -> bool:
        """Read and serve requests of a program; False if it has closed the device."""
        try:
            data = client.socket.recv(_RECEIVE_BYTES)
        except OSError:
            return False
        client.received += data
        while len(client.received) >= _REQUEST.size:
            operation, number, argument, length = _REQUEST.unpack_from(client.received)
            end = _REQUEST.size + (length if operation == _OUT else 0)
            if len(client.received) < end:
                break
            content, client.received = client.received[_REQUEST.size : end], client.received[end:]
            self._serve_request(client, operation, number, argument, length, content)
        return bool(data)

    def _serve_request(
        self, client: _Client, operation: int, number: int, argument: int, length: int, content: bytes
    ) -> None:
        if operation == _OUT:
            packets = self._answer(content)
            with self._lock:
                self._complete(client, number)
            self.send(CONTROL_IN, *packets)
            return
        with self._lock:
            if operation == _IN:
                self._endpoints[argument].transfers.append((client, number, length))
                self._move(argument)
            elif operation == _CANCEL:
                self._cancel(client, number)
            elif operation == _STRING:
                text = self._texts[argument - 1].encode() if argument <= len(self._texts) else b""
                self._complete(client, number, text[:length])
            elif operation == _CLAIM:
                owner = self._claims.setdefault(argument, client)
                self._complete(client, number, status=0 if owner is client else BUSY)
            else:
                if operation == _RELEASE and self._claims.get(argument) is client:
                    del self._claims[argument]
                if operation == _CLEAR_HALT:
                    self._endpoints[argument].packets.clear()
                self._complete(client, number, status=self._open_status if operation == _OPEN else 0)

    def _move(self, endpoint: int) -> None:
        """Give packets to transfers; the caller holds the lock, here and below."""
        waiting = self._endpoints[endpoint]
        while waiting.packets and waiting.transfers:
            client, number, length = waiting.transfers.popleft()
            packet = waiting.packets.popleft()
            whole = length // _WIRE_BYTES * _WIRE_BYTES
            if len(packet) > length > whole:  # the USB packet that does not fit is lost
                rest = packet[whole + _WIRE_BYTES :]
                self._complete(client, number, packet[:whole], _OVERFLOW)
            else:
                rest = packet[length:]
                self._complete(client, number, packet[:length])
            if rest:
                waiting.packets.appendleft(rest)

    def _cancel(self, client: _Client, number: int) -> None:
        for waiting in self._endpoints.values():
            for transfer in waiting.transfers:
                if transfer[:2] == (client, number):
                    waiting.transfers.remove(transfer)
                    self._complete(client, number, status=_CANCELLED)
                    return

    def _complete(self, client: _Client, number: int, data: Packet = b"", status: int = _COMPLETED) -> None:
        head = _ANSWER.pack(number, status, len(data))
        with contextlib.suppress(OSError):  # the program has gone
            sent = client.socket.sendmsg([head, data])
            if sent < len(head) + len(data):
                client.socket.sendall((head + bytes(data))[sent:])

    def _forget(self, client: _Client) -> None:
        with self._lock:
            self._selector.unregister(client.socket)
            client.socket.close()
            self._clients.discard(client)
            self._claims = {number: owner for number, owner in self._claims.items() if owner is not client}
            for waiting in self._endpoints.values():
                waiting.transfers = deque(each for each in waiting.transfers if each[0] is not client)
