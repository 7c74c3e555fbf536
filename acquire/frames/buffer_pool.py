"""Pools of page-aligned frame buffers.

Some buffers of a camera's pool circulate between its stream, which fills them, and the reader of the frames.
The others are a reserve. A reader may borrow a buffer, that is, keep its pixels until they are on the disk.
A buffer of the reserve then takes its place, so that the stream always has the same number of buffers.
"""

from __future__ import annotations

import threading
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from acquire.frames.frame import Frame
from acquire.frames.page_memory import page_memory, whole_pages


class BufferPool:
    """Numbered buffers for the pixels of frames, each at the beginning of a page of memory.

    A slot is the number of a buffer. A circulating buffer is either with the camera's stream, to be filled,
    or with the frame received into it. A borrowed buffer is kept by the reader of its frame until it is
    released. The other buffers are the reserve, from which borrowed buffers are replaced. Any thread may
    borrow and release.
    """

    def __init__(
        self,
        circulating: int,
        reserve: int,
        payload: int,
        requeue: Callable[[int], None] = lambda _slot: None,
    ) -> None:
        """Allocate the memory of all buffers.

        Args:
            circulating: number of buffers that belong to the camera's stream to begin with: slots 0 to
                circulating - 1.
            reserve: number of buffers that replace borrowed ones.
            payload: size of a buffer in bytes.
            requeue: function that gives a buffer, by its number, back to the stream to be filled; not called
                after `close`.
        """
        count, stride = circulating + reserve, whole_pages(payload)
        # Views of it keep the memory: the memory of a closed camera lives as long as one of its frames is
        # borrowed.
        memory = np.frombuffer(page_memory(count * stride), np.uint8)
        self._memory = memory[: count * stride].reshape(count, stride)
        self.circulating = circulating
        self._reserve = list(range(circulating, count))
        self._requeue: Callable[[int], None] | None = requeue
        self._lock = threading.Lock()

    def __len__(self) -> int:
        return len(self._memory)

    @property
    def reserve(self) -> int:
        """Number of free buffers that can replace borrowed ones (kept until their pixels are on the disk)."""
        return len(self._reserve)

    def address(self, slot: int) -> int:
        """Memory address of the first byte of buffer number `slot`."""
        return self._memory[slot].ctypes.data

    def image(self, slot: int, width: int, height: int) -> NDArray[np.uint8]:
        """View of the pixels in buffer number `slot`, shape (height, width), uint8; nothing is copied."""
        return self._memory[slot, : width * height].reshape(height, width)

    def buffer(self, slot: int) -> PooledBuffer:
        """Handle of buffer number `slot`, into which the camera's stream received a frame."""
        return PooledBuffer(self, slot)

    def copy(self, frame: Frame) -> Frame | None:
        """Copy a frame's image into a buffer of the reserve (the pool's free buffers).

        Returns:
            The frame with the copied image and its new buffer, which the caller must release; None if the
            reserve is empty.
        """
        with self._lock:
            if not self._reserve:
                return None
            slot = self._reserve.pop()
        height, width = frame.image.shape
        image = self.image(slot, width, height)
        image[:] = frame.image
        return frame._replace(image=image, buffer=PooledBuffer(self, slot, borrowed=True))

    def replace(self) -> bool:
        """Give the camera's stream a free buffer of the reserve, in place of one that is to be borrowed.

        Returns:
            True if the stream got one; False if the reserve is empty or the pool is closed: the buffer then
            cannot be borrowed.
        """
        with self._lock:
            if not self._reserve or self._requeue is None:
                return False
            # The buffer released last: part of it may still be in the processor's caches.
            self._requeue(self._reserve.pop())
            return True

    def give_back(self, slot: int, *, borrowed: bool) -> None:
        """Put buffer number `slot` back: into the reserve if it was borrowed, else to the camera's stream.

        After `close` nothing is done with a buffer that was not borrowed.
        """
        with self._lock:
            if borrowed:
                self._reserve.append(slot)
            elif self._requeue is not None:
                self._requeue(slot)

    def close(self) -> None:
        """Disconnect the pool from the camera's stream; borrowed buffers stay valid until their release."""
        with self._lock:
            self._requeue = None


class PooledBuffer:
    """Handle of the buffer that holds one frame's pixels; implements the interface FrameBuffer.

    Args:
        pool: owner of the buffer.
        slot: number of the buffer in the pool.
        borrowed: True if the buffer was taken from the pool's reserve, for a copy of the frame; it returns
            there on release.
    """

    __slots__ = ("_pool", "borrowed", "slot")

    def __init__(self, pool: BufferPool, slot: int, *, borrowed: bool = False) -> None:
        self._pool = pool
        self.slot = slot
        self.borrowed = borrowed

    def borrow(self) -> bool:
        """Keep the pixels unchanged until `release`; the camera's stream gets a free buffer instead.

        Returns:
            True if the buffer is borrowed; False if the pool has no free buffer or is closed: the pixels are
            then valid only until the reader of the frame returns.
        """
        self.borrowed = self._pool.replace()
        return self.borrowed

    def release(self) -> None:
        """Put the buffer back: into the pool's reserve if it was borrowed, else to the camera's stream.

        Call it once.
        """
        self._pool.give_back(self.slot, borrowed=self.borrowed)
