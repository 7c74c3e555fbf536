"""Pivot axes: edges of support polygons and tangents of round rims (method 1.3)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from analyze.geometry.edge_radius import edge_radius
from analyze.geometry.face_slopes import turn_covariance
from analyze.geometry.object_model import ObjectModel
from analyze.motion.moulded import moulded_radius
from analyze.planning.hypothesis import Hypothesis
from analyze.planning.rims import rim_headings, round_rim
from analyze.planning.stable_planes import RestingPlane
from analyze.types import Array, SupportLine
from schemas.object_spec import ObjectSpec

BRIDGED_SD = 3e-4
"""1 sigma [m] of an edge that bridges two corners and at which no face ends."""
FACET_WIDTH_FRACTION = 0.03
"""Width of a face, over the object's extent, up to which it is a facet of a round flank."""
TOUCHING_FRACTION = 3e-4
"""Distance of a face from an edge or its rounding, over the object's extent, up to which they touch."""
STEEPEST_WALL = np.radians(60.0)
"""Lean [rad] of the face that rises from an edge beyond which its rounding's inset is not used."""


@dataclass(frozen=True)
class NextEdge:
    """Edge that lands next as an object tips over its planned pivot edge, and the room before it does.

    When it lands it takes over: the object then turns over it. An edge carries as long as the object turns
    over it.

    Q is the region believed to hold the centre of mass, in the object frame.
    """

    takes_over: float
    """Tipping angle [rad] at which it takes over; 0 if the planned edge does not carry even at rest."""
    shift: float
    """Distance [m] of its line from that of the planned edge."""
    firmness: float
    """Largest factor by which Q can be scaled about its centre and the planned edge still carry at balance,
    for every centre of mass in Q; negative if it does not carry for the centre itself."""
    carrier: SupportLine | None = None
    """Line that carries at balance instead of the planned edge, wherever the centre of mass is in the middle
    part of Q; None if there is none, or if it is too near the planned edge to be distinguished from it."""
    carrier_firmness: float = -1.0
    """Largest factor by which Q can be scaled about its centre and that line carry at balance."""


@dataclass(frozen=True)
class PivotAxis:
    """Pivot line about which the object tips, with its resting plane, in the object frame O.

    The line is the centre line (axis of the rounding) of a rounded edge. W is the world frame at rest (z up,
    table at z = 0), Q the region that is believed to hold the centre of mass.
    """

    id: str
    """Name in plans: the face's id, then e and the number of the edge, or t and that of a rim's tangent."""
    plane: RestingPlane
    """Face that the object rests on."""
    direction: Array
    """(3,) unit pivot axis l, W's +y at rest; +theta about it tips."""
    tip: Array
    """(3,) unit, W's +x at rest: direction of the tip."""
    point: Array
    """(3,) point on the rounding's centre line, beside the centre of Q [m]."""
    radius: float
    """Radius of the rounding [m]."""
    sd: float
    """1 sigma of the line's place across itself [m]."""
    rolls: bool
    """True for the tangent of a round rim, on which the contact can roll."""
    moulded: bool = False
    """True if the rounding is part of the shape along all of the edge; False if it is the one stated for all
    edges."""
    radius_sd: float | None = None
    """1 sigma of the radius [m] where a scan leaves it open; None if it is that of all edges."""
    turn_sd: float = 0.0
    """1 sigma [rad] of the object's turn at rest about the axis, by the slopes of a scanned face."""
    next_edge: NextEdge | None = None
    """Edge that takes over as the object tips on; None if there is none, or it was not looked for."""
    lines_apart: float = 0.0
    """Distance [m] of the outermost of several close lines, as of a bevel, in the middle of which this axis
    lies; 0 for a single line."""
    placed: PivotAxis | None = None
    """Edge of the resting face by which the object is placed, if this line only takes over from it before
    balance; None if the object turns over this line from rest on."""

    @property
    def R_world_object(self) -> Array:  # noqa: N802 - the frames belong to the name
        """Rotation (3, 3) from the object frame O to the world frame W at rest.

        Its rows are W's x (direction of the tip), y (pivot axis) and z (up), in O.
        """
        return np.stack([self.tip, self.direction, self.plane.up])

    @property
    def p_world_object(self) -> Array:
        """Position (3,) [m] of the object frame's origin in the world frame, with the object at rest.

        The centre line of the edge's rounding then lies at x = 0, z = radius (of the rounding), and `point`,
        the axis's point on that line, at y = 0. If the object is placed with another edge on the mark, and
        turns over this line only later, the position is that with the other edge's line and point there.
        """
        if self.placed is not None:
            return self.placed.p_world_object
        return np.array([0.0, 0.0, self.radius]) - self.R_world_object @ self.point

    def carries_for(self, share: float) -> bool:
        """True if the object balances over this axis, before the next edge lands, for a share of Q.

        Q is the region believed to hold the centre of mass c. It must be so wherever c is in Q, scaled by
        `share` about its centre.

        Args:
            share: Scale of Q, 0 to 1; 1 stands for all of Q.
        """
        return self.next_edge is None or self.next_edge.firmness > share

    @property
    def edge(self) -> tuple[Array, Array]:
        """Ends (3,), (3,) [m, object frame] of the support polygon's edge over which the object tips.

        For the tangent of a round rim both are the polygon's foremost corner.
        """
        if self.rolls:
            corner = self.plane.polygon[int(np.argmax(self.plane.polygon @ self.tip))]
            return corner, corner
        start, end = self.plane.edges
        edge = int(np.argmax(self.plane.outward @ self.tip))
        return start[edge], end[edge]


