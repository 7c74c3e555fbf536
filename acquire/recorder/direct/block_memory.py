"""Memory for bytes on their way to the disk: blocks of equal size, allocated once and reused."""

from __future__ import annotations

import threading
from collections import deque
from typing import Final

from acquire.frames.page_memory import page_memory

BLOCK_BYTES: Final = 1 << 20


class BlockMemory:
    """A fixed number of page-aligned blocks of BLOCK_BYTES, which any thread may take and give back.

    The object also counts the bytes that wait for the disk in borrowed camera buffers, which are kept until
    their images are on the disk.
    """

    def __init__(self, size: int, most_borrowed_bytes: int = 0) -> None:
        """Allocate at least eight blocks, together at least `size` bytes.

        Args:
            size: number of bytes needed in blocks.
            most_borrowed_bytes: greatest number of bytes that wait in borrowed camera buffers besides. No
                block is allocated for these; they only count in the attribute `most_bytes`.
        """
        self.blocks = max(8, -(-size // BLOCK_BYTES))
        self.most_bytes = self.blocks * BLOCK_BYTES + most_borrowed_bytes
        """greatest number of bytes that may wait for the disk"""
        whole = memoryview(page_memory(self.blocks * BLOCK_BYTES))
        self._free = deque(
            whole[at : at + BLOCK_BYTES] for at in range(0, self.blocks * BLOCK_BYTES, BLOCK_BYTES)
        )
        self._borrowed_bytes = 0
        self._lock = threading.Lock()

    @property
    def free(self) -> int:
        """Number of blocks that can be taken now."""
        return len(self._free)

    @property
    def used_bytes(self) -> int:
        """Number of bytes that wait for the disk in blocks (each counts in full) and in camera buffers."""
        return (self.blocks - self.free) * BLOCK_BYTES + self._borrowed_bytes

    def take(self) -> memoryview:
        """Take a free block and return it as a view of BLOCK_BYTES.

        It is the one that was given back last, which is still in the processor's cache.

        Raises:
            IndexError: no block is free.
        """
        return self._free.pop()

    def give_back(self, block: memoryview) -> None:
        """Make `block`, which was taken before, available again."""
        self._free.append(block)

    def count_borrowed(self, size: int) -> None:
        """Count `size` bytes more (negative: fewer) that wait for the disk in borrowed camera buffers."""
        with self._lock:
            self._borrowed_bytes += size
