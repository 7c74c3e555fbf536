"""Interface of the file under a recording: bytes are appended in order until it is finished or aborted."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import ClassVar, NamedTuple, Protocol

from schemas.mcap.records import Buffer


class BorrowedRun(NamedTuple):
    """Borrowed pages, unchanged until they are released, with the bytes before and after them."""

    lead: bytes
    """fills the file up to the beginning of a page"""
    pages: list[memoryview]
    """one view per image, of whole pages; each begins on a page of the memory"""
    following: list[bytes]
    """bytes after each view: whole pages, except for the last"""
    release: list[Callable[[], None]]
    """called once each, by any thread, when the pages are in the file or will never be"""

    @property
    def borrowed_bytes(self) -> int:
        """Size of the borrowed pages."""
        return sum(map(len, self.pages))

    @property
    def own_bytes(self) -> int:
        """Size of the bytes around the borrowed pages."""
        return len(self.lead) + sum(map(len, self.following))


class RecordingFile(Protocol):
    """PageCacheFile or DirectFile. One thread at a time appends; others may call `sync` and `wait_until`."""

    @property
    def size(self) -> int:
        """Number of bytes accepted so far."""
        ...

    never_waits: ClassVar[bool]
    """True if `append` returns without waiting for the disk as long as there is room"""

    def has_room(self, size: int, *, image: bool, borrowed: int = 0) -> bool:
        """True if `size` bytes, and `borrowed` bytes in borrowed pages, are accepted now.

        Images leave some room for the rest.
        """
        ...

    def append(self, buffers: Sequence[Buffer], *, image: bool = False) -> int:
        """Accept `buffers`, all or none; they may be reused on return. Waits where there is no room.

        Returns:
            Their size.

        Raises:
            OSError: the disk is full or failing. Part of a full disk is reserved, and not available to
                images.
        """
        ...

    def append_borrowed(self, run: BorrowedRun) -> int:
        """Accept images in borrowed buffers.

        Returns:
            Their size, with the bytes around them.

        Raises:
            OSError: as from `append`; no buffer was released.
        """
        ...

    def release_reserve(self) -> None:
        """Make the reserved space available to everything: the recording takes no more images."""
        ...

    def wait_until(self, size: int) -> None:
        """Wait until others can read the first `size` bytes from the file.

        Raises:
            OSError: the disk failed before.
        """
        ...

    def sync(self) -> None:
        """Push bytes to the disk if enough have gathered. Called regularly; may take long."""
        ...

    def finish(self) -> None:
        """Write everything to the disk and close the file.

        Raises:
            OSError: the disk refuses; the file is closed all the same.
        """
        ...

    def abort(self) -> None:
        """Close the file; it holds the accepted bytes as far as the disk allows."""
        ...
