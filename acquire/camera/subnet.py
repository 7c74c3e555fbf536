"""Whether this computer has an address in a camera's subnet, and the command that gives it one."""

from __future__ import annotations

import ctypes
import fcntl
import ipaddress
import socket
import struct
from typing import Final

USUAL: Final = "check power, cable and address; `acquire discover` lists the cameras that answer"
_SIOCGIFCONF, _SIOCGIFNETMASK = 0x8912, 0x891B
"""requests of netdevice(7): addresses of all interfaces, and netmask of an address"""
_IFREQ_BYTES = struct.calcsize("16sP16x")
_MOST_ADDRESSES = 256
_LOOPBACK_BYTE = 127
LINK_LOCAL: Final = ipaddress.ip_network("169.254.0.0/16")
"""addresses that cameras give themselves without a DHCP server"""


def not_found_remedy(address: str) -> str:
    """Remedy for a camera that does not answer at an IP address.

    If this computer has no address in the camera's subnet, packets go to the default route, and the remedy is
    the command that mends it.
    """
    try:
        wanted = ipaddress.IPv4Address(address)
    except ValueError:
        return USUAL  # a device id
    if wanted.is_loopback or any(wanted in own.network for _, own in own_addresses()):
        return USUAL
    return f"none of this computer's addresses is in its subnet: {address_command(address)}"


def address_command(address: str) -> str:
    """Command that gives this computer an address in the subnet of a camera at an IPv4 address."""
    wanted = ipaddress.IPv4Address(address)
    prefix = 16 if wanted in LINK_LOCAL else 24
    # A neighbour of the camera, but neither the network's own address nor that of its broadcasts.
    mine = ipaddress.IPv4Address(int(wanted) ^ (3 if wanted.packed[-1] in (1, 254) else 1))
    cards = sorted({name for name, _ in own_addresses()}) or ["IFACE"]
    return (
        f"`sudo ip address add {mine}/{prefix} dev {' or '.join(cards)}`, for the interface that the camera "
        "is plugged into"
    )


def own_addresses() -> list[tuple[str, ipaddress.IPv4Interface]]:
    """Interfaces of this computer, without loopback, with each of their IPv4 addresses and its network."""
    found: list[tuple[str, ipaddress.IPv4Interface]] = []
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as query:
        for name, address in _configured(query):
            # With an address in it, the request is about that one of several (devinet.c, tryaddrmatch).
            request = struct.pack("16sHH4s232x", name, socket.AF_INET, 0, address)
            try:
                mask = fcntl.ioctl(query, _SIOCGIFNETMASK, request)[20:24]
            except OSError:
                continue
            if address[0] != _LOOPBACK_BYTE:
                text = f"{socket.inet_ntoa(address)}/{socket.inet_ntoa(mask)}"
                found.append((name.decode().partition(":")[0], ipaddress.IPv4Interface(text)))
    return found


def _configured(query: socket.socket) -> list[tuple[bytes, bytes]]:
    """Names of interfaces and their IPv4 addresses of four bytes, one for each address."""
    space = ctypes.create_string_buffer(_IFREQ_BYTES * _MOST_ADDRESSES)
    request = struct.pack("iP", len(space), ctypes.addressof(space))
    used = struct.unpack("iP", fcntl.ioctl(query, _SIOCGIFCONF, request))[0]
    entries = (space.raw[at : at + _IFREQ_BYTES] for at in range(0, used, _IFREQ_BYTES))
    return [(entry[:16].rstrip(b"\0"), entry[20:24]) for entry in entries]
