"""Opens the source of images at a path: a video, a folder of images, an MCAP file or a ROS 2 bag."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from analyze.errors import ImportRefused
from analyze.sources.image_file import IMAGE_SUFFIXES
from analyze.sources.image_folder import ImageFolder
from analyze.sources.listed_timing import table_beside
from analyze.sources.message_files import is_message_file
from analyze.sources.source import FrameSource
from analyze.sources.topic_source import TopicSource
from analyze.sources.video import VideoSource
from analyze.sources.video_container import VIDEO_SUFFIXES
from schemas.wording import counted

OWN_TIMES = Path("-")
"""in place of a table of times: the times that the source itself has, whatever table lies beside it"""


@dataclass(frozen=True)
class SourceOptions:
    """Options for reading images; each applies to one kind of source only, and None is its default.

    `capture_hz` (capture rate [Hz] of a slow-motion video), `times` (CSV with the times of a folder's images
    or a video's frames) and `topic` (topic of an MCAP file or bag).
    """

    capture_hz: float | None = None
    """frame rate at which a slow-motion video was captured [Hz]; None for the rate that the file states"""
    times: Path | None = None
    """CSV with the times of a folder's images or a video's frames; `OWN_TIMES` for a video's own time stamps.

    None for the only CSV in the folder, and for the one beside the video that has its name, if any.
    """
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
        ImportRefused: the path does not exist, it is no readable source, a ROS 1 bag or a folder of videos,
            or a given option does not apply to this kind of source.
    """
    if not path.exists():
        raise ImportRefused(f"{path}: no such file or folder: check the path")
    times = None if options.times == OWN_TIMES else options.times
    if is_message_file(path):
        if options.capture_hz is not None or times is not None:
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
    if path.is_dir():
        _refuse_videos(path)
        if options.capture_hz is not None:
            raise ImportRefused(
                f"{path}: --capture-fps applies to videos only, a folder's images have the times of its CSV: "
                "leave it out"
            )
        return ImageFolder(path, times)
    return _open_video(path, options)


def _refuse_videos(folder: Path) -> None:
    """Raise ImportRefused if a folder contains videos and no images: each video is a source of its own."""
    suffixes = {path.suffix.lower() for path in folder.iterdir()}
    videos = sorted(path for path in folder.iterdir() if path.suffix.lower() in VIDEO_SUFFIXES)
    if videos and suffixes.isdisjoint(IMAGE_SUFFIXES):
        raise ImportRefused(
            f"{folder}: contains {counted(len(videos), 'video')} and no images: name the videos themselves,"
            f" as {folder}/*{videos[0].suffix}"
        )


def _open_video(path: Path, options: SourceOptions) -> VideoSource:
    """Open a video; its times are those of the table given or beside it (`clip.csv`), else the file's own.

    Raises:
        ImportRefused: the video or the table cannot be read, or both a table and a capture rate are given.
    """
    times, remark = (options.times, None) if options.times is not None else table_beside(path)
    if times is None or times == OWN_TIMES:
        video = VideoSource(path, options.capture_hz)
        if remark is not None:
            video.add_remark("table", remark)
        return video
    if options.capture_hz is not None:
        raise ImportRefused(
            f"{path}: --capture-fps does not apply, as {times} has the times of its frames: leave out one of "
            "them (--times - uses the video's own times)"
        )
    return VideoSource(path, times=times)
