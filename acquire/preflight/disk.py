"""Checks of the disk that receives the recordings: free space and write speed."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from acquire.preflight.check import Check, Measured, failed_check, passed_check, skipped_check
from acquire.recorder.atomic import write_all

if TYPE_CHECKING:
    from schemas.rig import RigConfig

SPEED_MARGIN = 1.3
"""required write speed over the camera's data rate: a disk that is only as fast as the camera cannot catch up
after a delay"""
TEST_S = 2.0
"""duration of the camera's data that the test of the write speed writes [s]"""
MAX_TEST_BYTES = 256 << 20
_BLOCK = 1 << 20


class Disk:
    """Disks of this computer: measures free space and write speed of the disk that holds a folder.

    Args:
        monotonic_ns: function that returns the host's monotonic time [ns].
    """

    def __init__(self, monotonic_ns: Callable[[], int]) -> None:
        self._now_ns = monotonic_ns

    def free_bytes(self, folder: Path) -> int:
        """Free space for this user [B] on the disk that holds `folder`.

        Raises:
            OSError: the folder does not exist or cannot be used.
        """
        return shutil.disk_usage(folder).free

    def write_speed(self, folder: Path, size_bytes: int) -> float:
        """Speed [B/s] at which `size_bytes`, rounded up to whole MiB, are written to the disk of `folder`.

        The time includes synchronising. The bytes are random, so that compression does not help. The test
        file has no name, so that it vanishes even if the program is killed.

        Raises:
            OSError: the data cannot be written.
        """
        block = os.urandom(_BLOCK)
        blocks = -(-size_bytes // _BLOCK)
        with tempfile.TemporaryFile(dir=folder, buffering=0) as file:
            start = self._now_ns()
            for number in range(blocks):
                write_all(file.fileno(), [number.to_bytes(8, "little") + block[8:]])
            os.fdatasync(file.fileno())
            end = self._now_ns()
        return blocks * _BLOCK * 1e9 / max(1, end - start)


def data_rate(rig: RigConfig) -> float:
    """Data rate of the camera's mono8 images (one byte per pixel) [B/s]."""
    return rig.camera.width * rig.camera.height * rig.camera.frame_rate_hz


def check_disk(disk: Disk, rig: RigConfig) -> list[Check]:
    """Check free space and write speed of the disk that receives the recordings.

    The space is compared with the reserve that recordings leave free, the speed with the camera's data rate
    times SPEED_MARGIN. The findings name the folder, because a session's recording may be written to another
    one.

    Args:
        disk: the disk.
        rig: rig file; it gives the recording folder, the reserve and the camera's settings.

    Returns:
        Results of the two checks; the speed is not checked without a usable folder or room for the test.
    """
    folder = Path(rig.recorder.directory).absolute()
    rate = data_rate(rig)
    try:
        free = disk.free_bytes(folder)
    except OSError as error:
        remedy = "create the folder, or set [recorder] directory to another"
        space = failed_check("disk space", f"{folder}: {error.strerror}", remedy)
        return [space, skipped_check("disk speed", "the recording folder must be usable first")]
    space = _check_space(free, rig.recorder.disk_reserve_bytes, folder, rate)
    test_bytes = min(MAX_TEST_BYTES, round(TEST_S * rate))
    if free < 2 * test_bytes:
        return [space, skipped_check("disk speed", f"no room for a test of {test_bytes / 1e6:.0f} MB")]
    return [space, _check_speed(disk, folder, test_bytes, rate)]


def _check_space(free: int, reserve: int, folder: Path, rate: float) -> Check:
    measured = Measured(free, reserve, "B")
    found = (
        f"{free / 1e9:.1f} GB free in {folder}, {reserve / 1e9:.1f} GB reserved: "
        f"room for {max(0, free - reserve) / rate:.0f} s of strike windows"
    )
    if free < reserve:
        remedy = "free some space, or record on another disk: -o there, and [recorder] directory to check it"
        return failed_check("disk space", found, remedy, measured)
    return passed_check("disk space", found, measured)


def _check_speed(disk: Disk, folder: Path, test_bytes: int, rate: float) -> Check:
    try:
        speed = disk.write_speed(folder, test_bytes)
    except OSError as error:
        remedy = "make the folder writable for you, or choose another"
        return failed_check("disk speed", f"{folder}: {error.strerror}", remedy)
    needed = SPEED_MARGIN * rate
    measured = Measured(speed, needed, "B/s")
    found = (
        f"{speed / 1e6:.0f} MB/s written and synchronised in {folder}; "
        f"the camera sends {rate / 1e6:.1f} MB/s, {needed / 1e6:.0f} MB/s are required"
    )
    if speed < needed:
        remedy = (
            "record on a faster disk (-o there, and [recorder] directory to check it), or lower frame_rate_hz"
        )
        return failed_check("disk speed", found, remedy, measured)
    return passed_check("disk speed", found, measured)
