"""Interface of sources of images: a video, a folder of images, an MCAP file or a ROS 2 bag."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from analyze.sources.image_file import ImageFile
from schemas.session_manifest import TimeSource


class TimedImage(NamedTuple):
    """One decoded image of a source, as grey values, with its capture time since the source's start [ns]."""

    time_ns: int
    """capture time (mid-exposure) since the source's start, as the source states it [ns]"""
    image: NDArray[np.uint8]
    """(height, width) grey values; valid until the next image is read, unless copied"""


class TimedFile(NamedTuple):
    """One image of a source as a PNG or JPEG file, with its capture time since the source's start [ns]."""

    time_ns: int
    """capture time (mid-exposure) since the source's start, as the source states it [ns]"""
    file: ImageFile
    """the image as a PNG or JPEG file"""


class Frames(Protocol):
    """Interface of a sequence of images with increasing times, which may be read several times."""

    def frames(self, start_ns: int | None = None, end_ns: int | None = None) -> Iterator[TimedImage]:
        """Yield the decoded grey images in a range of times, each with its capture time.

        Args:
            start_ns: earliest time since the source's start [ns], included; None for no limit.
            end_ns: latest time since the source's start [ns], included; None for no limit.
        """
        ...


class FrameSource(Frames, Protocol):
    """Interface of the images of a file or folder; no file stays open between two readings.

    Raises (constructors and reading methods):
        ImportRefused: the source cannot be read, or its images differ in size.
    """

    name: str
    """Name of the file or folder, for messages."""
    width: int
    """Width of the images [px]."""
    height: int
    """Height of the images [px]."""
    time_source: TimeSource
    """Clock of the times: time stamps in the imported file, or arrival at the host that recorded it."""
    time_sd_ns: int
    """Standard deviation of a frame's time relative to the others [ns]."""
    wall_start_ns: int | None
    """Wall clock at the source's start [ns since 1970]; None if unknown."""
    rate_hz: float
    """Frame rate as captured, where no frame is missing [Hz]."""
    frame_count: int | None
    """Number of frames that the source states, for progress; None if it states none."""
    is_coded: bool
    """True if images must be decoded, which takes longer than reading pixels."""
    holds_files: bool
    """True if the images are PNG or JPEG files, which `files` yields."""

    @property
    def remarks(self) -> tuple[str, ...]:
        """Remarks for the user on faults of the source, such as that it is cut short or rotated.

        They are complete once all images were read.
        """
        ...

    def files(self, start_ns: int | None = None, end_ns: int | None = None) -> Iterator[TimedFile]:
        """Yield the images as PNG or JPEG files with their capture times.

        A file is unchanged where the source stores PNG or JPEG. Use it only for sources with `holds_files`;
        others may leave out images or raise ImportRefused.

        Args:
            start_ns: earliest time since the source's start [ns], included; None for no limit.
            end_ns: latest time since the source's start [ns], included; None for no limit.
        """
        ...
