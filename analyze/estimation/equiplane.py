"""Equi-planes: planes through a pivot's centre line and the centre of mass c (VISAPP 2013, eq. 4).

The centre line is that of the pivot edge's rounding; phi is the balance angle at which c stands above it.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from analyze.errors import EstimationError
from analyze.types import Array, EquiPlane, MotionFit, TipMotion
from schemas.strike_plan import PlannedStrike

AXIS_TOLERANCE = 1e-3
"""Largest angle [rad], as a chord, between a plan's pivot.direction and W's +y at rest."""


def equiplane(strike_id: str, planned: PlannedStrike, motion: TipMotion) -> EquiPlane:
    """Equi-plane of one strike (plane through pivot line and centre of mass), in the object frame O.

    Args:
        strike_id: Id of the strike, unique in the recording.
        planned: Planned strike: rest pose of the object, and the pivot line in O to which the fit belongs.
        motion: Motion of the strike, with a fit.

    Returns:
        The plane, through the centre line of the pivot edge's rounding, with balance angle [rad], rate
        constant k of the tip [rad/s^2] and their standard deviations by the fit that the motion uses; k is
        None if that fit has none. If another edge took over from the planned one before balance, `face` is
        empty and `facet_rad` the tipping angle [rad] from which it did.

    Raises:
        EstimationError: the motion has no fit, or the plan's pivot does not lie along the world's y at rest.
    """
    if motion.fit is None:
        raise EstimationError(
            f"strike {strike_id}: no motion could be fitted ({motion.verdict.value}): exclude this strike"
        )
    plane = equiplane_from_fit(strike_id, planned, motion.fit)
    if motion.carried_by is None:
        return plane
    return replace(plane, face="", facet_rad=motion.carried_by.takes_over_rad)


def equiplane_from_fit(strike_id: str, planned: PlannedStrike, fit: MotionFit) -> EquiPlane:
    """Equi-plane of one strike in the object frame O, by a given fit of its motion.

    Args:
        strike_id: Id of the strike, unique in the recording.
        planned: Planned strike: rest pose of the object, and its pivot edge in O.
        fit: Balance angle phi [rad], rate constant k [rad/s^2] and their covariance (2, 2). If the contact
            rolls on a curve, its circle of curvature replaces the pivot's point and radius.

    Returns:
        Plane through the centre line of the pivot edge's rounding and the centre of mass, with the fit's phi,
        k (None if the fit has none) and their errors.

    Raises:
        EstimationError: the plan's pivot does not lie along the world's y at rest.
    """
    R_world_object = np.array(planned.R_world_object)
    direction = np.array(planned.pivot.direction)
    direction = direction / np.linalg.norm(direction)
    off = float(np.linalg.norm(R_world_object @ direction - np.array([0.0, 1.0, 0.0])))
    if off > AXIS_TOLERANCE:
        raise EstimationError(
            f"plan strike {planned.id}: pivot.direction is {off:.3g} rad off W's +y at rest, not within "
            f"{AXIS_TOLERANCE:g}: make the plan anew"
        )
    up = R_world_object[2]
    point, radius, sd = np.array(planned.pivot.point), planned.pivot.radius_m, planned.pivot.sd_m
    rounded, radius_sd = True, 0.0
    if fit.rolling is not None:
        # The centre of curvature at the contact point at phi takes the part of a rounded edge's centre line.
        point = point + R_world_object[0] * fit.rolling.forward + up * fit.rolling.up
        radius, rounded, radius_sd = fit.rolling.radius, not fit.rolling.of_shape, fit.rolling.radius_sd
        # For a rolling curve that belongs to the shape, the place of the plan's pivot point has no effect.
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
        by_radius=fit.by_radius,
    )


def equiplane_normal(direction: Array, up: Array, phi: float) -> Array:
    """Unit normal (3,) of an equi-plane, n = (`up` turned by -phi about l) x l, in the object frame O.

    An equi-plane is the plane that a strike measures: it passes through the centre line of the pivot edge's
    rounding and the centre of mass (VISAPP 2013, eq. 4). With p a point on the centre line and c a point of
    the plane at distance R from that line, d(n.(c - p))/dphi = -R.

    Args:
        direction: (3,) unit pivot axis l in O; a positive turn about it tips the object.
        up: (3,) unit vector in O that points upwards at rest.
        phi: Balance angle [rad], at which the centre of mass stands above the contact.
    """
    return np.cross(balance_direction(direction, up, phi), direction)


def upright_in_gravity(plane: EquiPlane, lean: float) -> EquiPlane:
    """Copy of an equi-plane with its normal corrected for the vertical's lean from the table's normal.

    An equi-plane passes through the centre line of the pivot edge's rounding and the centre of mass, at
    distance R. Uncorrected, it is perpendicular to the table at balance and misses the centre of mass by R
    times the lean.

    Args:
        plane: Equi-plane as fitted.
        lean: Lean of the vertical from the table's normal, towards the side to which the object tips [rad].
    """
    return replace(plane, normal=equiplane_normal(plane.direction, plane.up, plane.phi - lean))


def balance_direction(direction: Array, up: Array, phi: float) -> Array:
    """Unit vector (3,) from pivot line to centre of mass: `up` turned by -phi about the pivot axis.

    The pivot line is the centre line of the edge's rounding. The vector points upwards in the world when the
    object stands at balance.

    Args:
        direction: (3,) unit pivot axis in the object frame O; a positive turn about it tips the object.
        up: (3,) unit vector in O that points upwards at rest.
        phi: Balance angle [rad], at which the centre of mass stands above the contact.
    """
    return np.cos(phi) * up - np.sin(phi) * np.cross(direction, up)


def standing_angle(points: Array, direction: Array, up: Array, pivot: Array) -> Array:
    """Tipping angle (...) [rad] at which points stand above the pivot line, between -pi and pi.

    Args:
        points: (..., 3) points [m], in the object frame O; one angle is returned for each.
        direction: (3,) unit direction of the pivot line in O; a positive turn about it tips the object.
        up: (3,) unit vector in O that points upwards at rest, where the angle is 0.
        pivot: (3,) point on the pivot line [m], in O.
    """
    arm = points - pivot
    return np.arctan2(-(arm @ np.cross(direction, up)), arm @ up)
