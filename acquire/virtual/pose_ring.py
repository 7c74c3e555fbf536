"""Ring buffer of poses in a memory-mapped file: one writer, any number of readers, no locks.

The virtual world writes the poses of object and arm; the camera process reads them.

Layout (little-endian, 8-byte cells): magic, capacity, count, 5 spare; then `capacity` stamps (int64 ns); then
`capacity` rows of 11 float64, in W, the world frame: p_world_object (3), q_world_object wxyz (4), arm angle,
arm axis (3).
`count` is the number of poses written so far; pose i is in slot i mod capacity. The writer fills the slot,
then raises `count` with one aligned store; a reader takes `count` before and after, and repeats the reading
if the writer could have overwritten it meanwhile. Not modelled: reordering on machines with a weaker memory
order than x86-64.
"""

from __future__ import annotations

import mmap
import os
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from acquire.errors import AcquireError

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

    from numpy.typing import ArrayLike, NDArray

_MAGIC = 0x676E6972_65736F70  # "posering"
_HEADER_CELLS = 8
_COLUMNS = 11
_CAPACITY, _COUNT = 1, 2
_GUARD = 16
"""slots next to the writer that readers do not use"""
_FIRST_SEARCH = 256
"""newest records, searched before the whole ring"""


class PoseRingError(AcquireError):
    """Error: the file of a pose ring is missing, is not a pose ring, or holds no pose yet."""


@dataclass(frozen=True)
class SampledPoses:
    """Poses of object and arm at n times: position [m], unit quaternion, arm angle [rad], hinge point [m].

    Poses are in W, the world frame; the quaternion (w, x, y, z) is from O, the object's frame, to W.
    """

    p_world_object: NDArray[np.float64]
    """(n, 3) position of the object's origin in W, the world frame [m]"""
    q_world_object_wxyz: NDArray[np.float64]
    """(n, 4) unit quaternion (w, x, y, z) from O, the object's frame, to W"""
    arm_angle: NDArray[np.float64]
    """(n,) angle of the arm [rad], 0 when it hangs, positive towards +x"""
    arm_axis_world: NDArray[np.float64]
    """(n, 3) point on the arm's hinge in W [m]"""

    def __iter__(self) -> Iterator[NDArray[np.float64]]:
        """Iterate over the four arrays, so that `p, q, angle, axis = ring.poses_at(times)` works.

        They are positions of the object (n, 3) [m], quaternions wxyz from object to world frame (n, 4), arm
        angles (n,) [rad], and points on the arm's hinge (n, 3) [m]; both points are in the world frame.
        """
        return iter((self.p_world_object, self.q_world_object_wxyz, self.arm_angle, self.arm_axis_world))


