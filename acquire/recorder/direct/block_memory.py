"""Memory for bytes on their way to the disk: equal blocks, allocated once, touched once, used again and again."""

from __future__ import annotations

import threading
from collections import deque
from typing import Final

from acquire.recorder.page_memory import page_memory

BLOCK_BYTES: Final = 1 << 20


class BlockMemory:
    """A fixed number of page-aligned blocks of BLOCK_BYTES. Any thread takes blocks and gives them back."""

    def __init__(self, size: int, most_lent_bytes: int = 0) -> None:
        """At least `size` bytes, and at least eight blocks; `most_lent_bytes` may wait besides, in memory that was lent."""
        self.blocks = max(8, -(-size // BLOCK_BYTES))
        self.most_bytes = self.blocks * BLOCK_BYTES + most_lent_bytes
        """that may wait for the disk"""
        whole = memoryview(page_memory(self.blocks * BLOCK_BYTES))
        self._free = deque(whole[at : at + BLOCK_BYTES] for at in range(0, self.blocks * BLOCK_BYTES, BLOCK_BYTES))
        self._lent_bytes = 0
        self._lock = threading.Lock()

    @property
    def free(self) -> int:
        """Blocks that can be taken now."""
        return len(self._free)

    @property
    def used_bytes(self) -> int:
        """What waits for the disk, in whole blocks, and in memory that was lent."""
        return (self.blocks - self.free) * BLOCK_BYTES + self._lent_bytes

    def take(self) -> memoryview:
        """A block, the one given back last: it is still in the processor's cache.

        Raises:
            IndexError: there is none.
        """
        return self._free.pop()

    def give_back(self, block: memoryview) -> None:
        """The block may be taken again."""
        self._free.append(block)

    def count_lent(self, size: int) -> None:
        """So many bytes more, or fewer, wait in memory that was lent."""
        with self._lock:
            self._lent_bytes += size
