"""Options of an import: its files, and the assignment of sources to planned strikes."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path

from analyze.errors import ImportRefused
from analyze.sources.open_source import SourceOptions
from schemas.wording import counted


@dataclass(frozen=True)
class ImportOptions:
    """Options of an import (`analyze import`): files, and the assignment of sources to planned strikes."""

    sources: tuple[Path, ...]
    """videos, folders of images, MCAP files or ROS 2 bags"""
    object_path: Path
    """object file (TOML)"""
    plan_path: Path | None
    """strike plan (JSON); None for strikes that nobody planned, which are found in the images"""
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
    times: tuple[Path, ...] = ()
    """tables (CSV) of the frames' times in the order of the sources, `OWN_TIMES` for none; empty to look for
    them in a folder, or beside a video"""

    tosses: tuple[Path, ...] = ()
    """videos or folders of images that show a toss each, taken whole, with the camera where it stood"""
    edges: tuple[str, ...] = ()
    """edges that the user states for strikes without a plan, as "s1=+x,bottom\""""
    mat_ruler_mm: float | None = None
    """length of the mat's ruler as measured on the print [mm]; None for the nominal one"""

    def source_options(self) -> tuple[SourceOptions, ...]:
        """Options for reading each source; one table holds for several folders with the same names.

        Raises:
            ImportRefused: the number of tables is not that of the sources.
        """
        times = self.times
        if len(times) == 1 and all(path.is_dir() for path in self.sources):
            times *= len(self.sources)
        if times and len(times) != len(self.sources):
            raise ImportRefused(
                f"--times is given {counted(len(times), 'time')} for {counted(len(self.sources), 'source')}: "
                "give it once for each, in their order (- for a source's own times)"
            )
        if not times:
            return (self.source,) * len(self.sources)
        return tuple(replace(self.source, times=path) for path in times)
