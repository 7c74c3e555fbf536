"""The UDP socket on which Aravis receives an image stream, found among this process's open files.

Aravis gives access to the socket's port only, and options that it does not offer must be set on the socket.
"""

from __future__ import annotations

import os
import socket
from typing import TYPE_CHECKING

from acquire.errors import CameraError

if TYPE_CHECKING:
    from collections.abc import Iterator


def find_udp_socket(port: int) -> socket.socket:
    """Duplicate of this process's IPv4 UDP socket that is bound to `port`.

    The caller closes the duplicate; the socket itself stays open.

    Raises:
        CameraError: this process has no such socket.
    """
    for candidate in _sockets():
        if _is_bound_to(candidate, port):
            return candidate
        candidate.close()
    raise CameraError(
        f"the image stream's socket (UDP port {port}) is not found: check that /proc is mounted"
    )


def _sockets() -> Iterator[socket.socket]:
    """Yield a duplicate of each socket that this process has open; the caller closes the duplicate."""
    for name in os.listdir("/proc/self/fd"):  # noqa: PTH208 - iterdir fails on descriptors that vanish
        duplicate = -1
        try:
            if os.readlink(f"/proc/self/fd/{name}").startswith("socket:"):  # noqa: PTH115 - not a path
                duplicate = os.dup(int(name))
                yield socket.socket(fileno=duplicate)
        except OSError:
            if duplicate >= 0:
                os.close(duplicate)


def _is_bound_to(candidate: socket.socket, port: int) -> bool:
    try:
        return (
            candidate.family == socket.AF_INET
            and candidate.type == socket.SOCK_DGRAM
            and candidate.getsockname()[1] == port
        )
    except OSError:
        return False
