"""Checks of the computer: serial port, daemon socket, receive buffer, USB latency."""

from __future__ import annotations

import errno
import fcntl
import grp
import os
import socket
import stat
from dataclasses import dataclass
from pathlib import Path

from acquire.camera.receive_buffer import enlarge_receive_buffer
from acquire.preflight.check import Check, Measured, failed_check, passed_check, skipped_check

MAX_SOCKET_PATH_BYTES = 100
"""longest path of the daemon's socket; the kernel allows 107 bytes"""
LATENCY_MS = 1
"""largest permitted latency timer of the USB adapter [ms]"""


@dataclass(frozen=True)
class PortState:
    """State of a serial port's device file: existence, access, group, and whether it is locked.

    `usable` and `in_use` are False, and `group` is empty, if the file does not exist.
    """

    exists: bool
    usable: bool
    """True if this user may read and write it"""
    group: str
    """name of the group that owns the file, or its number if it has no name"""
    in_use: bool
    """True if a program holds a lock on the port (flock, or the lock file of a running program)"""


@dataclass(frozen=True)
class FolderState:
    """State of the folder for the daemon's socket: existence, owner and access.

    A missing folder is neither owned nor private.
    """

    exists: bool
    owned: bool
    """True if it belongs to this user"""
    private: bool
    """True if no other user has access"""
    can_be_made: bool
    """True if it exists, or if this user can create it"""


@dataclass(frozen=True)
class ReceiveBuffer:
    """Size [bytes] of a UDP socket's receive buffer, and the system's limit of that size."""

    got_bytes: int
    """size that the system granted"""
    rmem_max_bytes: int | None
    """net.core.rmem_max; None if it cannot be read (in a container)"""


class Computer:
    """Linux computer that this program runs on: its serial ports, sockets and folders, for the checks.

    Args:
        sys: root of the tree /sys; a test passes its own.
        proc: root of the tree /proc.
        lock: folder of lock files of serial ports.
    """

    def __init__(
        self, sys: Path = Path("/sys"), proc: Path = Path("/proc"), lock: Path = Path("/run/lock")
    ) -> None:
        self._sys, self._proc, self._lock = sys, proc, lock

    def port(self, path: str) -> PortState:
        """State of the serial port at `path`: existence, access, group, and whether it is locked.

        An unusable port counts as not locked.
        """
        try:
            status = Path(path).stat()
        except OSError:
            return PortState(exists=False, usable=False, group="", in_use=False)
        try:
            group = grp.getgrgid(status.st_gid).gr_name
        except KeyError:
            group = str(status.st_gid)
        usable = os.access(path, os.R_OK | os.W_OK)
        in_use = usable and (_has_flock(path) or self._has_lock_file(path))
        return PortState(exists=True, usable=usable, group=group, in_use=in_use)

    def _has_lock_file(self, path: str) -> bool:
        """True if another running program has a lock file for the serial port at `path`.

        By the Filesystem Hierarchy Standard, 5.9, the file LCK..ttyUSB0 holds the program's process id as
        text.
        """
        try:
            owner = int((self._lock / f"LCK..{Path(path).resolve().name}").read_text(encoding="ascii"))
        except (OSError, ValueError):
            return False
        return owner != os.getpid() and (self._proc / str(owner)).exists()

    def socket_folder(self, folder: Path) -> FolderState:
        """State of the folder in which the daemon's socket is to be created.

        A missing folder counts as one that can be created if its nearest existing parent is writable.
        """
        try:
            status = folder.stat()
        except OSError:
            above = next((parent for parent in folder.absolute().parents if parent.exists()), Path("/"))
            can_be_made = above.is_dir() and os.access(above, os.W_OK | os.X_OK)
            return FolderState(exists=False, owned=False, private=False, can_be_made=can_be_made)
        owned, private = status.st_uid == os.getuid(), stat.S_IMODE(status.st_mode) & 0o077 == 0
        return FolderState(exists=True, owned=owned, private=private, can_be_made=True)

    def receive_buffer(self, asked_bytes: int) -> ReceiveBuffer:
        """Receive buffer that a UDP socket gets when it requests `asked_bytes`, and the system's limit.

        Both are in bytes. A socket on the loopback interface is opened to find out. The limit is None if it
        cannot be read.
        """
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            probe.bind(("127.0.0.1", 0))
            got = enlarge_receive_buffer(probe, asked_bytes)
        try:
            rmem_max = int((self._proc / "sys/net/core/rmem_max").read_text(encoding="ascii"))
        except (OSError, ValueError):
            rmem_max = None
        return ReceiveBuffer(got, rmem_max)

    def latency_timer_ms(self, port: str) -> int | None:
        """Latency timer [ms] of the USB adapter at the serial port `port`.

        It is the longest wait before the adapter passes on received bytes. None if the adapter has no such
        timer, or the timer cannot be read.
        """
        name = Path(port).resolve().name
        try:
            return int(
                (self._sys / "bus/usb-serial/devices" / name / "latency_timer").read_text(encoding="ascii")
            )
        except (OSError, ValueError):
            return None


def _has_flock(path: str) -> bool:
    """True if another program holds an exclusive lock (flock) on the serial port at `path`.

    The striker locks its port in this way (pyserial's `exclusive`). False if the port cannot be opened for
    another reason than being busy.
    """
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


# --- the checks


