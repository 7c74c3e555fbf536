"""Moments of inertia from k, and the tensor about the centre of mass (METHOD section 5)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from analyze.estimation.cells import Cells, moments_about
from analyze.types import Array, AxisInertia, CentreOfMass, EquiPlane, InertialParameters

MEASURED_FRACTION = 0.5
"""an entry whose sd is above this part of the prior's counts as the prior's"""
SMALLEST_EIGENVALUE = 1e-3
"""of the second-moment matrix, relative to its trace: keeps the tensor that of a body"""
ENTRIES = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))


@dataclass(frozen=True)
class Scale:
    """Mass and gravity, and what k cannot know; 1 sigma each."""

    mass: float
    mass_sd: float
    gravity: float
    gravity_sd: float
    k_relative_sd: float = 2e-3
    """error of k that the strikes on one axis share: air, play of the edge"""


@dataclass(frozen=True)
class InertiaPrior:
    """What the shape says of the tensor about c: mean (3, 3) and sd (3, 3) [kg m^2]."""

    mean: Array
    sd: Array


def inertia_prior(mass: float, com: Array, cells: Cells) -> InertiaPrior:
    """Midway between all mass on the surface and uniform; 1 sigma is their difference and at least a quarter of the diagonal.

    Args:
        mass: kg.
        com: (3,) m, where the mass's centre is known to be.
        cells: the body.
    """
    # About the measured c, not the distribution's own centre: mass * offset^2 is small and errs to the safe side.
    uniform = moments_about(cells, mass * cells.volumes / cells.volumes.sum(), com)
    surface = moments_about(cells, mass * cells.wall / cells.wall.sum(), com)
    mean = (uniform + surface) / 2
    scale = np.sqrt(np.outer(np.diag(mean), np.diag(mean)))
    return InertiaPrior(mean, np.maximum(np.abs(surface - uniform), 0.25 * scale))


def edge_inertia(plane: EquiPlane, distance: float, scale: Scale) -> float:
    """I_edge = m*g*R / k: moment about the contact line at balance [kg m^2]; R = distance of c from the rounding's centre line."""
    return scale.mass * scale.gravity * distance / _k(plane)


def inertial_parameters(planes: Sequence[EquiPlane], com: CentreOfMass, scale: Scale, prior: InertiaPrior) -> InertialParameters:
    """Moments about each axis, and the tensor about c.

    k = m*g*R / (I_c + m*(R + rho)^2), so I_edge = m*g*R/k and I_c = I_edge - m*(R + rho)^2. Repeats of one axis are averaged with their
    full covariance: mass, g, R and rho are shared, k's scatter is not. Tensor: least squares of l.I.l over the axes with the
    shape's prior for what they leave open; then made that of a possible body (second-moment matrix positive definite).

    Args:
        planes: one per strike; those without k count for c only.
        com: from the same planes, in the same order.
        scale: mass and gravity.
        prior: of the tensor.
    """
    used = [i for i, plane in enumerate(planes) if plane.k is not None]
    names = sorted({planes[i].axis_id for i in used})
    values, covariance = _per_strike(planes, com, scale, used)
    edge, about_c = values
    axes: list[AxisInertia] = []
    mixes = np.zeros((len(names), len(used)))
    for a, name in enumerate(names):
        own = [s for s, i in enumerate(used) if planes[i].axis_id == name]
        mixes[a, own] = _best_mix(covariance.i_com[np.ix_(own, own)], com.robust[[used[s] for s in own]])
    i_com = mixes @ about_c
    i_com_covariance = mixes @ covariance.i_com @ mixes.T
    i_edge, i_edge_sd = mixes @ edge, np.sqrt(np.diag(mixes @ covariance.i_edge @ mixes.T))
    for a, name in enumerate(names):
        direction = next(planes[i].direction for i in used if planes[i].axis_id == name)
        sd = float(np.sqrt(i_com_covariance[a, a]))
        axes.append(AxisInertia(name, direction, float(i_edge[a]), float(i_edge_sd[a]), float(i_com[a]), sd))
    tensor, tensor_sd, measured = _tensor(axes, i_com_covariance, prior)
    joint = np.zeros((4 + len(axes), 4 + len(axes)))
    joint[0, 0] = scale.mass_sd**2
    joint[1:4, 1:4] = com.covariance
    joint[4:, 4:] = i_com_covariance
    joint[4:, 0] = joint[0, 4:] = mixes @ covariance.mass
    joint[4:, 1:4] = mixes @ covariance.com
    joint[1:4, 4:] = joint[4:, 1:4].T
    return InertialParameters(scale.mass, scale.mass_sd, com, tensor, tensor_sd, measured, tuple(axes), joint)


