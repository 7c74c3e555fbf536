"""Coded pictures in the order in which they are decoded, numbered in the order of their times."""

from __future__ import annotations

import heapq
from collections import deque
from collections.abc import Iterable, Iterator
from typing import NamedTuple

from analyze.errors import ImportRefused
from analyze.importing.video import AccessUnit

_REORDERED = 32
"""pictures by which one may be coded ahead of its time; H.264 and H.265 allow 16"""


class Numbered(NamedTuple):
    """A coded picture with its place among all."""

    unit: AccessUnit
    number: int
    """in the order of times"""
    earlier_ns: int | None
    """time of the picture before it; None of the first"""


def numbered(units: Iterable[AccessUnit], name: str) -> Iterator[Numbered]:
    """Number a stream's pictures; as many as may be reordered are held back.

    Raises:
        ImportRefused: two have one time.
    """
    waiting: deque[AccessUnit] = deque()
    times: list[int] = []
    places: dict[int, tuple[int, int | None]] = {}
    count, last = 0, None

    def place_earliest() -> None:
        nonlocal count, last
        time_ns = heapq.heappop(times)
        if last is not None and time_ns <= last:
            raise ImportRefused(f"{name}: its time stamps do not rise at {time_ns * 1e-9:.3f} s: film again, or repair them")
        places[time_ns] = (count, last)
        count, last = count + 1, time_ns

    for unit in units:
        waiting.append(unit)
        heapq.heappush(times, unit.time_ns)
        if len(times) > _REORDERED:
            place_earliest()
        while waiting and waiting[0].time_ns in places:
            yield _at(waiting.popleft(), places)
    while times:
        place_earliest()
    while waiting:
        yield _at(waiting.popleft(), places)


def _at(unit: AccessUnit, places: dict[int, tuple[int, int | None]]) -> Numbered:
    number, earlier = places.pop(unit.time_ns)
    return Numbered(unit, number, earlier)
