"""Interface of a recording's file: bytes are appended in order until it is finished or aborted."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import ClassVar, NamedTuple, Protocol

from schemas.mcap.records import Buffer


class BorrowedRun(NamedTuple):
    """Bytes of a file to append: memory pages of images in borrowed camera buffers, and bytes around them.

    The pages do not change until their buffers are released; the other bytes are copied.
    """

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
        """Total size of the images' pages in borrowed camera buffers [bytes]."""
        return sum(map(len, self.pages))

    @property
    def own_bytes(self) -> int:
        """Number of bytes outside borrowed camera buffers: what precedes and follows the images' pages."""
        return len(self.lead) + sum(map(len, self.following))


class RecordingFile(Protocol):
    """Interface of a recording's file: bytes are appended until it is finished or aborted.

    PageCacheFile and DirectFile implement it. One thread at a time appends; other threads may call `sync` and
    `wait_until`.
    """

    @property
    def size(self) -> int:
        """Number of bytes accepted so far."""
        ...

    never_waits: ClassVar[bool]
    """True if `append` returns without waiting for the disk as long as there is room"""

    def has_room(self, size: int, *, image: bool, borrowed: int = 0) -> bool:
        """True if there is room now for `size` copied bytes and `borrowed` bytes in camera buffers.

        Always True for a PageCacheFile, whose `append` may wait. A DirectFile also returns True if the disk
        is full or failing: `append` then raises the error.

        Args:
            size: bytes to be copied.
            image: True for images, which leave some room for other messages.
            borrowed: bytes in borrowed camera buffers, which are not copied.
        """
        ...

    def append(self, buffers: Sequence[Buffer], *, image: bool = False) -> int:
        """Append all `buffers` to the file, or none; the caller may reuse them on return.

        Waits for the disk while the memory for bytes to be written is full or disk space is not yet
        allocated; a full disk is an error at once.

        Args:
            buffers: bytes to append, in order.
            image: True for images, which may not use the reserved part of the disk.

        Returns:
            Number of bytes appended.

        Raises:
            OSError: the disk is full or failing.
        """
        ...

    def append_borrowed(self, run: BorrowedRun) -> int:
        """Append images from borrowed camera buffers; each is released once the file no longer needs it.

        Args:
            run: the images' borrowed pages, and the bytes before, between and after them.

        Returns:
            Number of bytes appended: the images and the bytes around them.

        Raises:
            OSError: the disk is full or failing; no buffer was released.
        """
        ...

    def release_reserve(self) -> None:
        """Make the disk space reserved for the end of the recording available; no more images follow."""
        ...

    def wait_until(self, size: int) -> None:
        """Wait until other programs can read the first `size` bytes from the file.

        Raises:
            OSError: the disk failed before these bytes were in the file.
        """
        ...

    def sync(self) -> None:
        """Force appended bytes to the disk if enough have gathered. Called regularly; may take long."""
        ...

    def finish(self) -> None:
        """Write all accepted bytes to the disk (fsync) and close the file.

        Raises:
            OSError: the disk refuses; the file is closed all the same.
        """
        ...

    def abort(self) -> None:
        """Close the file without fsync; it holds the appended bytes as far as the disk accepted them."""
        ...
