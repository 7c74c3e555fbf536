"""Whether recordings of one object mean the same body: was it opened, refilled or exchanged in between?"""

# scipy is only partly typed; its unknowns are no mistakes of ours.
# pyright: reportMissingTypeStubs=false, reportUnknownVariableType=false, reportUnknownArgumentType=false, reportUnknownMemberType=false

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import chdtri

from analyze.estimation.joint_model import COM, SECOND, JointModel
from analyze.estimation.stated import ComPrior, SystematicErrors
from analyze.types import CentreOfMass, EquiPlane

CHANCE = 1e-3
"""of saying that recordings disagree although they do not"""
LEAST_WEIGHT = 1e-3


@dataclass(frozen=True)
class Agreement:
    """How much better the strikes fit if every recording may have a centre of mass of its own."""

    apart: float
    """m, the largest distance of a recording's from the first one's"""
    chi_squared: float
    """gained by it"""
    limit: float
    """of chi squared, passed by chance once in a thousand times"""

    @property
    def holds(self) -> bool:
        """One centre of mass will do."""
        return self.chi_squared <= self.limit


def agreement(
    planes: Sequence[EquiPlane], recorded_in: Sequence[int], com: CentreOfMass, systematic: SystematicErrors, prior: ComPrior
) -> Agreement:
    """Compare one c for all recordings with one for each, what the strikes share being shared in both.

    Linear about `com`: the residuals' covariance is that of the strikes, the shared errors and the common c; each further
    recording's shift of c has the body's size as prior. The gain is that of a likelihood ratio.

    Args:
        planes: of the strikes used.
        recorded_in: (strikes,) number of each one's recording.
        com: of all of them.
        systematic: as it was estimated with.
        prior: as it was estimated with.
    """
    model = JointModel(planes, systematic)
    at = np.concatenate([com.position, np.zeros(model.count - COM.stop)])
    residual, design = model.residual(at), model.design(at)
    by_com, shared = design[:, COM] * prior.sd, design[:, SECOND.stop :]
    variance = np.hypot([plane.sd_phi for plane in planes], systematic.strike_angle_sd) ** 2 / np.maximum(com.robust, LEAST_WEIGHT)
    covariance = np.diag(variance) + shared @ shared.T + by_com @ by_com.T
    others = sorted(set(recorded_in))[1:]
    mine = np.array([[number == other for other in others] for number in recorded_in], dtype=np.float64)
    shifts = np.einsum("so,sc->soc", mine, by_com).reshape(len(planes), -1)
    weighted = np.linalg.solve(covariance, np.column_stack([shifts, residual]))
    information = np.eye(shifts.shape[1]) + shifts.T @ weighted[:, :-1]
    told = shifts.T @ weighted[:, -1]
    shift = np.linalg.solve(information, told)
    apart = np.linalg.norm(shift.reshape(-1, 3) * prior.sd, axis=1).max(initial=0.0)
    limit = float(chdtri(shifts.shape[1], CHANCE)) if others else np.inf
    return Agreement(float(apart), float(told @ shift), limit)
