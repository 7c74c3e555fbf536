"""Relays between GigE Vision clients and Aravis's fake camera that add functions which the fake lacks.

The interposer owns UDP port 3956 of the camera's address and relays control packets (GVCP) to the fake, which
runs in the same process, over loopback, with one relay socket per client so that the fake still distinguishes
its controller from others. On the way it

- answers the timestamp latch (registers that store and return the camera's time: 0x944, 0x948, 0x94c) itself,
  at once;
- keeps a shadow of the frame period (0x138) and, with pulses, of the trigger mode (0x300): the client reads
  back what it wrote, while the fake runs freely with a period of its own, because the rendered images set the
  pace;
- reports when acquisition starts and stops (0x124).

With packet loss it also relays the stream (GVSP), drops packets by a seeded generator, and serves
PACKET_RESEND.

Packet layout: GigE Vision 2.0, chapters 16 (GVCP) and 25 (GVSP).
"""

from __future__ import annotations

import contextlib
import os
import select
import socket
import struct
import threading
from collections import Counter, OrderedDict
from dataclasses import dataclass
from typing import TYPE_CHECKING

from acquire.virtual.camera_makes import USER_SET_LOAD
from acquire.virtual.gige_faults import CameraHabits, FaultyRegisters
from acquire.virtual.gige_sockets import LOOPBACK, udp_socket

if TYPE_CHECKING:
    import random
    from collections.abc import Callable


_READREG, _READREG_ACK, _WRITEREG, _WRITEREG_ACK = 0x80, 0x81, 0x82, 0x83
_READMEM, _READMEM_ACK, _WRITEMEM, _WRITEMEM_ACK = 0x84, 0x85, 0x86, 0x87
_PACKET_RESEND = 0x40
_ACQUISITION, _FRAME_PERIOD, _TRIGGER_MODE = 0x124, 0x138, 0x300
_PRIVILEGE = 0x0A00
_FAKE_VALUES = {_FRAME_PERIOD: 1, _TRIGGER_MODE: 0}
"""values written to the fake instead of the client's"""
_LATCH, _LATCH_HIGH, _LATCH_LOW = 0x944, 0x948, 0x94C
_STREAM_PORT, _STREAM_ADDRESS = 0xD00, 0xD18
_SO_RCVBUFFORCE = 33
_RELAYS = 64
"""largest number of clients, and of requests without an answer"""
_RESEND_FRAMES = 64
"""number of frames kept for PACKET_RESEND"""

HEARTBEAT_READ = bytes.fromhex("4201008000040001") + struct.pack(">I", 0x938)
"""READREG of the heartbeat time-out: changes nothing, but wakes the fake's poll"""

Address = tuple[str, int]


@dataclass(frozen=True)
class Told:
    """Functions that the relay calls on its thread."""

    on_acquisition: Callable[[bool], None]
    """called when acquisition starts (True) or stops (False)"""
    on_claim: Callable[[], None]
    """called before a write to the control privilege reaches the fake camera"""
    on_user_set: Callable[[], None]
    """called when the client loads a user set"""


