"""Checks of the way to a GigE camera: route, packet size, link speed, reverse path filter, firewall."""

from __future__ import annotations

import fcntl
import ipaddress
import math
import socket
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final

from acquire.camera.discovery import GVCP_PORT
from acquire.camera.subnet import address_command, own_addresses
from acquire.preflight.check import Check, Measured, Outcome, failed_check, passed_check, skipped_check
from acquire.preflight.firewall import FIREWALL_LINE, ReadFirewall, check_firewall
from schemas.camera_kind import BYTES_PER_PIXEL

if TYPE_CHECKING:
    from collections.abc import Iterator

    from schemas.rig import CameraConfig

NETWORK_LINES = ("route", "packet size", "link speed", "rp_filter", FIREWALL_LINE)
"""names of the checks of the way to the camera, in order"""
GIGABIT: Final = 1000
"""speed of a GigE camera's link [Mbit/s]"""
GVSP_HEADER_BYTES, ETHERNET_BYTES, END_PACKET_BYTES = 36, 38, 110
"""bytes beside the pixels: headers of IP, UDP and GVSP, which packet_size includes; an Ethernet packet's
header, checksum, preamble and gap; leader or trailer of an image, gap included (GigE Vision 2.0, 25)"""
STRICT: Final = 1
"""value of rp_filter at which packets are dropped whose answer would leave by another interface; 2 is loose
(Linux, Documentation/networking/ip-sysctl.rst; RFC 3704, 2.2 and 2.4)"""
_SIOCGIFMTU = 0x8921
_RTF_UP, _RTF_GATEWAY, _RTF_REJECT = 0x1, 0x2, 0x200


@dataclass(frozen=True)
class Route:
    """Network interface that leads to an address: name, largest packet, own address, loopback or not."""

    interface: str
    """name of the interface, for example eth0"""
    mtu_bytes: int
    """largest packet that it carries"""
    loopback: bool
    """True if packets stay on this computer"""
    own_address: str = ""
    """this computer's IPv4 address from which packets are sent"""


class Network:
    """IPv4 network of this computer, as the kernel reports it to any user. Nothing is sent.

    Args:
        sys: root of the tree /sys; a test passes its own.
        proc: root of the tree /proc.
    """

    def __init__(self, sys: Path = Path("/sys"), proc: Path = Path("/proc")) -> None:
        self._sys, self._proc = sys, proc

    def route(self, address: str) -> Route | None:
        """Network interface that leads to an IPv4 address, with its largest packet; None if it is unknown.

        Raises:
            OSError: there is no route to the address.
        """
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            probe.connect((address, GVCP_PORT))  # sends nothing; the kernel only looks up the route
            local = probe.getsockname()[0]
            if ipaddress.IPv4Address(local).is_loopback:
                return Route("lo", _mtu(probe, "lo"), loopback=True, own_address=local)
            for name, own in own_addresses():
                if str(own.ip) == local:
                    return Route(name, _mtu(probe, name), loopback=False, own_address=local)
        return None

    def subnets(self, address: str) -> list[tuple[str, ipaddress.IPv4Network]] | None:
        """Interfaces in the subnet of an IPv4 address, with that network; None if the routes cannot be read.

        They are those of the longest prefixes among the routes that contain the address; none if these lead
        through a gateway, or if only the default route contains it.
        """
        try:
            lines = (self._proc / "net/route").read_text(encoding="ascii").splitlines()[1:]
        except OSError:
            return None
        found: list[tuple[str, ipaddress.IPv4Network, bool]] = []
        for line in lines:
            name, destination, gateway, flags, _, _, _, mask, *_ = line.split()
            network = ipaddress.IPv4Network(f"{_dotted(destination)}/{_dotted(mask)}", strict=False)
            if (
                ipaddress.IPv4Address(address) in network
                and int(flags, 16) & (_RTF_UP | _RTF_REJECT) == _RTF_UP
            ):
                direct = int(gateway, 16) == 0 and not int(flags, 16) & _RTF_GATEWAY
                found.append((name, network, direct))
        longest = max((network.prefixlen for _, network, _ in found), default=0)
        nearest = [each for each in found if each[1].prefixlen == longest and longest > 0]
        if not all(direct for *_, direct in nearest):
            return []
        return list(dict.fromkeys((name, network) for name, network, _ in nearest))

    def link_mbit(self, interface: str) -> int | None:
        """Speed that an interface has agreed upon with its neighbour [Mbit/s]; None if it states none."""
        speed = self._number(self._sys / "class/net" / interface / "speed")
        return speed if speed is not None and speed > 0 else None

    def reverse_path_filter(self, interface: str) -> int | None:
        """Reverse path filter that applies to an interface, 0 to 2; None if it cannot be read.

        The kernel takes the larger one of the interface's own and that of all interfaces.
        """
        folder = self._proc / "sys/net/ipv4/conf"
        own, common = (self._number(folder / name / "rp_filter") for name in (interface, "all"))
        return None if own is None or common is None else max(own, common)

    def _number(self, path: Path) -> int | None:
        try:
            return int(path.read_text(encoding="ascii"))
        except (OSError, ValueError):
            return None


