"""Image source: a folder of images with a CSV of their times, as high-speed cameras' programs write."""

from __future__ import annotations

import csv
from collections import Counter
from collections.abc import Callable, Iterator
from decimal import Decimal, InvalidOperation
from itertools import pairwise
from pathlib import Path
from typing import TextIO, TypeVar

import numpy as np

from analyze.errors import ImportRefused
from analyze.reading.image_message import decode_image_file
from analyze.reading.time_range import is_within
from analyze.sources.frame_timing import usual_interval
from analyze.sources.image_file import IMAGE_SUFFIXES, image_file
from analyze.sources.source import TimedFile, TimedImage
from schemas.session_manifest import TimeSource
from schemas.wording import counted

T = TypeVar("T")
_NAME, _TIME = "name", "time_s"
COLUMNS = f"{_NAME},{_TIME}"
FILE_SUFFIXES = {".png", ".jpg", ".jpeg"}
MIN_INTERVAL_S, MAX_INTERVAL_S = 1e-5, 0.5
"""bounds of the interval between two images [s]: no camera is faster, and a slower one misses the tip"""


class ImageFolder:
    """Source of the images in a folder, in the order of their times.

    Args:
        folder: folder with the images.
        times: CSV with the columns `name` (path relative to the folder) and `time_s`; None for the only CSV
            in the folder.

    Raises:
        ImportRefused: the CSV is missing, not understood, names fewer than two images or contradicts itself,
            or its earliest image cannot be read.
    """

    def __init__(self, folder: Path, times: Path | None = None) -> None:
        self.path = folder
        self.name = folder.name
        self.time_source = TimeSource.CONTAINER_PTS
        self.wall_start_ns: int | None = None
        self._csv = times or _only_csv(folder)
        self._images = _read_times(self._csv, folder)
        self.frame_count: int | None = len(self._images)
        self.time_sd_ns = _rounding_sd_ns(self._csv)
        self.rate_hz = 1e9 / usual_interval([time_ns for time_ns, _ in self._images])
        self.is_coded = True
        self.holds_files = {path.suffix.lower() for _, path in self._images} <= FILE_SUFFIXES
        first = self._read(self._images[0][1], decode_image_file)
        self.height, self.width = first.shape

    @property
    def remarks(self) -> tuple[str, ...]:
        """One remark for the user if the CSV does not name all images of the folder, else empty."""
        named = {path.resolve() for _, path in self._images}
        there = [path.resolve() for path in self.path.iterdir() if path.suffix.lower() in IMAGE_SUFFIXES]
        unnamed = sum(path not in named for path in there)
        return (
            (f"{self.name}: left out {unnamed} of {counted(len(there), 'image')}: not in {self._csv.name}",)
            if unnamed
            else ()
        )

    def frames(self, start_ns: int | None = None, end_ns: int | None = None) -> Iterator[TimedImage]:
        """Yield the decoded grey images with their times since the first image, in increasing order.

        Args:
            start_ns: earliest time since the first image [ns], included; None for no limit.
            end_ns: latest time since the first image [ns], included; None for no limit.

        Raises:
            ImportRefused: an image cannot be read, or differs in size from the first.
        """
        for time_ns, path in self._between(start_ns, end_ns):
            image = self._read(path, decode_image_file)
            self._refuse_other_size(path, image.shape[1], image.shape[0])
            yield TimedImage(time_ns, image)

    def files(self, start_ns: int | None = None, end_ns: int | None = None) -> Iterator[TimedFile]:
        """Yield the images as PNG or JPEG files with their times since the first image, in increasing order.

        Images of other formats are converted to PNG.

        Args:
            start_ns: earliest time since the first image [ns], included; None for no limit.
            end_ns: latest time since the first image [ns], included; None for no limit.

        Raises:
            ImportRefused: an image cannot be read, or differs in size from the first.
        """
        for time_ns, path in self._between(start_ns, end_ns):
            file = self._read(path, image_file)
            self._refuse_other_size(path, file.width, file.height)
            yield TimedFile(time_ns, file)

    def _between(self, start_ns: int | None, end_ns: int | None) -> Iterator[tuple[int, Path]]:
        return (timed for timed in self._images if is_within(timed[0], start_ns, end_ns))

    def _read(self, path: Path, decode: Callable[[bytes], T | None]) -> T:
        """Read an image file and convert its bytes with `decode`.

        Args:
            path: path of the image.
            decode: conversion of the file's bytes; it returns None for bytes that are no image.

        Returns:
            The result of `decode`, such as grey values.

        Raises:
            ImportRefused: the file cannot be read, or is not an image.
        """
        try:
            found = decode(path.read_bytes())
        except OSError as error:
            raise ImportRefused(
                f"{path}: cannot be read: {error.strerror}: check what {self._csv.name} names"
            ) from None
        if found is None:
            raise ImportRefused(f"{path}: not a readable image: leave it out of {self._csv.name}")
        return found

    def _refuse_other_size(self, path: Path, width: int, height: int) -> None:
        if (width, height) != (self.width, self.height):
            sizes = f"{width} x {height}, the first {self.width} x {self.height}"
            raise ImportRefused(f"{path}: has {sizes}: leave it out of {self._csv.name}")


