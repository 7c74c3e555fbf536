"""Consistency tests: between recordings, between a strike's estimators, and with the paper's method.

The paper is VISAPP 2013; its centre of mass is computed in paper.py.
"""

# scipy is only partly typed.
# pyright: reportMissingTypeStubs=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false, reportUnknownMemberType=false

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import chdtri, ndtr, ndtri

from analyze.estimation.equiplane import standing_angle
from analyze.estimation.joint_model import COM, SECOND, JointModel
from analyze.estimation.mass_properties import CentreOfMass
from analyze.estimation.paper import PaperCentre
from analyze.estimation.priors import ComPrior, SystematicErrors
from analyze.types import EquiPlane, MotionFit, TipMotion
from schemas.strike_result import Verdict

FALSE_ALARM_PROBABILITY = 1e-3
"""False-alarm probability of the test that recordings share one centre of mass."""
MIN_ROBUST_WEIGHT = 1e-3
"""Lower bound of a strike's robust weight, which divides its variance."""
MAX_SIGMAS = 3.0
"""Standardised difference above which two answers disagree; one pair in 370 exceeds it by chance."""
THREE_ERRORS_AS_ONE = 2.5 / 3.30
"""Factor from the norm of three standardised errors to the equally likely one of a single error."""


@dataclass(frozen=True)
class Agreement:
    """Result of the test of one centre of mass for all recordings against one for each recording.

    It holds the largest distance [m] of a recording's own centre of mass from the first recording's, and the
    decrease of chi^2 with its critical value.
    """

    largest_shift: float
    """Largest distance [m] of a recording's own centre of mass from the first recording's."""
    chi_squared: float
    """Decrease of chi^2 if every recording has its own centre of mass."""
    limit: float
    """Critical value of `chi_squared` at the false-alarm probability; infinite for one recording."""

    @property
    def holds(self) -> bool:
        """True if one centre of mass explains all recordings.

        It does if a centre of mass of its own for each recording lowers chi^2 by at most `limit`.
        """
        return self.chi_squared <= self.limit


def agreement(
    planes: Sequence[EquiPlane],
    recorded_in: Sequence[int],
    com: CentreOfMass,
    systematic: SystematicErrors,
    prior: ComPrior,
) -> Agreement:
    """Test whether all recordings have one centre of mass c: likelihood ratio against one c for each.

    The test is linear about `com`, the estimate from all strikes. With one c, the covariance of the residuals
    contains the strikes' noise, the errors that strikes share, and the prior of c. With one c for each
    recording, every recording but the first has a shift of its c as a further unknown, whose sd is that of
    the prior of c.

    Args:
        planes: Equi-planes of the strikes used: per strike, the plane through pivot line and c.
        recorded_in: (strikes,) number of each strike's recording; the smallest counts as the first one.
        com: Centre of mass c estimated from all strikes, in the object frame O, with the strikes' robust
            weights (below 1 for outliers), which divide the variances of the noise.
        systematic: Standard deviations of the errors that strikes share (tilt, scale, edge radius), as used
            for `com`.
        prior: Prior of c that `com` was estimated with.

    Returns:
        Largest shift of c [m], decrease of chi^2 and its critical value. With a single recording the shift
        and the decrease are 0 and the critical value is infinite, so that the test always holds.
    """
    model = JointModel(planes, systematic)
    at = np.concatenate([com.position, np.zeros(model.count - COM.stop)])
    residual, design = model.residual(at), model.design(at)
    by_com, shared = design[:, COM] * prior.sd, design[:, SECOND.stop :]
    variance = np.hypot([plane.sd_phi for plane in planes], systematic.strike_angle_sd) ** 2 / np.maximum(
        com.robust, MIN_ROBUST_WEIGHT
    )
    covariance = np.diag(variance) + shared @ shared.T + by_com @ by_com.T
    others = sorted(set(recorded_in))[1:]
    mine = np.equal(np.array(recorded_in, dtype=np.int64)[:, None], others).astype(np.float64)
    shifts = np.einsum("so,sc->soc", mine, by_com).reshape(len(planes), 3 * len(others))
    weighted = np.linalg.solve(covariance, np.column_stack([shifts, residual]))
    information = np.eye(shifts.shape[1]) + shifts.T @ weighted[:, :-1]
    score = shifts.T @ weighted[:, -1]
    shift = np.linalg.solve(information, score)
    largest_shift = np.linalg.norm(shift.reshape(-1, 3) * prior.sd, axis=1).max(initial=0.0)
    limit = float(chdtri(shifts.shape[1], FALSE_ALARM_PROBABILITY)) if others else np.inf
    return Agreement(float(largest_shift), float(score @ shift), limit)


@dataclass(frozen=True)
class EstimatorDisagreement:
    """Two estimators of one strike's motion that differ in phi or k by more than chance explains.

    phi is the balance angle, at which the centre of mass stands above the edge; k the rate constant of the
    pendulum equation theta'' = -k sin(phi - theta) of the tipping angle theta.
    """

    strike_id: str
    """Id of the strike."""
    used: str
    """Name of the estimator used."""
    other: str
    """Name of the estimator that differs from it."""
    phi_off: float
    """phi, the balance angle, of the other estimator minus that of the one used [rad]."""
    sigmas: float
    """Standardised difference of phi, or of k if `k_off` is given."""
    k_off: float | None = None
    """k of the other estimator over that of the one used, minus 1; None if it is phi that disagrees."""


