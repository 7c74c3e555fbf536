"""Size of the receive buffer of an image stream's UDP socket.

Linux's default (212 kB) is less than one frame: 4 to 22 % of the frames arrive complete at 120 fps (Aravis
#894). Aravis's own `socket-buffer` property is silently capped by net.core.rmem_max (Aravis #898), so the
option is set on the socket itself and read back.
"""

from __future__ import annotations

import os
import socket
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator

SO_RCVBUFFORCE = 33
"""number of the socket option that is not limited by net.core.rmem_max; it needs CAP_NET_ADMIN"""


def enlarge_receive_buffer(port: int, size_bytes: int) -> int:
    """Enlarge the receive buffer of this process's UDP socket that is bound to `port`.

    Without the privilege to exceed net.core.rmem_max the size is limited by it.

    Args:
        port: UDP port of the socket.
        size_bytes: wanted size [bytes].

    Returns:
        The effective size [bytes]: half of Linux's figure, which includes its bookkeeping. 0 if this process
        has no such socket.
    """
    for stream in _sockets():
        with stream:
            if _is_bound_to(stream, port):
                try:
                    stream.setsockopt(socket.SOL_SOCKET, SO_RCVBUFFORCE, size_bytes)
                except PermissionError:
                    stream.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, size_bytes)
                return stream.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF) // 2
    return 0


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
