"""Equi-planes: the plane in O that holds the pivot's centre line and the centre of mass (paper 3.2.1, eq. 4)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from analyze.errors import EstimationError
from analyze.types import Array, EquiPlane, MotionFit, TipMotion
from schemas.strike_plan import PlannedStrike

AXIS_TOLERANCE = 1e-3
"""rad: how far a plan's pivot.direction may be from W's +y at rest"""


def equiplane(strike_id: str, planned: PlannedStrike, motion: TipMotion) -> EquiPlane:
    """Equi-plane of one strike, from the fit its motion used.

    Args:
        strike_id: the strike, unique in the recording.
        planned: how the object lay, and its pivot in O.
        motion: the strike's motion with a fit.

    Raises:
        EstimationError: the motion holds no fit, or the plan's pivot does not lie along W's y.
    """
    if motion.fit is None:
        raise EstimationError(f"strike {strike_id}: no motion was fitted ({motion.verdict.value}): exclude it")
    return equiplane_from_fit(strike_id, planned, motion.fit)


def equiplane_from_fit(strike_id: str, planned: PlannedStrike, fit: MotionFit) -> EquiPlane:
    """As `equiplane`, from any estimator's fit: phi [rad], k [rad/s^2] and their (2, 2) covariance."""
    R_world_object = np.array(planned.R_world_object)
    direction = np.array(planned.pivot.direction)
    direction = direction / np.linalg.norm(direction)
    if np.linalg.norm(R_world_object @ direction - np.array([0.0, 1.0, 0.0])) > AXIS_TOLERANCE:
        raise EstimationError(f"plan strike {planned.id}: pivot.direction is not W's +y at rest: make the plan anew")
    up = R_world_object[2]
    point, radius, sd, rounded, radius_sd = np.array(planned.pivot.point), planned.pivot.radius_m, planned.pivot.sd_m, True, 0.0
    if fit.rolling is not None:
        # A flank's centre of curvature where it touches at phi is what the centre line is to a rounded edge.
        point = point + R_world_object[0] * fit.rolling.along + up * fit.rolling.over
        radius, rounded, radius_sd = fit.rolling.radius, not fit.rolling.of_shape, fit.rolling.radius_sd
        # Where the plan's pivot point lies does not matter to a curve of the shape's own.
        sd = float(np.hypot(sd, fit.rolling.sd)) if rounded else fit.rolling.sd
    return EquiPlane(
        strike_id=strike_id,
        axis_id=planned.axis_id,
        point=point,
        direction=direction,
        up=up,
        normal=equiplane_normal(direction, up, fit.phi),
        phi=fit.phi,
        sd_phi=float(np.sqrt(fit.covariance[0, 0])),
        k=fit.k,
        sd_k=None if fit.k is None else float(np.sqrt(fit.covariance[1, 1])),
        cov_phi_k=float(fit.covariance[0, 1]),
        edge_radius=radius,
        edge_sd=sd,
        heading=planned.heading_rad,
        face=planned.plane_id,
        rounded=rounded,
        radius_sd=radius_sd,
    )


def equiplane_normal(direction: Array, up: Array, phi: float) -> Array:
    """Unit normal by eq. (4): n = (R up) x l, where R turns by phi against the tip; d(n.(c - p))/dphi = -R_c.

    Args:
        direction: (3,) unit pivot axis l in O; +theta about it tips.
        up: (3,) unit, W's z in O at rest.
        phi: rad.
    """
    return np.cross(raised(direction, up, phi), direction)


def plumb(plane: EquiPlane, lean: float) -> EquiPlane:
    """The plane that stands upright in gravity where the vertical leans by `lean` [rad] from the table's normal, the way it tipped.

    Without it the plane is upright against the table, and misses c by R times the lean.
    """
    return replace(plane, normal=equiplane_normal(plane.direction, plane.up, plane.phi - lean))


def raised(direction: Array, up: Array, phi: float) -> Array:
    """Unit vector from the centre line to a c that stands above it at `phi`: up turned by -phi about l. Shapes as `equiplane_normal`."""
    return np.cos(phi) * up - np.sin(phi) * np.cross(direction, up)


def standing_angle(points: Array, direction: Array, up: Array, pivot: Array) -> Array:
    """Angle (...) [rad] by which the body must tip until `points` (..., 3), in O, stand above the line through `pivot` (3,)."""
    arm = points - pivot
    return np.arctan2(-(arm @ np.cross(direction, up)), arm @ up)