def estimator_disagreements(motions: Sequence[TipMotion]) -> tuple[EstimatorDisagreement, ...]:
    """Pairs of estimators of one strike whose phi or k differ by more than chance explains.

    The fit used for a strike is compared with each alternative, the fit of the same frames by another
    estimator. The limit rises with the number of comparisons, so that chance exceeds it anywhere in a
    session as rarely as `MAX_SIGMAS` in one comparison (9 comparisons: 3.6 sd). Not compared are:

    - motions without a fit;
    - alternatives whose assumptions the motion violates (the fit lists them);
    - alternatives without k, unless the strike's verdict is "good": they take phi to be the angle at which
      the motion passes the balance.

    Args:
        motions: Motions of the strikes, with their fits: balance angle phi [rad] and rate constant k
            [rad/s^2] of the pendulum equation theta'' = -k sin(phi - theta) of the tipping angle theta.

    Returns:
        One entry per alternative that differs, in the order of the motions; empty if none does.
    """
    compared = [
        (motion.strike_id, motion.fit, other)
        for motion in motions
        if motion.fit is not None
        for other in motion.alternatives
        if not other.violated and (other.k is not None or motion.verdict is Verdict.GOOD)
    ]
    limit = sigmas_of_any(sum(1 if other.k is None else 2 for _, _, other in compared))
    found = (_disagreement(*each, limit) for each in compared)
    return tuple(each for each in found if each is not None)


def sigmas_of_any(comparisons: int) -> float:
    """Standardised difference that chance exceeds in any of several comparisons as rarely as 3 sd in one.

    The comparisons are independent and normal. `MAX_SIGMAS` (3) for one comparison or none.
    """
    alone = 2.0 * float(ndtr(-MAX_SIGMAS))
    each = -np.expm1(np.log1p(-alone) / max(comparisons, 1))
    return -float(ndtri(0.5 * each))


def _disagreement(
    strike_id: str, fit: MotionFit, other: MotionFit, limit: float
) -> EstimatorDisagreement | None:
    """Disagreement between the fit used and the fit `other` of one strike's motion; None if they agree.

    They are compared in the balance angle phi and, if both have one, in the rate constant k; they disagree if
    either differs by more than `limit` sd. Reported are the estimators, the difference of phi [rad], and that
    of phi or k in sd, whichever is larger; if it is that of k, also its relative difference.
    """
    off = other.phi - fit.phi
    sigmas = abs(off) / float(np.sqrt(fit.covariance[0, 0] + other.covariance[0, 0]))
    if fit.k is not None and other.k is not None:
        sd = float(np.sqrt(fit.covariance[1, 1] + other.covariance[1, 1]))
        if abs(other.k - fit.k) > max(limit, sigmas) * sd:
            return EstimatorDisagreement(
                strike_id, fit.estimator, other.estimator, off, abs(other.k - fit.k) / sd, other.k / fit.k - 1
            )
    if sigmas > limit:
        return EstimatorDisagreement(strike_id, fit.estimator, other.estimator, off, sigmas)
    return None


@dataclass(frozen=True)
class CentreDifference:
    """Distance of the paper's centre of mass from the joint estimate of it, in m and in sd.

    The paper is VISAPP 2013; the joint estimate uses all strikes together.
    """

    distance: float
    """Distance between the two [m]."""
    sigmas: float
    """Norm of the difference in standard deviations, times `THREE_ERRORS_AS_ONE`."""

    @property
    def agree(self) -> bool:
        """True if the paper's centre of mass and the joint estimate differ by at most `MAX_SIGMAS` sd."""
        return self.sigmas <= MAX_SIGMAS


def centre_difference(
    paper: PaperCentre, planes: Sequence[EquiPlane], com: CentreOfMass, prior: ComPrior
) -> CentreDifference:
    """Distance between the paper's centre of mass and the joint estimate of it, with its significance.

    The paper (VISAPP 2013) states no standard deviation. Each of its planes is therefore given the variance
    of its balance angle plus that of a uniform error of up to `paper.err` [rad], the half-angle of the wedges
    whose overlap is the paper's centre of mass.

    Args:
        paper: The paper's centre of mass, found from `planes`, in the object frame O.
        planes: Equi-planes (planes through pivot line and centre of mass) at the paper's balance angles.
        com: Joint estimate of the centre of mass of the same body, in O.
        prior: Prior of the centre of mass, used for both.

    Returns:
        Distance [m], and the same in standard deviations: the norm of the three standardised components,
        times `THREE_ERRORS_AS_ONE`, so that 3 is as unlikely as an error of 3 sd of one quantity.
    """
    off = paper.position - com.position
    information = np.diag(prior.sd**-2)
    for plane in planes:
        turned = 1e-6 * np.eye(3)
        at = standing_angle(
            np.concatenate([com.position + turned, com.position - turned]),
            plane.direction,
            plane.up,
            plane.point,
        )
        by = (at[:3] - at[3:]) / 2e-6
        information += np.outer(by, by) / (plane.sd_phi**2 + paper.err**2 / 3.0)
    covariance = np.linalg.inv(information) + com.covariance
    return CentreDifference(
        float(np.linalg.norm(off)),
        THREE_ERRORS_AS_ONE * float(np.sqrt(off @ np.linalg.solve(covariance, off))),
    )
