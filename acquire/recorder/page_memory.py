"""Memory of whole pages, there before it is needed: what O_DIRECT writes from, and what a camera's stream writes into."""

from __future__ import annotations

import mmap
from typing import Final

PAGE: Final = 4096
"""a multiple of every disk's block"""
_STEP: Final = 2 << 20
"""a huge page"""
_POPULATE_WRITE: Final = 23
"""MADV_POPULATE_WRITE (Linux 5.14): every page is there before the first frame comes"""


def page_memory(size: int) -> mmap.mmap:
    """At least `size` bytes of zeros that begin on a page, in huge pages where the kernel has them; no first touch faults later."""
    # Private: memory that is shared gets no huge pages where the kernel is set up as usual (shmem_enabled = never).
    memory = mmap.mmap(-1, -(-size // _STEP) * _STEP, flags=mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS)
    if hasattr(mmap, "MADV_HUGEPAGE"):
        memory.madvise(mmap.MADV_HUGEPAGE)
    for start in range(0, len(memory), _STEP):  # madvise keeps the interpreter: not for long at a time
        try:
            memory.madvise(_POPULATE_WRITE, start, _STEP)
        except OSError:  # an older kernel: touch each page
            for at in range(start, start + _STEP, mmap.PAGESIZE):
                memory[at] = 0
    return memory


def whole_pages(size: int) -> int:
    """`size`, rounded up."""
    return -(-size // PAGE) * PAGE
