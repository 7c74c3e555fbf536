"""Host time of events that a striker board timed: the truth lies within the stated bound."""

from __future__ import annotations

import random

import pytest

from acquire.clock.reading import ClockReading
from acquire.striker.board_clock import WRAP_US, BoardClock, host_time
from schemas.proto import percuss_pb2 as pb

MS = 1_000_000


@pytest.mark.parametrize("seed", range(12))
def test_an_event_between_readings_is_known_to_half_the_shortest_round_trip(seed: int) -> None:
    draws = random.Random(seed)
    rate, start_us = 1 + draws.uniform(-0.005, 0.005), draws.randrange(WRAP_US)

    def board_us(host_ns: float) -> int:
        elapsed = int(host_ns * rate / 1000)
        return (start_us + elapsed - elapsed % 4) % WRAP_US

    clock = BoardClock(lambda _sample: None)
    readings, shortest = [], 1e9
    for at in [*range(8), *range(500, 508)]:
        before = at * 3 * MS
        after = before + round(draws.uniform(0.4, 2.0) * MS)
        readings.append(clock.observe(board_us(draws.uniform(before, after)), before, after))
        shortest = min(shortest, after - before)
    event_ns = 700 * MS
    found = host_time(clock.device_time_ns(board_us(event_ns)), readings)
    assert found is not None
    time_ns, sd_ns = found
    assert abs(time_ns - event_ns) < shortest / 2 + 50_000
    assert abs(time_ns - event_ns) < 4 * sd_ns
    assert sd_ns < shortest


def test_the_clock_wraps_and_starts_anew_without_a_jump() -> None:
    sent: list[pb.ClockSample] = []
    clock = BoardClock(sent.append)
    host_ns = 5_000 * MS
    for elapsed_s, raw in ((0, WRAP_US - 500_000), (1, 500_000), (2, 1_500_000)):
        clock.observe(raw, host_ns + elapsed_s * 1000 * MS, host_ns + elapsed_s * 1000 * MS + MS)
    assert clock.device_time_ns(WRAP_US - 100_000) == sent[0].device_time_ns + 400 * MS
    clock.restart()  # reset: its clock is at 0
    clock.observe(40_000, host_ns + 6000 * MS, host_ns + 6001 * MS)
    offsets = [(each.device_time_ns - each.host_before_ns) / MS for each in sent]
    assert max(offsets) - min(offsets) < 1
    assert len(sent) == 4


def test_a_clock_that_runs_wrong_gives_no_time() -> None:
    readings = [ClockReading(0, 0, MS), ClockReading(1500 * MS, 1000 * MS, 1001 * MS)]
    assert host_time(700 * MS, readings) is None
