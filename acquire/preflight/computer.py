"""What the computer must allow before a session: the serial port, the daemon's socket, receive buffers, packet size, USB latency."""

from __future__ import annotations

import contextlib
import errno
import fcntl
import grp
import ipaddress
import os
import socket
import stat
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from acquire.camera.discovery import GVCP_PORT
from acquire.camera.receive_buffer import enlarge_receive_buffer
from acquire.preflight.check import Check, Measured, failed, not_checked, passed

_SIOCGIFADDR, _SIOCGIFMTU = 0x8915, 0x8921
LONGEST_SOCKET_PATH = 100
LATENCY_MS = 1


@dataclass(frozen=True)
class PortState:
    """A serial port's device file."""

    exists: bool
    usable: bool
    """may be read and written by this user"""
    group: str
    in_use: bool
    """somebody holds the lock on it (flock, or a lock file of a program that is alive)"""


@dataclass(frozen=True)
class FolderState:
    """Where the daemon's socket is to lie."""

    exists: bool
    owned: bool
    private: bool
    """nobody else may look into it"""
    can_be_made: bool


@dataclass(frozen=True)
class ReceiveBuffer:
    """What a UDP socket got, and the system's bound."""

    got_bytes: int
    rmem_max_bytes: int | None
    """net.core.rmem_max; None where it cannot be read (in a container)"""


@dataclass(frozen=True)
class Route:
    """The interface that leads to an address."""

    interface: str
    mtu_bytes: int
    loopback: bool


class Computer(Protocol):
    """What the checks of this module ask the operating system."""

    def port(self, path: str) -> PortState:
        """The serial port at `path`."""
        ...

    def socket_folder(self, folder: Path) -> FolderState:
        """The folder of the daemon's socket."""
        ...

    def receive_buffer(self, asked_bytes: int) -> ReceiveBuffer:
        """What a UDP socket of this user gets when it asks for so much."""
        ...

    def route(self, address: str) -> Route | None:
        """The interface to an IPv4 address; None where it cannot be told. OSError: there is no way there."""
        ...

    def latency_timer_ms(self, port: str) -> int | None:
        """The USB adapter's latency timer; None where the port has none."""
        ...


class LinuxComputer:
    """The one this runs on. `sys`, `proc` and `lock` are parameters so that a test can bring its own trees."""

    def __init__(self, sys: Path = Path("/sys"), proc: Path = Path("/proc"), lock: Path = Path("/run/lock")) -> None:
        self._sys, self._proc, self._lock = sys, proc, lock

    def port(self, path: str) -> PortState:
        """See Computer."""
        try:
            status = Path(path).stat()
        except OSError:
            return PortState(exists=False, usable=False, group="", in_use=False)
        try:
            group = grp.getgrgid(status.st_gid).gr_name
        except KeyError:
            group = str(status.st_gid)
        usable = os.access(path, os.R_OK | os.W_OK)
        return PortState(exists=True, usable=usable, group=group, in_use=usable and (_flocked(path) or self._lock_file(path)))

    def _lock_file(self, path: str) -> bool:
        """Whether a living program keeps a lock file for the port (FHS 5.9: LCK..ttyUSB0 holds its process id in text)."""
        try:
            owner = int((self._lock / f"LCK..{Path(path).resolve().name}").read_text(encoding="ascii"))
        except (OSError, ValueError):
            return False
        return owner != os.getpid() and (self._proc / str(owner)).exists()

    def socket_folder(self, folder: Path) -> FolderState:
        """See Computer."""
        try:
            status = folder.stat()
        except OSError:
            above = next((parent for parent in folder.absolute().parents if parent.exists()), Path("/"))
            can_be_made = above.is_dir() and os.access(above, os.W_OK | os.X_OK)
            return FolderState(exists=False, owned=False, private=False, can_be_made=can_be_made)
        return FolderState(
            exists=True, owned=status.st_uid == os.getuid(), private=stat.S_IMODE(status.st_mode) & 0o077 == 0, can_be_made=True
        )

    def receive_buffer(self, asked_bytes: int) -> ReceiveBuffer:
        """See Computer."""
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            probe.bind(("127.0.0.1", 0))
            got = enlarge_receive_buffer(probe.getsockname()[1], asked_bytes)
        try:
            rmem_max = int((self._proc / "sys/net/core/rmem_max").read_text(encoding="ascii"))
        except (OSError, ValueError):
            rmem_max = None
        return ReceiveBuffer(got, rmem_max)

    def route(self, address: str) -> Route | None:
        """See Computer."""
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            probe.connect((address, GVCP_PORT))  # sends nothing; the kernel looks the route up
            local = probe.getsockname()[0]
            if ipaddress.IPv4Address(local).is_loopback:
                return Route("lo", _mtu(probe, "lo"), loopback=True)
            for _, name in socket.if_nameindex():
                with contextlib.suppress(OSError):
                    answer = fcntl.ioctl(probe.fileno(), _SIOCGIFADDR, struct.pack("256s", name.encode()[:15]))
                    if socket.inet_ntoa(answer[20:24]) == local:
                        return Route(name, _mtu(probe, name), loopback=False)
        return None

    def latency_timer_ms(self, port: str) -> int | None:
        """See Computer."""
        name = Path(port).resolve().name
        try:
            return int((self._sys / "bus/usb-serial/devices" / name / "latency_timer").read_text(encoding="ascii"))
        except (OSError, ValueError):
            return None


def _mtu(probe: socket.socket, interface: str) -> int:
    answer = fcntl.ioctl(probe.fileno(), _SIOCGIFMTU, struct.pack("256s", interface.encode()[:15]))
    return struct.unpack_from("<i", answer, 16)[0]