def check_port(state: PortState, port: str) -> Check:
    """Check that this user may read and write the servo's serial port.

    Returns:
        Result of the check: outcome, finding, and a remedy if it failed.
    """
    if not state.exists:
        remedy = "check the adapter's cable, and `port` in the rig file (`ls -l /dev/serial/by-id`)"
        return failed_check("serial port", f"{port}: does not exist", remedy)
    if not state.usable:
        return failed_check(
            "serial port",
            f"{port}: belongs to group {state.group}, you may not read and write it",
            f"sudo usermod -aG {state.group or 'dialout'} $USER, then log in again (a lingering service: "
            "sudo systemctl restart user@$(id -u))",
        )
    return passed_check("serial port", f"{port}: readable and writable")


def check_lock(state: PortState, port: str, daemon_pid: int | None) -> Check:
    """Check that the servo's serial port is free, or held by the rig's daemon.

    While a daemon runs, a lock on the port counts as the daemon's. The check is not made if the port cannot
    be used.

    Args:
        state: state of the serial port.
        port: path of the serial port.
        daemon_pid: process id of the rig's daemon; None if none runs.

    Returns:
        Result of the check: outcome, finding, and a remedy if it failed.
    """
    if not state.usable:
        return skipped_check("port lock", "the serial port must be usable first")
    if daemon_pid is not None:
        return passed_check("port lock", f"held by the daemon (pid {daemon_pid})" if state.in_use else "free")
    if state.in_use:
        remedy = f"end the program that `fuser -v {port}` names (ModemManager: see docs/how-to/hardware.md)"
        return failed_check("port lock", f"{port}: in use by another program", remedy)
    return passed_check("port lock", "free")


def check_socket(computer: Computer, path: Path) -> Check:
    """Check that the daemon's socket can be created at `path`, where only this user has access.

    Returns:
        Result of the check: outcome, finding, and a remedy if it failed.
    """
    name = "daemon socket"
    size = len(str(path).encode())
    if size > MAX_SOCKET_PATH_BYTES:
        measured = Measured(size, MAX_SOCKET_PATH_BYTES, "B")
        return failed_check(
            name, f"{path}: {size} bytes long", "set [daemon] socket to a shorter path", measured
        )
    if path.exists() and not path.is_socket():
        return failed_check(
            name, f"{path}: exists and is not a socket", "set [daemon] socket to another path"
        )
    return _check_socket_folder(computer.socket_folder(path.parent), path)


def _check_socket_folder(state: FolderState, path: Path) -> Check:
    name = "daemon socket"
    if not state.exists and state.can_be_made:
        return passed_check(name, f"{path}: its folder will be created with access for you only")
    if not state.exists:
        found = f"{path.parent}: does not exist and cannot be created"
        return failed_check(name, found, "set [daemon] socket to a folder of yours")
    if not state.owned:
        found = f"{path.parent}: belongs to another user"
        return failed_check(name, found, "set [daemon] socket to a folder of yours")
    if not state.private:
        return failed_check(name, f"{path.parent}: other users have access", f"chmod 700 {path.parent}")
    return passed_check(name, f"{path}: its folder is accessible to you only")


def check_receive_buffer(computer: Computer, asked_bytes: int) -> Check:
    """Check that the camera stream's UDP socket gets the buffer size that the rig file requests [bytes].

    Returns:
        Result of the check: outcome, finding, and a remedy if it failed.
    """
    buffer = computer.receive_buffer(asked_bytes)
    limit = "unknown" if buffer.rmem_max_bytes is None else f"{buffer.rmem_max_bytes} B"
    found = f"{buffer.got_bytes} B of {asked_bytes} B requested (net.core.rmem_max {limit})"
    measured = Measured(buffer.got_bytes, asked_bytes, "B")
    if buffer.got_bytes < asked_bytes:
        return failed_check(
            "receive buffer",
            found,
            f"sudo sysctl -w net.core.rmem_max={asked_bytes}, and keep it in /etc/sysctl.d "
            "(docs/how-to/hardware.md)",
            measured,
        )
    return passed_check("receive buffer", found, measured)


def check_latency_timer(computer: Computer, state: PortState, port: str) -> Check:
    """Check that the latency timer of the servo's USB adapter is at most LATENCY_MS.

    The timer is the longest wait before the adapter passes on received bytes. FTDI's default is 16 ms; only
    59 readings per second are then possible, too few to time a contact. A port without a timer passes. The
    check is not made if the port does not exist.

    Returns:
        Result of the check: outcome, finding, and a remedy if it failed.
    """
    if not state.exists:
        return skipped_check("USB latency", "the serial port must exist first")
    latency = computer.latency_timer_ms(port)
    if latency is None:
        return passed_check("USB latency", f"{port}: no adapter with a latency timer")
    measured = Measured(latency, LATENCY_MS, "ms")
    if latency > LATENCY_MS:
        # Opening the port requests low latency, but that fails on some systems (DynamixelSDK #116); udev
        # works.
        file = f"/sys/bus/usb-serial/devices/{Path(port).resolve().name}/latency_timer"
        remedy = (
            f"echo {LATENCY_MS} | sudo tee {file}; to make it permanent: udev rule in docs/how-to/hardware.md"
        )
        return failed_check("USB latency", f"{latency} ms", remedy, measured)
    return passed_check("USB latency", f"{latency} ms", measured)
