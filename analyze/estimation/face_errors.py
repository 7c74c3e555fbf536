"""Size of the errors of a shape's faces, by the agreement of strikes over several edges.

A face that is off its place turns the balance angles of tips over its edges. Tips over more edges than the
centre of mass needs show how large such errors are on the whole, where the object file does not state it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from analyze.estimation.joint import JointSolution, prior_start, solve_joint
from analyze.estimation.priors import ComPrior, SystematicErrors
from analyze.least_squares.intervals import normal_sd
from analyze.types import Array, EquiPlane

CANDIDATES = np.geomspace(1 / 3, 1.75, 6)
"""Sizes of the faces' errors that are compared, over the assumed one.

Each counts before the strikes in proportion to its size: all sizes from the smallest, that of good drawings,
to the largest are then equally likely. If small ones counted as much as large ones, a box struck over nine
edges whose faces are 0.3 mm off held its centre of mass in 83 % of sessions; so it is 92 %.
"""


def estimated_face_sd(planes: Sequence[EquiPlane], systematic: SystematicErrors, prior: ComPrior) -> float:
    """Standard deviation [m] of the places of a shape's faces, given the strikes' balance angles.

    Sizes around the assumed one are weighed by the marginal likelihood of the balance angles: the model of
    all strikes is linearised at its solution, and all unknowns are integrated out. The result is the sd of a
    normal error with the 95 % interval of one whose size is so uncertain: larger sizes that the strikes leave
    possible count, since few strikes may agree by chance. Where the strikes say nothing, it is 1.4 times the
    assumed one.

    Args:
        planes: Equi-planes (through pivot line and centre of mass) of the strikes, with the assumed error in
            `edge_sd`.
        systematic: Standard deviations of errors that strikes share; `face_sd` is the assumed one.
        prior: Prior of the centre of mass.
    """
    sizes = systematic.face_sd * CANDIDATES
    # The widest of the errors explains most, so that its robust weights separate outliers from
    # misplaced faces.
    widest = solution = solve_joint(*with_face_sd(planes, systematic, sizes[-1]), prior)
    logs = np.empty(len(sizes))
    for number in reversed(range(len(sizes))):
        solution = solve_joint(*with_face_sd(planes, systematic, sizes[number]), prior, initial=solution)
        logs[number] = _log_likelihood(solution, prior, widest.weight)
    share = sizes * np.exp(logs - logs.max())
    return normal_sd(sizes, share / share.sum())


def with_face_sd(
    planes: Sequence[EquiPlane], systematic: SystematicErrors, face_sd: float
) -> tuple[tuple[EquiPlane, ...], SystematicErrors]:
    """Equi-planes (through pivot line and centre of mass) and shared errors with another error of faces.

    Args:
        planes: Equi-planes of the strikes, whose `edge_sd` includes `systematic.face_sd`.
        systematic: Standard deviations of errors that strikes share.
        face_sd: Standard deviation [m] of the place of each face, instead of `systematic.face_sd`.
    """
    before = systematic.face_sd
    changed = tuple(
        replace(plane, edge_sd=float(np.sqrt(max(plane.edge_sd**2 - before**2, 0.0) + face_sd**2)))
        for plane in planes
    )
    return changed, replace(systematic, face_sd=face_sd)


def _log_likelihood(solution: JointSolution, prior: ComPrior, weight: Array) -> float:
    """Logarithm of the marginal likelihood of the strikes' balance angles, but for a constant.

    The model is linear about the solution, with normal priors of all unknowns.

    Args:
        solution: Solution of the joint problem from the balance angles alone.
        prior: Prior of the centre of mass.
        weight: (strikes,) robust weights, by which the variances of single strikes are divided.
    """
    model, x = solution.model, solution.x
    start, diagonal = prior_start(model, prior, None)
    rows = model.design(x)
    off = model.residual(x) - rows @ (x - start)
    own = np.array([plane.sd_phi for plane in model.planes]) ** 2 + model.systematic.strike_angle_sd**2
    variance = np.diag(own / np.maximum(weight, 1e-6)) + (rows / diagonal) @ rows.T
    return -0.5 * float(np.linalg.slogdet(variance)[1] + off @ np.linalg.solve(variance, off))