@dataclass(frozen=True)
class _StrikeCovariance:
    i_edge: Array
    i_com: Array
    mass: Array
    """(strikes,) with the mass"""
    com: Array
    """(strikes, 3) with c"""


def _per_strike(
    planes: Sequence[EquiPlane], com: CentreOfMass, scale: Scale, used: list[int]
) -> tuple[tuple[Array, Array], _StrikeCovariance]:
    """I_edge and I_c of each used strike with covariances, by first-order propagation of m, g, R, rho and k."""
    R = com.distances[used]
    k = np.array([_k(planes[i]) for i in used])
    rho = np.array([planes[i].edge_radius for i in used])
    m, g = scale.mass, scale.gravity
    edge = m * g * R / k
    about_c = edge - m * (R + rho) ** 2
    k_variance = np.diag([(planes[i].sd_k or 0.0) ** 2 / max(float(com.robust[i]), 1e-6) for i in used])
    same = np.array([[planes[i].axis_id == planes[j].axis_id for j in used] for i in used])
    k_covariance = k_variance + same * np.outer(k, k) * scale.k_relative_sd**2
    R_covariance = com.distance_covariance[np.ix_(used, used)]
    R_rho = com.edge_radius_distance_covariance[used]

    def propagate(by_m: Array, by_g: Array, by_R: Array, by_k: Array, by_rho: Array) -> Array:
        shared = np.outer(by_m, by_m) * scale.mass_sd**2 + np.outer(by_g, by_g) * scale.gravity_sd**2
        # The edge's radius moves R as well: neither is wrong alone.
        across = np.outer(by_rho, by_R * R_rho)
        radius = np.outer(by_rho, by_rho) * com.edge_radius_variance + across + across.T
        return shared + radius + by_R[:, None] * R_covariance * by_R + by_k[:, None] * k_covariance * by_k

    by_k = -edge / k
    i_edge = propagate(edge / m, edge / g, m * g / k, by_k, np.zeros(len(used)))
    by_R = m * (g / k - 2 * (R + rho))
    i_com = propagate(about_c / m, edge / g, by_R, by_k, -2 * m * (R + rho))
    with_com = by_R[:, None] * com.position_distance_covariance[:, used].T
    return (edge, about_c), _StrikeCovariance(i_edge, i_com, about_c / m * scale.mass_sd**2, with_com)


def _best_mix(covariance: Array, robust: Array) -> Array:
    """Weights (n,), sum 1, from the part of the covariance that differs among repeats: never negative."""
    own = np.diag(covariance) - covariance[~np.eye(len(covariance), dtype=bool)].min(initial=np.inf) if len(covariance) > 1 else np.ones(1)
    weight = robust / np.maximum(own, 1e-3 * np.diag(covariance))
    return weight / weight.sum()


def _tensor(axes: Sequence[AxisInertia], covariance: Array, prior: InertiaPrior) -> tuple[Array, Array, NDArray[np.bool_]]:
    mean = np.array([prior.mean[entry] for entry in ENTRIES])
    sd = np.array([prior.sd[entry] for entry in ENTRIES])
    precision = np.diag(1 / sd**2)
    rhs = mean / sd**2
    if axes:
        rows = np.array([[axis.direction[i] * axis.direction[j] * (1 if i == j else 2) for i, j in ENTRIES] for axis in axes])
        weight = np.linalg.inv(covariance)
        precision = precision + rows.T @ weight @ rows
        rhs = rhs + rows.T @ weight @ np.array([axis.i_com for axis in axes])
    posterior = np.linalg.inv(precision)
    sd_now = np.sqrt(np.diag(posterior))
    tensor = possible(_symmetric(posterior @ rhs))
    return tensor, _symmetric(sd_now), _symmetric(sd_now / sd) < MEASURED_FRACTION


def possible(inertia: Array) -> Array:
    """Nearest tensor (3, 3) that a body can have: its second-moment matrix tr(I)/2 - I positive definite, hence the triangle inequality."""
    second = np.trace(inertia) / 2 * np.eye(3) - inertia
    values, vectors = np.linalg.eigh(second)
    least = SMALLEST_EIGENVALUE * max(float(np.trace(second)), 1e-15)
    if values.min() >= least:
        return inertia
    second = vectors @ np.diag(np.maximum(values, least)) @ vectors.T
    return np.trace(second) * np.eye(3) - second


def _symmetric(entries: Array) -> Array:
    matrix = np.zeros((3, 3))
    for (i, j), value in zip(ENTRIES, entries, strict=True):
        matrix[i, j] = matrix[j, i] = value
    return matrix


def _k(plane: EquiPlane) -> float:
    if plane.k is None:
        raise ValueError(f"strike {plane.strike_id} has no k")
    return plane.k
