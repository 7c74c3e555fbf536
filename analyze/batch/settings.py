"""What an analysis depends on beside the recording: its code, its libraries and what the user set."""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict, dataclass
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

_ROOT = Path(__file__).resolve().parent.parent.parent
_PACKAGES = ("analyze", "schemas")
_OF_NO_MATTER = ("analyze/batch", "analyze/cards", "analyze/commands", "analyze/replay", "analyze/reproduce", "analyze/results/templates")
"""what shows results, or asks for them"""
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

    def json(self) -> dict[str, Any]:
        """As plain values."""
        return asdict(self)


@cache
def analysis_version() -> str:
    """Short, of the code that computes and of the libraries it computes with: another one may give other numbers."""
    digest = hashlib.sha256()
    for package in _PACKAGES:
        for path in sorted((_ROOT / package).rglob("*.py")):
            name = path.relative_to(_ROOT).as_posix()
            if not name.startswith(_OF_NO_MATTER):
                digest.update(f"{name}\n".encode() + path.read_bytes())
    for library in _LIBRARIES:
        digest.update(f"{library} {version(library)}\n".encode())
    return digest.hexdigest()[:16]


def key_of(content_id: str, settings: BatchSettings) -> str:
    """A result's name: of the recording's content, the analysis and its settings."""
    return hashlib.sha256(f"{content_id}\n{analysis_version()}\n{settings.digest}".encode()).hexdigest()[:32]
