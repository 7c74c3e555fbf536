"""Whether this computer has an address in a camera's subnet, and the command that gives it one."""

from __future__ import annotations

import fcntl
import ipaddress
import socket
import struct
from typing import Final

USUAL: Final = "check power, cable and address; `acquire discover` lists the cameras that answer"
_SIOCGIFADDR, _SIOCGIFNETMASK = 0x8915, 0x891B
"""requests of netdevice(7): address and netmask of an interface"""
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
    networks = _own_networks()
    if wanted.is_loopback or any(wanted in network for _, network in networks):
        return USUAL
    prefix = 16 if wanted in LINK_LOCAL else 24
    mine = ipaddress.IPv4Address(int(wanted) ^ 1)
    cards = sorted({name for name, _ in networks}) or ["IFACE"]
    return (
        f"none of this computer's addresses is in its subnet: `sudo ip address add {mine}/{prefix} dev "
        f"{' or '.join(cards)}`, for the interface that the camera is plugged into"
    )


def _own_networks() -> list[tuple[str, ipaddress.IPv4Network]]:
    """Interfaces of this computer, without loopback, with the networks of their first IPv4 addresses."""
    found: list[tuple[str, ipaddress.IPv4Network]] = []
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as query:
        for _, name in socket.if_nameindex():
            request = struct.pack("256s", name.encode()[:15])
            try:
                address, mask = (
                    fcntl.ioctl(query, code, request)[20:24] for code in (_SIOCGIFADDR, _SIOCGIFNETMASK)
                )
            except OSError:
                continue  # no address
            if address[0] != _LOOPBACK_BYTE:
                text = f"{socket.inet_ntoa(address)}/{socket.inet_ntoa(mask)}"
                found.append((name, ipaddress.IPv4Network(text, strict=False)))
    return found
