"""Model of phi and ln k of every strike, given c, second moments and shared errors.

    phi = atan2(-forward, height) + lean of the vertical + angle errors
    ln k = ln g + ln R - ln(l.J.l + (R + rho)^2) + error of the axis

with phi the balance angle, k the rate constant [rad/s^2] and c the centre of mass. At rest, the arm from the
centre line of the edge's rounding to c has a component `forward` in the horizontal direction of the tip and
an upward component `height`; R is its length. g is gravity, J the inertia about c per kilogram, l the unit
direction of the edge and rho its radius. A larger radius moves the centre line inwards, up and away from the
tip: phi changes in proportion to cos phi - sin phi, which vanishes at 45 degrees, so that upright and
45-degree tips together determine the radius. Neither equation contains the mass: motions determine J, but not
the moments of inertia themselves.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from analyze.estimation.equiplane import balance_direction
from analyze.estimation.priors import Scale, SystematicErrors
from analyze.geometry.second_moments import log_cholesky, unit_inertia
from analyze.types import Array, EquiPlane, RadiusSource

COM = slice(0, 3)
"""Indices of c among the unknowns."""
SECOND = slice(3, 9)
"""Indices of the second moments' six numbers (second_moments.py)."""
LENGTHS = slice(3, 6)
"""Indices of the logarithms of the body's lengths, the first three of the second moments' six numbers."""
TILT, SCALE_TERM, RADIUS, GRAVITY = slice(9, 11), 11, 12, 13
"""Indices of the shared errors: lean of the vertical, scale, common edge radius, gravity."""
FIRST_AXIS_TERM = 14
"""Number of unknowns before those of each axis."""
FORWARD, ANGLE, OWN_RADIUS, OWN_K = range(4)
"""Indices among the unknowns of one axis: place forward, angle, own edge radius, own part of k."""
AXIS_TERMS = 4
"""Number of unknowns of one axis."""
LEVEL_TERMS = 2
"""Number of unknowns of one levelling: lean towards W's x and y."""
OWN_RADIUS_FRACTION = 0.3
"""1 sigma of one edge's radius about the common one, as a fraction of the common one's sd."""
WALL_SHARE = 0.9
"""Error of a side face that all its edges share, as a fraction of a face's place error; the rest is each
edge's own, as scanned faces are not quite flat."""
MIN_DISTANCE = 1e-3
"""Lower bound of R [m], against division by zero."""


