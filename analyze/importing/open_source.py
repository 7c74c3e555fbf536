"""What a path on the command line is: a video, a folder of images."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from analyze.errors import ImportRefused
from analyze.importing.image_folder import ImageFolder
from analyze.importing.source import FrameSource
from analyze.importing.video import VideoSource


@dataclass(frozen=True)
class SourceOptions:
    """What the user says of the sources."""

    capture_hz: float | None = None
    """rate at which a slow-motion video was captured"""
    times: Path | None = None
    """CSV with the times of a folder's images"""


def open_source(path: Path, options: SourceOptions) -> FrameSource:
    """The source at `path`.

    Raises:
        ImportRefused: it is none that can be read.
    """
    if not path.exists():
        raise ImportRefused(f"{path}: no such file or folder: check the path")
    if path.is_dir():
        if options.capture_hz is not None:
            raise ImportRefused(f"{path}: --capture-fps is of videos: a folder's images have the times of its CSV")
        return ImageFolder(path, options.times)
    return VideoSource(path, options.capture_hz)
