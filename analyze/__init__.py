"""Offline toolkit of Percuss: plan strikes, read recordings, estimate an object's mass distribution.

    import analyze

    recording = analyze.load("recordings/sample-1.0.mcap")
    answer = analyze.estimate(recording)
    answer.centre_of_mass.position

The names below are the public interface; everything else may change without notice.
"""

from __future__ import annotations

from importlib.metadata import version
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from analyze.api import (
        AnalyzeError,
        CentreOfMass,
        InertiaTensor,
        ObjectEstimate,
        PartMass,
        Plan,
        Recording,
        Strike,
        StrikeFit,
        estimate,
        load,
        plan,
    )

__all__ = [
    "AnalyzeError",
    "CentreOfMass",
    "InertiaTensor",
    "ObjectEstimate",
    "PartMass",
    "Plan",
    "Recording",
    "Strike",
    "StrikeFit",
    "__version__",
    "estimate",
    "load",
    "plan",
]

__version__ = version("percuss")


def __getattr__(name: str) -> Any:
    """Public object with this name, imported on first use (PEP 562): `analyze --help` loads no numpy.

    Raises:
        AttributeError: `name` is not a public name.
    """
    if name not in __all__:
        raise AttributeError(f"module 'analyze' has no attribute {name!r}")
    from analyze import api

    return getattr(api, name)


def __dir__() -> list[str]:
    """Public names in alphabetical order, for tab completion."""
    return sorted(__all__)
