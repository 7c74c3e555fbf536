"""Posterior of centre of mass c and moments of inertia where linear error propagation is wrong.

If the strikes leave a direction v of c open, the moments I / m = g R / k - R^2 are curved along it, and sd
from the Jacobian at one point mean nothing. All strikes are then estimated jointly at fixed values s of c.v,
each from its neighbour; a solution has the weight

    exp(-misfit / 2) / sqrt(det H),

with H the information about all other unknowns (nested Laplace approximation: Rue, Martino and Chopin 2009;
the walk along s is that of the profile likelihood: Venzon and Moolgavkar 1988). Every quantity is a mixture
of normal distributions, one per s.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from analyze.estimation.damped_solve import WeightedProblem
from analyze.estimation.joint import JointSolution, MomentModel, solve_joint
from analyze.estimation.joint_model import COM, SECOND, JointModel
from analyze.estimation.moment_prior import widened
from analyze.estimation.posterior import Posterior, derived, linear_posterior, mixture_posterior
from analyze.estimation.priors import ComPrior, SystematicErrors
from analyze.estimation.profile_walk import ProfilePoint, walk
from analyze.geometry.second_moments import symmetric_entries, unit_inertia
from analyze.types import Array, EquiPlane

MAX_CURVATURE = 0.1
"""Second-order term of a quantity, 1 sd of c along a direction, over the quantity's sd, above which the joint
problem is solved at points along that direction."""
FILLING_FACTOR = 3.0
"""Factor on the shape's prior sd of the moments along an open direction: a body with its mass in one lump
then lies within about 1.3 sd."""
MAX_POINTS = 13
"""Largest number of points s tried on either side of the solution, along one direction."""
MAX_COARSE_POINTS = 7
"""Largest number of points tried on either side of the solution, along each of two directions."""
MAX_STEPS = 14
"""Largest number of Gauss-Newton steps at one point."""
NEGLIGIBLE_WEIGHT = 1e-6
"""Probability below which a point is left out."""
CONVERGED_DECREASE = 3e-3
"""Decrease of the misfit in a step below which a point is solved."""


class _Problem:
    """Least-squares problem of all strikes, to be solved with c held along given directions.

    c is the centre of mass.
    The strikes' robust weights, and the factor `spread` on their variances, stay those of `solution`.

    Args:
        solution: Solution of all strikes, by the same priors.
        prior: Prior of c.
        moments: Gravity, and the shape's prior of the moments.
    """

    def __init__(self, solution: JointSolution, prior: ComPrior, moments: MomentModel) -> None:
        self.solution = solution
        self.prior = prior
        self._weighted = WeightedProblem(solution, prior, moments, solution.weight / solution.spread)

    def inside(self, x: Array) -> bool:
        """True if c, of the unknowns `x` (count,), lies in the box that its prior is made from.

        Where the solution of all strikes lies outside this box, c may be as far out.
        """
        off = np.abs(x[COM] - self.prior.mean) / self.prior.sd
        at = np.abs(self.solution.x[COM] - self.prior.mean) / self.prior.sd
        return bool(np.all(off <= np.maximum(1.0, at)))

    def solved(self, x: Array, directions: Array, values: Array) -> ProfilePoint:
        """Most likely solution with c (centre of mass) held at the coordinates `values` along `directions`.

        Args:
            x: (count,) unknowns to start from.
            directions: (n, 3) orthonormal directions, in the object frame O.
            values: (n,) coordinates of c along them [m].

        Returns:
            All unknowns with their covariance, the log density of these values, and how the unknowns follow
            them.
        """
        free = _free_basis(directions, len(x))
        x = x.copy()
        x[COM] += directions.T @ (values - directions @ x[COM])
        x, there = self._weighted.minimised(x, free, MAX_STEPS, CONVERGED_DECREASE)
        misfit, normal, shape = there.misfit, there.normal, there.shape
        inner = free.T @ normal @ free
        covariance = np.asarray(free @ np.linalg.inv(inner) @ free.T, dtype=np.float64)
        # The density is that of the entries of the tensor, not of the logarithms that stand for them: a flat
        # body's logarithms have no lower end.
        by = symmetric_entries(unit_inertia(x[SECOND])[1])
        volume = float(np.linalg.slogdet(by)[1]) - 0.5 * float(np.linalg.slogdet(inner)[1])
        normalised = float(np.sum(np.log(symmetric_entries(shape.sd))))
        lifted = np.zeros((len(directions), len(x)))
        lifted[:, COM] = directions
        slopes = lifted - lifted @ normal @ covariance
        return ProfilePoint(x, covariance, volume - normalised - misfit / 2, slopes)


def profiled_posterior(
    planes: Sequence[EquiPlane],
    systematic: SystematicErrors,
    prior: ComPrior,
    moments: MomentModel,
    solution: JointSolution,
) -> Posterior:
    """Distribution of c and moments of inertia: normal where the strikes determine c, else a mixture.

    c is the centre of mass. A principal direction of its covariance is open if the second-order term of any
    reported quantity, 1 sd along it, exceeds `MAX_CURVATURE` of the quantity's sd. c is then moved along the
    one or two open directions of largest curvature, and each solution with c held there gives a component.
    For these the sd of the shape's prior of the moments is `FILLING_FACTOR` times larger, and c is confined
    to the box that its prior is made from.

    Args:
        planes: Equi-planes of the strikes (plane through pivot line and c), in the object frame O.
        systematic: Standard deviations of errors that strikes share (table tilt, shape scale, edge radius).
        prior: Prior of c.
        moments: Mass, gravity, and the shape's prior of the moments.
        solution: Solution of the joint problem of all these.
    """
    if not len(open_directions(solution, prior)):
        return linear_posterior(solution)

    wide_moments = replace(moments, prior=widened(moments.prior, FILLING_FACTOR))
    solution = solve_joint(planes, systematic, prior, wide_moments, solution)
    directions = open_directions(solution, prior)
    if not len(directions):
        return linear_posterior(solution)
    problem = _Problem(solution, prior, wide_moments)
    sds = np.sqrt(np.einsum("ni,ij,nj->n", directions, solution.covariance[COM, COM], directions))
    points = MAX_POINTS if len(directions) == 1 else MAX_COARSE_POINTS
    return _mixture(solution.model, directions, walk(problem, directions, sds, solution.x, points))


def open_directions(solution: JointSolution, prior: ComPrior) -> Array:
    """Up to two unit directions (n, 3) of c along which reported quantities are too far from linear in c.

    They are orthonormal, in the object frame O, close to those two principal directions of the covariance of
    the centre of mass c along which the quantities are least linear. n is 0 if all quantities are nearly
    linear (`MAX_CURVATURE`).

    Args:
        solution: Solution of all strikes, with their rate constants k.
        prior: Prior of c; the principal directions are those of the covariance in units of its sd.
    """
    model, x, P = solution.model, solution.x, solution.covariance
    relative = P[COM, COM] / np.outer(prior.sd, prior.sd)
    vectors = np.linalg.eigh((relative + relative.T) / 2)[1]
    here, by = derived(model, x)
    sds = np.sqrt(np.einsum("qi,ij,qj->q", by, P, by))
    found: list[tuple[float, Array]] = []
    for vector in vectors.T:
        # Steps in the unknowns that move c by 1 sd along the direction, all else following.
        v = vector / prior.sd
        step = P[:, COM] @ v / np.sqrt(v @ P[COM, COM] @ v)
        bend = (derived(model, x + step)[0] + derived(model, x - step)[0]) / 2 - here
        curvature = float(np.max(np.abs(bend) / np.maximum(sds, 1e-15)))
        if curvature > MAX_CURVATURE:
            along = vector * prior.sd
            found.append((curvature, along / np.linalg.norm(along)))
    found.sort(key=lambda each: -each[0])
    if not found:
        return np.zeros((0, 3))
    directions = np.array([along for _, along in found[:2]])
    return np.linalg.qr(directions.T)[0].T


def _mixture(model: JointModel, directions: Array, points: list[tuple[ProfilePoint, Array]]) -> Posterior:
    """Mixture of the normal distributions at solutions with the centre of mass held along `directions`.

    `points` holds each solution with the lengths (n,) [m] of the n directions that it stands for; its weight
    is proportional to its density times these lengths.
    """
    log_weights = np.array([point.log_density + float(np.sum(np.log(part))) for point, part in points])
    weights = np.exp(log_weights - log_weights.max())
    weights /= weights.sum()
    kept = weights > NEGLIGIBLE_WEIGHT
    chosen = [pair for pair, keep in zip(points, kept.tolist(), strict=True) if keep]
    means: list[Array] = []
    covariances: list[Array] = []
    steps: list[Array] = []
    for point, part in chosen:
        q, by = derived(model, point.x)
        means.append(q)
        covariances.append(by @ point.covariance @ by.T)
        steps.append((point.slopes * part[:, None]) @ by.T)
    return mixture_posterior(
        directions,
        weights[kept] / weights[kept].sum(),
        np.array(means),
        np.array(covariances),
        np.array(steps),
    )


def _free_basis(directions: Array, count: int) -> Array:
    """Orthonormal basis (count, count - n), as columns, of all changes of the unknowns that stay allowed.

    Not allowed are those that move the centre of mass along one of the n `directions` (n, 3).
    """
    across = np.linalg.svd(directions)[2][len(directions) :]
    basis = np.zeros((count, count - len(directions)))
    basis[COM, : len(across)] = across.T
    basis[COM.stop :, len(across) :] = np.eye(count - COM.stop)
    return basis
