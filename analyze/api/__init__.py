"""Public API behind `import analyze`, for notebooks and scripts: recordings, estimates, strike plans."""

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
    "estimate",
    "load",
    "plan",
]
