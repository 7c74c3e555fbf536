"""Interface of sources of images: a video, a folder of images, an MCAP file or a ROS 2 bag."""

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
    """capture time (mid-exposure) since the source's start, as the source states it [ns]"""
    image: NDArray[np.uint8]
    """(height, width) grey values; valid until the next image is read, unless copied"""


class TimedFile(NamedTuple):
    """One image of a source as a file."""

    time_ns: int
    """as in TimedImage [ns]"""
    file: ImageFile


class Frames(Protocol):
    """Images in the order of their increasing times, which may be read several times."""

    def frames(self, start_ns: int | None = None, end_ns: int | None = None) -> Iterator[TimedImage]:
        """Images from `start_ns` to `end_ns` since the source's start, both included."""
        ...


class FrameSource(Frames, Protocol):
    """Images of a file or folder, to be used in a `with` statement.

    Raises (all methods):
        ImportRefused: it cannot be read, or not with these options.
    """

    @property
    def name(self) -> str:
        """Name of the file or folder, for messages."""
        ...

    @property
    def width(self) -> int:
        """Width of the images [px]."""
        ...

    @property
    def height(self) -> int:
        """Height of the images [px]."""
        ...

    @property
    def time_source(self) -> TimeSource:
        """Origin of the times."""
        ...

    @property
    def time_sd_ns(self) -> int:
        """Standard deviation of a frame's time relative to the others [ns]."""
        ...

    @property
    def wall_start_ns(self) -> int | None:
        """Wall clock at the source's start [ns since 1970]; None if unknown."""
        ...

    @property
    def rate_hz(self) -> float:
        """Frame rate as captured, where no frame is missing [Hz]."""
        ...

    @property
    def frame_count(self) -> int | None:
        """Number of frames, for progress; None if unknown before reading."""
        ...

    @property
    def remarks(self) -> tuple[str, ...]:
        """Remarks for the user: cut short, rotated, times assumed. Complete once all images were read."""
        ...

    @property
    def is_coded(self) -> bool:
        """True if images must be decoded, which takes longer than reading pixels."""
        ...

    @property
    def holds_files(self) -> bool:
        """True if the images are PNG or JPEG files, which `files` yields."""
        ...

    def files(self, start_ns: int | None = None, end_ns: int | None = None) -> Iterator[TimedFile]:
        """The images that `frames` yields, as files, not decoded."""
        ...

    def close(self) -> None:
        """Release the file."""
        ...

    def __enter__(self) -> Self:
        """The source itself."""
        ...

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close it."""
        ...
