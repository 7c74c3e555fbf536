"""Pivot axes: the edges of the support polygons, and tangents of round rims; where their rounding's centre line runs (paper 3.1.2)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from analyze.geometry.object_model import ObjectModel
from analyze.geometry.polyhedron import BoolArray
from analyze.geometry.rotations import plane_basis
from analyze.motion.moulded import moulded_radius
from analyze.planning.hypothesis import Hypothesis
from analyze.planning.stable_planes import RestingPlane
from analyze.types import Array
from schemas.object_spec import ObjectSpec

BRIDGED_SD = 3e-4
"""m, where the edge joins two corners and no face ends there"""
RIM_TURN = np.radians(20.0)
"""edges that turn by less than this, on and on, are a round rim"""
RIM_EDGES = 5
STRIP = 0.03
"""of the object's size, up to which a face is a facet of something round"""
STEEPEST_WALL = np.radians(60.0)
"""lean of the struck-off face against the vertical beyond which the rounding's inset is not believed"""


@dataclass(frozen=True)
class PivotAxis:
    """One way to tip: the resting plane, and the line about which the object turns. All in O."""

    id: str
    plane: RestingPlane
    direction: Array
    """(3,) unit l = W's +y; +theta about it tips"""
    tip: Array
    """(3,) unit, W's +x: where the object tips to"""
    point: Array
    """(3,) m on the rounding's centre line, beside the hypothesis centre"""
    radius: float
    """m, of the rounding"""
    sd: float
    """m"""
    rolls: bool
    moulded: bool = False
    """whether the rounding is the shape's own, along all of the edge; else the one that is stated for all edges"""

    @property
    def R_world_object(self) -> Array:  # noqa: N802 - the frames belong to the name
        """(3, 3): rows are W's x, y, z in O."""
        return np.stack([self.tip, self.direction, self.plane.up])

    @property
    def p_world_object(self) -> Array:
        """(3,) m: puts the centre line at x = 0, z = radius, and `point` at y = 0."""
        return np.array([0.0, 0.0, self.radius]) - self.R_world_object @ self.point


@dataclass(frozen=True)
class Swing:
    """What is expected of a tip about one axis if c is at one place."""

    distance: float
    """R [m], of c from the centre line"""
    phi: float
    """rad"""
    i_edge: float
    """kg m^2, about the contact line at balance"""
    k: float
    """rad/s^2"""
    mass: float
    """kg"""


def pivot_axes(model: ObjectModel, spec: ObjectSpec, planes: Sequence[RestingPlane], believed: Hypothesis) -> list[PivotAxis]:
    """Every edge of every support polygon; of a round rim the tangents at whose headings a marker faces along the axis.

    Edges that c does not stand beside (it would yaw, not tip) are left out.
    """
    axes: list[PivotAxis] = []
    for plane in planes:
        start, end = plane.edges
        out = plane.outward()
        rim = _rim(plane)
        beside = believed.region.centre
        for i in np.flatnonzero(np.logical_not(rim)):
            direction = np.cross(plane.up, out[i])
            along = [float(direction @ (corner - beside)) for corner in (start[i], end[i])]
            if min(along) < 0 < max(along):
                axes.append(_axis(f"{plane.id}e{i}", model, spec, plane, out[i], (start[i], end[i]), beside))
        if rim.any():
            for number, tip in enumerate(_rim_headings(plane, spec)):
                contact = plane.polygon[int(np.argmax(plane.polygon @ tip))]
                if rim[int(np.argmax(out @ tip))]:
                    axes.append(_axis(f"{plane.id}t{number}", model, spec, plane, tip, (contact, contact), beside, rolls=True))
    return axes


def swing(axis: PivotAxis, com: Array, mass: float, unit_inertia: Array, gravity: float) -> Swing:
    """R, phi, I_edge and k (METHOD, frames and symbols) for c at `com` (3,) [m]; unit_inertia (3, 3) [m^2] is about c, per kilogram."""
    arm = com - axis.point
    up, forward = float(arm @ axis.plane.up), -float(arm @ axis.tip)
    distance = float(np.hypot(up, forward))
    i_com = mass * float(axis.direction @ unit_inertia @ axis.direction)
    i_edge = i_com + mass * (distance + axis.radius) ** 2
    return Swing(distance, float(np.arctan2(forward, up)), i_edge, mass * gravity * distance / i_edge, mass)


