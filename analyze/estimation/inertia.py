"""Moments of inertia and inertia tensor about the centre of mass c (method.md, sections 5 and 7).

The paper's own moment (VISAPP 2013, eq. 5) is in paper.py.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from analyze.estimation.cells import Cells, moments_about
from analyze.estimation.centre_of_mass import centre_of_mass_from_joint
from analyze.estimation.joint import JointSolution
from analyze.estimation.joint_model import COM
from analyze.estimation.mass_properties import AxisInertia, InertialParameters
from analyze.estimation.moment_prior import MomentPrior, UnitPrior
from analyze.estimation.posterior import TENSOR, Posterior, linear_posterior
from analyze.estimation.priors import ComPrior, Scale
from analyze.geometry.second_moments import symmetric_matrix
from analyze.least_squares.intervals import SIGMAS_95
from analyze.types import Array, EquiPlane

INFORMED_FRACTION = 0.5
"""Fraction of the prior's sd below which the sd of a tensor entry shows that strikes informed it."""
MAX_MEASURED_SHARE = 0.1
"""Half an entry's 95 % interval over the geometric mean of the diagonal entries of its row and column, up to
which the entry counts as measured. Sessions that determine c reach 0.02 to 0.06 (boxes, bottles, lumps
inside); sets that leave a direction of c open 0.2 to 1."""


def shape_prior(cells: Cells) -> MomentPrior:
    """Prior of the inertia per kilogram: midway between a uniform solid and all mass in the shell.

    1 sigma of an entry is the difference of the two, and at least a quarter of the geometric mean of the
    diagonal entries of its row and column. The shell is the body's outer wall. A body whose centre of mass c
    lies away from their centroids has its mass on that side. Its inertia about c is not larger for that, so
    the term by the parallel-axis theorem is no part of the mean; it is the size of a further error.

    Args:
        cells: Cells of the body, in shell and interior.

    Returns:
        Function of the centre of mass (3,) [m], in the object frame O, that gives the prior mean and sd, each
        (3, 3) [m^2], of the inertia per kilogram about that point.
    """
    shares = np.array([cells.volumes / cells.volumes.sum(), cells.shell / cells.shell.sum()])
    centroids = np.array([share @ cells.points for share in shares])
    about_centroids = np.array(
        [moments_about(cells, share, about) for share, about in zip(shares, centroids, strict=True)]
    )

    uniform, surface = about_centroids
    mean = (uniform + surface) / 2
    scale = np.sqrt(np.outer(np.diag(mean), np.diag(mean)))
    sd = np.maximum(np.abs(surface - uniform), 0.25 * scale)
    middle, unit = centroids.mean(axis=0), np.eye(3)

    def prior(com: Array) -> UnitPrior:
        off = middle - com
        apart = off @ off * unit - off[:, None] * off
        return UnitPrior(mean, np.hypot(sd, apart))

    return prior


def edge_inertia(plane: EquiPlane, distance: float, scale: Scale) -> float:
    """Moment of inertia of a tipping object about its contact line at balance, m g R / k [kg m^2].

    It is I_edge of method.md, section 5.

    Args:
        plane: Plane of the strike through pivot line and centre of mass, with the rate constant k [rad/s^2]
            of its motion.
        distance: Distance R of the centre of mass from the centre line of the edge's rounding [m].
        scale: Mass m and gravity g.

    Raises:
        ValueError: the plane has no k.
    """
    if plane.k is None:
        raise ValueError(f"strike {plane.strike_id} has no k")
    return scale.mass * scale.gravity * distance / plane.k