@dataclass(frozen=True)
class Swing:
    """Parameters of a tip about one axis, for a given centre of mass c and inertia.

    The edge is rounded; its centre line is the axis of the rounding. The tip is theta'' = -k sin(phi -
    theta), with theta the tipping angle, phi the balance angle and k = m g R / I_edge the rate constant: m is
    the mass, g gravity, R the distance of c from the centre line, I_edge the moment of inertia about the
    contact line at balance.
    """

    distance: float
    """Distance R of c from the centre line [m]."""
    phi: float
    """Balance angle [rad]."""
    i_edge: float
    """Moment of inertia about the contact line at balance [kg m^2]."""
    k: float
    """k = m g R / I_edge [rad/s^2]."""
    mass: float
    """Mass [kg]."""


def pivot_axes(
    model: ObjectModel, spec: ObjectSpec, planes: Sequence[RestingPlane], believed: Hypothesis
) -> list[PivotAxis]:
    """Pivot axes (lines about which the object tips): edges of support polygons, tangents of round rims.

    Edges are left out if the expected centre of mass does not lie between their ends along the edge: the
    object would yaw instead of tipping. A rim gives tangents (`rim_headings`).

    Args:
        model: Shape of the object.
        spec: Edge radius and markers.
        planes: Resting planes.
        believed: Hypothesis with the region of the centre of mass, of which the centre is used.
    """
    axes: list[PivotAxis] = []
    for plane in planes:
        start, end = plane.edges
        out = plane.outward
        rim = round_rim(plane)
        beside = believed.region.centre
        for i in np.flatnonzero(np.logical_not(rim)):
            direction = np.cross(plane.up, out[i])
            along = [float(direction @ (corner - beside)) for corner in (start[i], end[i])]
            if min(along) < 0 < max(along):
                axes.append(_axis(f"{plane.id}e{i}", model, spec, plane, out[i], (start[i], end[i]), beside))
        tips = rim_headings(plane, rim, spec, beside) if rim.any() else []
        axes += [
            rim_tangent(f"{plane.id}t{number}", model, spec, plane, tip, beside)
            for number, tip in enumerate(tips)
        ]
    return axes


def rim_tangent(
    name: str, model: ObjectModel, spec: ObjectSpec, plane: RestingPlane, tip: Array, beside: Array
) -> PivotAxis:
    """Pivot axis at the tangent of a round rim over which the object tips in a given direction.

    Args:
        name: Id of the axis.
        model: Shape of the object.
        spec: Object file, with the edges' radii if they are known.
        plane: Face that the object rests on, whose outline has the rim.
        tip: (3,) unit direction of the tip, in the face's plane, in the object frame.
        beside: (3,) expected centre of mass [m], in the object frame; the axis's point lies beside it.
    """
    contact = plane.polygon[int(np.argmax(plane.polygon @ tip))]
    return _axis(name, model, spec, plane, tip, (contact, contact), beside, rolls=True)


def swing(axis: PivotAxis, com: Array, mass: float, unit_inertia: Array, gravity: float) -> Swing:
    """Parameters of a tip about an axis, for a given centre of mass c and inertia.

    Args:
        axis: Pivot axis.
        com: (3,) centre of mass c [m], in the object frame.
        mass: Mass [kg].
        unit_inertia: (3, 3) inertia about c per kilogram [m^2], in the object frame.
        gravity: Gravity g [m/s^2].

    Returns:
        Distance R [m] of c from the centre line of the edge's rounding, balance angle phi [rad], moment
        I_edge [kg m^2] about the contact line at balance, k = m g R / I_edge [rad/s^2], and the mass.
    """
    arm = com - axis.point
    up, forward = float(arm @ axis.plane.up), -float(arm @ axis.tip)
    distance = float(np.hypot(up, forward))
    i_com = mass * float(axis.direction @ unit_inertia @ axis.direction)
    i_edge = i_com + mass * (distance + axis.radius) ** 2
    return Swing(distance, float(np.arctan2(forward, up)), i_edge, mass * gravity * distance / i_edge, mass)


