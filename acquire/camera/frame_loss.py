"""Counter of lost frames, by their numbers (block ids of the GVSP stream protocol) and by device time."""

from __future__ import annotations

_WRAP = 65535
"""16-bit block ids run 1..65535; 0 is skipped (GigE Vision 2.0, 25.2)"""


class FrameLoss:
    """Counter of the frames lost between two complete ones, by block id (frame number) and device time.

    Both criteria are needed: ids do not show exposures that the camera itself skipped, and times fail with a
    wrong frame rate. Aravis's own statistics are unusable: `n_missing_packets` over-reports and `n_underruns`
    counts packets.

    Args:
        frame_rate_hz: frame rate of the camera.
        stamps_arrival: True if the times are those of arrival: then ids alone are counted, as a frame that a
            busy computer received late is none after a loss.
    """

    def __init__(self, frame_rate_hz: float, *, stamps_arrival: bool = False) -> None:
        self._period_ns, self._stamps_arrival = 1e9 / frame_rate_hz, stamps_arrival
        self._last: tuple[int, int] | None = None

    def before(self, frame_id: int, device_time_ns: int) -> int:
        """Number of frames lost between the previous complete frame and the one given; 0 for the first frame.

        Call once for every complete frame, in order. Lost frames are counted both by id and by time, and the
        larger count is returned. A count by id that exceeds twice the count by time by more than 1000 is
        implausible and ignored: the ids of such a camera repeat, and do not number its frames.

        Args:
            frame_id: block id of the frame, 16 bits (1-65535, then 1 again) or longer.
            device_time_ns: time of the frame on the camera's clock [ns].
        """
        last, self._last = self._last, (frame_id, device_time_ns)
        if last is None:
            return 0
        last_id, last_time_ns = last
        by_id = frame_id - last_id - 1
        if max(frame_id, last_id) <= _WRAP:
            by_id %= _WRAP
        by_time = round((device_time_ns - last_time_ns) / self._period_ns) - 1
        # A repeated id is a camera without ids: 65534 frames were not lost in one period.
        has_ids = by_id <= max(2 * by_time, 0) + 1000
        return max(0, by_id if has_ids else 0, 0 if self._stamps_arrival else by_time)
