"""Coded pictures in the order in which they are decoded, numbered in the order of their times; by groups, because there are 100 000."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from analyze.errors import ImportRefused

_REORDERED = 32
"""pictures by which one may be coded ahead of its time; H.264 and H.265 allow 16"""

Integers = NDArray[np.int64]


class CodedPictures(NamedTuple):
    """Some coded pictures as they stand in the file, one after the other."""

    times_ns: Integers
    """(n,) since the source's start; in the order of decoding these need not rise"""
    keys: NDArray[np.bool_]
    """(n,) whether a decoder may begin with it"""
    data: list[memoryview]
    """n access units with start codes, each after the room that was asked for; a key one brings its parameter sets"""


class NumberedPictures(NamedTuple):
    """Some coded pictures with their places among all."""

    pictures: CodedPictures
    numbers: Integers
    """(n,) in the order of times"""
    in_order_ns: Integers
    """(m,) times of the pictures that follow those given out so before, in order"""


def numbered(groups: Iterable[CodedPictures], name: str) -> Iterator[NumberedPictures]:
    """Number a stream's pictures; as many as may be reordered are held back.

    Raises:
        ImportRefused: two have one time.
    """
    none = np.empty(0, np.int64)
    waiting = CodedPictures(none, np.empty(0, np.bool_), [])
    unplaced = placed = none
    first, last_ns = 0, -1  # number of the first in `placed`; time of the last that was placed

    def place(count: int) -> tuple[CodedPictures, NumberedPictures]:
        """Place the earliest of those that have no place yet; what waits now, and what need not wait any more."""
        nonlocal unplaced, placed, first, last_ns
        ordered = np.sort(unplaced)
        newly, unplaced = ordered[:count], ordered[count:]
        behind = np.flatnonzero(np.diff(newly, prepend=last_ns) <= 0)
        if len(behind):
            at_s = newly[behind[0]] * 1e-9
            raise ImportRefused(f"{name}: its time stamps do not rise at {at_s:.3f} s: film again, or repair them")
        last_ns = int(newly[-1]) if count else last_ns
        placed = np.concatenate((placed, newly))
        late = np.flatnonzero(waiting.times_ns > last_ns)
        ready = int(late[0]) if len(late) else len(waiting.times_ns)
        given, left = _cut(waiting, 0, ready), _cut(waiting, ready, None)
        numbers = first + np.searchsorted(placed, given.times_ns)
        settled = int(np.searchsorted(placed, left.times_ns.min())) if len(left.times_ns) else len(placed)
        placed, first = placed[settled:], first + settled
        return left, NumberedPictures(given, numbers, newly)

    for group in groups:
        waiting = CodedPictures(
            np.concatenate((waiting.times_ns, group.times_ns)), np.concatenate((waiting.keys, group.keys)), waiting.data + group.data
        )
        unplaced = np.concatenate((unplaced, group.times_ns))
        waiting, ready = place(max(0, len(unplaced) - _REORDERED))
        yield ready
    waiting, ready = place(len(unplaced))
    yield ready


def _cut(pictures: CodedPictures, start: int, stop: int | None) -> CodedPictures:
    return CodedPictures(pictures.times_ns[start:stop], pictures.keys[start:stop], pictures.data[start:stop])
