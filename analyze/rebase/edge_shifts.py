"""Displacement of a plan's pivot edges between two shapes of one object."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from analyze.geometry.object_model import ObjectModel
from analyze.types import Array
from schemas.strike_plan import PlannedStrike

ALLOWED_SDS = 3.0
"""displacement of an edge, in standard deviations of its place, up to which it is the planned edge"""
MIN_ALLOWED_M = 5e-5
"""displacement [m] that is always allowed: vertices are rounded when a shape is exported"""
_ANGLES = 13
"""number of tipping angles at which two shapes are compared"""


@dataclass(frozen=True)
class EdgeShift:
    """Displacement of a planned strike's pivot edge and resting face from one shape to another."""

    strike_id: str
    """id of the planned strike"""
    axis_id: str
    """name of its edge in the plan"""
    shift_m: float
    """displacement of the edge across itself [m]"""
    allowed_m: float
    """largest displacement [m] that the errors of both shapes explain"""
    turn_rad: float
    """rotation of the resting face [rad]"""
    allowed_rad: float
    """largest rotation [rad] that the errors of both shapes explain"""

    @property
    def is_same_edge(self) -> bool:
        """True if the planned edge is an edge of the other shape, within the shapes' errors."""
        return self.shift_m <= self.allowed_m and self.turn_rad <= self.allowed_rad


def edge_shifts(
    strikes: Sequence[PlannedStrike], before: ObjectModel, after: ObjectModel, surface_sd: float
) -> list[EdgeShift]:
    """Displacements of the planned strikes' edges between the shape that was planned on and another one.

    As the object tips by theta, its lowest point is that of the hull in the direction
    d = -u cos(theta) + t sin(theta), with u up and t the direction of the tip at rest. If the edge is
    displaced by delta, the hull's extent h(d) changes by delta.d; delta is fitted from rest to balance, and
    the largest |h_after - h_before| counts where it is larger.

    Args:
        strikes: planned strikes, with pivots on the first shape.
        before: shape that the plan was made for.
        after: the other shape.
        surface_sd: 1 sigma [m] of the place of the other shape's faces.
    """
    return [_shift(strike, before, after, surface_sd) for strike in strikes]


def _shift(strike: PlannedStrike, before: ObjectModel, after: ObjectModel, surface_sd: float) -> EdgeShift:
    tip, _, up = np.array(strike.R_world_object)
    theta = np.linspace(0.0, max(strike.phi_predicted_rad, 0.1), _ANGLES)
    down = np.outer(np.sin(theta), tip) - np.outer(np.cos(theta), up)
    change = _extent(after, down) - _extent(before, down)
    delta = np.linalg.lstsq(np.stack([np.sin(theta), -np.cos(theta)], axis=1), change, rcond=None)[0]
    shift = max(float(np.linalg.norm(delta)), float(np.abs(change).max()))
    sd = float(np.hypot(strike.pivot.sd_m, surface_sd))
    allowed = max(ALLOWED_SDS * sd, MIN_ALLOWED_M)
    base = before.hull_vertices[before.hull_vertices @ -up >= _extent(before, -up[None])[0] - allowed]
    width = max(float(np.ptp(base @ tip)), 1e-3)
    turn = _angle_to_face(after, -up)
    return EdgeShift(
        strike.id,
        strike.axis_id,
        shift,
        allowed,
        turn,
        _angle_to_face(before, -up) + float(np.sqrt(2)) * allowed / width,
    )


def _extent(model: ObjectModel, directions: Array) -> Array:
    """Extents (n,) [m] of a shape from O's origin in directions (n, 3): its support function."""
    return (model.hull_vertices @ directions.T).max(axis=0)


def _angle_to_face(model: ObjectModel, down: Array) -> float:
    """Angle [rad] between a direction (3,) and the nearest outward normal of the shape's convex hull."""
    normals = model.hull_planes[:, :3]
    nearest = normals[int(np.argmax(normals @ down))]
    return float(np.arctan2(np.linalg.norm(np.cross(nearest, down)), nearest @ down))
