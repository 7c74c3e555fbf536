"""Image source: a folder of images with a CSV of their times, as high-speed cameras' programs write."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TypeVar

from analyze.errors import ImportRefused
from analyze.reading.image_message import decode_image_file
from analyze.reading.time_range import is_within
from analyze.sources.frame_timing import usual_interval
from analyze.sources.image_file import IMAGE_SUFFIXES, image_file
from analyze.sources.source import TimedFile, TimedImage
from analyze.sources.times_table import TimesTable, checked_times_ns, read_times_table, refuse_repeated
from schemas.input_file import read_bytes
from schemas.session_manifest import TimeSource
from schemas.wording import counted

T = TypeVar("T")
COLUMNS = "name,time_s"
FILE_SUFFIXES = {".png", ".jpg", ".jpeg"}


class ImageFolder:
    """Source of the images in a folder, in the order of their times.

    Args:
        folder: folder with the images.
        times: CSV with the columns `name` (path relative to the folder) and `time_s` (or another column of
            times); None for the only CSV in the folder.

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
        table = read_times_table(self._csv, "image")
        self._table_remark = table.remark
        self._images = _timed_images(table, folder)
        self.frame_count: int | None = len(self._images)
        self.time_sd_ns = table.sd_ns
        self.rate_hz = 1e9 / usual_interval([time_ns for time_ns, _ in self._images])
        self.is_coded = True
        self.holds_files = {path.suffix.lower() for _, path in self._images} <= FILE_SUFFIXES
        first = self._read(self._images[0][1], decode_image_file)
        self.height, self.width = first.shape

    @property
    def remarks(self) -> tuple[str, ...]:
        """Remarks for the user: images of the folder that the CSV does not name, and how it was read."""
        named = {path.resolve() for _, path in self._images}
        there = [path.resolve() for path in self.path.iterdir() if path.suffix.lower() in IMAGE_SUFFIXES]
        unnamed = sum(path not in named for path in there)
        left_out = (
            f"{self.name}: left out {unnamed} of {counted(len(there), 'image')}: not in {self._csv.name}"
        )
        return (*([self._table_remark] if self._table_remark else []), *([left_out] if unnamed else []))

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
            found = decode(read_bytes(path))
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


def _timed_images(table: TimesTable, folder: Path) -> list[tuple[int, Path]]:
    """Time since the first image [ns] and path of each image of a table, in the order of the times.

    Args:
        table: the table, in which each image is named.
        folder: folder that the names are relative to.

    Raises:
        ImportRefused: the table names no images, a row names none, an image has two rows, or two images have
            the same time.
    """
    path, rows = table.path, sorted(table.rows, key=lambda row: row.time_s)
    if rows[0].name is None:
        raise ImportRefused(
            f"{path}: has no column name, which image has which time: add it before the times"
        )
    for row in table.rows:
        if not row.name:
            raise ImportRefused(f"{path}: line {row.line}: names no image: correct it, or leave the line out")
    images = [folder / (row.name or "") for row in rows]
    refuse_repeated(path, [str(image) for image in images])
    return list(zip(checked_times_ns(path, rows, "image"), images, strict=True))
