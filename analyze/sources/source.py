"""Where foreign images come from: a video, a folder of images, an MCAP file or ROS 2 bag of others. All give the same."""

from __future__ import annotations

from collections.abc import Iterator
from types import TracebackType
from typing import NamedTuple, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from analyze.sources.image_file import ImageFile
from schemas.session_manifest import TimeSource


class TimedImage(NamedTuple):
    """One image of a source."""

    time_ns: int
    """since the source's start, of mid-exposure as well as the source knows it; on the source's clock, that of the capture"""
    image: NDArray[np.uint8]
    """(height, width) mono, as it is to be analysed; valid until the next is asked for, unless it is copied"""


class TimedFile(NamedTuple):
    """One image of a source as it was coded."""

    time_ns: int
    """as a TimedImage's"""
    file: ImageFile


class Frames(Protocol):
    """Images in the order of their times, which rise. May be read several times."""

    def frames(self, start_ns: int | None = None, end_ns: int | None = None) -> Iterator[TimedImage]:
        """Images from `start_ns` to `end_ns` since the source's start, both included."""
        ...


class FrameSource(Frames, Protocol):
    """Images of a file or folder. Use it in a `with` statement.

    Raises (all of it):
        ImportRefused: it cannot be read, or not as asked.
    """

    @property
    def name(self) -> str:
        """The file or folder, for messages."""
        ...

    @property
    def width(self) -> int:
        """Of the images, as they are given out [px]."""
        ...

    @property
    def height(self) -> int:
        """Of the images, as they are given out [px]."""
        ...

    @property
    def time_source(self) -> TimeSource:
        """Where the times come from."""
        ...

    @property
    def time_sd_ns(self) -> int:
        """1 sigma of a frame's time against the others'."""
        ...

    @property
    def wall_start_ns(self) -> int | None:
        """Wall clock at the source's start [ns since 1970], where the source tells."""
        ...

    @property
    def rate_hz(self) -> float:
        """Frames per second as they were captured, where none is missing."""
        ...

    @property
    def frame_count(self) -> int | None:
        """How many frames there are, for progress; None where only reading tells."""
        ...

    @property
    def remarks(self) -> tuple[str, ...]:
        """One line each for what a reader must know: cut short, turned, times made up. Whole once all was read."""
        ...

    @property
    def is_coded(self) -> bool:
        """Whether images must be decoded, which takes longer than reading their pixels."""
        ...

    @property
    def holds_files(self) -> bool:
        """Whether its images are PNG or JPEG files, which `files` gives."""
        ...

    def files(self, start_ns: int | None = None, end_ns: int | None = None) -> Iterator[TimedFile]:
        """The same images as from `frames`, not decoded."""
        ...

    def close(self) -> None:
        """Let go of the file."""
        ...

    def __enter__(self) -> Self:
        """The source itself."""
        ...

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        """Close it."""
        ...