def _dotted(hexadecimal: str) -> str:
    """IPv4 address from eight digits, in which the kernel prints a number in its own byte order."""
    return socket.inet_ntoa(struct.pack("=I", int(hexadecimal, 16)))


def _mtu(probe: socket.socket, interface: str) -> int:
    answer = fcntl.ioctl(probe.fileno(), _SIOCGIFMTU, struct.pack("256s", interface.encode()[:15]))
    return struct.unpack_from("<i", answer, 16)[0]


def check_network(network: Network, firewall: ReadFirewall, camera: CameraConfig) -> Iterator[Check]:
    """Yield the checks of the way to a camera, in the order of NETWORK_LINES.

    Without an IP address, or a route by an interface in the camera's subnet, what follows is not checked.

    Args:
        network: network of this computer.
        firewall: function that reads the packet filter.
        camera: section `camera` of the rig file.
    """
    address = camera.address
    try:
        ipaddress.IPv4Address(address)
    except ValueError:
        remedy = "write the IP address that `acquire discover` prints"
        yield skipped_check("route", f"{address} is a device id, not an IP address", remedy)
        yield from _after_route("an IP address is needed")
        return
    try:
        route = network.route(address)
    except OSError as error:
        yield failed_check("route", f"no route to {address}: {error.strerror}", address_command(address))
        yield from _after_route("there must be a route first")
        return
    if route is None:
        remedy = f"compare by hand: `ip route get {address}`, `ip link`"
        yield skipped_check("route", f"the interface to {address} is unknown", remedy)
        yield from _after_route("the interface must be known first")
        return
    subnets = None if route.loopback else network.subnets(address)
    checked = check_route(route, subnets, address)
    yield checked
    if checked.outcome is Outcome.FAIL and len(subnets or ()) < 2:
        yield from _after_route("an interface must be in the camera's subnet first")
        return
    yield check_packet_size(route, camera.packet_size)
    if route.loopback:
        yield from (passed_check(name, "packets stay on this computer") for name in NETWORK_LINES[2:])
        return
    yield check_link_speed(route, network.link_mbit(route.interface), camera)
    yield _check_reverse_paths(network, route, subnets)
    yield check_firewall(firewall, route.interface, address)


def _after_route(reason: str) -> Iterator[Check]:
    return (skipped_check(name, reason) for name in NETWORK_LINES[1:])


def check_route(route: Route, subnets: list[tuple[str, ipaddress.IPv4Network]] | None, address: str) -> Check:
    """Check that exactly one interface is in the camera's subnet, and that packets leave by it.

    A camera has no gateway: it answers only addresses of its own subnet. If two interfaces are in it, packets
    leave by one of them, and a camera at the other never hears them.

    Args:
        route: interface that leads to the camera.
        subnets: interfaces in the camera's subnet, with that network; None if they are unknown.
        address: IPv4 address of the camera.
    """
    if route.loopback:
        return passed_check("route", f"{route.interface}: packets stay on this computer")
    if subnets is None:
        return skipped_check("route", f"{route.interface}; the kernel's routes cannot be read")
    inside = [network for _, network in subnets if ipaddress.IPv4Address(route.own_address) in network]
    one_host = any(network.prefixlen == ipaddress.IPV4LENGTH for _, network in subnets)
    if not subnets or not (inside or one_host):
        found = f"{route.interface} ({route.own_address}) is not in the subnet of {address}"
        return failed_check("route", found, address_command(address))
    names = sorted({name for name, _ in subnets})
    if len(names) > 1:
        found = f"{' and '.join(names)} are in the subnet of {address}; packets leave by {route.interface}"
        remedy = (
            f"give each interface a subnet of its own, or sudo ip route add {address}/32 dev IFACE, for the "
            "interface that the camera is plugged into"
        )
        return failed_check("route", found, remedy)
    return passed_check("route", f"{route.interface}, {route.own_address}, no gateway")


