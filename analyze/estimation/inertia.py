"""Moments of inertia and inertia tensor about the centre of mass c (method.md, sections 5 and 7).

The paper's own moment (VISAPP 2013, eq. 5) is in paper.py.
"""

from __future__ import annotations

import numpy as np

from analyze.estimation.cells import Cells, moments_about
from analyze.estimation.centre_of_mass import centre_of_mass_from_joint
from analyze.estimation.joint import JointSolution, MomentPrior, UnitPrior
from analyze.estimation.joint_model import COM, SECOND
from analyze.estimation.priors import ComPrior, Scale
from analyze.estimation.second_moments import symmetric_entries, symmetric_matrix, unit_inertia
from analyze.types import Array, AxisInertia, EquiPlane, InertialParameters

MEASURED_FRACTION = 0.5
"""Fraction of the prior's sd below which the sd of a tensor entry marks the entry as measured."""


def shape_prior(cells: Cells) -> MomentPrior:
    """Prior of the inertia per kilogram: midway between a uniform solid and all mass in the shell.

    1 sigma of an entry is the difference of the two, and at least a quarter of the geometric mean of the
    diagonal entries of its row and column. The shell is the body's outer wall.

    Args:
        cells: Cells of the body, in shell and interior.

    Returns:
        Function of the centre of mass (3,) [m], in the object frame O, that gives the prior mean and sd, each
        (3, 3) [m^2], of the inertia per kilogram about that point. The uniform solid and the shell are not
        shifted so that their own centroids lie there; the parallel-axis term of the distance is included, is
        small, and widens the prior.
    """
    shares = np.array([cells.volumes / cells.volumes.sum(), cells.shell / cells.shell.sum()])
    centroids = np.array([share @ cells.points for share in shares])
    about_centroids = np.array(
        [moments_about(cells, share, about) for share, about in zip(shares, centroids, strict=True)]
    )

    def prior(com: Array) -> UnitPrior:
        off = centroids - com
        moved = np.sum(off**2, axis=1)[:, None, None] * np.eye(3) - off[:, :, None] * off[:, None, :]
        uniform, surface = about_centroids + moved
        mean = (uniform + surface) / 2
        scale = np.sqrt(np.outer(np.diag(mean), np.diag(mean)))
        return UnitPrior(mean, np.maximum(np.abs(surface - uniform), 0.25 * scale))

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
    solution: JointSolution, com_prior: ComPrior, scale: Scale
) -> InertialParameters:
    """Mass, centre of mass and inertia tensor with covariance (10, 10), from the solution of all strikes.

    The strikes' motions determine the inertia per kilogram and the mass is stated, so the two are
    independent. Directions that no axis observes are determined by the shape's prior.

    Args:
        solution: Solution of the joint problem of all strikes' balance angles phi and rate constants k, those
            of the motions theta'' = -k sin(phi - theta).
        com_prior: Prior of the centre of mass that the problem was solved with.
        scale: Mass and gravity that the problem was solved with.

    Returns:
        Parameters of the body that tipped, in the object frame O, with covariance in the order mass [kg],
        centre of mass [m], Ixx, Iyy, Izz, Ixy, Ixz, Iyz [kg m^2] about the centre of mass. A tensor
        entry counts as measured if its sd is below `MEASURED_FRACTION` of the prior's. For each pivot axis
        with a k that was used, sorted by id: the moments about its edge and about its parallel through the
        centre of mass.
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
    first = [strikes[name] for name in sorted(struck)]
    relative = scale.mass_sd / m

    def sd(value: float, row: Array) -> float:
        return float(np.sqrt(m**2 * row @ P @ row + (m * value * relative) ** 2))

    axes = tuple(
        AxisInertia(
            axis_id=model.planes[i].axis_id,
            direction=model.planes[i].direction,
            i_edge=m * float(about_edge[i]),
            i_edge_sd=sd(float(about_edge[i]), by_edge[i]),
            i_com=m * float(about_com[i]),
            i_com_sd=sd(float(about_com[i]), by_com[i]),
        )
        for i in first
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
    """Joint covariance (1 + n, 1 + n) of the mass and n quantities derived from the joint estimate.

    Each quantity is either proportional to the mass (as a moment of inertia) or independent of it.

    Args:
        rows: (n, count) derivatives of the quantities by the joint estimate's unknowns, at the stated mass.
        P: (count, count) covariance of these unknowns.
        values: (n,) values of the quantities; 0 for those that do not depend on the mass.
        scale: Mass with its standard deviation.
    """
    by_mass = np.concatenate([[1.0], values / scale.mass])
    covariance = np.outer(by_mass, by_mass) * scale.mass_sd**2
    covariance[1:, 1:] += rows @ P @ rows.T
    return covariance
