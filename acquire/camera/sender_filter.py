"""Filter of an image stream's packets by their sender, and a count of those that are not the camera's.

Aravis checks a packet's sender only on its packet socket, which is not used here (it quantises arrival
times); on the ordinary socket any sender's packets become frames. So that socket is connected to the camera:
the kernel then gives it the camera's packets only. A second socket at the same address and port receives all
the others. It is seldom read, and costs no more than its small buffer, however many packets arrive: those
that do not fit are counted by the kernel.

A sender that forges the camera's address and port passes: GVSP has no signature (SECURITY.md).
"""

from __future__ import annotations

import os
import socket
import struct
from collections import Counter
from dataclasses import dataclass
from typing import Final

SO_MEMINFO: Final = 55
"""number of the socket option that reads a socket's memory figures, nine 32-bit integers"""
_DROPS_AT: Final = 8
"""index among the figures of SO_MEMINFO: packets that the kernel dropped for this socket"""
_BUFFER_BYTES: Final = 64 << 10
_LARGEST_READ: Final = 1000
"""largest number of packets read at a time; the buffer holds fewer, unless they arrive while it is read"""


@dataclass(frozen=True)
class ForeignPackets:
    """Packets that arrived on an image stream's port from other senders than its camera."""

    count: int = 0
    """number of packets"""
    sender: tuple[str, int] | None = None
    """IP address and port of the sender seen most often; None if none was seen"""


class SenderFilter:
    """Filter that leaves an image stream's socket only the packets of its camera, and counts all others.

    The stream's socket is filtered from construction on, until it is closed by its owner.

    Args:
        stream: the stream's UDP socket, bound; the filter keeps a duplicate of it.
        address: IP address of the camera.
        port: UDP port from which the camera sends images; 0 if unknown: only the address is checked then.

    Raises:
        OSError: the kernel refuses.
    """

    def __init__(self, stream: socket.socket, address: str, port: int) -> None:
        self.address, self.port = address, port
        self._drops = 0
        # Not stream.dup(): that would make the socket blocking, and Aravis's thread would never end.
        self._stream = socket.socket(fileno=os.dup(stream.fileno()))
        self._others = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            # Linux compares only those parts of the peer's address that are set: port 0 means any.
            self._stream.connect((address, port))
            self._others.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _BUFFER_BYTES)
            self._others.setblocking(False)
            self._share_port()
        except OSError:
            self.close()
            raise

    def _share_port(self) -> None:
        """Bind the second socket to the stream's address and port, and let no other program do the same."""
        both = self._stream, self._others
        for each in both:
            each.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        self._others.bind(self._stream.getsockname())
        for each in both:
            each.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 0)

    def accept_any_port(self) -> None:
        """Check only the address of packets from now on, for a camera that states a wrong port."""
        self.port = 0
        self._stream.connect((self.address, 0))

    def take_foreign_packets(self) -> ForeignPackets:
        """Packets of other senders than the camera since the last call, or since construction."""
        senders: Counter[tuple[str, int]] = Counter()
        for _ in range(_LARGEST_READ):
            try:
                senders[self._others.recvfrom(1)[1]] += 1
            except OSError:
                break
        memory = self._others.getsockopt(socket.SOL_SOCKET, SO_MEMINFO, 4 * (_DROPS_AT + 1))
        drops = struct.unpack_from("I", memory, 4 * _DROPS_AT)[0]
        dropped, self._drops = (drops - self._drops) % (1 << 32), drops
        first = next(iter(senders.most_common(1)), None)
        return ForeignPackets(senders.total() + dropped, None if first is None else first[0])

    def close(self) -> None:
        """Close the filter's own sockets. May be repeated."""
        self._stream.close()
        self._others.close()