def inertial_parameters_from_joint(
    solution: JointSolution, com_prior: ComPrior, scale: Scale, posterior: Posterior | None = None
) -> InertialParameters:
    """Mass, centre of mass and inertia tensor with covariance (10, 10), from the solution of all strikes.

    The strikes' motions determine the inertia per kilogram and the mass is stated, so the two are
    independent. Directions that no axis observes are determined by the shape's prior.

    Args:
        solution: Solution of the joint problem of all strikes' balance angles phi and rate constants k, those
            of the motions theta'' = -k sin(phi - theta).
        com_prior: Prior of the centre of mass that the problem was solved with.
        scale: Mass and gravity that the problem was solved with.
        posterior: Distribution of c and moments where it is not normal (profile.py); None to propagate errors
            linearly.

    Returns:
        Parameters of the body that tipped, in the object frame O, with covariance in the order mass [kg],
        centre of mass [m], Ixx, Iyy, Izz, Ixy, Ixz, Iyz [kg m^2] about the centre of mass. For each pivot
        axis with a k that was used, sorted by id: the moments about its edge and about its parallel through
        the centre of mass. `measured_entries` says which entries count as measured. Where `posterior` is a
        mixture, all values are its means, and intervals by its quantiles are added.
    """
    model, posterior = solution.model, posterior or linear_posterior(solution)
    m, mean, P = scale.mass, posterior.mean, posterior.covariance
    strikes = {plane.axis_id: i for i, plane in reversed(list(enumerate(model.planes)))}
    struck = {plane.axis_id for plane, uses in zip(model.planes, solution.data.uses_k, strict=True) if uses}
    first = [strikes[name] for name in sorted(struck)]
    about_com, about_edge = posterior.about_com.start, posterior.about_edge.start
    relative = scale.mass_sd / m

    def sd(index: int) -> float:
        return float(m * np.sqrt(P[index, index] + (mean[index] * relative) ** 2))

    def interval(index: int) -> tuple[float, float] | None:
        if posterior.linear:
            return None
        low, high = posterior.interval(index, relative)
        return m * low, m * high

    axes = tuple(
        AxisInertia(
            axis_id=model.planes[i].axis_id,
            direction=model.planes[i].direction,
            i_edge=m * float(mean[about_edge + i]),
            i_edge_sd=sd(about_edge + i),
            i_com=m * float(mean[about_com + i]),
            i_com_sd=sd(about_com + i),
            i_edge_interval=interval(about_edge + i),
            i_com_interval=interval(about_com + i),
        )
        for i in first
    )
    tensor = list(range(TENSOR.start, TENSOR.stop))
    ten = _with_mass(posterior, tensor, scale)
    tensor_sd = symmetric_matrix(np.sqrt(np.diag(ten)[4:]))
    ends = None if posterior.linear else np.array([interval(index) for index in tensor])
    inertia = m * symmetric_matrix(mean[TENSOR])
    prior_sd = np.ones((3, 3)) if solution.moment_prior is None else m * solution.moment_prior.sd
    return InertialParameters(
        mass=m,
        mass_sd=scale.mass_sd,
        com=centre_of_mass_from_joint(solution, com_prior, posterior),
        inertia=inertia,
        inertia_sd=tensor_sd,
        measured=measured_entries(inertia, tensor_sd, prior_sd, ends),
        axes=axes,
        joint_covariance=_with_mass(posterior, [about_com + i for i in first], scale),
        covariance=ten,
        inertia_intervals=ends,
        informed=tensor_sd < INFORMED_FRACTION * prior_sd,
    )


def measured_entries(inertia: Array, sd: Array, prior_sd: Array, ends: Array | None) -> NDArray[np.bool_]:
    """True (3, 3) for entries of the inertia tensor that the strikes measured.

    An entry is measured if half its 95 % interval is at most `MAX_MEASURED_SHARE` of the geometric mean of
    the diagonal entries of its row and column, and its sd is below `INFORMED_FRACTION` of the prior's.

    Args:
        inertia: (3, 3) tensor [kg m^2].
        sd: (3, 3) standard deviations [kg m^2].
        prior_sd: (3, 3) those of the shape's prior [kg m^2].
        ends: (6, 2) 95 % intervals of xx, yy, zz, xy, xz, yz [kg m^2], of which half the length counts where
            it exceeds 1.96 sd; None for 1.96 sd throughout.
    """
    half = SIGMAS_95 * sd
    if ends is not None:
        half = np.maximum(half, symmetric_matrix(np.diff(ends, axis=1)[:, 0] / 2))
    size = np.sqrt(np.outer(np.diag(inertia), np.diag(inertia)))
    return (half <= MAX_MEASURED_SHARE * size) & (sd < INFORMED_FRACTION * prior_sd)


def _with_mass(posterior: Posterior, moments: list[int], scale: Scale) -> Array:
    """Covariance (4 + n, 4 + n) of mass [kg], centre of mass [m] and n moments of inertia [kg m^2].

    Moments are proportional to the mass, the centre of mass does not depend on it.

    Args:
        posterior: Distribution of centre of mass and moments per kilogram.
        moments: Indices of the moments among the posterior's quantities.
        scale: Mass with its standard deviation.
    """
    where = [*range(COM.start, COM.stop), *moments]
    factors = np.concatenate([np.ones(3), np.full(len(moments), scale.mass)])
    by_mass = np.concatenate([[1.0], np.zeros(3), posterior.mean[moments]])
    covariance = np.outer(by_mass, by_mass) * scale.mass_sd**2
    covariance[1:, 1:] += np.outer(factors, factors) * posterior.covariance[np.ix_(where, where)]
    return covariance