def _only_csv(folder: Path) -> Path:
    """Path of the only CSV file in a folder.

    Raises:
        ImportRefused: the folder contains none, or several.
    """
    found = sorted(folder.glob("*.csv"))
    if len(found) == 1:
        return found[0]
    if not found:
        raise ImportRefused(
            f"{folder}: the times of its images are unknown: put a CSV with the columns {COLUMNS} into it"
        )
    raise ImportRefused(
        f"{folder}: contains {len(found)} CSV files: name the one with the times, as --times {found[0]}"
    )


def _read_times(path: Path, folder: Path) -> list[tuple[int, Path]]:
    """Read a CSV of images; return time and path of each image, in the order of the times.

    Times are since the first image [ns].

    Args:
        path: the CSV.
        folder: folder that the CSV's names are relative to.

    Raises:
        ImportRefused: the CSV is not understood, names fewer than two images or one twice, two images have
            the same time, or the median interval is outside `MIN_INTERVAL_S` to `MAX_INTERVAL_S`.
    """
    found = _read_lines(path, folder)
    if len(found) < 2:
        raise ImportRefused(
            f"{path}: names {counted(len(found), 'image')}: a strike needs more: name all images with "
            "their times"
        )
    start = found[0][0]
    timed = [(round((time_s - start) * 10**9), image) for time_s, image in found]
    often, count = Counter(str(image) for _, image in found).most_common(1)[0]
    if count > 1:
        raise ImportRefused(f"{path}: names {often} {count} times: each image has one time: correct it")
    for (earlier, _), (later, image) in pairwise(timed):
        if later <= earlier:
            raise ImportRefused(f"{path}: two images have the same time, one is {image.name}: correct it")
    usual_s = 1e-9 * float(np.median(np.diff([time_ns for time_ns, _ in timed])))
    if not MIN_INTERVAL_S < usual_s < MAX_INTERVAL_S:
        raise ImportRefused(
            f"{path}: its images come every {usual_s:.3g} s: {_TIME} must be in seconds, not milliseconds or "
            "frame numbers"
        )
    return timed


def _read_lines(path: Path, folder: Path) -> list[tuple[Decimal, Path]]:
    """Read the lines of a CSV of images; return time [s, decimal number] and path of each image, by time.

    The times count from the zero that the CSV uses.

    Args:
        path: the CSV.
        folder: folder that the CSV's names are relative to.

    Raises:
        ImportRefused: the CSV cannot be read, lacks a column, or a line has no name or no time.
    """
    found: list[tuple[Decimal, Path]] = []
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            rows = _rows(file)
            if not {_NAME, _TIME} <= set(rows.fieldnames or ()):
                columns = ",".join(rows.fieldnames or ()) or "none"
                raise ImportRefused(f"{path}: has the columns {columns}: it needs {COLUMNS}")
            for row in rows:
                if not (row[_NAME] or "").strip():
                    raise ImportRefused(
                        f"{path}: line {rows.line_num}: names no image: correct it, or leave the line out"
                    )
                time_s = _seconds(row[_TIME])
                if time_s is None:
                    raise ImportRefused(
                        f"{path}: line {rows.line_num}: {_TIME} {row[_TIME]!r} is not a number of seconds"
                    )
                found.append((time_s, folder / row[_NAME].strip()))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise ImportRefused(
            f"{path}: cannot be read as CSV ({error}): it needs the columns {COLUMNS}"
        ) from None
    return sorted(found)


def _rows(file: TextIO) -> csv.DictReader[str]:
    """Reader of a CSV's rows, each a mapping from column name to text.

    Column names are in lower case and without surrounding blanks.
    """
    rows = csv.DictReader(file)
    rows.fieldnames = [name.strip().lower() for name in rows.fieldnames or ()]
    return rows


def _seconds(text: str | None) -> Decimal | None:
    """Parse a time [s] to a decimal number; None if the text is missing or no finite number.

    A float has too few digits for seconds since 1970.
    """
    try:
        value = Decimal((text or "").strip())
    except InvalidOperation:
        return None
    return value if value.is_finite() else None


def _rounding_sd_ns(path: Path) -> int:
    """Standard deviation [ns] of the rounding of a CSV's times: unit of the last decimal / sqrt(12).

    The time with the most decimals counts; times in exponent notation are ignored. The result is at least
    1 ns.
    """
    with path.open(encoding="utf-8-sig", newline="") as file:
        digits = max(
            (
                len(row[_TIME].strip().partition(".")[2])
                for row in _rows(file)
                if "e" not in row[_TIME].lower()
            ),
            default=9,
        )
    return max(1, round(10.0 ** (9 - digits) / 12**0.5))
