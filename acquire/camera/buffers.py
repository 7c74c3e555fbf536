"""The buffers of a camera's stream: whole pages of our own memory.

Some circulate between stream and reader. Of the others one takes the place of each frame that is kept, so that frames which wait for a
disk never take a buffer from reception.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from acquire.recorder.page_memory import page_memory, whole_pages

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from acquire.camera.base import Frame


class FrameBuffers:
    """Slots of `payload` bytes, each at the beginning of a page; the first `circulating` are the stream's to begin with."""

    def __init__(self, circulating: int, spare: int, payload: int) -> None:
        count, stride = circulating + spare, whole_pages(payload)
        # Views of it keep the memory: that of a closed camera lives as long as a frame of it is kept.
        self._memory = np.frombuffer(page_memory(count * stride), np.uint8)[: count * stride].reshape(count, stride)
        self.circulating = circulating
        self._spare = list(range(circulating, count))
        self._kept: dict[int, Frame] = {}

    def __len__(self) -> int:
        return len(self._memory)

    def address(self, slot: int) -> int:
        """Of the slot's first byte."""
        return self._memory[slot].ctypes.data

    def image(self, slot: int, width: int, height: int) -> NDArray[np.uint8]:
        """View (height, width) of a slot."""
        return self._memory[slot, : width * height].reshape(height, width)

    def keep(self, frame: Frame) -> int | None:
        """The slot to take the frame's place; None where there is none, and the frame is not kept."""
        if not self._spare:
            return None
        self._kept[frame.token] = frame
        return self._spare.pop()  # the one released last: the processor may have some of it in its caches

    def release(self, frame: Frame) -> int | None:
        """The slot to go back to the stream; None where another took its place, or the frame is of another camera."""
        kept = self._kept.get(frame.token)
        if kept is None:
            return frame.token
        if kept is frame:
            del self._kept[frame.token]
            self._spare.append(frame.token)
        return None
