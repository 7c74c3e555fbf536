"""Loss counting: block ids wrap past 0, exposures skipped by the camera show in time only."""

from __future__ import annotations

import pytest

from acquire.camera.frame_loss import FrameLoss

PERIOD_NS = 8_333_333


@pytest.mark.parametrize(
    ("ids", "periods", "lost"),
    [
        ([1, 2, 3], [0, 1, 2], [0, 0, 0]),
        ([65534, 65535, 1, 2], [0, 1, 2, 3], [0, 0, 0, 0]),
        ([65534, 2], [0, 3], [0, 2]),
        ([10, 14], [0, 4], [0, 3]),
        ([10, 11], [0, 3], [0, 2]),  # the camera itself skipped two exposures
        ([10, 11], [0, 65536], [0, 65535]),  # ids came round once
        ([5, 5], [0, 1], [0, 0]),  # a camera without block ids
        ([65535, 65536, 65538], [0, 1, 3], [0, 0, 1]),  # extended ids do not wrap
    ],
)
def test_lost_frames(ids: list[int], periods: list[int], lost: list[int]) -> None:
    loss = FrameLoss(120.0)
    assert [loss.before(frame_id, n * PERIOD_NS) for frame_id, n in zip(ids, periods, strict=True)] == lost


@pytest.mark.parametrize(
    ("ids", "periods", "lost"),
    [
        ([1, 2, 3], [0, 3.0, 3.2], [0, 0, 0]),  # the computer was busy for 25 ms
        ([1, 2, 5], [0, 1.0, 1.1], [0, 0, 2]),
        ([5, 5, 5], [0, 1.0, 9.0], [0, 0, 0]),  # neither ids nor a clock
    ],
)
def test_arrivals_do_not_count_as_losses(ids: list[int], periods: list[float], lost: list[int]) -> None:
    loss = FrameLoss(120.0, stamps_arrival=True)
    times = [round(n * PERIOD_NS) for n in periods]
    assert [loss.before(frame_id, time) for frame_id, time in zip(ids, times, strict=True)] == lost
