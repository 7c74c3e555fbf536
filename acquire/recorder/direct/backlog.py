"""Memory for a recording past the page cache, so that a disk standstill of BACKLOG_S loses no image."""

from __future__ import annotations

import math
from typing import Final

from acquire.frames.page_memory import PAGE_BYTES
from acquire.recorder.direct.block_memory import BLOCK_BYTES, BlockMemory
from acquire.recorder.frame_format import FrameFormat

BACKLOG_S: Final = 2.0
"""longest standstill of the disk during which no image is dropped [s]"""


def backlog_frames(frames: FrameFormat) -> int:
    """Number of camera buffers that a recording may borrow (keep until they are on the disk) at a time.

    It is the number of frames that arrive in BACKLOG_S (2 s), or 0 for images smaller than a page (4096
    bytes), which are copied instead.

    Args:
        frames: size and rate of the frames.
    """
    return math.ceil(BACKLOG_S * frames.frame_rate_hz) if frames.image_bytes >= PAGE_BYTES else 0


def backlog_memory(frames: FrameFormat, borrowable: int) -> BlockMemory:
    """Allocate and return blocks of memory for the bytes of a recording that are copied.

    These are the records between two images and each image's last bytes, less than a page (4096 bytes).

    Args:
        frames: size of the images.
        borrowable: greatest number of images that wait for the disk in the camera's buffers at a time.
    """
    # Two pages at most are copied for each image: its end, and the records between it and the next image.
    # Eight blocks more, because the end of one file is written beside the head of the next.
    return BlockMemory(borrowable * 2 * PAGE_BYTES + 8 * BLOCK_BYTES, borrowable * frames.image_bytes)
