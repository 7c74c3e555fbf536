"""Options of an import: its files, and the assignment of sources to planned strikes."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from analyze.sources.open_source import SourceOptions


@dataclass(frozen=True)
class ImportOptions:
    """Options of an import (`analyze import`): files, and the assignment of sources to planned strikes."""

    sources: tuple[Path, ...]
    """videos, folders of images, MCAP files or ROS 2 bags"""
    object_path: Path
    """object file (TOML)"""
    plan_path: Path
    """strike plan (JSON)"""
    camera_path: Path | None
    """camera file; None for the calibration in the sources' own files"""
    strikes: tuple[str, ...] = ()
    """ids of planned strikes, "-" to leave one out, or "auto" where the images shall show it, in the order of
    the sources, or of the strikes in a single source"""
    whole: bool = False
    """True if each source shows one strike and is used whole; no onset (begin of a tip) is searched for"""
    source: SourceOptions = field(default_factory=SourceOptions)
    """options for reading the sources, common to all"""
    rate_sd_hz: float | None = None
    """standard deviation of the frame rate [Hz]; None if it was not measured"""
    aside: Path | None = None
    """folder in which the strikes' images are stored until they are written; None to decode them again"""
