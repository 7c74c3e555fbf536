"""Whether what should mean the same does: estimators of one strike, the paper's centre of mass and ours, recordings of one object."""

# scipy is only partly typed; its unknowns are no mistakes of ours.
# pyright: reportMissingTypeStubs=false, reportUnknownVariableType=false, reportUnknownArgumentType=false, reportUnknownMemberType=false

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import chdtri

from analyze.estimation.equiplane import standing_angle
from analyze.estimation.joint_model import COM, SECOND, JointModel
from analyze.estimation.paper import PaperCentre
from analyze.estimation.stated import ComPrior, SystematicErrors
from analyze.types import CentreOfMass, EquiPlane, MotionFit, TipMotion
from schemas.result import Verdict

CHANCE = 1e-3
"""of saying that recordings disagree although they do not"""
LEAST_WEIGHT = 1e-3
APART = 3.0
"""sd from which two answers are said to disagree: by chance one pair in 370 does"""
OF_THREE = 2.5 / 3.30
"""what three standardised errors together are as one (as joint.OF_TWO)"""


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


@dataclass(frozen=True)
class EstimatorsApart:
    """Two estimators of one strike that disagree by more than their sd allow."""

    strike_id: str
    used: str
    other: str
    phi_off: float
    """rad, the other's less the one's used"""
    sigmas: float
    k_off: float | None = None
    """relative, where it is k that disagrees"""


def estimators_apart(motions: Sequence[TipMotion]) -> tuple[EstimatorsApart, ...]:
    """Where another estimator of a strike means another phi or k than the one used.

    Not where the other's assumptions are known to be violated (that stands beside it), nor a sign change where the strike rocked back:
    there was no passage to be found. They see the same frames, so that less than their two sd together is between them.
    """
    found: list[EstimatorsApart] = []
    for motion in motions:
        if motion.fit is None:
            continue
        for other in motion.alternatives:
            if other.violated or (other.k is None and motion.verdict is not Verdict.GOOD):
                continue
            apart = _apart(motion.strike_id, motion.fit, other)
            if apart is not None:
                found.append(apart)
    return tuple(found)


def _apart(strike_id: str, fit: MotionFit, other: MotionFit) -> EstimatorsApart | None:
    off = other.phi - fit.phi
    sigmas = abs(off) / float(np.sqrt(fit.covariance[0, 0] + other.covariance[0, 0]))
    if fit.k is not None and other.k is not None:
        sd = float(np.sqrt(fit.covariance[1, 1] + other.covariance[1, 1]))
        if abs(other.k - fit.k) > max(APART, sigmas) * sd:
            return EstimatorsApart(strike_id, fit.estimator, other.estimator, off, abs(other.k - fit.k) / sd, other.k / fit.k - 1)
    return EstimatorsApart(strike_id, fit.estimator, other.estimator, off, sigmas) if sigmas > APART else None


@dataclass(frozen=True)
class CentresApart:
    """The paper's centre of mass against ours."""

    distance: float
    """m"""
    sigmas: float
    """of that, as one standardised error"""

    @property
    def agree(self) -> bool:
        """Within what both are known to."""
        return self.sigmas <= APART


def centres_apart(paper: PaperCentre, planes: Sequence[EquiPlane], com: CentreOfMass, prior: ComPrior) -> CentresApart:
    """Compare the paper's centre of mass with ours.

    The paper's has no sd of its own: each of its planes is taken as off by the sd of its angle and, anywhere alike, by up to `paper.err`.

    Args:
        paper: found from `planes`.
        planes: with the paper's angles.
        com: ours, of the same body.
        prior: of both.
    """
    off = paper.position - com.position
    information = np.diag(prior.sd**-2)
    for plane in planes:
        turned = 1e-6 * np.eye(3)
        at = standing_angle(np.concatenate([com.position + turned, com.position - turned]), plane.direction, plane.up, plane.point)
        by = (at[:3] - at[3:]) / 2e-6
        information += np.outer(by, by) / (plane.sd_phi**2 + paper.err**2 / 3.0)
    covariance = np.linalg.inv(information) + com.covariance
    return CentresApart(float(np.linalg.norm(off)), OF_THREE * float(np.sqrt(off @ np.linalg.solve(covariance, off))))
