"""Bytes of a file that wait for the disk: copied into blocks of memory, or in place in camera buffers.

One thread adds bytes at the end, another takes views of them and drops what is written. Borrowed pages are
pixels in a camera buffer, kept until they are on the disk. Copied bytes fill one
block after the other, also where borrowed pages stand between them in the file, so that one page at the end
of an image takes one page of memory and no more. Borrowed pages begin and end on pages of the file; therefore
a byte has the same place within its page in memory and in the file.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable

from acquire.recorder.direct.block_memory import BLOCK_BYTES, BlockMemory
from acquire.recorder.recording_file import BorrowedRun


class _Stretch:
    """Consecutive bytes of a file, as views of memory: of copied bytes, or of pages of camera buffers.

    Copied bytes that stand between borrowed pages belong to the same stretch as the pages.
    """

    __slots__ = ("block", "borrowed_bytes", "closed", "end", "release", "start", "views")

    def __init__(self, start: int) -> None:
        self.start = self.end = start
        """offset in the file"""
        self.views: list[memoryview] = []
        self.closed = False
        """True if it does not grow any more, its views cover exactly its bytes, and it ends with a page of
        the file"""
        self.block: list[memoryview] = []
        """full blocks, given back once the stretch is written"""
        self.release: list[Callable[[], None]] = []
        """functions to call once the borrowed pages are written, which give them back"""
        self.borrowed_bytes = 0


class WaitingBytes:
    """Queue of a file's bytes between the thread that appends them and the thread that writes them.

    Offsets are those in the file.

    Args:
        memory: owner of the blocks into which bytes are copied; they are given back to it.
    """

    def __init__(self, memory: BlockMemory) -> None:
        self._memory = memory
        self._block: memoryview | None = None
        """block being filled"""
        self._room = 0
        self._growing: _Stretch | None = None
        self._added: deque[_Stretch] = deque()
        """stretches that the writing thread has not seen yet"""
        self._line: list[_Stretch] = []
        """stretches of the writing thread"""

    # --- the thread that appends ---

    @property
    def room(self) -> int:
        """Number of bytes that still fit in the block being filled; 0 if there is none."""
        return self._room

    def add_block(self, block: memoryview) -> None:
        """Make the empty `block` (BLOCK_BYTES long) the one that later calls of `copy` fill.

        Call it when the block before is full, or there is none yet.
        """
        self._block, self._room = block, BLOCK_BYTES

    def copy(self, at: int, part: memoryview) -> None:
        """Copy the file's next bytes into the block being filled.

        Args:
            at: offset of `part` in the file: the end of the bytes added before.
            part: at most `room` bytes.

        Raises:
            IndexError: there is no block to copy to.
        """
        stretch = self._growing
        if stretch is None:
            stretch = _Stretch(at)
            stretch.views = [self._rest_of_block()]
        self._fill(part, stretch)
        stretch.end += len(part)
        if self._growing is None:
            self._added.append(stretch)
        self._growing = stretch
        if not self._room:
            self._close_growing()

    def add_borrowed(self, at: int, run: BorrowedRun, more: list[memoryview]) -> int:
        """Add borrowed pages (pixels in camera buffers) without copying, and copy the bytes between them.

        The bytes before the first page and after the last one are left to the caller.

        Args:
            at: offset of the first borrowed page, the beginning of a page of the file.
            run: borrowed pages and the bytes between them.
            more: free blocks for the bytes between, removed from the end of this list as needed.

        Returns:
            Offset after the last borrowed page.

        Raises:
            IndexError: `more` has too few blocks.
        """
        self._close_growing()
        stretch = _Stretch(at)
        views = stretch.views
        for pages, following in zip(run.pages, run.following[:-1], strict=False):
            views.append(pages)
            copied = memoryview(following)
            while copied:
                if not self._room:
                    self.add_block(more.pop())
                rest, size = self._rest_of_block(), min(len(copied), self._room)
                views.append(rest[:size])
                self._fill(copied[:size], stretch)
                copied = copied[size:]
        views.append(run.pages[-1])
        stretch.end = at + sum(map(len, views))
        stretch.release, stretch.borrowed_bytes = run.release, run.borrowed_bytes
        stretch.closed = True
        self._memory.count_borrowed(stretch.borrowed_bytes)
        self._added.append(stretch)
        return stretch.end

    def _rest_of_block(self) -> memoryview:
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
        """Views of the waiting bytes from offset `start` to `end` of the file, in order; nothing is removed.

        Args:
            start: at or after the end of the bytes dropped before.
            end: at most the end of the bytes added.
        """
        line = self._line
        while start < end and (not line or line[-1].end < end):
            line.append(self._added.popleft())
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

    def drop_written(self, end: int) -> None:
        """Give back blocks and camera buffers of bytes before offset `end`, which are on the disk.

        Blocks that also hold later bytes are kept.
        """
        count = 0
        for stretch in self._line:
            if not stretch.closed or stretch.end > end:
                break
            count += 1
            self._release(stretch)
            self._give_back(stretch)
        del self._line[:count]

    def release_borrowed(self) -> None:
        """Release all borrowed camera buffers after the disk failed; their pages will not be written."""
        while self._added:
            self._line.append(self._added.popleft())
        for stretch in self._line:
            self._release(stretch)

    # --- either thread, when the other has ended ---

    def close(self) -> None:
        """Release all borrowed camera buffers and give back all blocks of memory."""
        self.release_borrowed()
        for stretch in self._line:
            self._give_back(stretch)
        self._line = []
        if self._block is not None:
            self._memory.give_back(self._block)
        self._block, self._growing, self._room = None, None, 0

    def _release(self, stretch: _Stretch) -> None:
        if stretch.release:
            self._memory.count_borrowed(-stretch.borrowed_bytes)
            releases, stretch.release = stretch.release, []
            for release in releases:
                release()

    def _give_back(self, stretch: _Stretch) -> None:
        for block in stretch.block:
            self._memory.give_back(block)
