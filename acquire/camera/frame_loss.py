"""Counter of lost frames, by GVSP block id and by device time."""

from __future__ import annotations

_WRAP = 65535
"""16-bit block ids run 1..65535; 0 is skipped (GigE Vision 2.0, 25.2)"""


class FrameLoss:
    """Counter of the frames lost between two complete ones.

    Both criteria are needed: ids do not show exposures that the camera itself skipped, and times fail with a
    wrong frame rate. Aravis's own statistics are unusable: `n_missing_packets` over-reports and `n_underruns`
    counts packets.
    """

    def __init__(self, frame_rate_hz: float) -> None:
        self._period_ns = 1e9 / frame_rate_hz
        self._last: tuple[int, int] | None = None

    def before(self, frame_id: int, device_time_ns: int) -> int:
        """Number of frames lost between the last complete frame and this one."""
        last, self._last = self._last, (frame_id, device_time_ns)
        if last is None:
            return 0
        last_id, last_time_ns = last
        by_id = frame_id - last_id - 1
        if max(frame_id, last_id) <= _WRAP:
            by_id %= _WRAP
        by_time = round((device_time_ns - last_time_ns) / self._period_ns) - 1
        # A repeated id is a camera without ids: 65534 frames were not lost in one period.
        return max(0, by_time if by_id > max(2 * by_time, 0) + 1000 else by_id, by_time)
