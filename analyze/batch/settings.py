"""What an analysis depends on beside the recording: its code, its libraries and what the user set."""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict, dataclass
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

from analyze.errors import ArchiveError

_ROOT = Path(__file__).resolve().parent.parent.parent
_PACKAGES = ("analyze", "schemas")
_OF_NO_MATTER = ("analyze/batch", "analyze/cards", "analyze/verbs", "analyze/replay", "analyze/reproduce", "analyze/report/templates")
"""what shows results, or asks for them"""
_BUT = ("analyze/batch/analysis.py", "analyze/batch/sparse_copy.py", "analyze/batch/table.py")
"""of these what makes rows"""
_LIBRARIES = ("numpy", "scipy", "opencv-python-headless", "trimesh")


@dataclass(frozen=True)
class BatchSettings:
    """What the user may change of every recording's analysis."""

    object_path: str = ""
    """use this object file instead of the recordings' own"""
    object_sha256: str = ""
    """of that file"""
    estimator: str = ""
    """as `EstimateOptions`; "": the one that suits each strike"""
    seed: int = 0

    @property
    def digest(self) -> str:
        """Of everything that matters to the results."""
        told = {name: value for name, value in asdict(self).items() if name != "object_path"}
        return hashlib.sha256(json.dumps(told, sort_keys=True).encode()).hexdigest()[:16]

    @classmethod
    def of_object(cls, path: Path) -> BatchSettings:
        """With an object file instead of the recordings' own.

        Raises:
            AnalyzeError: it cannot be read.
        """
        return cls(object_path=str(path.resolve()), object_sha256=_sha256_of(path))

    def refuse_changed_object(self) -> None:
        """The object file must be the one whose hash names the results.

        Raises:
            ArchiveError: it was changed meanwhile.
            AnalyzeError: it cannot be read.
        """
        if self.object_path and _sha256_of(Path(self.object_path)) != self.object_sha256:
            raise ArchiveError(f"{self.object_path}: was changed while the run went on: start it again")

    def json(self) -> dict[str, Any]:
        """As plain values."""
        return asdict(self)


def _sha256_of(path: Path) -> str:
    from analyze.reading.object_file import object_files  # a run over an archive that did not change needs none

    files = object_files(path)
    return hashlib.sha256(path.read_bytes() + (files.shape_bytes or b"")).hexdigest()


@cache
def analysis_version() -> str:
    """Short, of the code that computes and of the libraries it computes with: another one may give other numbers."""
    digest = hashlib.sha256()
    for package in _PACKAGES:
        for path in sorted((_ROOT / package).rglob("*.py")):
            name = path.relative_to(_ROOT).as_posix()
            if name in _BUT or not name.startswith(_OF_NO_MATTER):
                digest.update(f"{name}\n".encode() + path.read_bytes())
    for library in _LIBRARIES:
        digest.update(f"{library} {version(library)}\n".encode())
    return digest.hexdigest()[:16]


def key_of(content_id: str, settings: BatchSettings) -> str:
    """A result's name: of the recording's content, the analysis and its settings."""
    return hashlib.sha256(f"{content_id}\n{analysis_version()}\n{settings.digest}".encode()).hexdigest()[:32]
