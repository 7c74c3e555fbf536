"""Opens the source of images at a path: a video, a folder of images, an MCAP file or a ROS 2 bag."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from analyze.errors import ImportRefused
from analyze.sources.image_folder import ImageFolder
from analyze.sources.message_files import is_message_file
from analyze.sources.source import FrameSource
from analyze.sources.topic_source import TopicSource
from analyze.sources.video import VideoSource


@dataclass(frozen=True)
class SourceOptions:
    """Options for reading images; each applies to one kind of source only, and None is its default.

    `capture_hz` (capture rate [Hz] of a slow-motion video), `times` (CSV with the times of a folder's images)
    and `topic` (topic of an MCAP file or bag).
    """

    capture_hz: float | None = None
    """frame rate at which a slow-motion video was captured [Hz]; None for the rate that the file states"""
    times: Path | None = None
    """CSV with the times of a folder's images; None for the only one in the folder"""
    topic: str | None = None
    """topic of an MCAP file or bag; None for the only one with images"""


def open_source(path: Path, options: SourceOptions) -> FrameSource:
    """Open the source of images at a path, of the kind that the path shows.

    A message file (MCAP, ROS 2 bag) gives a `TopicSource`, a folder an `ImageFolder`, any other file a
    `VideoSource`.

    Args:
        path: file or folder.
        options: how to read it.

    Returns:
        The source; images are read from it with `frames` or `files`.

    Raises:
        ImportRefused: the path does not exist, it is no readable source or a ROS 1 bag, or a given option
            does not apply to this kind of source.
    """
    if not path.exists():
        raise ImportRefused(f"{path}: no such file or folder: check the path")
    if is_message_file(path):
        if options.capture_hz is not None or options.times is not None:
            named = "--capture-fps" if options.capture_hz is not None else "--times"
            raise ImportRefused(
                f"{path}: {named} does not apply to message files, which have times of their own: leave it "
                "out"
            )
        return TopicSource(path, options.topic)
    if path.suffix.lower() == ".bag":
        raise ImportRefused(
            f"{path}: is a ROS 1 bag: convert it with `rosbags-convert --src {path.name} --dst {path.stem}`"
        )
    if options.topic is not None:
        raise ImportRefused(f"{path}: --topic applies to MCAP files and ROS 2 bags only: leave it out")
    if options.times is not None and not path.is_dir():
        raise ImportRefused(
            f"{path}: --times applies to folders of images only, a video has times of its own: leave it out"
        )
    if path.is_dir():
        if options.capture_hz is not None:
            raise ImportRefused(
                f"{path}: --capture-fps applies to videos only, a folder's images have the times of its CSV: "
                "leave it out"
            )
        return ImageFolder(path, options.times)
    return VideoSource(path, options.capture_hz)
