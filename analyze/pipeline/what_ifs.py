"""Robustness of an estimate under what-ifs, with the motions' alternative estimators among them."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from analyze.estimation.what_ifs import Alternative, alternatives
from analyze.pipeline.equiplanes import equiplanes

if TYPE_CHECKING:
    from collections.abc import Sequence

    from analyze.estimation.joint import JointSolution, MomentModel
    from analyze.estimation.mass_properties import InertialParameters
    from analyze.estimation.priors import ComPrior, SystematicErrors
    from analyze.pipeline.evidence import Evidence
    from analyze.types import EquiPlane, MotionFit, TipMotion


def estimate_alternatives(
    evidence: Evidence,
    motions: Sequence[TipMotion],
    planes: Sequence[EquiPlane],
    priors: tuple[SystematicErrors, ComPrior, MomentModel],
    solution: JointSolution,
    struck: InertialParameters,
) -> tuple[Alternative, ...]:
    """Changes of centre of mass and moments under what-ifs: a changed assumption, strike or estimator.

    The robustness table of the report lists them: per what-if that applies the change of the centre of mass
    [m] in the object frame O, relative changes of the principal moments, and whether the estimate holds. Of
    the strikes left out in turn only the worst is kept. Empty if the centre of mass is not observed, and
    without strikes.

    Args:
        evidence: recordings, object and plan.
        motions: fitted motions of the strikes used, in the order of `planes`.
        planes: equi-planes (planes through pivot line and centre of mass) that the estimate was made from.
        priors: errors that strikes share, prior of the centre of mass, and mass, gravity and prior of the
            moments.
        solution: least-squares solution of all strikes together.
        struck: mass, centre of mass and inertia of the body that tipped, markers included, as stated from
            `solution`.
    """
    if not planes:
        return ()
    return alternatives(planes, *priors, solution, struck, _by_other_estimators(evidence, motions, planes))


def _by_other_estimators(
    evidence: Evidence, motions: Sequence[TipMotion], planes: Sequence[EquiPlane]
) -> tuple[EquiPlane, ...] | None:
    """Equi-planes as they come out by each motion's best other estimator; None if no motion has another.

    An equi-plane is the plane through the pivot line and the centre of mass, with the balance angle phi and
    the rate k of theta'' = -k sin(phi - theta); these are replaced. An estimator whose assumptions the motion
    violates does not count. A contact that rolls keeps its fit.

    Args:
        evidence: recordings, object and plan.
        motions: fitted motions of the strikes, in the order of `planes`.
        planes: equi-planes that the estimate was made from.
    """
    others = [
        _other_fit(motion) if plane.rounded else None for motion, plane in zip(motions, planes, strict=True)
    ]
    if all(other is None for other in others):
        return None
    changed = [
        motion if other is None else replace(motion, fit=other)
        for motion, other in zip(motions, others, strict=True)
    ]
    return tuple(
        plane
        if other is None
        else replace(
            plane,
            phi=new.phi,
            sd_phi=new.sd_phi,
            normal=new.normal,
            k=None if plane.k is None else new.k,
            sd_k=None if plane.k is None else new.sd_k,
            cov_phi_k=new.cov_phi_k,
        )
        for plane, other, new in zip(planes, others, equiplanes(evidence, changed), strict=True)
    )


def _other_fit(motion: TipMotion) -> MotionFit | None:
    """Alternative fit of a motion with the smallest sd of the balance angle; None if there is none.

    Only fits that also give the rate k of theta'' = -k sin(phi - theta) are used: the others, such as the
    instant at which the angular acceleration changes sign, can be off by degrees after a hop.
    """
    fits = [
        fit for fit in motion.alternatives if fit.k is not None and not fit.violated and fit.rolling is None
    ]
    return min(fits, key=lambda fit: float(fit.covariance[0, 0]), default=None)
