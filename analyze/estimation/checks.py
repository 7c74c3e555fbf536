"""Checks of the answer: each strike predicted from all others, gravity from several R, moments and c within what the shape allows."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from analyze.estimation.joint import OF_TWO, JointSolution, Moments, solve_joint
from analyze.estimation.joint_model import COM, GRAVITY
from analyze.estimation.stated import ComPrior, SystematicErrors
from analyze.types import Array, EquiPlane

UNKNOWN_GRAVITY = 0.2
"""relative 1 sigma, where g is asked for"""
SIGMAS = 3.0
"""from which on something is said to disagree"""


@dataclass(frozen=True)
class LeftOut:
    """A strike beside what all others predict of it."""

    strike_id: str
    phi: float
    """rad, predicted"""
    phi_off: float
    """rad, measured less predicted"""
    phi_sd: float
    """rad, expected of that: of the prediction and of the strike"""
    k_off: float | None
    """relative, the same; None where k is not used"""
    k_sd: float | None
    sigmas: float
    """both together, as one standardised error"""
    k: float
    """rad/s^2, predicted, where the first recording was made"""
    by_others: Array
    """(2, 2) of the predicted (phi, ln k)"""
    own: Array
    """(2, 2), by which the strike's own (phi, ln k) scatter; 0 for a k that is not used"""

    @property
    def foretold(self) -> bool:
        """It is what the others say."""
        return self.sigmas <= SIGMAS


@dataclass(frozen=True)
class Gravity:
    """What the strikes say of g where nothing is stated of it: axes with different R tell it from the moments."""

    relative: float
    """over the stated one, less 1"""
    sd: float

    @property
    def agrees(self) -> bool:
        """Within what it is known to."""
        return abs(self.relative) <= SIGMAS * self.sd


def leave_one_out(solution: JointSolution) -> tuple[LeftOut, ...]:
    """Each strike taken out of the problem, linear about the solution, and predicted: posterior predictive of phi and ln k.

    All that theta(t) says of the body is in these two; what they make of theta(t) itself is in motion/foretold_motion.py.
    """
    model, x, weight = solution.model, solution.x, solution.weight
    information = np.linalg.inv(solution.covariance)
    phi, by_phi = model.residual(x), model.design(x)
    log_k, by_k = model.log_k(x)
    found: list[LeftOut] = []
    for i, plane in enumerate(model.planes):
        uses_k = bool(solution.data.uses_k[i])
        parts = 2 if uses_k else 1
        W = solution.data.whiten[i, :parts, :parts]
        precision = W.T @ W / solution.spread
        both = np.stack([by_phi[i], by_k[i]])
        rows = both[:parts]
        off: Array = np.array([phi[i], log_k[i] - solution.data.log_k[i]])[:parts]
        others = np.asarray(np.linalg.inv(information - weight[i] * rows.T @ precision @ rows), dtype=np.float64)
        moved = both @ others @ rows.T @ precision @ off * weight[i]
        off = off + moved[:parts]
        own = np.zeros((2, 2))
        own[:parts, :parts] = np.linalg.inv(precision)
        by_others = np.asarray(both @ others @ both.T, dtype=np.float64)
        expected = (by_others + own)[:parts, :parts]
        sigmas = math.sqrt(float(off @ np.linalg.solve(expected, off))) * (OF_TWO if uses_k else 1.0)
        sd = np.sqrt(np.diag(expected))
        found.append(
            LeftOut(
                strike_id=plane.strike_id,
                phi=plane.phi + float(off[0]),
                phi_off=-float(off[0]),
                phi_sd=float(sd[0]),
                k_off=-float(off[1]) if uses_k else None,
                k_sd=float(sd[1]) if uses_k else None,
                sigmas=sigmas,
                k=math.exp(float(log_k[i] + moved[1])),
                by_others=by_others,
                own=own,
            )
        )
    return tuple(found)


def gravity_told(
    planes: Sequence[EquiPlane], systematic: SystematicErrors, prior: ComPrior, moments: Moments, near: JointSolution
) -> Gravity:
    """G as the strikes have it, against the stated one."""
    open_scale = replace(moments.scale, gravity_sd=UNKNOWN_GRAVITY * moments.scale.gravity)
    found = solve_joint(planes, systematic, prior, replace(moments, scale=open_scale), near)
    sd = float(np.sqrt(found.covariance[GRAVITY, GRAVITY]))
    return Gravity(float(np.expm1(UNKNOWN_GRAVITY * found.x[GRAVITY])), UNKNOWN_GRAVITY * sd)


def outside_hull(com: Array, covariance: Array, hull_planes: Array) -> float:
    """By how many sd c (3,) lies outside the hull (planes (p, 4), outward n.x + d); 0: inside it or no more than that."""
    height = hull_planes[:, :3] @ com + hull_planes[:, 3]
    sd = np.sqrt(np.einsum("pi,ij,pj->p", hull_planes[:, :3], covariance, hull_planes[:, :3]))
    return max(0.0, float(np.max(height / np.maximum(sd, 1e-12))))


def impossible_moments(solution: JointSolution, hull_vertices: Array) -> list[str]:
    """Ids of axes whose moment no mass within the hull with that c could have.

    Below 0 by k itself, g R / k - (R + rho)^2; or above what mass at the hull's ends would have: along any direction the second moment
    about c is at most (b - c)(c - a) where the body reaches from a to b (Bhatia and Davis 2000).
    """
    model, x, P = solution.model, solution.x, solution.covariance
    about_com, by = model.about_com(x)
    ln_k, by_ln_k = model.log_k(x)
    edge = model.about_edge(x)[0]
    found: set[str] = set()
    for i, plane in enumerate(model.planes):
        if not solution.data.uses_k[i]:
            continue
        ends = (hull_vertices - x[COM]) @ np.stack([plane.up, np.cross(plane.direction, plane.up)], axis=1)
        most = float(np.sum(np.maximum(ends.max(axis=0), 0) * np.maximum(-ends.min(axis=0), 0)))
        # What this strike's k alone would make of the moment, all else as found.
        own = float(about_com[i] - edge[i] * (solution.data.log_k[i] - ln_k[i]))
        sd = float(edge[i] * np.sqrt(by_ln_k[i] @ P @ by_ln_k[i] + (plane.sd_k or 0.0) ** 2 / (plane.k or 1.0) ** 2))
        sd = float(np.hypot(sd, np.sqrt(by[i] @ P @ by[i])))
        if own + SIGMAS * sd < 0 or own - SIGMAS * sd > most:
            found.add(plane.axis_id)
    return sorted(found)


@dataclass(frozen=True)
class Checks:
    """All checks of one answer."""

    left_out: tuple[LeftOut, ...]
    gravity: Gravity
    impossible: tuple[str, ...]
    """ids of axes"""
    outside: float
    """sd by which c lies outside the hull"""


def check(
    planes: Sequence[EquiPlane],
    systematic: SystematicErrors,
    prior: ComPrior,
    moments: Moments,
    solution: JointSolution,
    hull: tuple[Array, Array],
) -> Checks:
    """Carry out all; `hull`: vertices (h, 3) and planes (p, 4) of the shape's."""
    return Checks(
        leave_one_out(solution),
        gravity_told(planes, systematic, prior, moments, solution),
        tuple(impossible_moments(solution, hull[0])),
        outside_hull(solution.x[COM], solution.covariance[COM, COM], hull[1]),
    )
