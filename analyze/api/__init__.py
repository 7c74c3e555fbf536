"""Public API behind `import analyze`, for notebooks and scripts: recordings, estimates, strike plans."""

from analyze.api.functions import estimate as estimate
from analyze.api.functions import load as load
from analyze.api.functions import plan as plan
from analyze.api.mass_properties import CentreOfMass as CentreOfMass
from analyze.api.mass_properties import InertiaTensor as InertiaTensor
from analyze.api.mass_properties import PartMass as PartMass
from analyze.api.object_estimate import ObjectEstimate as ObjectEstimate
from analyze.api.recording import Recording as Recording
from analyze.api.recording import Strike as Strike
from analyze.api.recording import StrikeFit as StrikeFit
from analyze.api.strike_plan import Plan as Plan
from analyze.errors import AnalyzeError as AnalyzeError
