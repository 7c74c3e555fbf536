"""Inputs of an import: plan, videos of tosses, and the checks that all sources must pass."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from analyze.cameras.camera_file import CameraFile
from analyze.errors import ImportRefused
from analyze.importing.options import ImportOptions
from analyze.reading.object_file import ObjectFiles
from analyze.sources.open_source import open_source
from analyze.sources.source import FrameSource
from analyze.sources.video import VideoSource
from schemas.document import read_text
from schemas.output_file import OutputError
from schemas.strike_plan import StrikePlan, parse_strike_plan


@dataclass(frozen=True)
class StruckPlan:
    """Plan of the strikes that the sources show, with its text, which is attached to the recording."""

    plan: StrikePlan
    """the plan that was struck, or what was found to be struck"""
    text: str
    """content of the plan's file"""


def read_plan(path: Path, files: ObjectFiles) -> StruckPlan:
    """Read the plan that was struck.

    Raises:
        ImportRefused: the plan is of another object.
        DocumentError: the file cannot be used.
    """
    text = read_text(path)
    plan = parse_strike_plan(text, str(path))
    if plan.object_sha256 != files.sha256:
        raise ImportRefused(
            f"{path}: made for another object than {files.spec.name!r}: repeat `analyze plan` for this one; "
            "or, if the object file was edited after the strikes, import with the one of the plan, then "
            "`analyze rebase` the recording"
        )
    return StruckPlan(plan, text)


def refuse_full(folder: Path | None, kept: Sequence[VideoSource]) -> None:
    """Check that the disk has room for the videos that go into the recording without recoding.

    Args:
        folder: folder on the disk; None for no check.
        kept: these videos; each needs as much room in the recording as its file has.

    Raises:
        OutputError: the disk has less room.
    """
    needed = sum(video.path.stat().st_size for video in kept)
    if folder is not None and (free := shutil.disk_usage(folder).free) < needed:
        raise OutputError(
            f"{folder}: has {free / 1e6:.0f} MB free, the recording needs {needed / 1e6:.0f} MB: choose "
            "another place"
        )


def refuse_other_camera(source: FrameSource, camera: CameraFile) -> None:
    """Check that a source's images have the size for which the camera's lens was calibrated.

    Raises:
        ImportRefused: they have another size.
    """
    spec = camera.calibration
    if (source.width, source.height) == (spec.width, spec.height):
        return
    sizes = f"{source.width} x {source.height} px, {camera.path} is of {spec.width} x {spec.height}"
    remedy = "calibrate with a video of the strikes' camera mode, not with photos"
    if (source.width, source.height) == (spec.height, spec.width):
        remedy = (
            "one of them was rotated when it was edited or shared: import and calibrate with the videos as "
            "the camera recorded them, in the sensor's orientation"
        )
    raise ImportRefused(f"{source.name}: has {sizes}: {remedy}")


def open_tosses(options: ImportOptions) -> tuple[FrameSource, ...]:
    """Videos or folders that show a toss each, whose times are even where they are stored as coded.

    Raises:
        ImportRefused: a source cannot be read, or is slow motion in a part of it only.
    """
    tosses = tuple(open_source(path, options.source) for path in options.tosses)
    for source in tosses:
        if isinstance(source, VideoSource) and source.storable_format is not None:
            times = [pictures.times_ns for pictures in source.coded()]
            source.check_constant_rate(np.sort(np.concatenate(times)))
    return tosses
