"""Size of the receive buffer of an image stream's UDP socket.

Linux's default (212 kB) is less than one frame: 4 to 22 % of the frames arrive complete at 120 fps (Aravis
#894). Aravis's own `socket-buffer` property is silently capped by net.core.rmem_max (Aravis #898), so the
option is set on the socket itself and read back.
"""

from __future__ import annotations

import socket

SO_RCVBUFFORCE = 33
"""number of the socket option that is not limited by net.core.rmem_max; it needs CAP_NET_ADMIN"""


def enlarge_receive_buffer(stream: socket.socket, size_bytes: int) -> int:
    """Enlarge the receive buffer of a socket.

    Without the privilege to exceed net.core.rmem_max the size is limited by it.

    Args:
        stream: the socket.
        size_bytes: wanted size [bytes].

    Returns:
        The effective size [bytes]: half of Linux's figure, which includes its bookkeeping.
    """
    try:
        stream.setsockopt(socket.SOL_SOCKET, SO_RCVBUFFORCE, size_bytes)
    except PermissionError:
        stream.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, size_bytes)
    return stream.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF) // 2
