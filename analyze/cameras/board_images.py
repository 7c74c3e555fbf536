"""Reads the images of a calibration from image files, folders, patterns, recordings and videos."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from analyze.errors import CalibrationError
from analyze.progress import Progress, no_progress
from analyze.reading.image_message import decode_image_file
from analyze.reading.recording import open_recording
from analyze.sources.image_file import IMAGE_SUFFIXES
from schemas import topics
from schemas.input_file import read_bytes

RECORDING = ".mcap"
VIDEOS = (".mp4", ".mov", ".m4v", ".mkv", ".avi", ".webm", ".3gp")
SAMPLE_INTERVAL_NS = 200_000_000
"""interval between images taken from a recording or video [ns], in which a hand moves the board noticeably"""

Image = NDArray[np.uint8]


def resolve_inputs(inputs: Sequence[Path]) -> list[Path]:
    """List the files that the given paths stand for, each once, in the order given.

    A folder stands for its images, a pattern such as `img*.png` for the images, videos and recordings that
    match.

    Raises:
        CalibrationError: a file does not exist, a pattern matches no such file, or a folder contains no
            image.
    """
    found: list[Path] = []
    for given in inputs:
        if given.is_dir():
            inside = sorted(path for path in given.iterdir() if path.suffix.lower() in IMAGE_SUFFIXES)
            if not inside:
                raise CalibrationError(
                    f"{given}: contains no images ({', '.join(IMAGE_SUFFIXES)}): name the folder that"
                    " contains them, or a recording"
                )
            found += inside
        elif given.exists():
            found.append(given)
        else:
            try:
                pattern = str(given.relative_to(given.anchor))
                fitting = (
                    sorted(Path(given.anchor or ".").glob(pattern))
                    if any(c in pattern for c in "*?[")
                    else []
                )
            except ValueError:  # not a valid pattern, as img**.png
                fitting = []
            if not fitting:
                raise CalibrationError(f"{given}: no such file or folder: check the path")
            readable = [
                path for path in fitting if path.suffix.lower() in (*IMAGE_SUFFIXES, *VIDEOS, RECORDING)
            ]
            if not readable:
                raise CalibrationError(
                    f"{given}: matches no image, video or recording, only such as {fitting[0].name}: name "
                    "the images of the board"
                )
            found += readable
    return list(dict.fromkeys(found))


def read_images(files: Sequence[Path], progress: Progress) -> Iterator[tuple[str, Image]]:
    """Yield name and grey values (height, width) uint8 of each image.

    Of a recording or video at most five images a second are taken; their names contain the time since the
    first image [s].

    Args:
        files: images, recordings (.mcap) and videos.
        progress: called with a text, the number of files or images read and of all.

    Raises:
        CalibrationError: a file cannot be read or is no image, or a recording contains no images.
        ImportRefused: a video cannot be read.
        RecordingError: a recording cannot be read.
    """
    for number, path in enumerate(files):
        progress("reading", number, len(files))
        if path.suffix.lower() == RECORDING:
            yield from _recording_images(path, progress)
        elif path.suffix.lower() in VIDEOS:
            yield from _video_images(path, progress)
        else:
            yield str(path), read_image(path)


def read_image(path: Path) -> Image:
    """Read an image file, or a video's first image; return grey values (height, width) uint8.

    The image is in the sensor's orientation: a photo's orientation tag is ignored, since the lens belongs to
    the sensor.

    Raises:
        CalibrationError: the file cannot be read, or is no image.
        ImportRefused: a video cannot be read.
    """
    if path.suffix.lower() in VIDEOS:
        return next(image for _, image in _video_images(path, no_progress))
    try:
        data = read_bytes(path)
    except OSError as error:
        raise CalibrationError(f"{path}: cannot be read: {error.strerror}: check the path") from None
    image = decode_image_file(data)
    if image is None:
        raise CalibrationError(f"{path}: not a readable image ({', '.join(IMAGE_SUFFIXES)}): leave it out")
    return image


def _recording_images(path: Path, progress: Progress) -> Iterator[tuple[str, Image]]:
    """Yield name and grey values of a recording's images, `SAMPLE_INTERVAL_NS` or more apart.

    The name is the path with the time since the first image [s].

    Raises:
        CalibrationError: the recording contains no images.
        RecordingError: the recording cannot be read.
    """
    with open_recording(path) as recording:
        times = recording.times(topics.raw_image(recording.camera).name)
        if len(times) == 0:
            raise CalibrationError(f"{path}: contains no images: record one that shows the board")
        first, last_taken = int(times[0]), None
        for frame in recording.images():
            progress(
                f"reading {path.name}",
                (frame.time_ns - first) // SAMPLE_INTERVAL_NS,
                (int(times[-1]) - first) // SAMPLE_INTERVAL_NS,
            )
            if last_taken is None or frame.time_ns - last_taken >= SAMPLE_INTERVAL_NS:
                last_taken = frame.time_ns
                yield f"{path} at {(frame.time_ns - first) * 1e-9:.1f} s", frame.image


def _video_images(path: Path, progress: Progress) -> Iterator[tuple[str, Image]]:
    """Yield name and grey values of a video's images, `SAMPLE_INTERVAL_NS` or more apart.

    The name is the path with the time since the first image [s].

    Raises:
        ImportRefused: the video cannot be read.
    """
    from analyze.sources.video import VideoSource

    video = VideoSource(path)
    last_taken = None
    for number, frame in enumerate(video.frames()):
        if last_taken is None or frame.time_ns - last_taken >= SAMPLE_INTERVAL_NS:
            progress(f"reading {path.name}", number, video.frame_count or number)
            last_taken = frame.time_ns
            yield f"{path} at {frame.time_ns * 1e-9:.1f} s", frame.image
