"""What strikes tell about c and the inertia together, with the errors that they share (METHOD 1.6, rows; sections 4 and 5).

Every strike gives phi and ln k, both linear in small changes of the unknowns: c, the six entries of the inertia about c, and what the
strikes share: mass, gravity, its tilt, the shape's scale, the edges' radius. What belongs to one axis (the line's place, an angle, a part
of k) is integrated out, so that repeats never look surer than they are. All unknowns are in units of their prior 1 sigma.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from analyze.planning.pivots import PivotAxis, Swing
from analyze.types import Array

COM = slice(0, 3)
INERTIA = slice(3, 9)
MASS, GRAVITY, TILT, SCALE, RADIUS = range(9, 14)
SHARED = 14
PRIVATE = 4
"""of an axis: its line's place towards the tip and upwards, an angle, a part of k; an angle more for each further heading of it"""
ANGLE = 2
USUAL = 0.0
"""rad, heading of the strikes that are planned"""
ENTRIES = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
SOURCES = {
    "mass": (MASS,),
    "gravity": (GRAVITY,),
    "tilt of gravity": (TILT,),
    "scale of the shape": (SCALE,),
    "radius of the edges": (RADIUS,),
}


@dataclass(frozen=True)
class Errors:
    """1 sigma of what strikes share, and of what a repeat of one axis shares. As in estimation (SystematicErrors, Scale)."""

    tilt: float = float(np.radians(0.2))
    """rad, of gravity against the table's normal"""
    scale: float = 0.0
    """relative, of the shape"""
    edge_radius: float = 0.0
    """m"""
    mass: float = 0.002
    """relative"""
    gravity: float = 5e-4
    """relative"""
    axis_angle: float = 2e-4
    """rad, common to the strikes on one axis: resting face, lens"""
    strike_angle: float = 5e-4
    """rad, from strike to strike beyond the fit: slip of the edge"""
    axis_k: float = 2e-3
    """relative, common to the strikes on one axis: air, play of the edge"""


@dataclass(frozen=True)
class Candidate:
    """An axis that can be used, and what one strike on it tells."""

    axis: PivotAxis
    expected: Swing
    noise: Array
    """(2, 2) covariance of phi [rad] and ln k from one strike"""

    @property
    def normal(self) -> Array:
        """Unit normal (3,) of the expected equi-plane, in O: the tip direction turned by phi."""
        return np.cos(self.expected.phi) * self.axis.tip + np.sin(self.expected.phi) * self.axis.plane.up


@dataclass(frozen=True)
class Belief:
    """What is known before the strikes that are planned, beside c = where the candidates expect it."""

    com_sd: float
    """m, every direction alike: c lies in the shape"""
    inertia: Array
    """(3, 3) kg m^2, about c"""
    inertia_sd: float
    """kg m^2, of the moment about any direction"""
    made: Mapping[str, Mapping[float, Array]] = field(default_factory=dict[str, Mapping[float, Array]])
    """per axis that was struck already, per heading [rad] of those strikes: (2, 2) inverse covariance of phi and ln k from all of them"""
    struck: tuple[Candidate, ...] = ()
    """those axes"""


