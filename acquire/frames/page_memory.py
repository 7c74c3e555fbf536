"""Memory that begins on a page and whose pages all exist before use.

A camera's stream writes frames into it, and the disk reads them from it without the page cache (O_DIRECT).
"""

from __future__ import annotations

import mmap
from typing import Final

PAGE_BYTES: Final = 4096
"""page size in bytes; a multiple of every disk's block size"""
_HUGE_PAGE_BYTES: Final = 2 << 20
"""size of a huge page in bytes"""
_MADV_POPULATE_WRITE: Final = 23
"""madvise(2), Linux 5.14: every page exists before the first frame arrives"""


def page_memory(size: int) -> mmap.mmap:
    """Allocate at least `size` zero bytes that begin on a page; no later access causes a page fault.

    A page fault in the middle of a strike costs more than copying a frame. Huge pages are used where the
    kernel offers them.

    Returns:
        The memory; its length is `size` rounded up to whole huge pages (2 MiB).
    """
    # Private: shared memory gets no huge pages in the kernel's usual configuration (shmem_enabled = never).
    memory = mmap.mmap(
        -1, -(-size // _HUGE_PAGE_BYTES) * _HUGE_PAGE_BYTES, flags=mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS
    )
    if hasattr(mmap, "MADV_HUGEPAGE"):
        memory.madvise(mmap.MADV_HUGEPAGE)
    for start in range(0, len(memory), _HUGE_PAGE_BYTES):  # madvise holds the GIL: only for a short time each
        try:
            memory.madvise(_MADV_POPULATE_WRITE, start, _HUGE_PAGE_BYTES)
        except OSError:  # an older kernel: touch each page
            for at in range(start, start + _HUGE_PAGE_BYTES, mmap.PAGESIZE):
                memory[at] = 0
    return memory


def whole_pages(size: int) -> int:
    """`size` [bytes], rounded up to a multiple of PAGE_BYTES (4096); returns bytes."""
    return -(-size // PAGE_BYTES) * PAGE_BYTES