class ControlRelay:
    """Relay of control packets (GVCP) between clients and Aravis's fake camera, on its own thread.

    It answers the timestamp latch (requests to store and return the camera's time) itself. Does not model:
    write protection of the latch.

    Args:
        control: socket bound to the camera's control port.
        inner: private socket that the fake polls instead of one at the control port.
        device_now_ns: function that returns the time of the camera's clock [ns].
        period_us: frame period at the start [us].
        told: who is told of what the client does.
        habits: what the camera does otherwise; a pulse generator gives it a trigger mode.
    """

    def __init__(
        self,
        control: socket.socket,
        inner: socket.socket,
        device_now_ns: Callable[[], int],
        period_us: int,
        told: Told,
        habits: CameraHabits,
    ) -> None:
        self._control, self._inner = control, inner
        self._inner_address: Address = inner.getsockname()
        self._device_now_ns, self._told = device_now_ns, told
        self._shadows = {_FRAME_PERIOD: period_us}
        if habits.pulses_hz > 0:
            self._shadows[_TRIGGER_MODE] = habits.remembered(_TRIGGER_MODE)
        self._faulty = FaultyRegisters(habits)
        self._latched_ns = 0
        self._stream_address, self._stream_port = "", 0
        self._pending: OrderedDict[tuple[Address, int], tuple[int, int]] = OrderedDict()
        self._relays: OrderedDict[Address, socket.socket] = OrderedDict()
        self._clients: dict[int, Address] = {}
        self._epoll = select.epoll()
        self._epoll.register(control, select.EPOLLIN)
        self._stop_read, self._stop_write = os.pipe()
        self._epoll.register(self._stop_read, select.EPOLLIN)
        self._stream: StreamRelay | None = None
        self._thread = threading.Thread(target=self._run, name="gvcp-relay")

    @property
    def period_us(self) -> int:
        """Frame period set by the client [us], at least 1."""
        return max(1, self._shadows[_FRAME_PERIOD])

    @property
    def triggered(self) -> bool:
        """True if a pulse generator is connected and the client has switched the trigger on."""
        return self._shadows.get(_TRIGGER_MODE, 0) != 0

    def start(self, stream: StreamRelay | None) -> None:
        """Start relaying control packets between clients and the fake camera, on a thread.

        Args:
            stream: relay of the images if some of their packets are to be lost; None if the fake camera sends
                the images itself.
        """
        self._stream = stream
        self._thread.start()

    def close(self) -> None:
        """Stop the relay's thread and close its sockets, the given ones included."""
        os.write(self._stop_write, b"x")
        self._thread.join()
        self._epoll.close()
        os.close(self._stop_read)
        os.close(self._stop_write)
        for relay in self._relays.values():
            relay.close()
        self._control.close()
        self._inner.close()

    def poke(self) -> None:
        """Wake the fake camera's poll with a harmless request, unless a waiting packet wakes it anyway.

        Aravis 0.8.26 computes the poll's waiting time as an unsigned difference; past the deadline it
        underflows, and the fake stalls for 100 ms (fixed upstream in 1ca41a403). A waiting packet makes the
        poll return at once.
        """
        if not select.select([self._inner], [], [], 0)[0]:
            with contextlib.suppress(OSError):
                self._control.sendto(HEARTBEAT_READ, self._inner_address)

    def _run(self) -> None:
        while True:
            for descriptor, _ in self._epoll.poll():
                if descriptor == self._stop_read:
                    return
                with contextlib.suppress(BlockingIOError, ConnectionRefusedError):
                    if descriptor == self._control.fileno():
                        packet, client = self._control.recvfrom(2048)
                        self._from_client(bytearray(packet), client)
                    else:
                        relay = self._relays[self._clients[descriptor]]
                        self._from_fake(bytearray(relay.recv(2048)), self._clients[descriptor])

    def _from_client(self, packet: bytearray, client: Address) -> None:
        if len(packet) < 8 or client == self._inner_address:
            return
        command, _, identity = struct.unpack_from(">HHH", packet, 2)
        if command == _PACKET_RESEND:
            if self._stream is not None and len(packet) >= 20:
                self._stream.resend(*struct.unpack_from(">III", packet, 8))
            return
        if command in (_READREG, _WRITEREG, _READMEM, _WRITEMEM) and len(packet) >= 12:
            (register,) = struct.unpack_from(">I", packet, 8)
            value = struct.unpack_from(">I", packet, 12)[0] if len(packet) >= 16 else 0
            if register in (_LATCH, _LATCH_HIGH, _LATCH_LOW) and command in (_READREG, _WRITEREG):
                self._answer_latch(command, register, value, identity, client)
                return
            if status := self._faulty.refusal(command, register, value):
                self._control.sendto(struct.pack(">HHHH", status, command + 1, 0, identity), client)
                return
            if (test := self._faulty.test_packet(command, register, value)) is not None:
                self._control.sendto(*test)
            if command in (_WRITEREG, _WRITEMEM):
                self._tell(register)
                self._rewrite(packet, register)
            self._pending[client, identity] = (register, value)
            while len(self._pending) > _RELAYS:
                self._pending.popitem(last=False)
        self._relay_for(client).sendto(packet, self._inner_address)

    def _tell(self, register: int) -> None:
        if register == _PRIVILEGE:
            self._told.on_claim()
        elif register == USER_SET_LOAD:
            if _TRIGGER_MODE in self._shadows:
                self._shadows[_TRIGGER_MODE] = 0
            self._told.on_user_set()

    def _rewrite(self, packet: bytearray, register: int) -> None:
        if register in self._shadows:
            struct.pack_into(">I", packet, 12, _FAKE_VALUES[register])
        elif register == _STREAM_PORT and self._stream is not None:
            struct.pack_into(">I", packet, 12, self._stream.port)

    def _from_fake(self, packet: bytearray, client: Address) -> None:
        acknowledged, _, identity = struct.unpack_from(">HHH", packet, 2)
        register, value = self._pending.pop((client, identity), (0, 0))
        if register in self._shadows:
            if acknowledged in (_WRITEREG_ACK, _WRITEMEM_ACK):
                self._shadows[register] = value
            elif acknowledged == _READREG_ACK:
                struct.pack_into(">I", packet, 8, self._shadows[register])
            elif acknowledged == _READMEM_ACK:
                struct.pack_into(">I", packet, 12, self._shadows[register])
        elif acknowledged in (_WRITEREG_ACK, _WRITEMEM_ACK):
            if register == _ACQUISITION:
                self._told.on_acquisition(value != 0)
            elif register in (_STREAM_ADDRESS, _STREAM_PORT) and self._stream is not None:
                self._set_destination(register, value, self._stream)
        self._control.sendto(packet, client)

    def _set_destination(self, register: int, value: int, stream: StreamRelay) -> None:
        if register == _STREAM_ADDRESS:
            self._stream_address = socket.inet_ntoa(struct.pack(">I", value))
        else:
            self._stream_port = value & 0xFFFF
        stream.send_to((self._stream_address, self._stream_port))

    def _answer_latch(self, command: int, register: int, value: int, identity: int, client: Address) -> None:
        if command == _WRITEREG:
            if register == _LATCH and value & 2:
                self._latched_ns = self._device_now_ns()
            answer = struct.pack(">HHHHHH", 0, _WRITEREG_ACK, 4, identity, 0, 1)
        else:
            high, low = self._latched_ns >> 32, self._latched_ns & 0xFFFFFFFF
            content = {_LATCH: 0, _LATCH_HIGH: high, _LATCH_LOW: low}[register]
            answer = struct.pack(">HHHHI", 0, _READREG_ACK, 4, identity, content)
        self._control.sendto(answer, client)

    def _relay_for(self, client: Address) -> socket.socket:
        relay = self._relays.get(client)
        if relay is None:
            relay = self._relays[client] = udp_socket(LOOPBACK)
            self._clients[relay.fileno()] = client
            self._epoll.register(relay, select.EPOLLIN)
            if len(self._relays) > _RELAYS:
                _, oldest = self._relays.popitem(last=False)
                self._epoll.unregister(oldest)
                del self._clients[oldest.fileno()]
                oldest.close()
        else:
            self._relays.move_to_end(client)
        return relay


