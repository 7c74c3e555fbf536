"""The bytes of a file that wait for the disk, where they lie: in blocks of our own, into which they were copied, or in lent memory.

One thread adds bytes at the end, another takes views of them and lets go of what is written. Bytes that are copied fill one block after
the other, also where lent pages stand between them in the file, so that a page of an image's end costs a page of memory and no more.
Lent pages begin and end where pages of the file do: so a byte's place in its page is the same in memory and in the file.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable

from acquire.recorder.data_file import LentRun
from acquire.recorder.direct.block_memory import BLOCK_BYTES, BlockMemory


class _Stretch:
    """Bytes that follow each other in the file: one that grows lies in one block, one with lent pages in many places."""

    __slots__ = ("block", "closed", "end", "lent_bytes", "release", "start", "views")

    def __init__(self, start: int) -> None:
        self.start = self.end = start
        """in the file"""
        self.views: list[memoryview] = []
        self.closed = False
        """it does not grow any more, its views are those of its bytes, and it ends with a page of the file"""
        self.block: list[memoryview] = []
        """to be given back with it"""
        self.release: list[Callable[[], None]] = []
        self.lent_bytes = 0


class WaitingBytes:
    """See above; offsets are those in the file."""

    def __init__(self, memory: BlockMemory) -> None:
        self._memory = memory
        self._block: memoryview | None = None
        """the one being filled"""
        self._room = 0
        self._growing: _Stretch | None = None
        self._coming: deque[_Stretch] = deque()
        """not seen by the other thread yet"""
        self._line: list[_Stretch] = []
        """the other thread's"""

    # --- the thread that adds ---

    @property
    def room(self) -> int:
        """Bytes that can be copied before another block is needed."""
        return self._room

    def add_block(self, block: memoryview) -> None:
        """Go on in `block`; the last one is full."""
        self._block, self._room = block, BLOCK_BYTES

    def copy(self, at: int, part: memoryview) -> None:
        """Take in the file's next bytes; there is room for them."""
        stretch = self._growing
        if stretch is None:
            stretch = _Stretch(at)
            stretch.views = [self._rest()]
        self._fill(part, stretch)
        stretch.end += len(part)
        if self._growing is None:
            self._coming.append(stretch)
        self._growing = stretch
        if not self._room:
            self._close_growing()

    def lend(self, at: int, run: LentRun, more: list[memoryview]) -> int:
        """Take in all of `run` but its lead, from `at` on, which begins a page; `more` has the blocks it needs. Returns where it ends."""
        self._close_growing()
        stretch = _Stretch(at)
        views = stretch.views
        for lent, behind in zip(run.lent, run.behind[:-1], strict=False):
            views.append(lent)
            copied = memoryview(behind)
            while copied:
                if not self._room:
                    self.add_block(more.pop())
                rest, size = self._rest(), min(len(copied), self._room)
                views.append(rest[:size])
                self._fill(copied[:size], stretch)
                copied = copied[size:]
        views.append(run.lent[-1])
        stretch.end = at + sum(map(len, views))
        stretch.release, stretch.lent_bytes = run.release, run.lent_bytes
        stretch.closed = True
        self._memory.count_lent(stretch.lent_bytes)
        self._coming.append(stretch)
        return stretch.end

    def _rest(self) -> memoryview:
        if self._block is None:
            raise IndexError("there is no block to copy to")
        return self._block[BLOCK_BYTES - self._room :]

    def _fill(self, part: memoryview, stretch: _Stretch) -> None:
        block, size = self._block, len(part)
        if block is None:
            raise IndexError("there is no block to copy to")
        within = BLOCK_BYTES - self._room
        block[within : within + size] = part
        self._room -= size
        if not self._room:
            stretch.block.append(block)
            self._block = None

    def _close_growing(self) -> None:
        stretch = self._growing
        if stretch is not None:
            stretch.views = [stretch.views[0][: stretch.end - stretch.start]]
            stretch.closed = True
            self._growing = None

    # --- the thread that writes ---

    def views(self, start: int, end: int) -> list[memoryview]:
        """The bytes from `start`, which is not let go of, to `end`, which was taken in."""
        line = self._line
        while start < end and (not line or line[-1].end < end):
            line.append(self._coming.popleft())
        views: list[memoryview] = []
        for stretch in line:
            if stretch.closed and start <= stretch.start and stretch.end <= end:
                views += stretch.views
            else:
                at = stretch.start
                for view in stretch.views:
                    if part := view[max(start - at, 0) : max(end - at, 0)]:
                        views.append(part)
                    at += len(view)
        return views

    def let_go(self, end: int) -> None:
        """What stands before `end` is written: give back its memory."""
        count = 0
        for stretch in self._line:
            if not stretch.closed or stretch.end > end:
                break
            count += 1
            self._release(stretch)
            self._give_back(stretch)
        del self._line[:count]

    def give_back_lent(self) -> None:
        """The disk failed: what was lent will not be written."""
        while self._coming:
            self._line.append(self._coming.popleft())
        for stretch in self._line:
            self._release(stretch)

    # --- either, when the other has ended ---

    def close(self) -> None:
        """Give back everything."""
        self.give_back_lent()
        for stretch in self._line:
            self._give_back(stretch)
        self._line = []
        if self._block is not None:
            self._memory.give_back(self._block)
        self._block, self._growing, self._room = None, None, 0

    def _release(self, stretch: _Stretch) -> None:
        if stretch.release:
            self._memory.count_lent(-stretch.lent_bytes)
            releases, stretch.release = stretch.release, []
            for release in releases:
                release()

    def _give_back(self, stretch: _Stretch) -> None:
        for block in stretch.block:
            self._memory.give_back(block)
