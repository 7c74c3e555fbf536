"""Round rims on which bodies tip, and the turn of a round body about its axis, which no edge shows."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from analyze.geometry.rotations import matrix_from_vector, vector_from_matrix
from analyze.registration.places import MAX_TURN_SD

if TYPE_CHECKING:
    from analyze.geometry.object_model import ObjectModel
    from analyze.registration.solution import Solution
    from analyze.registration.views import StrikeView
    from analyze.types import Array
    from schemas.strike_plan import PlannedStrike

RIM_WINDOW = math.radians(30.0)
"""angle [rad] to either side of the tip's direction over which a rim must be a circle"""
MAX_RIM_RESIDUAL = 3e-3
"""largest deviation of a rim from a circle within that angle, over the circle's radius; a mesh's facets make
1e-3 with 64 of them"""
MAX_AXES_APART = 1e-3
"""largest distance [m] between the axes of two rims of a body of revolution"""
SAME_AXIS = math.cos(math.radians(0.5))
"""smallest cosine between the directions of the axes of two rims of a body of revolution"""
MAX_ASYMMETRY = 0.01
"""largest depth or height of a turned body's surface under its own, over its longest extent, for a body of
revolution"""
_TURNS = np.radians([37.0, 90.0, 151.0, 200.0, 263.0])
"""angles by which a body is turned to find whether it is one of revolution [rad]"""
_MAX_POINTS = 500
"""most points of the surface that are looked at"""


@dataclass(frozen=True)
class FreeTurn:
    """Axis of a body of revolution, about which only its markers show how it is turned."""

    point: Array
    """(3,) point on the axis, in the object frame O [m]"""
    direction: Array
    """(3,) unit vector of the axis in O"""

    def turned(self, T: Array, angle: float) -> Array:
        """Pose (4, 4) in O, its translation in m, turned about the axis by an angle [rad]."""
        turn = matrix_from_vector(self.direction * angle)
        turned = np.eye(4)
        turned[:3, :3] = turn @ T[:3, :3]
        turned[:3, 3] = self.point + turn @ (T[:3, 3] - self.point)
        return turned

    def off_tangent(self, point: Array, turn: Array) -> Array:
        """Displacement (3,) [m] of a point turned about the axis, less the one along its circle's tangent.

        Args:
            point: (3,) point in O [m].
            turn: (3,) rotation vector [rad], of which the part along the axis counts.
        """
        about = self.direction * float(self.direction @ turn)
        arm = point - self.point
        return matrix_from_vector(about) @ arm - arm - np.cross(about, arm)


def rim_centre(model: ObjectModel, planned: PlannedStrike) -> Array | None:
    """Point (3,) [m] in O on the axis of the round rim over which a planned strike tips the body.

    The extent of the resting face in directions t within `RIM_WINDOW` of the tip's is that of a circle,
    h = c.t + r, for a rim with centre c and radius r. None for a straight edge, or a rim that is no circle.

    Args:
        model: the object's exterior.
        planned: the planned strike.
    """
    if not planned.rolls:
        return None
    tip, across, up = np.array(planned.R_world_object)
    level = model.hull_vertices @ up
    base = model.hull_vertices[level < level.min() + 1e-3 * float(model.extent.max())]
    angles = np.linspace(-RIM_WINDOW, RIM_WINDOW, 25)
    extent = (base @ (np.outer(np.cos(angles), tip) + np.outer(np.sin(angles), across)).T).max(axis=0)
    columns = np.stack([np.cos(angles), np.sin(angles), np.ones(len(angles))], axis=1)
    fitted: Array = np.asarray(np.linalg.solve(columns.T @ columns, columns.T @ extent), dtype=np.float64)
    ahead, aside, radius = (float(value) for value in fitted)
    residual = float(np.abs(columns @ fitted - extent).max())
    if radius <= 0 or residual > MAX_RIM_RESIDUAL * radius:
        return None
    return np.asarray(ahead * tip + aside * across + level.min() * up, dtype=np.float64)


def rim_axis(views: Sequence[StrikeView]) -> FreeTurn | None:
    """Axis of the first round rim over which one of the strikes tips the body; None if there is none."""
    axes = (FreeTurn(v.rim_centre, v.R_world_object[2]) for v in views if v.rim_centre is not None)
    return next(axes, None)


def free_turn(model: ObjectModel, views: Sequence[StrikeView]) -> FreeTurn | None:
    """Axis about which the body may be turned without a change that any strike shows; None if there is none.

    All strikes must tip it over circular rims about one axis, and the body must be one of revolution about
    that axis: its surface, turned about it, covers itself within `MAX_ASYMMETRY`.

    Args:
        model: the object's exterior.
        views: views of the strikes.
    """
    free = rim_axis(views)
    if free is None:
        return None
    point, direction = free.point, free.direction
    for view in views:
        if view.rim_centre is None:
            return None
        apart = view.rim_centre - point
        apart -= direction * float(apart @ direction)
        if (
            abs(float(view.R_world_object[2] @ direction)) < SAME_AXIS
            or np.linalg.norm(apart) > MAX_AXES_APART
        ):
            return None
    step = max(1, len(model.vertices) // _MAX_POINTS)
    surface = model.vertices[::step] - point
    limit = MAX_ASYMMETRY * float(model.extent.max())
    for angle in _TURNS:
        turned = point + surface @ matrix_from_vector(direction * angle).T
        if float(np.abs(model.depth(turned)).max()) > limit:
            return None
    return free


def turn_between(free: FreeTurn, found: Mapping[int | str, Array], given: Mapping[int | str, Array]) -> float:
    """Mean angle [rad] about a body's axis from markers' found poses to given ones; 0 without common markers.

    Args:
        free: axis of the body.
        found: pose (4, 4) in O of each marker found.
        given: poses of some of these markers, by which O's direction about the axis is defined.
    """
    angles = [
        float(vector_from_matrix(given[name][:3, :3] @ found[name][:3, :3].T) @ free.direction)
        for name in found
        if name in given
    ]
    mean = np.mean(np.exp(1j * np.array(angles))) if angles else 1.0
    return float(np.angle(mean))


def turned_as_given(solution: Solution, free: FreeTurn, given: Mapping[int | str, Array]) -> Solution:
    """Solution with all markers turned about a body's axis so that they lie as the object file states.

    Markers whose turn against the first one is not determined do not count.

    Args:
        solution: the joint fit.
        free: axis of the body, about which its shape leaves O's direction free.
        given: poses T_object_marker (4, 4) that the object file states; empty to leave the solution as it is.
    """
    axis = free.direction
    known = {
        name: solution.T_object_marker[name]
        for name, P in solution.covariance.items()
        if float(axis @ P[:3, :3] @ axis) < MAX_TURN_SD**2
    }
    angle = turn_between(free, known, given)
    turn = np.kron(np.eye(2), matrix_from_vector(axis * angle))
    return replace(
        solution,
        T_object_marker={name: free.turned(T, angle) for name, T in solution.T_object_marker.items()},
        covariance={name: turn @ P @ turn.T for name, P in solution.covariance.items()},
    )