class JointModel:
    """Model of balance angle phi and ln k of all strikes as functions of one vector x of unknowns.

    k is the rate constant of the tipping motion. x (count,) holds the centre of mass c (3) [m, in the object
    frame O], six numbers that determine the second moments of the mass about c, per kilogram
    (second_moments.py), then the errors that strikes share, each in units of its sd:

    - the vertical's lean from the table's normal towards x and y of the world frame W (first levelling);
    - the shape's scale, the edges' common radius, gravity;
    - four per pivot axis: the edge's place in the direction of the tip, beyond that of its side face, an
      angle, its own radius, an error of k;
    - the place of each face rested on, or rising from a pivot edge: all edges of a face lie in it, so that
      one face's error acts upwards where the object rests on it and forward where it is the side face;
    - for each of these faces, the part of the radius that its edges share, where the object rests on it;
    - two of lean for each further levelling (set-up of the table with one lean);
    - an angle for each further heading (direction of the tip) of an axis: the camera sees another side;
    - three for the turn of all markers on the object, where strikes over round rims depend on it;
    - those of the turns of the object at rest, where markers show them (rest_turns.py).

    Args:
        planes: Equi-planes of the strikes: planes through pivot line and c, with the measured phi.
        systematic: Standard deviations of the shared errors, and the prior of the lean of each levelling.
        scale: Gravity, its error and that of k; None for a model that is used for phi alone.

    Attributes:
        planes: equi-planes of the strikes, whose phi the model is compared with.
        systematic: standard deviations of the shared errors.
        axes: number of pivot axes.
        faces: number of faces rested on or rising from a pivot edge.
        face_terms: index, among the unknowns, of the place of each of these faces that has an id, by id.
        tilts: prior of the lean of each levelling.
        count: number of unknowns.
    """

    def __init__(
        self, planes: Sequence[EquiPlane], systematic: SystematicErrors, scale: Scale | None = None
    ) -> None:
        axes = sorted({plane.axis_id for plane in planes})
        self.planes = planes
        self.systematic = systematic
        self.axes = len(axes)
        faces = sorted({face for plane in planes for face in _faces(plane)})
        first_face = FIRST_AXIS_TERM + AXIS_TERMS * len(axes)
        self.faces = len(faces)
        self.face_terms: dict[str, int] = {name: first_face + i for i, (name, _) in enumerate(faces) if name}
        # Two unknowns per face: its place, and the part of the radius that its edges share.
        self._further_levels = first_face + 2 * len(faces)
        self.tilts = systematic.tilts()
        further = self._further_levels + LEVEL_TERMS * (len(self.tilts) - 1)
        self._first = {name: FIRST_AXIS_TERM + AXIS_TERMS * number for number, name in enumerate(axes)}
        angles: dict[tuple[str, float], int] = {}
        for plane in planes:
            key = (plane.axis_id, plane.heading)
            if key not in angles:
                first_seen = all(axis != plane.axis_id for axis, _ in angles)
                angles[key] = self._first[plane.axis_id] + ANGLE if first_seen else further
                further += not first_seen
        rested = further + 3 * any(plane.phi_by_turn is not None for plane in planes)
        n, by_rest = len(planes), [len(p.phi_by_rest) for p in planes if p.phi_by_rest is not None]
        self.count = rested + max(by_rest, default=0)
        self._point = np.array([plane.point for plane in planes]).reshape(n, 3)
        self._along = np.array([plane.direction for plane in planes]).reshape(n, 3)
        self._up = np.array([plane.up for plane in planes]).reshape(n, 3)
        self._forward = np.cross(self._along, self._up)
        base_up = np.array([plane.base_up for plane in planes]).reshape(n, 3)
        base_forward = np.cross(self._along, base_up)
        self._phi = np.array([plane.phi for plane in planes])
        self._radius = np.array([plane.edge_radius for plane in planes])
        self._log_g = 0.0 if scale is None else float(np.log(scale.gravity))
        self._shift = np.zeros((n, 3, self.count))
        self._turn, self._radius_error, self._k_error = np.zeros((3, n, self.count))
        self._lean = np.zeros(n)
        self._latest: tuple[bytes, tuple[Array, Array, Array]] = b"", (np.zeros(0), np.zeros(0), np.zeros(0))
        for i, plane in enumerate(planes):
            first = self._first[plane.axis_id]
            self._shift[i, :, SCALE_TERM] = plane.point * systematic.scale_sd
            self._radius_error[i], moved = self._edge_errors(
                plane, (base_forward[i], base_up[i]), systematic, first, first_face, faces
            )
            self._shift[i] += moved
            tilt, towards = self.tilts[plane.level], np.array([np.cos(plane.heading), np.sin(plane.heading)])
            self._lean[i] = towards @ tilt.lean
            self._turn[i, self.tilt_terms(plane.level)] = towards * tilt.sd
            self._turn[i, angles[plane.axis_id, plane.heading]] = systematic.axis_angle_sd
            for start, by in ((further, plane.phi_by_turn), (rested, plane.phi_by_rest)):
                if by is not None:
                    self._turn[i, start : start + len(by)] = by
            self._turn[i] += plane.by_radius[0] * self._radius_error[i]
            if scale is not None:
                if plane.k is not None:
                    self._k_error[i] += plane.by_radius[1] / plane.k * self._radius_error[i]
                self._k_error[i, GRAVITY] = scale.gravity_sd / scale.gravity
                self._k_error[i, first + OWN_K] = scale.k_relative_sd

    def _edge_errors(
        self,
        plane: EquiPlane,
        base: tuple[Array, Array],
        systematic: SystematicErrors,
        first: int,
        first_face: int,
        faces: Sequence[tuple[str, str]],
    ) -> tuple[Array, Array]:
        """Changes of an edge's radius (count,) and place (3, count) [m] by 1 sd of each unknown of the model.

        The place is that of the centre line of the edge's rounding, in the object frame O.

        Args:
            plane: plane of a strike over the edge, through this line and the centre of mass.
            base: unit vectors, each (3,), forward and up along the face that lies on the table at the line.
            systematic: standard deviations of shared errors.
            first: index of the first unknown of the pivot axis.
            first_face: index of the first face's unknown.
            faces: keys of all faces, in the order of their unknowns.
        """
        radius, shift = np.zeros(self.count), np.zeros((3, self.count))
        forward, up = base
        if plane.rounded:
            radius_of_face = first_face + len(faces) + faces.index(_faces(plane)[0])
            radius[RADIUS], radius[radius_of_face], radius[first + OWN_RADIUS] = radius_sds(plane, systematic)
            shift += np.outer(_centre_line_shift(plane, forward, up), radius)
        else:
            # A flank's centre of curvature lies nearer to c by as much as its radius is larger.
            radius[first + OWN_RADIUS] = plane.radius_sd
            shift[:, first + OWN_RADIUS] = (
                balance_direction(plane.direction, plane.up, plane.phi) * plane.radius_sd
            )
        of_wall = WALL_SHARE * min(systematic.face_sd, plane.edge_sd) if plane.wall else 0.0
        shift[:, first + FORWARD] = forward * np.sqrt(plane.edge_sd**2 - of_wall**2)
        # A face farther out moves the line along the other face that meets at the edge.
        rest, *wall = (first_face + faces.index(face) for face in _faces(plane))
        shift[:, rest] = (forward * np.tan(plane.wall_lean) - up) * plane.edge_sd
        for term in wall:
            shift[:, term] += forward * of_wall / np.cos(plane.wall_lean)
        return radius, shift

    def axis_term(self, axis_id: str, term: int) -> int:
        """Index, in the vector of all unknowns, of one of the four that a pivot axis has for itself.

        `term` says which: `FORWARD`, `ANGLE`, `OWN_RADIUS` or `OWN_K`.
        """
        return self._first[axis_id] + term

    def radius_errors(self, axis_ids: Sequence[str]) -> Array:
        """Changes (n, count) [m] of the radii of n pivot axes' edges by 1 sd of each of the model's unknowns.

        The unknowns are the edges' common radius, those of faces and of single edges; other entries are 0.
        """
        number = {plane.axis_id: i for i, plane in enumerate(self.planes)}
        return self._radius_error[[number[name] for name in axis_ids]]

    def tilt_terms(self, level: int) -> slice:
        """Slice of the vector of unknowns that holds a levelling's two errors of lean, towards x, then y.

        A levelling is a set-up of the table, with the lean of the vertical towards x and y of the world frame
        W the same for all its strikes; `level` is its number, from 0.
        """
        start = TILT.start if level == 0 else self._further_levels + LEVEL_TERMS * (level - 1)
        return slice(start, start + LEVEL_TERMS)

    def start(self, com: Array, inertia: Array) -> Array:
        """Vector of unknowns (count,) with the given centre of mass and inertia, and all errors 0.

        In order: centre of mass (3) [m], six numbers for the inertia (`log_cholesky`), then the errors common
        to several strikes, such as those of gravity and of an edge's place.

        Args:
            com: (3,) centre of mass [m], in the object frame O.
            inertia: (3, 3) inertia tensor about the centre of mass per kilogram [m^2].
        """
        return np.concatenate([com, log_cholesky(inertia), np.zeros(self.count - SECOND.stop)])

    def residual(self, x: Array) -> Array:
        """Modelled minus measured balance angle (strikes,) [rad], in [-pi, pi), at the unknowns `x`.

        `x` (count,) holds centre of mass [m], second moments and errors, as the class describes it.
        """
        forward, height, _ = self._arms(x)
        angles = np.arctan2(-forward, height) + self._lean - self._phi + self._turn @ x
        return np.remainder(angles + np.pi, 2 * np.pi) - np.pi

    def design(self, x: Array) -> Array:
        """Derivative (strikes, count) of the balance angles [rad] by the unknowns, at unknowns `x` (count,).

        `count` is the number of unknowns: centre of mass c [m], second moments and errors. The derivative by
        c is n / R [rad/m], with n the unit normal of the plane through c and the pivot's centre line, R the
        distance of c from that line.
        """
        forward, height, R = self._arms(x)
        # Eq. (4) at the phi of the present c.
        normals = (-self._forward * (height / R)[:, None] + self._up * (forward / R)[:, None]) / R[:, None]
        return self._rows(normals) + self._turn

    def lean(self, x: Array) -> Array:
        """Lean (strikes,) [rad] of the vertical from the table's normal in the direction of each tip.

        It is the prior's mean plus the lean errors among the unknowns `x` (count,).
        """
        terms = [self.tilt_terms(plane.level) for plane in self.planes]
        return self._lean + np.array([self._turn[i, where] @ x[where] for i, where in enumerate(terms)])

    def distances(self, x: Array) -> Array:
        """Distances R (strikes,) [m] of the centre of mass from each strike's pivot line.

        The pivot line is the centre line of the edge's rounding. R is at least `MIN_DISTANCE`. `x` (count,)
        holds the model's unknowns: centre of mass [m], second moments, shared errors.
        """
        return self._arms(x)[2]

    def distance_design(self, x: Array) -> Array:
        """Derivative (strikes, count) of the distances [m] of the centre of mass from the pivot lines.

        A pivot line is the centre line of an edge's rounding. The derivative is by the model's unknowns
        (centre of mass [m], second moments, shared errors), at their values `x` (count,).
        """
        forward, height, R = self._arms(x)
        return self._rows((self._forward * forward[:, None] + self._up * height[:, None]) / R[:, None])

    def about_com(self, x: Array) -> tuple[Array, Array]:
        """Moments of inertia per kilogram [m^2] about axes through c parallel to the pivots; derivatives.

        c is the centre of mass. The moments (strikes,) are l.J.l, with J the inertia tensor per kilogram
        about c and l a pivot's unit direction; the derivatives (strikes, count) are by the unknowns `x`.
        """
        J, by = unit_inertia(x[SECOND])
        rows = np.zeros((len(self.planes), self.count))
        rows[:, SECOND] = np.einsum("si,nij,sj->sn", self._along, by, self._along)
        return np.einsum("si,ij,sj->s", self._along, J, self._along), rows

    def about_edge(self, x: Array) -> tuple[Array, Array]:
        """Moment of inertia per kilogram (strikes,) [m^2] about the contact line, l.J.l + (R + rho)^2.

        J is the inertia per kilogram about the centre of mass, l the pivot's unit direction, rho the edge's
        radius, R the distance of the centre of mass from the centre line of the edge's rounding. Returned as
        a pair with its derivative (strikes, count) by the unknowns `x`.
        """
        return self._about_edge(x, self.distance_design(x))

    def _about_edge(self, x: Array, by_distance: Array) -> tuple[Array, Array]:
        """`about_edge` at the unknowns `x`, where the distances' derivative `by_distance` is known."""
        about_com, by_second = self.about_com(x)
        lever = self.distances(x) + self._radius + self._radius_error @ x
        return about_com + lever**2, by_second + 2 * lever[:, None] * (by_distance + self._radius_error)

    def log_k(self, x: Array) -> tuple[Array, Array]:
        """Modelled ln k (strikes,), with k the rate constant in rad/s^2, and its derivative (strikes, count).

        k = m g R / I_edge with m the mass, g gravity, R the distance of the centre of mass from the centre
        line of the edge's rounding, and I_edge the moment of inertia about the line of contact with the
        table. The derivative is by the unknowns `x` (count,).
        """
        R, by_distance = self.distances(x), self.distance_design(x)
        about_edge, by = self._about_edge(x, by_distance)
        rows = by_distance / R[:, None] - by / about_edge[:, None] + self._k_error
        return self._log_g + np.log(R / about_edge) + self._k_error @ x, rows

    def _arms(self, x: Array) -> tuple[Array, Array, Array]:
        """Arm from pivot line to centre of mass: forward, upward component, length R, each (strikes,) [m].

        Forward is the horizontal direction of the tip at rest. The pivot line is the centre line of the
        edge's rounding, shifted by the errors of scale, radius and place in the unknowns `x` (count,). R is
        at least `MIN_DISTANCE`. The arms at the latest `x` are kept: a step asks for them five times.
        """
        key = x.tobytes()
        if key != self._latest[0]:
            arm = x[COM] - self._point - self._shift @ x
            forward, height = np.sum(arm * self._forward, axis=1), np.sum(arm * self._up, axis=1)
            self._latest = key, (forward, height, np.maximum(np.hypot(forward, height), MIN_DISTANCE))
        return self._latest[1]

    def _rows(self, across: Array) -> Array:
        """Derivative (strikes, count) of one component of each strike's arm [m] by the unknowns `x` (count,).

        The arm leads from the strike's pivot line to the centre of mass. The component is that along `across`
        (strikes, 3), one direction per strike, taken as constant.
        """
        rows = -np.einsum("si,sic->sc", across, self._shift)
        rows[:, COM] = across
        return rows


