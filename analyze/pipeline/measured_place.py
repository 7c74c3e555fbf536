"""Place of a pivot line by the strikes' own motion, where the shape knows it less well.

A scan gives the rounded edge of a foot to some millimetres: it may have any radius up to the one seen,
a chamfer looks like a rounding, and a slightly curved base looks flat. The motion shows directly how
far ahead of the planned line the body turned as it balanced, to about half a millimetre, and roughly
how high the centre of curvature is of what rolled on the table (`PivotPlace`). At balance the centre of
mass is above that line, whatever the shape of the edge: only the distance ahead matters for the equi-
plane, the height for the moments.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from analyze.estimation.equiplane import balance_direction, equiplane_normal
from analyze.estimation.joint_model import centre_line_shift
from analyze.types import Array, EquiPlane, PivotPlace, RadiusPrior, TipMotion
from schemas.strike_plan import PlannedStrike


@dataclass(frozen=True)
class _Seen:
    """Measured pivot line of one strike, against that of its plane."""

    ahead: float
    """distance [m] ahead of the plane's line at balance"""
    sd: float
    """1 sigma of it [m]"""
    radius: float
    """radius of curvature [m] of what rolled on the table"""
    radius_sd: float
    """1 sigma of it [m]"""


def with_measured_places(
    planes: Sequence[EquiPlane],
    planned: Sequence[PlannedStrike],
    motions: Sequence[TipMotion],
    own_sd: float = 0.0,
) -> tuple[EquiPlane, ...]:
    """Equi-planes moved to where the motions show their pivot lines, on axes that the shape knows less well.

    The shape's place and the mean of the measured ones of an axis are averaged by their variances, and so are
    the radii. The sd of a mean is that of the best one, as errors of the markers' places are common to all.
    What then remains unknown of the radius moves the line towards the centre of mass, and no longer across.

    Args:
        planes: equi-planes of the strikes (through pivot line and centre of mass), in the object frame O.
        planned: the planned strike of each.
        motions: the motion of each.
        own_sd: 1 sigma [m] by which the shape misplaces a rounded edge besides its radius, as chamfers look
            like roundings in a scan; 0 for an exact shape.

    Returns:
        The planes, in the same order. A strike that was carried by another line than planned, or rolled on a
        curve whose radius is known, has its plane unchanged; one without a measured place gets `own_sd`.
    """
    seen: dict[tuple[str, float], list[_Seen]] = {}
    for plane, strike, motion in zip(planes, planned, motions, strict=True):
        if motion.pivot_place is not None:
            found = _seen(plane, strike, motion.pivot_place)
            seen.setdefault((plane.axis_id, plane.heading), []).append(found)
    return tuple(
        plane
        if plane.radius_prior is None or not plane.rounded or plane.facet_rad
        else _moved(plane, plane.radius_prior, seen.get((plane.axis_id, plane.heading), []), own_sd)
        for plane in planes
    )


def _seen(plane: EquiPlane, strike: PlannedStrike, place: PivotPlace) -> _Seen:
    """Measured pivot line of a strike against that of its plane, which may differ from the planned one."""
    apart = float(_across(plane) @ (np.array(strike.pivot.point) - plane.point))
    radius = strike.pivot.radius_m + place.lift + place.above
    return _Seen(place.ahead + apart, place.sd, radius, place.above_sd)


def _moved(plane: EquiPlane, prior: RadiusPrior, seen: Sequence[_Seen], own_sd: float) -> EquiPlane:
    """Copy of a plane whose line and radius are the averages of the shape's and the measured ones.

    Only the sd of the place changes where the shape knows it better than the motions show it.
    """
    across = _across(plane)
    edge_sd = math.hypot(plane.edge_sd, own_sd)
    by_shape = math.hypot(float(centre_line_shift(plane) @ across) * prior.sd, edge_sd)
    if not seen or by_shape <= min(each.sd for each in seen):
        return replace(plane, edge_sd=edge_sd) if own_sd else plane
    ahead, sd = _average([(0.0, by_shape), _mean([(each.ahead, each.sd) for each in seen])])
    radius, radius_sd = _average(
        [(plane.edge_radius, prior.sd), _mean([(each.radius, each.radius_sd) for each in seen])]
    )
    more = max(radius, 0.0) - plane.edge_radius
    by_phi, by_k = plane.by_radius
    phi = plane.phi - by_phi * more
    return replace(
        plane,
        normal=equiplane_normal(plane.direction, plane.up, phi),
        point=plane.point + across * ahead + balance_direction(plane.direction, plane.up, plane.phi) * more,
        phi=phi,
        k=None if plane.k is None else plane.k - by_k * more,
        edge_sd=sd,
        edge_radius=plane.edge_radius + more,
        rounded=False,
        radius_sd=radius_sd,
        radius_prior=None,
        face="",
        wall="",
    )


def _mean(values: Sequence[tuple[float, float]]) -> tuple[float, float]:
    """Mean of values with sds, weighted by their variances, and the least of the sds."""
    return _average(values)[0], min(sd for _, sd in values)


def _average(values: Sequence[tuple[float, float]]) -> tuple[float, float]:
    """Mean of independent values with sds, weighted by their variances, and its sd."""
    value, sd = np.array(values).T
    weight = sd**-2.0
    return float(weight @ value / weight.sum()), float(weight.sum() ** -0.5)


def _across(plane: EquiPlane) -> Array:
    """Direction (3,) in O that is horizontal at balance, across the pivot line, towards the tip."""
    forward = np.cross(plane.direction, plane.up)
    return np.asarray(math.cos(plane.phi) * forward + math.sin(plane.phi) * plane.up)
