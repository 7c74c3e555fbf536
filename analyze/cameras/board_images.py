"""Where the images of a calibration come from: files, folders, patterns, recordings, videos."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from analyze.errors import CalibrationError
from analyze.reading.image_message import image_of_file
from analyze.reading.recording import open_recording
from schemas import topics

SUFFIXES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".pgm", ".webp")
RECORDING = ".mcap"
VIDEOS = (".mp4", ".mov", ".m4v", ".mkv", ".avi", ".webm", ".3gp")
EVERY_NS = 200_000_000
"""of a recording or a video: a board that is moved by hand is elsewhere after this"""

Image = NDArray[np.uint8]


def named_files(inputs: Sequence[Path]) -> list[Path]:
    """The files that are meant: each as named, those of a folder, those that a pattern in quotes fits. Once each.

    Raises:
        CalibrationError: there is no such file, or no image in a folder.
    """
    found: list[Path] = []
    for given in inputs:
        if given.is_dir():
            inside = sorted(path for path in given.iterdir() if path.suffix.lower() in SUFFIXES)
            if not inside:
                raise CalibrationError(f"{given}: holds no images ({', '.join(SUFFIXES)}): name the folder they are in, or a recording")
            found += inside
        elif given.exists():
            found.append(given)
        else:
            try:
                pattern = str(given.relative_to(given.anchor))
                fitting = sorted(Path(given.anchor or ".").glob(pattern)) if any(c in pattern for c in "*?[") else []
            except ValueError:  # no pattern: as img**.png
                fitting = []
            if not fitting:
                raise CalibrationError(f"{given}: no such file or folder: check the path")
            found += [path for path in fitting if path.suffix.lower() in (*SUFFIXES, *VIDEOS, RECORDING)]
    return list(dict.fromkeys(found))


def images(files: Sequence[Path], progress: Callable[[str, int, int], None]) -> Iterator[tuple[str, Image]]:
    """Name and grey values of each image; of a recording or a video five a second.

    Raises:
        CalibrationError: a file is no image.
        ImportRefused: a video cannot be read.
        RecordingError: a recording cannot be read.
    """
    for number, path in enumerate(files):
        progress("reading", number, len(files))
        if path.suffix == RECORDING:
            yield from _recorded(path, progress)
        elif path.suffix.lower() in VIDEOS:
            yield from _filmed(path, progress)
        else:
            yield str(path), one_image(path)


def one_image(path: Path) -> Image:
    """Grey values of an image file, as the sensor has them: a photo's note of how the camera was held is not followed.

    Of a video the first image: a camera that stands needs no other.

    Raises:
        CalibrationError: it is none.
        ImportRefused: a video cannot be read.
    """
    if path.suffix.lower() in VIDEOS:
        return next(image for _, image in _filmed(path, lambda _text, _done, _total: None))
    try:
        data = path.read_bytes()
    except OSError as error:
        raise CalibrationError(f"{path}: cannot be read: {error.strerror}: check the path") from None
    image = image_of_file(data)
    if image is None:
        raise CalibrationError(f"{path}: is no image that can be read ({', '.join(SUFFIXES)}): leave it out")
    return image


def _recorded(path: Path, progress: Callable[[str, int, int], None]) -> Iterator[tuple[str, Image]]:
    with open_recording(path) as recording:
        times = recording.times(topics.raw_image(recording.camera).name)
        if len(times) == 0:
            raise CalibrationError(f"{path}: holds no images: record one in which the board is shown")
        first, last_taken = int(times[0]), None
        for frame in recording.images():
            progress(f"reading {path.name}", (frame.time_ns - first) // EVERY_NS, (int(times[-1]) - first) // EVERY_NS)
            if last_taken is None or frame.time_ns - last_taken >= EVERY_NS:
                last_taken = frame.time_ns
                yield f"{path} at {(frame.time_ns - first) * 1e-9:.1f} s", frame.image


def _filmed(path: Path, progress: Callable[[str, int, int], None]) -> Iterator[tuple[str, Image]]:
    from analyze.sources.video import VideoSource

    with VideoSource(path) as video:
        last_taken = None
        for number, frame in enumerate(video.frames()):
            if last_taken is None or frame.time_ns - last_taken >= EVERY_NS:
                progress(f"reading {path.name}", number, video.frame_count or number)
                last_taken = frame.time_ns
                yield f"{path} at {frame.time_ns * 1e-9:.1f} s", frame.image
