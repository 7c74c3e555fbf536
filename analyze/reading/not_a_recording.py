"""Text for a path that is no recording: what it is instead, and the command that makes a recording of it."""

from __future__ import annotations

from pathlib import Path

from schemas.input_file import open_file

BAG_METADATA = "metadata.yaml"
"""file in the folder of a ROS 2 bag"""
VIDEO_FOLDER = "a folder of videos"
"""kind of a folder with videos"""
_VIDEOS = frozenset({".mp4", ".mov", ".mkv", ".avi", ".webm", ".m4v"})
_IMAGES = frozenset({".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".pgm", ".webp"})
_VIDEO_MAGIC = (
    (4, b"ftyp"),
    (4, b"moov"),
    (4, b"mdat"),
    (0, b"\x1aE\xdf\xa3"),
    (8, b"AVI "),
    (0, b"GIF8"),
    (0, b"\x00\x00\x01\xba"),
    (0, b"FLV"),
)
"""places and bytes by which MP4, Matroska, AVI, GIF, MPEG and Flash videos are recognised"""
_SQLITE = b"SQLite format 3\x00"


def not_a_recording(path: Path) -> str:
    """Message to the user on an existing file or folder that is no recording: its kind, and what to do.

    Videos, folders of images and bags of ROS 2 are named, with the command `analyze import`, which makes
    recordings of them.

    Args:
        path: the file or folder; it may be unreadable.
    """
    try:
        what = _folder_kind(path) if path.is_dir() else _file_kind(path)
    except OSError as error:
        return f"{path}: cannot be read: {error.strerror}"
    inside = sorted(file.name for file in path.glob("*.mcap"))
    name_one = f"name a file in it, as {inside[0]}" if inside else ""
    if what is not None:
        files = f"{path.name}/*{_first_video(path)}" if what == VIDEO_FOLDER else path.name
        to_import = f"`analyze import {files}` makes one of it (options: `analyze import --help`)"
        return f"{path}: is {what}, not a recording: {to_import}{'; or ' if inside else ''}{name_one}"
    if not path.is_dir():
        return (
            f"{path}: is not a recording: it does not begin like an MCAP file: name a .mcap file, as "
            "`acquire session`, `acquire demo` and `analyze import` write it"
        )
    return f"{path}: is a folder, not a recording: {name_one or 'name an MCAP file'}"


def _folder_kind(path: Path) -> str | None:
    """Kind of a folder that `analyze import` reads, as "a ROS 2 bag"; None for other folders."""
    names = [file.suffix.lower() for file in path.iterdir()]
    if (path / BAG_METADATA).is_file():
        return "a ROS 2 bag"
    if any(name in _VIDEOS for name in names):
        return VIDEO_FOLDER
    return "a folder of images" if any(name in _IMAGES for name in names) else None


def _first_video(folder: Path) -> str:
    """Ending of the first video in a folder that has one, as ".mp4"."""
    return next(file.suffix for file in sorted(folder.iterdir()) if file.suffix.lower() in _VIDEOS)


def _file_kind(path: Path) -> str | None:
    """Kind of a file that `analyze import` reads by its first bytes, as "a video"; None for other files."""
    with open_file(path) as file:
        head = file.read(16)
    if head.startswith(_SQLITE) and path.suffix.lower() == ".db3":
        return "a ROS 2 bag"
    if any(head[at : at + len(magic)] == magic for at, magic in _VIDEO_MAGIC):
        return "a video"
    return None
