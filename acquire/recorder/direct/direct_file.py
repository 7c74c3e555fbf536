"""A file written without the page cache (O_DIRECT), from preallocated blocks, by a thread of its own.

A write through the page cache copies every byte once more and hands it to the kernel's threads, which may
find the disk busy when gigabytes wait; then they block the next writer. Here bytes are copied once, into a
block of memory. Borrowed pages (pixels in a camera's buffer) are not copied: the disk reads them in place.
Appending does not wait for the disk as long as blocks are free. While the disk stands still the blocks fill;
when too few are left, images are refused (`has_room`).

The space of the file is allocated before its bytes are accepted, so that a disk that fills up refuses the
next image, never an accepted one. O_DIRECT writes whole pages: the last page is padded with zeros, which no
record begins with, and written again when more bytes follow. `finish` cuts the file to its length; the file
of a killed process ends in such zeros.

A reader that maps the growing file sees whole records, then at most one record that is cut, or zeros.
"""

from __future__ import annotations

import errno
import mmap
import os
import threading
from collections.abc import Sequence
from pathlib import Path
from typing import ClassVar, Final

from acquire.frames.page_memory import PAGE_BYTES
from acquire.recorder import atomic
from acquire.recorder.direct.block_memory import BLOCK_BYTES, BlockMemory
from acquire.recorder.direct.direct_io import allocate, write_pages
from acquire.recorder.direct.waiting_bytes import WaitingBytes
from acquire.recorder.recording_file import BorrowedRun
from schemas.mcap.records import Buffer

GATHER_BYTES: Final = 4 << 20
MOST_GATHER_BYTES: Final = 8 << 20
"""greatest number of bytes that gather before a write [bytes]; GATHER_BYTES is the least, where little memory
may wait: a frame's share of a write of 8 MB is 12 us, of 2 MB 18 us"""
MOST_WRITE_BYTES: Final = 16 << 20
"""greatest size of one write [bytes]"""
FLUSH_S: Final = 0.1
"""bytes are written after this time even if too few have gathered [s]"""
RESERVE_BYTES: Final = 8 << 20
"""allocated space that images do not get [bytes]: for small topics, seal and summary"""
ALLOCATE_BYTES: Final = 64 << 20
"""step of the allocation of disk space [bytes]"""
RESERVE_BLOCKS: Final = 2
"""blocks of memory that images do not get"""


