"""Is the disk that takes the recordings fast and empty enough?"""

from __future__ import annotations

import errno
import os
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

from acquire.preflight.check import Check, Measured, failed, not_checked, passed

if TYPE_CHECKING:
    from acquire.config import RigConfig

SPEED_MARGIN = 1.3
"""a disk just as fast as the camera has no time for anything else"""
TEST_S = 2.0
LARGEST_TEST_BYTES = 256 << 20
_BLOCK = 1 << 20


class Disk(Protocol):
    """What the checks of this module ask of a disk. Both raise OSError."""

    def free_bytes(self, folder: Path) -> int:
        """Free for this user."""
        ...

    def write_speed(self, folder: Path, size_bytes: int) -> float:
        """Bytes per second of `size_bytes` written there and synchronised; nothing stays."""
        ...


class RealDisk:
    """The disk itself. `monotonic_ns`: host time."""

    def __init__(self, monotonic_ns: Callable[[], int]) -> None:
        self._now_ns = monotonic_ns

    def free_bytes(self, folder: Path) -> int:
        """See Disk."""
        disk = os.statvfs(folder)
        return disk.f_bavail * disk.f_frsize

    def write_speed(self, folder: Path, size_bytes: int) -> float:
        """See Disk. Random bytes, so that a disk that compresses gains nothing, into a file without a name: a kill leaves nothing."""
        block = os.urandom(_BLOCK)
        blocks = -(-size_bytes // _BLOCK)
        with tempfile.TemporaryFile(dir=folder, buffering=0) as file:
            start = self._now_ns()
            for number in range(blocks):
                _write_all(file.fileno(), number.to_bytes(8, "little") + block[8:])
            os.fdatasync(file.fileno())
            end = self._now_ns()
        return blocks * _BLOCK * 1e9 / max(1, end - start)


def _write_all(descriptor: int, data: bytes) -> None:
    view = memoryview(data)
    while view:
        written = os.write(descriptor, view)
        if written == 0:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        view = view[written:]


def data_rate(rig: RigConfig) -> float:
    """Bytes per second of the images of a strike window, mono8."""
    return rig.camera.width * rig.camera.height * rig.camera.frame_rate_hz


def check_disk(disk: Disk, rig: RigConfig) -> list[Check]:
    """Free space against the reserve, and speed against the camera. A session's own file may go elsewhere: so the folder is named."""
    folder = Path(rig.recorder.directory).absolute()
    rate = data_rate(rig)
    test_bytes = min(LARGEST_TEST_BYTES, round(TEST_S * rate))
    try:
        free = disk.free_bytes(folder)
    except OSError as error:
        space = failed("disk space", f"{folder}: {error.strerror}", "make the folder, or set [recorder] directory to another")
        return [space, not_checked("disk speed", "the recording folder comes first")]
    reserve = rig.recorder.disk_reserve_bytes
    measured = Measured(free, reserve, "B")
    found = (
        f"{free / 1e9:.1f} GB free in {folder}, {reserve / 1e9:.1f} GB kept back: {max(0, free - reserve) / rate:.0f} s of strike windows"
    )
    if free < reserve:
        space = failed(
            "disk space", found, "free some space, or record on another disk: -o there, and [recorder] directory to check it", measured
        )
    else:
        space = passed("disk space", found, measured)
    if free < 2 * test_bytes:
        return [space, not_checked("disk speed", f"no room for a test of {test_bytes / 1e6:.0f} MB")]
    try:
        speed = disk.write_speed(folder, test_bytes)
    except OSError as error:
        return [space, failed("disk speed", f"{folder}: {error.strerror}", "make the folder writable for you, or choose another")]
    needed = SPEED_MARGIN * rate
    measured = Measured(speed, needed, "B/s")
    found = (
        f"{speed / 1e6:.0f} MB/s written and synchronised in {folder}; "
        f"the camera sends {rate / 1e6:.1f} MB/s, {needed / 1e6:.0f} MB/s are wanted"
    )
    if speed < needed:
        return [
            space,
            failed(
                "disk speed",
                found,
                "record on a faster disk (-o there, and [recorder] directory to check it), or lower frame_rate_hz",
                measured,
            ),
        ]
    return [space, passed("disk speed", found, measured)]
