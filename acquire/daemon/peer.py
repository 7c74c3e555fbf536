"""Process, user and group id of the process at the other end of a unix socket."""

from __future__ import annotations

import socket
import struct
from typing import NamedTuple

_CREDENTIALS = struct.Struct("3i")


class Peer(NamedTuple):
    """Process, user and group id of the process at a socket's other end, from the kernel (SO_PEERCRED)."""

    pid: int
    uid: int
    gid: int


def read_peer(sock: socket.socket) -> Peer:
    """Process, user and group id of the process at the other end of the connected unix socket `sock`."""
    return Peer(
        *_CREDENTIALS.unpack(sock.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _CREDENTIALS.size))
    )
