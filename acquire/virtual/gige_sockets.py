"""UDP sockets of the virtual GigE camera: its control port, and those taken from Aravis's fake camera."""

from __future__ import annotations

import contextlib
import errno
import os
import socket
from typing import TYPE_CHECKING

from acquire.errors import CameraError

if TYPE_CHECKING:
    from acquire.clock.clock import Clock

GVCP_PORT = 3956
LOOPBACK = "127.0.0.1"


def udp_socket(address: str, port: int = 0) -> socket.socket:
    """Non-blocking UDP socket bound to an IP address and port (0: any free one).

    Raises:
        OSError: it cannot be bound.
    """
    result = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        result.bind((address, port))
    except OSError:
        result.close()
        raise
    result.setblocking(False)
    return result


def claim_control_port(address: str, clock: Clock) -> socket.socket:
    """Bind the camera's control port (UDP 3956), and return its non-blocking socket.

    Aravis's fake camera reports that it runs even if the port was busy, and then answers nobody: so the port
    is bound here. A busy port is tried for half a second.

    Args:
        address: IP address of the camera.
        clock: the host's clock, for the pauses.

    Raises:
        CameraError: another camera holds the port, or the address does not belong to this host.
    """
    for attempt in range(10):
        try:
            return udp_socket(address, GVCP_PORT)
        except OSError as error:
            if error.errno != errno.EADDRINUSE:
                place = f"{address}:{GVCP_PORT}"
                raise CameraError(
                    f"virtual camera: cannot bind {place}: {error.strerror}: use a 127.x.x.x address"
                ) from None
            if attempt < 9:
                clock.sleep(0.05)
    raise CameraError(
        f"virtual camera: UDP port {GVCP_PORT} of {address} is in use: another virtual camera runs; "
        "stop it, or give another address (--address 127.0.0.2)"
    )


def free_address() -> str:
    """First loopback address from 127.0.0.1 to 127.0.0.32 at which no virtual camera runs.

    127.0.0.1 if none is free: the camera reports that when it starts.
    """
    for last in range(1, 33):
        address = f"127.0.0.{last}"
        with contextlib.suppress(OSError):
            udp_socket(address, GVCP_PORT).close()
            return address
    return LOOPBACK


def adopt_fake_sockets(descriptors_before: set[int], address: str) -> tuple[socket.socket, int]:
    """Replace the sockets of Aravis's fake camera: control by a private one, images by one at `address`.

    The fake listens and sends only at the address of a network interface; most loopback addresses, such as
    127.0.0.21, belong to none.
    `dup2` swaps the file behind the descriptor that the fake's thread uses. If the fake has several control
    sockets, the others are replaced by sockets that never receive anything.

    Args:
        descriptors_before: file descriptors that were open before the fake was made.
        address: IP address of the camera.

    Returns:
        The private control socket on loopback, and the UDP port from which the fake now sends images.

    Raises:
        CameraError: the fake opened no control socket, or none for images.
    """
    opened = descriptors() - descriptors_before
    inner = udp_socket(LOOPBACK)
    adopted, source_port = False, 0
    for descriptor in opened:
        port = _udp_port(descriptor)
        if port == 0:
            continue
        if port != GVCP_PORT:
            with udp_socket(address) as images:
                os.dup2(images.fileno(), descriptor)
                source_port = images.getsockname()[1]
        elif adopted:
            with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as silent:
                silent.setblocking(False)
                os.dup2(silent.fileno(), descriptor)
        else:
            os.dup2(inner.fileno(), descriptor)
            adopted = True
    if not adopted or not source_port:
        inner.close()
        raise CameraError(
            f"virtual camera at {address}: Aravis's fake camera opened no socket for "
            f"{'images' if adopted else 'control'}; check that the loopback interface is up"
        )
    return inner, source_port


def descriptors() -> set[int]:
    """Numbers of the open file descriptors of this process."""
    names = os.listdir("/proc/self/fd")  # noqa: PTH208 - descriptors vanish while iterdir stats them
    return {int(name) for name in names if _is_open(int(name))}


def _is_open(descriptor: int) -> bool:
    """True if a file descriptor is open. The one that listed the descriptors is closed by now."""
    try:
        os.fstat(descriptor)
    except OSError:
        return False
    return True


def _udp_port(descriptor: int) -> int:
    """Local port of an IPv4 UDP socket by its file descriptor; 0 if it is none, or closed by now."""
    with contextlib.suppress(OSError):
        if os.readlink(f"/proc/self/fd/{descriptor}").startswith("socket:"):  # noqa: PTH115 - not a path
            with socket.socket(fileno=os.dup(descriptor)) as probe:
                if probe.family == socket.AF_INET and probe.type == socket.SOCK_DGRAM:
                    return probe.getsockname()[1]
    return 0