def check_packet_size(route: Route, packet_size: int) -> Check:
    """Check that the interface carries the camera's packets [bytes]; loopback carries any."""
    name = "packet size"
    measured = Measured(packet_size, route.mtu_bytes, "B")
    found = f"{packet_size} B, {route.interface} carries {route.mtu_bytes} B"
    if route.loopback:
        return passed_check(name, f"{found} (loopback)", measured)
    if packet_size > route.mtu_bytes:
        remedy = (
            f"sudo ip link set {route.interface} mtu 9000, or packet_size = {route.mtu_bytes} in the rig file"
        )
        return failed_check(name, found, remedy, measured)
    return passed_check(name, found, measured)


def needed_mbit(camera: CameraConfig) -> float:
    """Data rate of a GigE camera's images with all headers [Mbit/s].

    f·(B + n·(36 + 38) + 2·110)·8 bits, with the frame rate f, B bytes of pixels, and n packets of
    packet_size - 36 bytes of them.
    """
    pixels = camera.width * camera.height * BYTES_PER_PIXEL[camera.pixel_format]
    packets = math.ceil(pixels / (camera.packet_size - GVSP_HEADER_BYTES))
    frame_bytes = pixels + packets * (GVSP_HEADER_BYTES + ETHERNET_BYTES) + 2 * END_PACKET_BYTES
    return 8e-6 * camera.frame_rate_hz * frame_bytes


def check_link_speed(route: Route, speed_mbit: int | None, camera: CameraConfig) -> Check:
    """Check that the link to the camera runs at 1000 Mbit/s or more, and carries the images.

    A cable with a broken pair, or an old switch, brings a link down to 100 Mbit/s.

    Args:
        route: interface that leads to the camera.
        speed_mbit: speed of its link [Mbit/s]; None if it is not known.
        camera: section `camera` of the rig file.
    """
    needed = needed_mbit(camera)
    images = f"images need {needed:.0f} Mbit/s"
    if speed_mbit is None:
        return skipped_check(
            "link speed", f"{images}; {route.interface} states no speed (virtual, or no link)"
        )
    found = f"{images}, {route.interface} runs at {speed_mbit} Mbit/s"
    measured = Measured(speed_mbit, max(needed, GIGABIT), "Mbit/s")
    if speed_mbit < GIGABIT:
        remedy = (
            f"replace the cable (Cat 5e or better, all four pairs) or the switch; `ethtool {route.interface}`"
        )
        return failed_check("link speed", found, remedy, measured)
    if speed_mbit < needed:
        return failed_check("link speed", found, "lower frame_rate_hz or the image size", measured)
    return passed_check("link speed", found, measured)


def _check_reverse_paths(
    network: Network, route: Route, subnets: list[tuple[str, ipaddress.IPv4Network]] | None
) -> Check:
    others = sorted({name for name, _ in subnets or ()} - {route.interface})
    return check_reverse_path_filter(route, {name: network.reverse_path_filter(name) for name in others})


def check_reverse_path_filter(route: Route, others: dict[str, int | None]) -> Check:
    """Check that packets of a camera that come in by another interface of its subnet are not dropped.

    Strict reverse path filtering drops, without a word, each packet whose answer would leave by another
    interface: with two interfaces in one subnet all those that come in by the second.

    Args:
        route: interface by which packets to the camera leave.
        others: reverse path filters of the other interfaces in its subnet, None where one cannot be read.
    """
    if not others:
        return passed_check("rp_filter", f"no interface but {route.interface} is in the camera's subnet")
    strict = [name for name, value in others.items() if value == STRICT]
    if strict:
        names = " and ".join(strict)
        settings = " ".join(f"net.ipv4.conf.{name}.rp_filter=2" for name in strict)
        found = (
            f"strict at {names}: packets of a camera there are dropped, as answers leave by {route.interface}"
        )
        return failed_check("rp_filter", found, f"sudo sysctl -w {settings}, or correct the route above")
    if None in others.values():
        return skipped_check("rp_filter", "/proc/sys/net/ipv4/conf cannot be read")
    return passed_check("rp_filter", f"not strict at {' and '.join(others)}")