@dataclass(frozen=True)
class Information:
    """The linear problem of one object's candidates."""

    candidates: tuple[Candidate, ...]
    belief: Belief
    errors: Errors

    @cached_property
    def units(self) -> Array:
        """(14,) prior 1 sigma of the shared unknowns: m, kg m^2, then those of `Errors`."""
        e, i = self.errors, self.belief.inertia_sd
        # Off-diagonal entries have 1/sqrt 2, so that the moment about every direction is as uncertain.
        return np.array([*[self.belief.com_sd] * 3, *[i] * 3, *[i / np.sqrt(2)] * 3, e.mass, e.gravity, e.tilt, e.scale, e.edge_radius])

    @cached_property
    def _rows(self) -> dict[int, tuple[Candidate, Array, Array, Array]]:
        """Of each candidate that was asked for: itself, its `rows` and the inverse covariance (2, 2) of one strike."""
        return {}

    @cached_property
    def _of_axis(self) -> dict[tuple[int, int], tuple[Candidate, Array]]:
        """Each candidate that was asked for, and `of_axis` of it."""
        return {}

    def rows(self, each: Candidate) -> tuple[Array, Array]:
        """Derivatives (2, 14) and (2, 4) of phi and ln k by the shared and the axis's own unknowns, in units of their sd."""
        return self._told(each)[:2]

    def _told(self, each: Candidate) -> tuple[Array, Array, Array]:
        if id(each) not in self._rows:
            noise = each.noise + np.diag([self.errors.strike_angle**2, 0.0])
            self._rows[id(each)] = (each, *self._derivatives(each), np.asarray(np.linalg.inv(noise), dtype=np.float64))
        return self._rows[id(each)][1:]

    def _derivatives(self, each: Candidate) -> tuple[Array, Array]:
        e, axis, swing = self.errors, each.axis, each.expected
        R, rho, phi = swing.distance, axis.radius, swing.phi
        across = -each.normal / R
        outwards = -np.sin(phi) * axis.tip + np.cos(phi) * axis.plane.up
        m, i_edge = swing.mass, swing.i_edge
        # d ln k = dm/m + dg/g + dR/R - dI_edge/I_edge; I_edge = l.I.l + m*(R + rho)^2.
        by_R = 1 / R - 2 * m * (R + rho) / i_edge
        l = axis.direction  # noqa: E741 - the field's name
        moment = np.array([l[i] * l[j] * (1 if i == j else 2) for i, j in ENTRIES])
        shared = np.zeros((2, SHARED))
        shared[0, COM], shared[1, COM] = across, by_R * outwards
        shared[1, INERTIA] = -moment / i_edge
        shared[1, MASS] = 1 - m * (R + rho) ** 2 / i_edge
        shared[1, GRAVITY] = 1.0
        shared[0, TILT] = 1.0
        shared[:, SCALE] = -(shared[:, COM] @ axis.point)
        if not axis.moulded:
            # A larger radius moves the centre line inwards: up and away from the tip.
            shared[:, RADIUS] = -(shared[:, COM] @ (axis.plane.up - axis.tip))
            shared[1, RADIUS] -= 2 * m * (R + rho) / i_edge
        own = np.zeros((2, PRIVATE))
        own[:, 0] = -(shared[:, COM] @ axis.tip) * axis.sd
        own[:, 1] = -(shared[:, COM] @ axis.plane.up) * axis.sd
        own[0, 2], own[1, 3] = e.axis_angle, e.axis_k
        return shared * self.units, own

    def weight(self, each: Candidate, strikes: int) -> Array:
        """Inverse covariance (2, 2) of phi and ln k from `strikes` more on this axis and those made before, all at the usual heading."""
        return strikes * self._told(each)[2] + self.belief.made.get(each.axis.id, {}).get(USUAL, np.zeros((2, 2)))

    def seen(self, each: Candidate, strikes: int) -> tuple[Array, Array, Array]:
        """All that is known of an axis, `strikes` more among it, each of its h headings by itself.

        At heading a a tip feels cos a of the rise towards +x, and the camera sees another tag: the angle error is another one.

        Returns:
            Derivatives (2h, 14) and (2h, 3 + h) of phi and ln k as in `rows`, and their inverse covariance (2h, 2h).
        """
        shared, own = self.rows(each)
        turned = [(heading, made) for heading, made in self.belief.made.get(each.axis.id, {}).items() if heading != USUAL]
        many = 1 + len(turned)
        all_shared, all_own = np.tile(shared, (many, 1)), np.zeros((2 * many, PRIVATE + many - 1))
        all_own[:, :PRIVATE] = np.tile(own, (many, 1))
        weight = np.zeros((2 * many, 2 * many))
        weight[:2, :2] = self.weight(each, strikes)
        for i, (heading, made) in enumerate(turned, start=1):
            phi = 2 * i
            all_shared[phi, TILT] *= np.cos(heading)
            all_own[phi, PRIVATE + i - 1], all_own[phi, ANGLE] = all_own[phi, ANGLE], 0.0
            weight[phi : phi + 2, phi : phi + 2] = made
        return all_shared, all_own, weight

    def of_axis(self, each: Candidate, strikes: int) -> Array:
        """Information (14, 14) about the shared unknowns; the axis's own are integrated out."""
        asked = (id(each), strikes)
        if asked not in self._of_axis:
            self._of_axis[asked] = (each, self._marginal(each, strikes))
        return self._of_axis[asked][1]

    def _marginal(self, each: Candidate, strikes: int) -> Array:
        shared, own, weight = self.seen(each, strikes)
        # (W^-1 + B B^T)^-1 by Woodbury, for W that may be singular (no k).
        inner = np.linalg.inv(np.eye(own.shape[1]) + own.T @ weight @ own)
        marginal = weight - weight @ own @ inner @ own.T @ weight
        return np.asarray(shared.T @ marginal @ shared, dtype=np.float64)

    def before(self, leave_out: Sequence[str] = ()) -> Array:
        """Information (14, 14) of the priors and of the strikes made, without the axes named in `leave_out`."""
        known = [self.of_axis(each, 0) for each in self.belief.struck if each.axis.id not in leave_out]
        return np.asarray(sum(known, np.eye(SHARED)), dtype=np.float64)

    def covariance(self, chosen: Sequence[Candidate], repeats: Sequence[int]) -> Array:
        """(14, 14), in the unknowns' own units, after `repeats` strikes on each of `chosen`."""
        total = self.before([each.axis.id for each in chosen])
        for each, many in zip(chosen, repeats, strict=True):
            total = total + self.of_axis(each, many)
        units = self.units
        return np.linalg.inv(total) * np.outer(units, units)

    def sources(self, chosen: Sequence[Candidate], repeats: Sequence[int]) -> dict[str, float]:
        """Root mean square distance [m] of c from the truth that each kind of error causes; their squares add up."""
        here = {each.axis.id for each in chosen}
        axes = [*chosen, *(each for each in self.belief.struck if each.axis.id not in here)]
        many = [*repeats, *[0] * (len(axes) - len(chosen))]
        known = [self.seen(each, strikes) for each, strikes in zip(axes, many, strict=True)]
        count = SHARED + sum(own.shape[1] for _, own, _ in known)
        information, first = np.eye(count), SHARED
        place, angle = np.zeros(count, dtype=bool), np.zeros(count, dtype=bool)
        for shared, own, weight in known:
            last = first + own.shape[1]
            rows = np.zeros((len(shared), count))
            rows[:, :SHARED], rows[:, first:last] = shared, own
            information += rows.T @ weight @ rows
            place[first : first + ANGLE] = angle[first + ANGLE] = True
            angle[first + PRIVATE : last] = True
            first = last
        P = np.linalg.inv(information)
        gain = P[COM] * self.belief.com_sd
        # Each prior enters with weight 1: it causes P[c, i]^2; what is left is the strikes' own noise.
        caused = np.sum(gain**2, axis=0)
        total = float(np.trace(P[COM, COM])) * self.belief.com_sd**2
        parts = {name: float(sum(caused[i] for i in which)) for name, which in SOURCES.items()}
        parts["place of the edges"] = float(caused[place].sum())
        parts["angle error of an axis"] = float(caused[angle].sum())
        parts["noise of the angles"] = max(total - sum(parts.values()), 0.0)
        return {name: float(np.sqrt(value)) for name, value in parts.items()}


def moment_row(direction: Array) -> Array:
    """(6,) row that gives l.I.l from the tensor's entries in the order of `ENTRIES`."""
    return np.array([direction[i] * direction[j] * (1 if i == j else 2) for i, j in ENTRIES])


def spread(normals: Array) -> float:
    """Least singular value of unit normals (n, 3) over the square root of n: 0 where they leave a direction of c unknown."""
    if len(normals) < 3:
        return 0.0
    least = float(np.linalg.eigvalsh(normals.T @ normals)[0])
    return float(np.sqrt(max(least, 0.0) / len(normals)))


def unknown_direction(normals: Array) -> Array:
    """Unit vector (3,) in O along which planes with unit `normals` (n, 3) know c worst."""
    _, _, vt = np.linalg.svd(np.vstack([np.zeros((3, 3)), normals]))
    worst = vt[2]
    worst = worst * np.sign(worst[int(np.argmax(np.abs(worst)))])
    return np.where(np.abs(worst) < 1e-6, 0.0, worst)