class PoseRing:
    """Ring buffer of time-stamped poses of object and arm in a memory-mapped file.

    Made with `create` (by its one writer) or `open` (by a reader).

    Args:
        memory: the mapped file, with a valid header.
        capacity: number of poses that it holds; older ones are overwritten.
    """

    def __init__(self, memory: mmap.mmap, capacity: int) -> None:
        self._memory = memory
        self._cells = np.frombuffer(memory, dtype=np.int64)
        self._capacity = capacity
        self._time = self._cells[_HEADER_CELLS : _HEADER_CELLS + capacity]
        self._row = self._cells[_HEADER_CELLS + capacity :].view(np.float64).reshape(capacity, _COLUMNS)

    @classmethod
    def create(cls, path: Path, capacity: int = 16384) -> PoseRing:
        """Create an empty pose ring for writing, with file mode 0600, and return it.

        An existing file is replaced.

        Args:
            path: path of the file.
            capacity: number of poses that it holds.
        """
        size = 8 * (_HEADER_CELLS + capacity * (1 + _COLUMNS))
        path.unlink(missing_ok=True)
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_EXCL, 0o600)
        try:
            os.ftruncate(descriptor, size)
            ring = cls(mmap.mmap(descriptor, size), capacity)
        finally:
            os.close(descriptor)
        ring._cells[_CAPACITY] = capacity
        ring._cells[0] = _MAGIC
        return ring

    @classmethod
    def open(cls, path: Path) -> PoseRing:
        """Open an existing pose ring for reading, and return it.

        A pose ring is a ring buffer of the poses of object and arm, in a mapped file.

        Raises:
            PoseRingError: no such file, or it is not a pose ring.
        """
        try:
            with path.open("rb") as file:
                memory = mmap.mmap(file.fileno(), 0, prot=mmap.PROT_READ)
        except (OSError, ValueError) as error:
            raise PoseRingError(
                f"{path}: cannot be read as a pose ring ({error}): check that the virtual world is running"
            ) from None
        header = np.zeros(_HEADER_CELLS)
        if len(memory) >= 8 * _HEADER_CELLS:
            header = np.frombuffer(memory, dtype=np.int64, count=_HEADER_CELLS)
        capacity = int(header[_CAPACITY])
        if header[0] != _MAGIC or len(memory) != 8 * (_HEADER_CELLS + capacity * (1 + _COLUMNS)):
            raise PoseRingError(f"{path}: is not a pose ring: start the virtual world again")
        return cls(memory, capacity)

    def append(
        self,
        time_ns: int,
        p_world_object: ArrayLike,
        q_wxyz: ArrayLike,
        arm_angle: float,
        arm_axis_world: ArrayLike,
    ) -> None:
        """Add a pose, overwriting the oldest one if the ring is full; times must not decrease.

        Args:
            time_ns: host monotonic time [ns].
            p_world_object: (3,) position of the object's origin in W, the world frame [m].
            q_wxyz: (4,) unit quaternion (w, x, y, z) from O, the object's frame, to W.
            arm_angle: angle of the arm [rad], 0 when it hangs, positive towards +x.
            arm_axis_world: (3,) point on the axis about which the arm turns, in W [m].
        """
        count = int(self._cells[_COUNT])
        slot = count % self._capacity
        row = self._row[slot]
        row[0:3] = p_world_object
        row[3:7] = q_wxyz
        row[7] = arm_angle
        row[8:11] = arm_axis_world
        self._time[slot] = time_ns
        self._cells[_COUNT] = count + 1

    def latest_time_ns(self) -> int:
        """Host monotonic time of the newest pose [ns].

        Raises:
            PoseRingError: there is no pose yet.
        """
        count = int(self._cells[_COUNT])
        if count == 0:
            raise PoseRingError("the pose ring is empty: the virtual world has not started")
        return int(self._time[(count - 1) % self._capacity])

    def poses_at(self, times_ns: ArrayLike | Sequence[int]) -> SampledPoses:
        """Poses of object and arm, interpolated at the given times.

        The interpolation is linear in position and angle, and normalised-linear in rotation. For times before
        the oldest pose in the ring or after the newest, that pose is returned.

        Args:
            times_ns: (n,) host monotonic times [ns], at least one, in any order.

        Returns:
            Positions (n, 3) [m] and quaternions wxyz (n, 4) of the object, arm angles (n,) [rad] and points
            (n, 3) [m] on the arm's hinge, in the world frame and in the order of the times.

        Raises:
            PoseRingError: the ring is empty.
        """
        wanted = np.atleast_1d(np.asarray(times_ns, dtype=np.int64))
        oldest = int(wanted.min())
        while True:
            time, row, first = self._newest(oldest)
            if int(self._cells[_COUNT]) - first <= self._capacity:
                return _interpolate(time, row, wanted)

    def _newest(self, oldest_ns: int) -> tuple[NDArray[np.int64], NDArray[np.float64], int]:
        """Newest poses of object and arm, oldest first: times (n,), rows (n, 11), number of the first pose.

        Times are host monotonic [ns]. The poses reach back to `oldest_ns` if the ring still holds a pose of
        that time. A row holds, in the world frame W, the object's position (3) [m] and quaternion wxyz (4),
        the arm's angle [rad] and a point on the arm's hinge (3) [m]. Poses are numbered from 0, counting all
        ever written.

        Raises:
            PoseRingError: the ring is empty.
        """
        count = int(self._cells[_COUNT])
        if count == 0:
            raise PoseRingError("the pose ring is empty: the virtual world has not started")
        kept = min(count, self._capacity - _GUARD)
        length = min(_FIRST_SEARCH, kept)
        if self._time[(count - length) % self._capacity] > oldest_ns:
            length = kept
        slots = np.arange(count - length, count) % self._capacity
        return self._time[slots], self._row[slots], count - length


def _interpolate(
    time: NDArray[np.int64], row: NDArray[np.float64], wanted: NDArray[np.int64]
) -> SampledPoses:
    after = np.clip(np.searchsorted(time, wanted, side="left"), 1, max(len(time) - 1, 1))
    before = after - 1
    after = np.minimum(after, len(time) - 1)
    span = np.maximum(time[after] - time[before], 1)
    share = np.clip((wanted - time[before]) / span, 0.0, 1.0)[:, None]
    old, new = row[before], row[after]
    mixed = old + share * (new - old)
    near = np.where(np.sum(old[:, 3:7] * new[:, 3:7], axis=1, keepdims=True) < 0, -new[:, 3:7], new[:, 3:7])
    q = old[:, 3:7] + share * (near - old[:, 3:7])
    q /= np.linalg.norm(q, axis=1, keepdims=True)
    return SampledPoses(mixed[:, 0:3], q, mixed[:, 7], mixed[:, 8:11])