def phi_spread(axis: PivotAxis, believed: Hypothesis) -> float:
    """1 sigma [rad] of an axis's balance angle phi, as the centre of mass varies over its region.

    Args:
        axis: Pivot axis.
        believed: What is assumed of the object; the covariance of its region of the centre of mass is used.
    """
    arm = believed.region.centre - axis.point
    arm = arm - axis.direction * float(arm @ axis.direction)
    across = np.cross(axis.direction, arm) / float(arm @ arm)
    return float(np.sqrt(across @ believed.region.covariance() @ across))


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
    """Pivot axis at an edge, on the centre line of its rounding.

    The rounding of an edge that is sharp in the shape touches both faces: its centre lies one radius inside
    each. The radius is the expected one, as stated, seen on a scan, or assumed (`edge_radius`). A rounding
    that is part of the shape, as of a moulded body, begins where the face ends: its centre is straight above.

    Args:
        name: Id of the axis.
        model: Shape of the object.
        spec: Object file, with the edges' radii if they are known.
        plane: Face that the object rests on.
        tip: (3,) unit direction of the tip, in the object frame.
        edge: Ends (3,), (3,) of the edge [m], in the object frame; equal for a rim.
        beside: (3,) expected centre of mass [m], in the object frame; the axis's point lies beside it.
        rolls: True for the tangent of a round rim.

    Returns:
        The axis, in the object frame: line through a point (3,) [m], with unit direction (3,), unit tip
        direction (3,), and radius of the rounding [m].
    """
    direction = np.cross(plane.up, tip)
    wall = wall_lean(model, tip, plane.up, edge)
    contact = edge[0] + direction * float(direction @ (beside - edge[0]))
    prior = edge_radius(spec, model, name, contact, direction)
    radius = prior.mean
    lean = 0.0 if wall is None else wall
    inset = radius * (1 + np.sin(lean)) / np.cos(lean)
    level = float(contact @ plane.up)
    own = model.edge_sd(np.array(edge))
    if wall is None and (moulded := _moulded_radius(model, plane, tip, contact, beside)) is not None:
        point = contact + plane.up * (plane.level - level + moulded)
        return PivotAxis(name, plane, direction, tip, point, moulded, own, rolls, moulded=True)
    point = contact + plane.up * (plane.level - level + radius) - tip * inset
    own = place_sd(own, wall)
    turn_sd = float(np.sqrt(direction @ turn_covariance(model, plane.up) @ direction))
    return PivotAxis(
        name, plane, direction, tip, point, radius, own, rolls, radius_sd=prior.blurred_sd, turn_sd=turn_sd
    )


def place_sd(own: float, wall: float | None) -> float:
    """1 sigma [m] of the place of an edge across itself, larger where no face rises from it.

    Args:
        own: 1 sigma [m] of an edge in which two faces meet (`ObjectModel.edge_sd`).
        wall: Lean [rad] of the face that rises from the edge (`wall_lean`); None if there is none, so that
            the edge bridges two corners of the hull.
    """
    return own if wall is not None else float(np.hypot(own, BRIDGED_SD))


def _moulded_radius(
    model: ObjectModel, plane: RestingPlane, tip: Array, contact: Array, beside: Array
) -> float | None:
    """Radius [m] of the rounding that the shape itself has at the edge; None if it has none.

    It is None too if the resting face is one of the narrow flat sides of a round flank: in the direction of
    the tip its width is below `FACET_WIDTH_FRACTION` of the object's longest extent.

    Args:
        model: Shape of the object.
        plane: Face that the object rests on.
        tip: (3,) unit direction of the tip, in the object frame.
        contact: (3,) point of the edge [m], in the object frame.
        beside: (3,) expected centre of mass [m], in the object frame.
    """
    if float(np.ptp(plane.polygon @ tip)) < FACET_WIDTH_FRACTION * float(model.extent.max()):
        return None
    arm = beside - contact
    phi = float(np.arctan2(-(arm @ tip), arm @ plane.up))
    return moulded_radius((model.hull_vertices - contact) @ np.stack([tip, plane.up]).T, phi)


def wall_lean(
    model: ObjectModel, tip: Array, up: Array, points: Sequence[Array], depth: float = 0.0
) -> float | None:
    """Lean [rad] of the face that rises from an edge: angle of its outward normal over the horizontal.

    The face is one of the convex hull whose plane passes through all `points` (`depth` outside them) within
    `TOUCHING_FRACTION` of the object's longest extent; of several, the one that faces most along `tip`.

    Args:
        model: Shape of the object.
        tip: (3,) unit direction of the tip, in the object frame.
        up: (3,) unit normal of the resting face, into the object, in the object frame.
        points: Points (3,) [m], in the object frame: the ends of the edge, or one on its rounding's centre
            line.
        depth: Distance [m] from the points to the planes of the faces that meet at the edge: 0 for points of
            the edge, the radius for points on its rounding's centre line.

    Returns:
        The lean; None if no face but the resting face passes there, or the lean is not between minus and plus
        `STEEPEST_WALL`.
    """
    planes = model.hull_planes
    within = TOUCHING_FRACTION * float(model.extent.max())
    gaps = [planes[:, :3] @ point + planes[:, 3] + depth for point in points]
    normals = planes[(np.abs(gaps) < within).all(axis=0) & (planes[:, :3] @ up > -0.999), :3]
    if not len(normals):
        return None
    forward, height = normals @ tip, normals @ up
    best = int(np.argmax(forward / np.maximum(np.hypot(forward, normals @ np.cross(up, tip)), 1e-12)))
    lean = float(np.arctan2(height[best], forward[best]))
    return lean if abs(lean) < STEEPEST_WALL else None