def _flocked(path: str) -> bool:
    """Whether another program has the port to itself, as the striker's own port does (pyserial's `exclusive`)."""
    try:
        descriptor = os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    except OSError as error:
        return error.errno == errno.EBUSY
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        return error.errno in {errno.EWOULDBLOCK, errno.EAGAIN}
    finally:
        os.close(descriptor)
    return False


# --- the checks -------------------------------------------------------------------------------------------------------


def check_port(computer: Computer, port: str) -> Check:
    """May the servo's port be opened by this user?"""
    state = computer.port(port)
    if not state.exists:
        return failed(
            "serial port", f"{port}: is not there", "check the adapter's cable, and `port` in the rig file (`ls -l /dev/serial/by-id`)"
        )
    if not state.usable:
        return failed(
            "serial port",
            f"{port}: belongs to group {state.group}, you may not read and write it",
            f"sudo usermod -aG {state.group or 'dialout'} $USER, then log in again",
        )
    return passed("serial port", f"{port}: may be read and written")


def check_lock(computer: Computer, port: str, daemon_pid: int | None) -> Check:
    """Is the port free, or held by our daemon?"""
    state = computer.port(port)
    if not state.usable:
        return not_checked("port lock", "the serial port comes first")
    if daemon_pid is not None:
        return passed("port lock", f"held by the daemon (pid {daemon_pid})" if state.in_use else "free")
    if state.in_use:
        return failed(
            "port lock", f"{port}: in use by another program", f"`fuser -v {port}` names it: end it (ModemManager: see docs/hardware.md)"
        )
    return passed("port lock", "free")


def check_socket(computer: Computer, path: Path) -> Check:
    """Can the daemon's socket be made where only this user can open it?"""
    name = "daemon socket"
    size = len(str(path).encode())
    if size > LONGEST_SOCKET_PATH:
        return failed(name, f"{path}: {size} bytes", "set [daemon] socket to a shorter path", Measured(size, LONGEST_SOCKET_PATH, "B"))
    if path.exists() and not path.is_socket():
        return failed(name, f"{path}: is there and is no socket", "set [daemon] socket to another path")
    state = computer.socket_folder(path.parent)
    if not state.exists:
        if state.can_be_made:
            return passed(name, f"{path}: its folder will be made, yours alone")
        return failed(name, f"{path.parent}: is not there and cannot be made", "set [daemon] socket to a folder of yours")
    if not state.owned:
        return failed(name, f"{path.parent}: belongs to another user", "set [daemon] socket to a folder of yours")
    if not state.private:
        return failed(name, f"{path.parent}: others may look into it", f"chmod 700 {path.parent}")
    return passed(name, f"{path}: in a folder that is yours alone")


def check_receive_buffer(computer: Computer, asked_bytes: int) -> Check:
    """Does the stream's socket get the buffer that the rig file asks for?"""
    buffer = computer.receive_buffer(asked_bytes)
    bound = "unknown" if buffer.rmem_max_bytes is None else f"{buffer.rmem_max_bytes} B"
    found = f"{buffer.got_bytes} B of {asked_bytes} B asked (net.core.rmem_max {bound})"
    measured = Measured(buffer.got_bytes, asked_bytes, "B")
    if buffer.got_bytes < asked_bytes:
        return failed(
            "receive buffer",
            found,
            f"sudo sysctl -w net.core.rmem_max={asked_bytes}, and keep it in /etc/sysctl.d (docs/hardware.md)",
            measured,
        )
    return passed("receive buffer", found, measured)


def check_packet_size(computer: Computer, address: str, packet_size: int) -> Check:
    """Do the camera's packets fit the interface that leads to it? Loopback carries any."""
    name = "packet size"
    try:
        ipaddress.IPv4Address(address)
    except ValueError:
        return not_checked(name, f"{address} is a device id, not an IP address", "write the IP address that `acquire discover` prints")
    try:
        route = computer.route(address)
    except OSError as error:
        return failed(name, f"no way leads to {address}: {error.strerror}", "give the interface an address in the camera's subnet")
    if route is None:
        return not_checked(name, f"the interface to {address} cannot be told", f"compare by hand: `ip route get {address}`, `ip link`")
    measured = Measured(packet_size, route.mtu_bytes, "B")
    found = f"{packet_size} B, {route.interface} carries {route.mtu_bytes} B"
    if route.loopback:
        return passed(name, f"{found} (loopback)", measured)
    if packet_size > route.mtu_bytes:
        return failed(
            name, found, f"sudo ip link set {route.interface} mtu 9000, or packet_size = {route.mtu_bytes} in the rig file", measured
        )
    return passed(name, found, measured)


def check_latency_timer(computer: Computer, port: str) -> Check:
    """FTDI gathers bytes for 16 ms by default: 59 reads a second, and no contact can be timed."""
    if not computer.port(port).exists:
        return not_checked("USB latency", "the serial port comes first")
    latency = computer.latency_timer_ms(port)
    if latency is None:
        return passed("USB latency", f"{port}: no adapter with a latency timer")
    measured = Measured(latency, LATENCY_MS, "ms")
    if latency > LATENCY_MS:
        # The port asks for low latency when it is opened, but that does not work on every system (DynamixelSDK #116): udev does.
        file = f"/sys/bus/usb-serial/devices/{Path(port).resolve().name}/latency_timer"
        return failed(
            "USB latency", f"{latency} ms", f"echo {LATENCY_MS} | sudo tee {file}, for ever: udev rule in docs/hardware.md", measured
        )
    return passed("USB latency", f"{latency} ms", measured)
