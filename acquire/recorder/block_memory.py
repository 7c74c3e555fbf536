"""Memory for bytes on their way to the disk: equal blocks, allocated once, touched once, used again and again."""

from __future__ import annotations

import mmap
from collections import deque
from typing import Final

BLOCK_BYTES: Final = 1 << 20
_POPULATE_WRITE: Final = 23
"""MADV_POPULATE_WRITE (Linux 5.14): every page is there before the first frame comes"""


class BlockMemory:
    """A fixed number of page-aligned blocks of BLOCK_BYTES. One thread takes blocks, another gives them back."""

    def __init__(self, size: int) -> None:
        """At least `size` bytes, and at least eight blocks."""
        self.blocks = max(8, -(-size // BLOCK_BYTES))
        self._memory = mmap.mmap(-1, self.blocks * BLOCK_BYTES)
        if hasattr(mmap, "MADV_HUGEPAGE"):
            self._memory.madvise(mmap.MADV_HUGEPAGE)
        for start in range(0, len(self._memory), BLOCK_BYTES):  # madvise keeps the interpreter: not for long at a time
            try:
                self._memory.madvise(_POPULATE_WRITE, start, BLOCK_BYTES)
            except OSError:  # an older kernel: touch each page
                for at in range(start, start + BLOCK_BYTES, mmap.PAGESIZE):
                    self._memory[at] = 0
        whole = memoryview(self._memory)
        self._free = deque(whole[at : at + BLOCK_BYTES] for at in range(0, len(whole), BLOCK_BYTES))

    @property
    def free(self) -> int:
        """Blocks that can be taken now."""
        return len(self._free)

    @property
    def used_bytes(self) -> int:
        """What waits for the disk, in whole blocks."""
        return (self.blocks - self.free) * BLOCK_BYTES

    def take(self) -> memoryview:
        """A block, the one given back last: it is still in the processor's cache.

        Raises:
            IndexError: there is none.
        """
        return self._free.pop()

    def give_back(self, block: memoryview) -> None:
        """The block may be taken again."""
        self._free.append(block)
