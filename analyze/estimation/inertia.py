"""Moments of inertia and inertia tensor about the centre of mass c (method.md, sections 5 and 7).

The paper's own moment (VISAPP 2013, eq. 5) is in paper.py.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from analyze.estimation.cells import Cells, moments_about
from analyze.estimation.centre_of_mass import centre_of_mass_from_joint, require_planes
from analyze.estimation.joint import JointSolution, MomentModel, UnitPrior, solve_joint
from analyze.estimation.joint_model import COM, SECOND
from analyze.estimation.priors import ComPrior, Scale, SystematicErrors
from analyze.estimation.second_moments import symmetric_entries, symmetric_matrix, unit_inertia
from analyze.types import Array, AxisInertia, EquiPlane, InertialParameters

MEASURED_FRACTION = 0.5
"""Fraction of the prior's sd below which the sd of a tensor entry marks the entry as measured."""


@dataclass(frozen=True)
class ShapePrior:
    """Prior of the inertia per kilogram: midway between a uniform solid and all mass in the shell.

    1 sigma of an entry is the difference of the two, and at least a quarter of the geometric mean of the
    diagonal entries of its row and column. The shell is the body's outer wall.
    """

    centroids: Array
    """(2, 3) centroids of the uniform solid and of the shell [m], in the object frame O."""
    about_centroids: Array
    """(2, 3, 3) inertia per kilogram of the two about their centroids [m^2]."""

    def __call__(self, com: Array) -> UnitPrior:
        """Prior mean and sd, each (3, 3) [m^2], of the inertia per kilogram about the centre of mass.

        The uniform solid and the shell are not moved to `com`; the parallel-axis term of their distance from
        it is small and widens the prior.

        Args:
            com: (3,) centre of mass [m], in the object frame O.
        """
        off = self.centroids - com
        moved = np.sum(off**2, axis=1)[:, None, None] * np.eye(3) - off[:, :, None] * off[:, None, :]
        uniform, surface = self.about_centroids + moved
        mean = (uniform + surface) / 2
        scale = np.sqrt(np.outer(np.diag(mean), np.diag(mean)))
        return UnitPrior(mean, np.maximum(np.abs(surface - uniform), 0.25 * scale))


def shape_prior(cells: Cells) -> ShapePrior:
    """Prior of the inertia per kilogram from the shape alone, by its cells in shell and interior."""
    shares = [cells.volumes / cells.volumes.sum(), cells.shell / cells.shell.sum()]
    centroids = [share @ cells.points for share in shares]
    return ShapePrior(
        np.array(centroids),
        np.array(
            [moments_about(cells, share, about) for share, about in zip(shares, centroids, strict=True)]
        ),
    )


def edge_inertia(plane: EquiPlane, distance: float, scale: Scale) -> float:
    """Moment of inertia about the contact line at balance, I_edge = m g R / k [kg m^2] (method.md, 5).

    Args:
        plane: Plane of the strike through pivot line and centre of mass, with its rate constant k [rad/s^2].
        distance: Distance R of the centre of mass from the centre line of the edge's rounding [m].
        scale: Mass m and gravity g.

    Raises:
        ValueError: the plane has no k.
    """
    if plane.k is None:
        raise ValueError(f"strike {plane.strike_id} has no k")
    return scale.mass * scale.gravity * distance / plane.k


def inertial_parameters(
    planes: Sequence[EquiPlane],
    systematic: SystematicErrors,
    com_prior: ComPrior,
    scale: Scale,
    shape: ShapePrior,
) -> InertialParameters:
    """Mass, centre of mass c and inertia tensor about c, from phi and k of all strikes together.

    phi is a strike's balance angle and k = m g R / (I_c,l + m (R + rho)^2), with I_c,l the moment about the
    line through c along the pivot axis l, rho the edge's radius and R the distance of c from its centre line:
    the motion determines the inertia per kilogram and the mass is stated, so the two are independent.
    Directions that no axis observes are determined by the shape's prior.

    Args:
        planes: Equi-planes (plane through pivot line and c) in the object frame O, one per strike; one
            without k contributes to c only.
        systematic: Standard deviations of errors that strikes share (table tilt, shape scale, edge radius).
        com_prior: Prior of c.
        scale: Mass and gravity.
        shape: Prior of the moments.

    Returns:
        Mass, c and tensor in O, with covariances, moments per axis and the entries that strikes determine.

    Raises:
        EstimationError: there is no plane.
    """
    require_planes(planes)
    return inertial_parameters_from_joint(
        solve_joint(planes, systematic, com_prior, MomentModel(scale, shape)), com_prior, scale
    )


def inertial_parameters_from_joint(
    solution: JointSolution, com_prior: ComPrior, scale: Scale
) -> InertialParameters:
    """Mass, centre of mass and inertia tensor of a joint solution, with their covariance (10, 10).

    Args:
        solution: Solution of the joint problem of all strikes' balance angles and rate constants k.
        com_prior: Prior of the centre of mass that the problem was solved with.
        scale: Mass and gravity that the problem was solved with.

    Returns:
        Parameters of the body that tipped, in the object frame O. A tensor entry counts as measured if its
        sd is below `MEASURED_FRACTION` of the prior's; axes with a k have their moments, sorted by id.
    """
    model, x, P = solution.model, solution.x, solution.covariance
    J, by = unit_inertia(x[SECOND])
    m = scale.mass
    to_tensor = np.zeros((6, len(x)))
    to_tensor[:, SECOND] = m * symmetric_entries(by).T
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
    ten = _with_mass(
        np.vstack([to_com, to_tensor]), P, np.concatenate([np.zeros(3), m * symmetric_entries(J)]), scale
    )
    tensor_sd = symmetric_matrix(np.sqrt(np.diag(ten)[4:]))
    return InertialParameters(
        mass=m,
        mass_sd=scale.mass_sd,
        com=centre_of_mass_from_joint(solution, com_prior),
        inertia=m * J,
        inertia_sd=tensor_sd,
        measured=tensor_sd < MEASURED_FRACTION * prior_sd,
        axes=axes,
        joint_covariance=_with_mass(
            np.vstack([to_com, m * by_com[first]]),
            P,
            np.concatenate([np.zeros(3), m * about_com[first]]),
            scale,
        ),
        covariance=ten,
    )


def _with_mass(rows: Array, P: Array, values: Array, scale: Scale) -> Array:
    """Covariance (1 + n, 1 + n) of the mass and n quantities, which are proportional to it or independent.

    Args:
        rows: (n, count) derivatives of the quantities by the unknowns.
        P: (count, count) covariance of the unknowns.
        values: (n,) values of the quantities; 0 for those that do not depend on the mass.
        scale: Mass with its standard deviation.
    """
    by_mass = np.concatenate([[1.0], values / scale.mass])
    covariance = np.outer(by_mass, by_mass) * scale.mass_sd**2
    covariance[1:, 1:] += rows @ P @ rows.T
    return covariance
