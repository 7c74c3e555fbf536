"""Preallocated memory for images on their way to the file."""

from __future__ import annotations

from collections import deque

import numpy as np
from numpy.typing import NDArray


class ImageRing:
    """A fixed number of image slots. One thread takes slots, another gives them back."""

    def __init__(self, slots: int, height: int, width: int) -> None:
        # Filled with zeros, not merely reserved: a page fault in the middle of a strike costs more than the copy.
        self._memory = np.full((slots, height, width), 0, dtype=np.uint8)
        self._free = deque(range(slots))

    @property
    def free(self) -> int:
        """Slots that can be taken now."""
        return len(self._free)

    def take(self, image: NDArray[np.uint8]) -> int | None:
        """Copy `image` (height, width) into a free slot; None when there is none."""
        try:
            slot = self._free.pop()  # the one given back last: its memory is still in the processor's cache
        except IndexError:
            return None
        self._memory[slot] = image
        return slot

    def image(self, slot: int) -> NDArray[np.uint8]:
        """View (height, width) of a taken slot."""
        return self._memory[slot]

    def give_back(self, slot: int) -> None:
        """The slot may be taken again."""
        self._free.append(slot)
