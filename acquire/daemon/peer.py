"""Credentials of the process at the other end of a unix socket."""

from __future__ import annotations

import socket
import struct
from typing import NamedTuple

_CREDENTIALS = struct.Struct("3i")


class Peer(NamedTuple):
    """Credentials as the kernel reports them (unix(7), SO_PEERCRED)."""

    pid: int
    uid: int
    gid: int


def read_peer(sock: socket.socket) -> Peer:
    """Read the credentials of the process that is connected to `sock`."""
    return Peer(
        *_CREDENTIALS.unpack(sock.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _CREDENTIALS.size))
    )