def _axis(
    name: str,
    model: ObjectModel,
    spec: ObjectSpec,
    plane: RestingPlane,
    tip: Array,
    edge: tuple[Array, Array],
    beside: Array,
    rolls: bool = False,
) -> PivotAxis:
    """Axis at an edge. The rounding of a sharp one (radius rho) touches both faces, so its centre lies rho inside either.

    Where the shape has the rounding, as a moulded body's, it begins where the face ends: its centre is straight above.
    """
    direction = np.cross(plane.up, tip)
    wall = _wall(model, plane, tip, edge)
    radius = spec.edge_radius_m
    lean = 0.0 if wall is None else wall
    inset = radius * (1 + np.sin(lean)) / np.cos(lean)
    contact = edge[0] + direction * float(direction @ (beside - edge[0]))
    level = float(contact @ plane.up)
    own = model.edge_sd(np.array(edge))
    if wall is None and (moulded := _moulded(model, plane, tip, contact, beside)) is not None:
        point = contact + plane.up * (plane.level - level + moulded)
        return PivotAxis(name, plane, direction, tip, point, moulded, own, rolls, moulded=True)
    point = contact + plane.up * (plane.level - level + radius) - tip * inset
    sd = own if wall is not None else float(np.hypot(own, BRIDGED_SD))
    return PivotAxis(name, plane, direction, tip, point, radius, sd, rolls)


def _moulded(model: ObjectModel, plane: RestingPlane, tip: Array, contact: Array, beside: Array) -> float | None:
    """Radius [m] of a rounding that the shape itself has beyond `contact`; its centre line is straight above."""
    if float(np.ptp(plane.polygon @ tip)) < STRIP * float(model.extent.max()):
        return None
    arm = beside - contact
    phi = float(np.arctan2(-(arm @ tip), arm @ plane.up))
    return moulded_radius((model.hull_vertices - contact) @ np.stack([tip, plane.up]).T, phi)


def _wall(model: ObjectModel, plane: RestingPlane, tip: Array, edge: tuple[Array, Array]) -> float | None:
    """Angle [rad] by which the normal of the face that rises from the edge points upwards; None where no face ends at the edge."""
    tolerance = 3e-4 * float(model.extent.max())
    planes = model.hull_planes
    touches = np.all([np.abs(planes[:, :3] @ point + planes[:, 3]) < tolerance for point in edge], axis=0)
    others = touches & (planes[:, :3] @ plane.up > -0.999)
    if not others.any():
        return None
    normals = planes[others, :3]
    forward, up = normals @ tip, normals @ plane.up
    best = int(np.argmax(forward / np.maximum(np.hypot(forward, normals @ np.cross(plane.up, tip)), 1e-12)))
    lean = float(np.arctan2(up[best], forward[best]))
    return lean if abs(lean) < STEEPEST_WALL else None


def _rim(plane: RestingPlane) -> BoolArray:
    """Which edges (k,) belong to a round rim, as bool: runs of short turns on both sides."""
    out = plane.outward()
    turn = np.arccos(np.clip(np.einsum("ki,ki->k", out, np.roll(out, -1, axis=0)), -1, 1))
    gentle = turn < RIM_TURN
    round_edge = gentle & np.roll(gentle, 1)
    return round_edge if round_edge.sum() >= RIM_EDGES else np.zeros(len(out), dtype=bool)


def _rim_headings(plane: RestingPlane, spec: ObjectSpec) -> list[Array]:
    """Tip directions (3,) for which a marker faces against the axis, towards the camera; without known markers every 45 degrees."""
    headings: list[Array] = []
    for marker in spec.marker:
        if marker.T_object_marker is not None:
            normal = np.array(marker.T_object_marker)[:3, 2]
            flat = normal - plane.up * float(normal @ plane.up)
            if np.linalg.norm(flat) > 0.9:
                headings.append(np.cross(plane.up, flat / np.linalg.norm(flat)))
    if all(marker.T_object_marker is None for marker in spec.marker):
        u, v = plane_basis(plane.up)
        headings = [np.cos(a) * u + np.sin(a) * v for a in np.arange(8) * np.pi / 4]
    distinct: list[Array] = []
    for heading in headings:
        if all(heading @ other < np.cos(np.radians(5)) for other in distinct):
            distinct.append(heading)
    return distinct
