"""Settings and version of a batch analysis, which with the recording's content determine its result."""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict, dataclass
from pathlib import Path

from analyze.cache.code_version import analysis_version
from analyze.errors import ArchiveError
from analyze.pipeline.evidence import RecordingHead


@dataclass(frozen=True)
class BatchSettings:
    """Settings for the analysis of every recording of a batch: object file, estimator, random seed."""

    object_path: str = ""
    """path of the object file to use instead of the recordings' own; "" for theirs"""
    object_sha256: str = ""
    """hash of the object file at `object_path` and its shape file; "" if no object file is given"""
    estimator: str = ""
    """estimator of the balance angle phi and rate constant k, such as pivot_fit; "" for the one that suits
    each strike"""
    seed: int = 0
    """seed of the random draws behind intervals of region, part and filling masses"""

    @property
    def digest(self) -> str:
        """Hash (16 hexadecimal digits) of all settings that affect the results.

        An object file counts by its content (`object_sha256`), not by its path.
        """
        fields = {name: value for name, value in asdict(self).items() if name != "object_path"}
        return hashlib.sha256(json.dumps(fields, sort_keys=True).encode()).hexdigest()[:16]

    @classmethod
    def with_object(cls, path: Path) -> BatchSettings:
        """Default settings, but with the object file `path` in place of the recordings' own.

        Raises:
            ShapeError: the object file or its shape file cannot be read.
        """
        return cls(object_path=str(path.resolve()), object_sha256=_sha256_of(path))

    def refuse_changed_object(self) -> None:
        """Raise ArchiveError if the object file has changed since the settings were made.

        Nothing is checked if the recordings' own object files are used.

        Raises:
            ArchiveError: the object file changed during the run.
            ShapeError: the object file or its shape file cannot be read.
        """
        if self.object_path and _sha256_of(Path(self.object_path)) != self.object_sha256:
            raise ArchiveError(f"{self.object_path}: changed during the run: start the run again")


def _sha256_of(path: Path) -> str:
    from analyze.reading.object_file import read_object_files  # slow to import, rarely needed

    files = read_object_files(path)
    return hashlib.sha256(path.read_bytes() + (files.shape_bytes or b"")).hexdigest()


def key_of(head: RecordingHead, settings: BatchSettings) -> str:
    """Key of a result: hash (32 hexadecimal digits) of recording content, analysis version and settings.

    A copy of a recording with another object file (`analyze rebase`) has the same messages, and a key of its
    own.

    Args:
        head: identity of the recording.
        settings: settings of the analysis.
    """
    content = head.content_id
    if head.manifest.rebased:
        content += f"\n{head.manifest.object_sha256}"
    return hashlib.sha256(f"{content}\n{analysis_version()}\n{settings.digest}".encode()).hexdigest()[:32]