class DirectFile:
    """File of a recording, written with O_DIRECT by a thread of its own; implements RecordingFile.

    Appended bytes wait for the disk in blocks of `memory`, which several files may share. One thread at a
    time appends; other threads may call `wait_until`.

    Args:
        part_path: path of the new file, which must not exist.
        memory: blocks for the bytes that are copied.
        sync_bytes: written bytes after which the writing thread calls fdatasync.

    Raises:
        RecorderError: `part_path` is taken, or cannot be created in its folder.
    """

    never_waits: ClassVar = True

    def __init__(self, part_path: Path, memory: BlockMemory, sync_bytes: int) -> None:
        self.size = 0
        self._fd = atomic.create_part(part_path, os.O_DIRECT)
        self._memory = memory
        self._waiting = WaitingBytes(memory)
        self._sync_bytes = sync_bytes
        self._synced = 0
        self._gather = max(GATHER_BYTES, min(MOST_GATHER_BYTES, memory.most_bytes // 16))
        self._ahead = memory.most_bytes + RESERVE_BYTES
        self._allocated = 0
        self._wanted = 0
        """size of the file once the bytes being appended are accepted"""
        self._full: OSError | None = None
        self._committed = 0
        """bytes that may be written: `size`, or less while more bytes are appended than the memory holds"""
        self._written = 0
        """bytes in whole pages that are on the disk and final"""
        self._readable = 0
        """bytes that are in the file, including those in its padded last page"""
        self._tail = mmap.mmap(-1, PAGE_BYTES)
        self._failed: OSError | None = None
        self._closing = False
        self._change = threading.Condition()
        self._allocate_ahead()
        self._thread = threading.Thread(target=self._run, name="recorder-disk", daemon=True)
        self._thread.start()

    def has_room(self, size: int, *, image: bool, borrowed: int = 0) -> bool:
        """True if `append` would not wait now: it accepts the bytes, or raises the error of the disk.

        False if too few blocks of memory are free, or too little disk space is allocated as yet.

        Args:
            size: bytes to be copied.
            image: True for images, which leave RESERVE_BLOCKS blocks and RESERVE_BYTES of the disk free.
            borrowed: bytes in borrowed pages (camera buffers), which take disk space and no blocks.
        """
        blocks = self._memory.free - (RESERVE_BLOCKS if image else 0)
        in_memory = size <= self._waiting.room + blocks * BLOCK_BYTES
        # Where the disk is full or failing, `append` raises the error.
        return in_memory and (
            self._fits(size + borrowed, image=image) or self._full is not None or self._failed is not None
        )

    def append(self, buffers: Sequence[Buffer], *, image: bool = False) -> int:
        """Copy all `buffers` for the writing thread, or none; waits while there is no room.

        Args:
            buffers: bytes to append, in order.
            image: True for images, which leave RESERVE_BYTES of the disk free.

        Returns:
            Number of bytes appended.

        Raises:
            OSError: the disk is full or failing.
        """
        size = sum(map(len, buffers))
        self._make_room(size, image=image)
        self._accept_until(self._copy(self.size, buffers, []))
        return size

    def append_borrowed(self, run: BorrowedRun) -> int:
        """Queue images in camera buffers for the writing thread, and copy the bytes around them.

        Each buffer is released when its pages are on the disk, or when the disk failed. Waits while there is
        no room.

        Args:
            run: the images' borrowed pages, and the bytes before, between and after them.

        Returns:
            Number of bytes appended: borrowed pages and copied bytes.

        Raises:
            OSError: the disk is full or failing; no buffer was released.
        """
        own = run.own_bytes
        size = own + run.borrowed_bytes
        self._make_room(size, image=True)
        blocks = self._take_blocks(own)  # no error is possible from here on
        at = self._waiting.add_borrowed(self._copy(self.size, [run.lead], blocks), run, blocks)
        self._accept_until(self._copy(at, [run.following[-1]], blocks))
        return size

    def _make_room(self, size: int, *, image: bool) -> None:
        """Wait until space for `size` bytes more is allocated on the disk.

        For images, RESERVE_BYTES must be free beyond that.

        Raises:
            OSError: the disk is full or failing.
        """
        if self._failed is not None:
            raise self._failed
        self._wanted = self.size + size
        while not self._fits(size, image=image):
            if self._full is not None:
                raise self._full
            self._wait_for_disk()

    def _copy(self, at: int, buffers: Sequence[Buffer], blocks: list[memoryview]) -> int:
        """Copy bytes that belong at offset `at` of the file into blocks of memory.

        The block in use is filled first. Then those of `blocks` are filled and removed from that list, then
        free blocks. The call waits for the disk if no block is free.

        Returns:
            Offset in the file of the end of the copied bytes.

        Raises:
            OSError: the disk failed while the call waited for a free block.
        """
        waiting = self._waiting
        for buffer in buffers:
            view = memoryview(buffer)
            while view:
                if not waiting.room:
                    waiting.add_block(blocks.pop() if blocks else self._take(at))
                part = view[: waiting.room]
                waiting.copy(at, part)
                at += len(part)
                view = view[len(part) :]
        return at

    def _accept_until(self, at: int) -> None:
        """Accept the copied bytes up to offset `at`: the writing thread may write them from now on.

        The thread is woken if enough bytes wait.
        """
        self.size = self._committed = at
        if at - self._written >= self._gather:
            with self._change:
                self._change.notify_all()

    def release_reserve(self) -> None:
        """Do nothing: this file always keeps disk space for the recording's end, which images may not use."""

    def wait_until(self, size: int) -> None:
        """Wait until other programs can read the first `size` bytes from the file.

        Raises:
            OSError: the disk failed before these bytes were in the file.
        """
        with self._change:
            self._change.wait_for(lambda: self._readable >= size or self._failed is not None)
            if self._readable < size and self._failed is not None:
                raise self._failed

    def sync(self) -> None:
        """Do nothing: the writing thread calls fdatasync."""

    def finish(self) -> None:
        """Write all accepted bytes, cut the file to their length, fsync and close it.

        Raises:
            OSError: the disk failed; the file is closed all the same.
        """
        try:
            self._end()
            if self._failed is not None:
                raise self._failed
            os.fsync(self._fd)
        finally:
            os.close(self._fd)

    def abort(self) -> None:
        """Write the accepted bytes as far as the disk allows, cut the file to their length, close it."""
        try:
            self._end()
        except OSError:  # as far as the disk allows
            pass
        finally:
            os.close(self._fd)

    def _end(self) -> None:
        """Wait until the writing thread wrote all bytes or failed; free the memory, cut the file's padding.

        Raises:
            OSError: the file cannot be cut.
        """
        with self._change:
            self._closing = True
            self._change.notify_all()
        self._thread.join()
        self._waiting.close()
        # Cut the padding and give back the allocated space that was not used.
        os.ftruncate(self._fd, self.size if self._failed is None else self._readable)

    def _fits(self, size: int, *, image: bool) -> bool:
        """True if `size` bytes more fit in the file's allocated space; images leave RESERVE_BYTES free."""
        return self.size + size + (RESERVE_BYTES if image else 0) <= self._allocated

    def _take(self, at: int) -> memoryview:
        """Take and return a free block of memory for the file's bytes from offset `at` on.

        While no block is free it waits for the writing thread, which is permitted to write the bytes before
        `at` meanwhile and so frees their blocks.

        Raises:
            OSError: the disk failed.
        """
        while True:
            try:
                return self._memory.take()
            except IndexError:
                self._committed = at
                self._wait_for_disk()

    def _take_blocks(self, size: int) -> list[memoryview]:
        """Take the free blocks that copying `size` bytes needs besides the block in use.

        Waits for the disk while too few blocks are free.

        Returns:
            Blocks of BLOCK_BYTES; an empty list if the block in use has room enough.

        Raises:
            OSError: the disk failed; the blocks were given back.
        """
        blocks: list[memoryview] = []
        try:
            while size > self._waiting.room + len(blocks) * BLOCK_BYTES:
                blocks.append(self._take(self.size))
        except OSError:
            for block in blocks:
                self._memory.give_back(block)
            raise
        return blocks

    def _wait_for_disk(self) -> None:
        """Wake the writing thread, and wait until it has written something, at most FLUSH_S.

        Raises:
            OSError: the disk failed.
        """
        with self._change:
            self._change.notify_all()
            self._change.wait(FLUSH_S)
        if self._failed is not None:
            raise self._failed

    # --- writing thread ---

    def _run(self) -> None:
        while True:
            with self._change:
                gathered = self._change.wait_for(
                    lambda: self._closing or self._committed - self._written >= self._gather, FLUSH_S
                )
                ending, size = self._closing, self._committed
            try:
                self._allocate_ahead()
                # Under load the last page is left for the next write, which is due soon.
                self._write(size, tail=ending or not gathered)
                if self._written - self._synced >= self._sync_bytes:
                    self._synced = self._written
                    os.fdatasync(self._fd)
            except Exception as error:  # whatever ends this thread, no other may wait for it for ever
                self._failed = error if isinstance(error, OSError) else OSError(errno.EIO, repr(error))
                self._waiting.release_borrowed()
            with self._change:
                self._change.notify_all()
                if self._failed is not None or (ending and self._readable == self.size):
                    return

    def _allocate_ahead(self) -> None:
        """Allocate disk space beyond the file's end, in smaller steps as the disk fills up.

        If the disk refuses even BLOCK_BYTES, the error is kept in `_full` and no more is allocated.
        """
        step = ALLOCATE_BYTES
        while self._full is None and self._allocated < max(self._written + self._ahead, self._wanted):
            try:
                allocate(self._fd, self._allocated, step)
                self._allocated += step
            except OSError as error:
                if error.errno == errno.EINTR:
                    continue
                if step == BLOCK_BYTES:
                    self._full = error
                step = max(BLOCK_BYTES, step // 4)

    def _write(self, size: int, *, tail: bool) -> None:
        """Write the waiting bytes before offset `size` of the file.

        Without `tail` only whole pages are written; with it the last page is padded with zeros.

        Raises:
            OSError: the disk refuses.
        """
        while True:
            whole = min(size - size % PAGE_BYTES, self._written + MOST_WRITE_BYTES)
            views = self._waiting.views(self._written, whole)
            last = whole == size - size % PAGE_BYTES
            padded = size % PAGE_BYTES if last and tail and self._readable < size else 0
            if padded:
                self._tail[:padded] = b"".join(self._waiting.views(whole, size))
                self._tail[padded:] = bytes(PAGE_BYTES - padded)
                views.append(memoryview(self._tail))
            if views:
                write_pages(self._fd, views, self._written)
            with self._change:
                self._written = whole
                self._readable = max(self._readable, whole + padded)
            self._waiting.drop_written(whole)
            if last:
                return
