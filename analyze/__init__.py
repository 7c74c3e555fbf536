"""Percuss, the offline toolkit: plan strikes, read recordings, estimate what is inside an object.

    import analyze

    recording = analyze.load("recordings/sample-1.0.mcap")
    answer = analyze.estimate(recording)
    answer.centre_of_mass.position

The names below are the public interface; everything else may change without notice.
"""

from __future__ import annotations

from importlib import import_module
from importlib.metadata import version
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from analyze.api.functions import estimate, load, plan
    from analyze.api.object_estimate import CentreOfMass, InertiaTensor, ObjectEstimate, PartMass
    from analyze.api.recording import Recording, Strike, StrikeFit
    from analyze.api.strike_plan import Plan
    from analyze.errors import AnalyzeError

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

_HOMES = {
    "AnalyzeError": "analyze.errors",
    "CentreOfMass": "analyze.api.object_estimate",
    "InertiaTensor": "analyze.api.object_estimate",
    "ObjectEstimate": "analyze.api.object_estimate",
    "PartMass": "analyze.api.object_estimate",
    "Plan": "analyze.api.strike_plan",
    "Recording": "analyze.api.recording",
    "Strike": "analyze.api.recording",
    "StrikeFit": "analyze.api.recording",
    "estimate": "analyze.api.functions",
    "load": "analyze.api.functions",
    "plan": "analyze.api.functions",
}
"""module by public name; imported on first use, so that `analyze --help` does not load numpy"""


def __getattr__(name: str) -> Any:
    """Import a public name on its first use (PEP 562)."""
    home = _HOMES.get(name)
    if home is None:
        raise AttributeError(f"module 'analyze' has no attribute {name!r}")
    return getattr(import_module(home), name)


def __dir__() -> list[str]:
    """Public names, for completion."""
    return sorted(__all__)
