"""Inertial parameters of the object without the markers (printed tags) that are glued to it.

Half a gram of marker on an object of 34 g moves the centre of mass by 0.7 mm (method.md, section 7).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from analyze.estimation.mass_properties import AxisInertia, InertialParameters
from analyze.geometry.second_moments import symmetric_entries, symmetric_matrix
from analyze.types import Array, EquiPlane
from schemas.object_spec import MarkerSpec

CARD_OVER_TAG_SIZE = 10 / 8
"""Edge of a marker's card over that of its black square."""
RELATIVE_STEP = 1e-6
"""Step of the numerical derivatives, relative to each parameter's size."""


def can_subtract(markers: Sequence[MarkerSpec]) -> bool:
    """True if the mass of all markers (printed tags) can be subtracted: all that have a mass have a pose.

    Also True if no marker has a mass.
    """
    return all(marker.T_object_marker is not None for marker in markers if marker.mass_kg > 0)


def without_markers(whole: InertialParameters, markers: Sequence[MarkerSpec]) -> InertialParameters:
    """Mass, centre of mass and moments of the object without its markers, in the object frame O.

    Markers are printed tags glued to the object. Quantities of single strikes (residuals, distances, planes,
    weights) stay those of the body that tipped.

    Args:
        whole: Parameters of the object with its markers.
        markers: Markers; their masses and poses count as exact, and one without a pose is not subtracted.

    Returns:
        Parameters with their covariances, or `whole` itself if no marker has both a mass and a pose.
    """
    mass, first, about_origin = _marker_moments(markers)
    if mass == 0.0:
        return whole
    ten = np.concatenate([[whole.mass], whole.com.position, symmetric_entries(whole.inertia)])

    def bare(ten: Array) -> Array:
        m, c = ten[0] - mass, (ten[0] * ten[1:4] - first) / (ten[0] - mass)
        origin = symmetric_matrix(ten[4:]) + ten[0] * _point_inertia(ten[1:4]) - about_origin
        return np.concatenate([[m], c, symmetric_entries(origin - m * _point_inertia(c))])

    found = bare(ten)
    sizes = RELATIVE_STEP * np.array([whole.mass, *[0.1] * 3, *[np.trace(whole.inertia)] * 6])
    by = np.array([(bare(ten + step) - bare(ten - step)) / (2 * step.sum()) for step in np.diag(sizes)]).T
    covariance = by @ whole.covariance @ by.T
    inertia = symmetric_matrix(found[4:])
    directions = np.array([axis.direction for axis in whole.axes]).reshape(-1, 3)
    lines = symmetric_entries(directions[:, :, None] * directions[:, None, :]) * [1, 1, 1, 2, 2, 2]
    to_joint = np.zeros((4 + len(lines), 10))
    to_joint[:4, :4] = np.eye(4)
    to_joint[4:, 4:] = lines
    joint = to_joint @ covariance @ to_joint.T
    planes = {plane.axis_id: plane for plane in whole.com.planes}
    axes: list[AxisInertia] = []
    for axis, i_com, sd in zip(
        whole.axes, (lines @ found[4:]).tolist(), np.sqrt(np.diag(joint)[4:]).tolist(), strict=True
    ):
        plane = planes[axis.axis_id]
        before = axis.i_com + whole.mass * _lever(whole.com.position, plane, axis.direction) ** 2
        after = i_com + found[0] * _lever(found[1:4], plane, axis.direction) ** 2
        axes.append(
            replace(
                axis,
                i_edge=axis.i_edge + after - before,
                i_com=i_com,
                i_com_sd=sd,
                i_edge_interval=_shifted(axis.i_edge_interval, after - before),
                i_com_interval=_shifted(axis.i_com_interval, i_com - axis.i_com),
            )
        )
    return replace(
        whole,
        mass=float(found[0]),
        com=replace(
            whole.com,
            position=found[1:4],
            covariance=covariance[1:4, 1:4],
            # The markers' mass is small: ends move as the means do.
            intervals=_moved_ends(whole.com.intervals, found[1:4] - whole.com.position),
        ),
        inertia=inertia,
        inertia_intervals=_moved_ends(whole.inertia_intervals, found[4:] - ten[4:]),
        inertia_sd=symmetric_matrix(np.sqrt(np.diag(covariance)[4:])),
        axes=tuple(axes),
        joint_covariance=joint,
        covariance=covariance,
    )


def _moved_ends(ends: Array | None, by: Array) -> Array | None:
    """Intervals (n, 2) of n quantities, both ends moved by `by` (n,), in their unit; None if `ends` is."""
    return None if ends is None else ends + by[:, None]


def _shifted(ends: tuple[float, float] | None, by: float) -> tuple[float, float] | None:
    """Interval (lower, upper end) of one quantity moved by `by`, in its unit; None if `ends` is None."""
    return None if ends is None else (ends[0] + by, ends[1] + by)


def _marker_moments(markers: Sequence[MarkerSpec]) -> tuple[float, Array, Array]:
    """Mass [kg], first moment (3,) [kg m] and inertia (3, 3) [kg m^2] of all markers, about O's origin.

    O is the object frame. A marker is a thin square card of uniform density, `CARD_OVER_TAG_SIZE` as wide as
    its black square; one without mass or pose is left out.
    """
    mass, first, about_origin = 0.0, np.zeros(3), np.zeros((3, 3))
    for marker in markers:
        if marker.mass_kg > 0 and marker.T_object_marker is not None:
            T = np.array(marker.T_object_marker)
            middle = T[:3, 3] - T[:3, 2] * marker.thickness_m / 2
            own = marker.mass_kg * (CARD_OVER_TAG_SIZE * marker.size_m) ** 2 / 12 * np.diag([1.0, 1.0, 2.0])
            mass += marker.mass_kg
            first = first + marker.mass_kg * middle
            about_origin = (
                about_origin + T[:3, :3] @ own @ T[:3, :3].T + marker.mass_kg * _point_inertia(middle)
            )
    return mass, first, about_origin


def _point_inertia(place: Array) -> Array:
    """Inertia per kilogram (3, 3) [m^2] of a point mass at `place` (3,) [m], about the origin."""
    return float(place @ place) * np.eye(3) - np.outer(place, place)


def _lever(com: Array, plane: EquiPlane, direction: Array) -> float:
    """Distance R + rho [m] of the centre of mass from the line of contact with the table at balance.

    R is the distance from the centre line of the edge's rounding, rho the radius of the rounding.

    Args:
        com: (3,) centre of mass [m], in the object frame O.
        plane: Plane through a strike's pivot line and the centre of mass (equi-plane), which gives a point on
            the centre line, and rho.
        direction: (3,) unit direction of the centre line, in O.
    """
    return float(np.linalg.norm(np.cross(com - plane.point, direction))) + plane.edge_radius