def radius_sds(plane: EquiPlane, systematic: SystematicErrors) -> tuple[float, float, float]:
    """Standard deviations [m] of the three independent errors of a rounded edge's radius.

    They are the error that all edges share, the one that all edges of its resting face share, and its own.

    Args:
        plane: plane of a strike over the edge, with the prior of its radius, if it has one of its own.
        systematic: errors of edges without a prior of their own.
    """
    prior = plane.radius_prior
    if prior is not None:
        return prior.common_sd, prior.face_sd, prior.own_sd
    return systematic.edge_radius_sd, 0.0, OWN_RADIUS_FRACTION * systematic.edge_radius_sd


def centre_line_shift(plane: EquiPlane) -> Array:
    """Displacement (3,) of the centre line of an edge's rounding per metre of its radius, in the frame O.

    The rounding touches the resting face and the side face, so that a larger one has its centre line higher
    and farther back. One that is part of the shape starts where the resting face ends: its centre line only
    rises.
    """
    up = plane.base_up
    return _centre_line_shift(plane, np.cross(plane.direction, up), up)


def _centre_line_shift(plane: EquiPlane, forward: Array, up: Array) -> Array:
    """`centre_line_shift` where the unit vectors `forward` and `up` (3,) along the resting face are known."""
    if plane.radius_prior is not None and plane.radius_prior.source is RadiusSource.SHAPE:
        return up
    return up - forward * (1 + np.sin(plane.wall_lean)) / np.cos(plane.wall_lean)


def _faces(plane: EquiPlane) -> list[tuple[str, str]]:
    """Keys of the resting face and, if known, of the side face at a pivot edge, in this order.

    Each face has one error of its place in the model. A key is (id of the face, ""), or ("", id of the pivot
    axis) if the resting face is not known: a pair, so that the two kinds of id cannot be confused.
    """
    rest = (plane.face, "") if plane.face else ("", plane.axis_id)
    return [rest, (plane.wall, "")] if plane.wall else [rest]
