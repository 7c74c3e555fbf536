"""Numbers a video file's coded pictures, which come in decoding order, by their place in time order.

Video that is in a recording is decoded in reading/compressed_video.py. Pictures are handled in groups, since
a video may have 100 000.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from analyze.errors import ImportRefused

MAX_REORDERED = 32
"""largest number of pictures that precede an earlier one in decoding order; H.264 and H.265 allow 16"""

IntArray = NDArray[np.int64]


class CodedPictures(NamedTuple):
    """Coded pictures in decoding order: data, times since the file's start [ns], key pictures marked.

    A decoder can begin at a key picture.
    """

    times_ns: IntArray
    """(n,) times since the source's start [ns], in decoding order, which may differ from time order"""
    keys: NDArray[np.bool_]
    """(n,) True for key pictures, where a decoder may begin"""
    data: list[memoryview]
    """n buffers: the requested number of free bytes, then the picture as coded, with start codes (Annex B).

    Key pictures contain the parameter sets that a decoder needs.
    """


class NumberedPictures(NamedTuple):
    """Some of a stream's coded pictures, in decoding order, with their numbers; and times of the stream.

    A picture's number is its position by time among all pictures of the stream, from 0. The times [ns] are
    the stream's next ones in increasing order, so that they may be those of other pictures.
    """

    pictures: CodedPictures
    numbers: IntArray
    """(n,) position of each picture in the time order of the whole stream, from 0"""
    in_order_ns: IntArray
    """(m,) times [ns] of the stream's next m pictures in time order; m may differ from n"""


def number_pictures(groups: Iterable[CodedPictures], name: str) -> Iterator[NumberedPictures]:
    """Number a stream's pictures by their place in time order.

    A picture's number is known once no picture with an earlier time can follow. Therefore, of the times read
    so far, the latest `MAX_REORDERED` get no number until further pictures or the stream's end were read.

    Args:
        groups: all pictures of the stream, in groups in decoding order.
        name: name of the file, for error messages.

    Yields:
        After each group the pictures that can be numbered so far, possibly none; after the last group the
        rest. All are in decoding order.

    Raises:
        ImportRefused: two pictures have the same time, or more than `MAX_REORDERED` pictures precede an
            earlier one.
    """
    none = np.empty(0, np.int64)
    waiting = CodedPictures(none, np.empty(0, np.bool_), [])
    unplaced = placed = none
    first, last_ns = 0, -1  # number of the first time in `placed`; the last time that was placed

    def place(count: int) -> tuple[CodedPictures, NumberedPictures]:
        """Number the `count` earliest times that have no number yet, then pictures by their times.

        Pictures read but not numbered (`waiting`) get their numbers in decoding order, up to the first one
        whose time has no number yet.

        Returns:
            The pictures that remain without number; the pictures numbered now, with the `count` times,
            increasing.

        Raises:
            ImportRefused: one of the times is not later than the time before it in time order.
        """
        nonlocal unplaced, placed, first, last_ns
        ordered = np.sort(unplaced)
        newly, unplaced = ordered[:count], ordered[count:]
        behind = np.flatnonzero(np.diff(newly, prepend=last_ns) <= 0)
        if len(behind):
            at_s = newly[behind[0]] * 1e-9
            raise ImportRefused(
                f"{name}: its time stamps do not increase at {at_s:.3f} s: record the video again, or repair "
                "them"
            )
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
            np.concatenate((waiting.times_ns, group.times_ns)),
            np.concatenate((waiting.keys, group.keys)),
            waiting.data + group.data,
        )
        unplaced = np.concatenate((unplaced, group.times_ns))
        waiting, ready = place(max(0, len(unplaced) - MAX_REORDERED))
        yield ready
    waiting, ready = place(len(unplaced))
    yield ready


def _cut(pictures: CodedPictures, start: int, stop: int | None) -> CodedPictures:
    return CodedPictures(pictures.times_ns[start:stop], pictures.keys[start:stop], pictures.data[start:stop])
