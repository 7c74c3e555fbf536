"""The file under a recording that is being written: bytes are appended, in order, and it is finished or given up."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import ClassVar, NamedTuple, Protocol

from schemas.mcap.records import Buffer


class LentRun(NamedTuple):
    """Pages that stay as they are, where they are, until they are released, and the bytes of our own around them."""

    lead: bytes
    """brings the file to the beginning of a page"""
    lent: list[memoryview]
    """each of whole pages, and begins on one of the memory"""
    behind: list[bytes]
    """what follows each; whole pages, but for the last"""
    release: list[Callable[[], None]]
    """called once, by any thread, when the pages are in the file or will never be"""

    @property
    def lent_bytes(self) -> int:
        """Of the pages that are lent."""
        return sum(map(len, self.lent))

    @property
    def own_bytes(self) -> int:
        """Of the rest."""
        return len(self.lead) + sum(map(len, self.behind))


class DataFile(Protocol):
    """PageCacheFile or DirectFile. `append` comes from one thread at a time; `sync` and `wait_until` may come beside it."""

    @property
    def size(self) -> int:
        """Bytes taken in so far."""
        ...

    never_waits: ClassVar[bool]
    """whether `append` of what there is room for returns without waiting for the disk"""

    def has_room(self, size: int, *, image: bool, lent: int = 0) -> bool:
        """Whether `size` bytes, and `lent` bytes of lent memory, can be taken in now; images leave some room for the rest."""
        ...

    def append(self, buffers: Sequence[Buffer], *, image: bool = False) -> int:
        """Take in `buffers`, all or none, and return their size. The buffers may be used again. Waits where there is no room.

        Raises:
            OSError: the disk is full or failing. Of a full disk some is kept back, which images do not get.
        """
        ...

    def append_lent(self, run: LentRun) -> int:
        """The same for images that are lent.

        Raises:
            OSError: as from `append`; nothing is released then.
        """
        ...

    def release_reserve(self) -> None:
        """From now on the space kept back is for everything: the recording takes no more images."""
        ...

    def wait_until(self, size: int) -> None:
        """Wait until the first `size` bytes can be read from the file by others.

        Raises:
            OSError: the disk failed before.
        """
        ...

    def sync(self) -> None:
        """Push bytes to the disk if enough have gathered; called every now and then. May take long."""
        ...

    def finish(self) -> None:
        """Everything is on the disk, and the file is closed.

        Raises:
            OSError: the disk refuses; the file is closed all the same.
        """
        ...

    def abort(self) -> None:
        """Close; what was taken in is in the file as far as the disk allows."""
        ...