class StreamRelay:
    """Relay of image packets (GVSP) that drops some at random, on its own thread from construction on.

    It keeps the packets of the last 64 frames to answer resend requests.

    Args:
        packet_loss: probability that a packet is dropped, 0 to 1.
        rng: generator of the losses.
        address: IP address of the camera, from which the packets are sent.

    Raises:
        OSError: the address is not one of this host.
    """

    def __init__(self, packet_loss: float, rng: random.Random, address: str) -> None:
        self._loss, self._rng = packet_loss, rng
        self._socket = udp_socket(LOOPBACK)
        self._socket.setblocking(True)
        try:
            self._socket.setsockopt(socket.SOL_SOCKET, _SO_RCVBUFFORCE, 16 << 20)
        except PermissionError:
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 16 << 20)
        self.port: int = self._socket.getsockname()[1]
        """UDP port on loopback to which the fake camera sends the stream"""
        self._output = udp_socket(address)
        self._output.setblocking(True)
        self.source_port: int = self._output.getsockname()[1]
        """UDP port at the camera's address from which the stream is sent"""
        self.counts: Counter[str] = Counter()
        """numbers of packets sent, dropped, resent and resend_missed (requested again, but no longer kept)"""
        self._destination: Address | None = None
        self._frames: OrderedDict[int, dict[int, bytes]] = OrderedDict()
        self._thread = threading.Thread(target=self._run, name="gvsp-relay")
        self._thread.start()

    def send_to(self, destination: Address) -> None:
        """Set the IP address and port of the client to which images are sent.

        An empty address or port 0 means that no client listens.
        """
        self._destination = destination if destination[0] and destination[1] else None

    def resend(self, frame_id: int, first: int, last: int) -> None:
        """Send packets of a frame again, as far as they are kept; none of them is dropped at random.

        Args:
            frame_id: block id of the frame; its lowest 16 bits are used.
            first: number of the first packet.
            last: number of the last packet; at most 4097 packets are sent.
        """
        frame = self._frames.get(frame_id & 0xFFFF)
        for index in range(first, min(last, first + 4096) + 1):
            packet = None if frame is None else frame.get(index)
            self.counts["resend_missed" if packet is None else "resent"] += 1
            if packet is not None and self._destination is not None:
                self._output.sendto(packet, self._destination)

    def close(self) -> None:
        """Stop the relay's thread and close its socket."""
        with udp_socket(LOOPBACK) as waker:
            waker.sendto(b"", (LOOPBACK, self.port))
        self._thread.join()
        self._socket.close()
        self._output.close()

    def _run(self) -> None:
        while packet := self._socket.recv(65536):
            frame_id, index = struct.unpack_from(">HI", packet, 2)
            index &= 0xFFFFFF
            frame = self._frames.get(frame_id)
            if frame is None:
                frame = self._frames[frame_id] = {}
                while len(self._frames) > _RESEND_FRAMES:
                    self._frames.popitem(last=False)
            frame[index] = packet
            if self._rng.random() < self._loss:
                self.counts["dropped"] += 1
            elif self._destination is not None:
                self._output.sendto(packet, self._destination)
                self.counts["sent"] += 1
