"""Moments of inertia and the tensor about the centre of mass, as the joint estimate has them (METHOD sections 5 and 7)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from analyze.estimation.cells import Cells, moments_about
from analyze.estimation.centre_of_mass import com_of, refuse_none
from analyze.estimation.joint import JointSolution, Moments, UnitPrior, solve_joint
from analyze.estimation.joint_model import COM, SECOND
from analyze.estimation.second_moments import six, symmetric, unit_inertia
from analyze.estimation.stated import ComPrior, Scale, SystematicErrors
from analyze.types import Array, AxisInertia, EquiPlane, InertialParameters

MEASURED_FRACTION = 0.5
"""an entry whose sd is above this part of the prior's counts as the prior's"""


@dataclass(frozen=True)
class ShapePrior:
    """Midway between all mass on the surface and uniform; 1 sigma is their difference and at least a quarter of the diagonal."""

    centroids: Array
    """(2, 3) m, of the uniform solid and of the wall"""
    about_centroids: Array
    """(2, 3, 3) m^2, inertia about them per kilogram"""

    def __call__(self, com: Array) -> UnitPrior:
        """About c (3,), not the distributions' own centres: offset^2 is small and errs to the safe side."""
        off = self.centroids - com
        moved = np.sum(off**2, axis=1)[:, None, None] * np.eye(3) - off[:, :, None] * off[:, None, :]
        uniform, surface = self.about_centroids + moved
        mean = (uniform + surface) / 2
        scale = np.sqrt(np.outer(np.diag(mean), np.diag(mean)))
        return UnitPrior(mean, np.maximum(np.abs(surface - uniform), 0.25 * scale))


def shape_prior(cells: Cells) -> ShapePrior:
    """What the shape says of the moments."""
    shares = [cells.volumes / cells.volumes.sum(), cells.wall / cells.wall.sum()]
    centroids = [share @ cells.points for share in shares]
    return ShapePrior(
        np.array(centroids), np.array([moments_about(cells, share, about) for share, about in zip(shares, centroids, strict=True)])
    )


def edge_inertia(plane: EquiPlane, distance: float, scale: Scale) -> float:
    """I_edge = m*g*R / k: moment about the contact line at balance [kg m^2]; R = distance of c from the rounding's centre line."""
    if plane.k is None:
        raise ValueError(f"strike {plane.strike_id} has no k")
    return scale.mass * scale.gravity * distance / plane.k


def inertial_parameters(
    planes: Sequence[EquiPlane], systematic: SystematicErrors, com_prior: ComPrior, scale: Scale, shape: ShapePrior
) -> InertialParameters:
    """Mass, c and tensor from phi and k of all strikes together.

    k = m*g*R / (I_c + m*(R + rho)^2): motions tell the inertia per kilogram, the mass is what was stated; so both are independent.
    Directions that no axis tells of come from the shape.

    Args:
        planes: one per strike; those without k count for c only.
        systematic: shared errors.
        com_prior: of c.
        scale: mass and gravity.
        shape: prior of the moments.

    Raises:
        EstimationError: no plane.
    """
    refuse_none(planes)
    return parameters_of(solve_joint(planes, systematic, com_prior, Moments(scale, shape)), com_prior, scale)


def parameters_of(solution: JointSolution, com_prior: ComPrior, scale: Scale) -> InertialParameters:
    """The solution's c, moments and tensor with the covariance of all ten parameters."""
    model, x, P = solution.model, solution.x, solution.covariance
    J, by = unit_inertia(x[SECOND])
    m = scale.mass
    to_tensor = np.zeros((6, len(x)))
    to_tensor[:, SECOND] = m * six(by).T
    about_com, by_com = model.about_com(x)
    about_edge, by_edge = model.about_edge(x)
    strikes = {plane.axis_id: i for i, plane in reversed(list(enumerate(model.planes)))}
    struck = {plane.axis_id for plane, uses in zip(model.planes, solution.data.uses_k, strict=True) if uses}
    names = sorted(struck)
    first = [strikes[name] for name in names]
    relative = scale.mass_sd / m

    def sd(value: float, row: Array) -> float:
        return float(np.sqrt(m**2 * row @ P @ row + (m * value * relative) ** 2))

    axes = tuple(
        AxisInertia(
            axis_id=name,
            direction=model.planes[i].direction,
            i_edge=m * float(about_edge[i]),
            i_edge_sd=sd(float(about_edge[i]), by_edge[i]),
            i_com=m * float(about_com[i]),
            i_com_sd=sd(float(about_com[i]), by_com[i]),
        )
        for name, i in zip(names, first, strict=True)
    )
    to_com = np.zeros((3, len(x)))
    to_com[:, COM] = np.eye(3)
    prior_sd = np.ones((3, 3)) if solution.moment_prior is None else m * solution.moment_prior.sd
    ten = _with_mass(np.vstack([to_com, to_tensor]), P, np.concatenate([np.zeros(3), m * six(J)]), scale)
    tensor_sd = symmetric(np.sqrt(np.diag(ten)[4:]))
    return InertialParameters(
        mass=m,
        mass_sd=scale.mass_sd,
        com=com_of(solution, com_prior),
        inertia=m * J,
        inertia_sd=tensor_sd,
        measured=tensor_sd < MEASURED_FRACTION * prior_sd,
        axes=axes,
        joint_covariance=_with_mass(np.vstack([to_com, m * by_com[first]]), P, np.concatenate([np.zeros(3), m * about_com[first]]), scale),
        covariance=ten,
    )


def _with_mass(rows: Array, P: Array, values: Array, scale: Scale) -> Array:
    """Covariance (1 + n, 1 + n) of the mass and of n quantities, those with `values` (n,) not 0 being proportional to it."""
    by_mass = np.concatenate([[1.0], values / scale.mass])
    covariance = np.outer(by_mass, by_mass) * scale.mass_sd**2
    covariance[1:, 1:] += rows @ P @ rows.T
    return covariance
