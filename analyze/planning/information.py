"""Fisher information of strikes about centre of mass and inertia (method 1.6, 4, 5).

Every strike gives the balance angle phi and ln k, k the rate constant of the tip. Both are linear in small
changes of the unknowns, which are in units of their prior 1 sigma: centre of mass, inertia about it, and the
errors that strikes share. Errors of one axis are integrated out, so that repeats do not average them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from analyze.planning.pivots import PivotAxis, Swing
from analyze.types import TENSOR_ENTRIES, Array

COM = slice(0, 3)
"""Indices of c among the shared unknowns."""
INERTIA = slice(3, 9)
"""Indices of the six entries of the inertia about c."""
MASS, GRAVITY, TILT, SCALE, RADIUS = range(9, 14)
"""Indices of the shared errors."""
SHARED_COUNT = 14
"""Number of shared unknowns."""
AXIS_COUNT = 4
"""Number of unknowns of an axis: its line's place towards the tip and upwards, an angle, a part of k.

Each further heading of the axis has one more angle."""
ANGLE = 2
"""Index of the angle among an axis's unknowns."""
SOURCES = {
    "mass": (MASS,),
    "gravity": (GRAVITY,),
    "tilt of gravity": (TILT,),
    "scale of the shape": (SCALE,),
    "radius of the edges": (RADIUS,),
}
"""Names of the shared error sources, with the indices of their unknowns."""


@dataclass(frozen=True)
class SharedErrors:
    """Standard deviations of errors that the fits do not show; most are common to several strikes.

    Some are common to all strikes, those named `axis_...` to the strikes on one axis (pivot edge), and
    `strike_angle` is one strike's own. The estimation has the same in `SystematicErrors` and `Scale`. phi is
    the balance angle, k the rate constant of a tip, theta'' = -k sin(phi - theta), theta the tipping angle.
    """

    tilt: float = float(np.radians(0.2))
    """1 sigma of gravity's tilt from the table's normal [rad]."""
    scale: float = 0.0
    """Relative 1 sigma of the shape's scale."""
    edge_radius: float = 0.0
    """1 sigma of the edges' radius [m]."""
    mass: float = 0.002
    """Relative 1 sigma of the mass."""
    gravity: float = 5e-4
    """Relative 1 sigma of gravity."""
    axis_angle: float = 2e-4
    """1 sigma [rad] of the angle error common to the strikes on one axis: resting face, lens."""
    strike_angle: float = 5e-4
    """1 sigma [rad] of phi from strike to strike beyond the fit's: slip of the edge."""
    axis_k: float = 2e-3
    """Relative 1 sigma of k common to the strikes on one axis: air, play of the edge."""


@dataclass(frozen=True)
class Candidate:
    """A pivot axis with its expected swing (parameters of the tip) and the noise of one strike.

    The noise is the covariance of the measured balance angle phi and of ln k, k the rate constant of the tip.
    """

    axis: PivotAxis
    """Pivot axis, the edge about which the object tips."""
    expected: Swing
    """Swing about it for the expected centre of mass."""
    noise: Array
    """(2, 2) covariance of phi [rad] and ln k from one strike."""
    heading: float = 0.0
    """Turn [rad] of object and striker about the vertical for the strikes to be planned."""

    @property
    def normal(self) -> Array:
        """Unit normal (3,), in the object frame, of the plane through edge and centre of mass (equi-plane).

        It is cos(phi) t + sin(phi) u, with t the unit direction of the tip and u the upward unit direction,
        both at rest, and phi the expected balance angle, at which the centre of mass stands above the edge.
        """
        return np.cos(self.expected.phi) * self.axis.tip + np.sin(self.expected.phi) * self.axis.plane.up


@dataclass(frozen=True)
class Belief:
    """Knowledge before the planned strikes: prior of centre of mass c and inertia, and strikes made.

    Of c only the standard deviation is held: its expected place is the one for which the tips of the
    candidates (axes that can be struck) were predicted.
    """

    com_sd: float
    """1 sigma of c in every direction [m]: c lies in the shape."""
    inertia: Array
    """(3, 3) expected inertia about c [kg m^2], in the object frame."""
    inertia_sd: float
    """1 sigma of the moment about any direction [kg m^2]."""
    made: Mapping[str, Mapping[float, Array]] = field(default_factory=dict[str, Mapping[float, Array]])
    """Inverse covariance (2, 2) of balance angle phi and ln k (k the tip's rate constant) from all strikes
    made, by axis id and heading [rad]."""
    struck: tuple[Candidate, ...] = ()
    """Axes of the strikes made."""


@dataclass(frozen=True)
class Information:
    """Measurement problem of one object, linearised: information of strikes about shared unknowns.

    The information is Fisher information. The 14 shared unknowns are the centre of mass c (3), the inertia
    about c (6 entries), and the relative errors of mass and gravity, gravity's tilt, the shape's relative
    scale error and the edges' radius error. Each axis (pivot edge) has unknowns of its own. A strike measures
    the balance angle phi and ln k, k the rate constant of the tip.
    """

    candidates: tuple[Candidate, ...]
    """Axes that can be struck."""
    belief: Belief
    """Priors and strikes made."""
    errors: SharedErrors
    """Errors that strikes share."""

    @cached_property
    def units(self) -> Array:
        """Prior 1 sigma (14,) of the shared unknowns, in their order.

        They are centre of mass c [m] (3), inertia about c [kg m^2] (6: three diagonal, then three other
        entries), mass and gravity (relative), gravity's tilt [rad], the shape's scale (relative), the edges'
        radius [m].
        """
        e, i = self.errors, self.belief.inertia_sd
        # Off-diagonal entries have 1/sqrt 2, so that the moment about every direction is equally uncertain.
        return np.array(
            [
                *[self.belief.com_sd] * 3,
                *[i] * 3,
                *[i / np.sqrt(2)] * 3,
                e.mass,
                e.gravity,
                e.tilt,
                e.scale,
                e.edge_radius,
            ]
        )

    @cached_property
    def _rows(self) -> dict[int, tuple[Candidate, Array, Array, Array]]:
        """Cache of derivatives of balance angle and ln k (rate constant), by `id` of the candidate axis.

        An entry holds the candidate and the three results of `_linearised`: derivatives by the unknowns that
        all strikes share (2, 14) and by the axis's own (2, 4), both in units of their prior 1 sigma, and the
        inverse covariance (2, 2) of one strike.
        """
        return {}

    @cached_property
    def _axis_information(self) -> dict[tuple[int, int], tuple[Candidate, Array]]:
        """Cache of the Fisher information (14, 14) of strikes on one axis about the 14 shared unknowns.

        These are centre of mass (3), inertia about it (6), mass, gravity, tilt, scale and edge radius, which
        strikes on all axes have in common. The key is `id` of the candidate axis and number of strikes; an
        entry holds the candidate and the information. It is filled by `axis_information`.
        """
        return {}

    def _linearised(self, each: Candidate) -> tuple[Array, Array, Array]:
        """Derivatives of what a strike on axis `each` measures: balance angle phi [rad] and ln k.

        k is the rate constant of the tip, theta'' = -k sin(phi - theta). The unknowns are in units of their
        prior 1 sigma.

        Returns:
            Derivatives (2, 14) by the unknowns that all strikes share (centre of mass, inertia, errors), in
            the order of `units`, and (2, 4) by those of the axis: its line's place towards the tip and
            upwards, an angle error, an error of ln k. Third, the inverse covariance (2, 2) of phi and ln k
            from one strike. They are cached.
        """
        if id(each) not in self._rows:
            noise = each.noise + np.diag([self.errors.strike_angle**2, 0.0])
            self._rows[id(each)] = (
                each,
                *self._derivatives(each),
                np.asarray(np.linalg.inv(noise), dtype=np.float64),
            )
        return self._rows[id(each)][1:]

    def _derivatives(self, each: Candidate) -> tuple[Array, Array]:
        e, axis, swing = self.errors, each.axis, each.expected
        R, rho, phi = swing.distance, axis.radius, swing.phi
        across = -each.normal / R
        outwards = -np.sin(phi) * axis.tip + np.cos(phi) * axis.plane.up
        m, i_edge = swing.mass, swing.i_edge
        # d ln k = dm/m + dg/g + dR/R - dI_edge/I_edge; I_edge = l.I.l + m*(R + rho)^2.
        by_R = 1 / R - 2 * m * (R + rho) / i_edge
        shared = np.zeros((2, SHARED_COUNT))
        shared[0, COM], shared[1, COM] = across, by_R * outwards
        shared[1, INERTIA] = -moment_row(axis.direction) / i_edge
        shared[1, MASS] = 1 - m * (R + rho) ** 2 / i_edge
        shared[1, GRAVITY] = 1.0
        shared[0, TILT] = np.cos(each.heading)
        shared[:, SCALE] = -(shared[:, COM] @ axis.point)
        if not axis.moulded:
            # A larger radius moves the centre line inwards: up and away from the tip.
            shared[:, RADIUS] = -(shared[:, COM] @ (axis.plane.up - axis.tip))
            shared[1, RADIUS] -= 2 * m * (R + rho) / i_edge
        shared[:, RADIUS] *= 1.0 if axis.radius_sd is None else axis.radius_sd / e.edge_radius
        own = np.zeros((2, AXIS_COUNT))
        own[:, 0] = -(shared[:, COM] @ axis.tip) * axis.sd
        own[:, 1] = -(shared[:, COM] @ axis.plane.up) * axis.sd
        own[0, 2], own[1, 3] = np.hypot(e.axis_angle, axis.turn_sd), e.axis_k
        return shared * self.units, own

    def weight(self, each: Candidate, strikes: int) -> Array:
        """Inverse covariance (2, 2) of phi [rad] and ln k from strikes on one axis, made and planned.

        phi is the balance angle, k the rate constant [rad/s^2] of the tip theta'' = -k sin(phi - theta). Of
        the strikes made, those at the axis's heading (turn of object and striker about the vertical) count.

        Args:
            each: the axis.
            strikes: number of planned strikes, added to those made.
        """
        return strikes * self._linearised(each)[2] + self.belief.made.get(each.axis.id, {}).get(
            each.heading, np.zeros((2, 2))
        )

    def measurements(self, each: Candidate, strikes: int) -> tuple[Array, Array, Array]:
        """Linear model of the measurements of strikes on one axis, at each of its h headings.

        A heading is the turn [rad] of object and striker about the vertical; that of the axis always counts.
        Included are the strikes made before, and `strikes` more at the axis's heading. The table's tilt
        towards the world's +x changes phi at heading a by cos a of what it does at heading 0. At a further
        heading the camera sees another tag, which has its own angle error.

        Args:
            each: Axis, with its expected swing and the noise of one strike.
            strikes: Number of further strikes on it.

        Returns:
            Derivatives (2h, 14) by the shared unknowns: centre of mass (3), inertia (6), and the errors of
            mass, gravity, gravity's tilt, shape scale and edge radius; derivatives (2h, 3 + h) by those of
            the axis: its line's place towards the tip and upwards, an angle error, an error of ln k, and one
            more angle error for each further heading; and the inverse covariance (2h, 2h) of the rows. All
            unknowns are in units of their prior 1 sigma. Rows are phi (balance angle, rad) and ln k (k the
            tip's rate constant) of each heading, the axis's own first.
        """
        shared, own, _ = self._linearised(each)
        turned = [
            (heading, made)
            for heading, made in self.belief.made.get(each.axis.id, {}).items()
            if heading != each.heading
        ]
        many = 1 + len(turned)
        all_shared, all_own = np.tile(shared, (many, 1)), np.zeros((2 * many, AXIS_COUNT + many - 1))
        all_own[:, :AXIS_COUNT] = np.tile(own, (many, 1))
        weight = np.zeros((2 * many, 2 * many))
        weight[:2, :2] = self.weight(each, strikes)
        for i, (heading, made) in enumerate(turned, start=1):
            phi = 2 * i
            all_shared[phi, TILT] = np.cos(heading) * self.units[TILT]
            all_own[phi, AXIS_COUNT + i - 1], all_own[phi, ANGLE] = all_own[phi, ANGLE], 0.0
            weight[phi : phi + 2, phi : phi + 2] = made
        return all_shared, all_own, weight

    def axis_information(self, each: Candidate, strikes: int) -> Array:
        """Fisher information (14, 14) of strikes on one axis about the shared unknowns.

        Shared are centre of mass (3), inertia (6), and the errors of mass, gravity, gravity's tilt, the
        shape's scale and the edges' radius, in units of their prior 1 sigma. The information covers the
        strikes made before on the axis `each`, and `strikes` more at its heading (turn of object and striker
        about the vertical). The axis's own unknowns (its line's place, angle errors, an error of
        ln k, with k the tip's rate constant) are integrated out. The result is cached.
        """
        asked = (id(each), strikes)
        if asked not in self._axis_information:
            self._axis_information[asked] = (each, self._marginal(each, strikes))
        return self._axis_information[asked][1]

    def _marginal(self, each: Candidate, strikes: int) -> Array:
        shared, own, weight = self.measurements(each, strikes)
        if each.axis.turn_sd > 0:
            # A scanned face's slope errs by degrees: Woodbury's difference would be lost in rounding.
            values, vectors = np.linalg.eigh(weight)
            root = np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T
            errors = np.eye(len(weight)) + root @ own @ own.T @ root.T
            return np.asarray(shared.T @ root.T @ np.linalg.solve(errors, root @ shared), dtype=np.float64)
        # (W^-1 + B B^T)^-1 by Woodbury, for W that may be singular (no k).
        inner = np.linalg.inv(np.eye(own.shape[1]) + own.T @ weight @ own)
        marginal = weight - weight @ own @ inner @ own.T @ weight
        return np.asarray(shared.T @ marginal @ shared, dtype=np.float64)

    def before(self, leave_out: Sequence[str] = ()) -> Array:
        """Fisher information (14, 14) before the planned strikes: of the priors and of the strikes made.

        Strikes on axes in `leave_out` (ids) do not count. The 14 unknowns, shared by all strikes, are centre
        of mass (3), inertia about it (6), and the errors of mass, gravity, tilt of gravity, the shape's scale
        and edge radius, in this order. Each is in units of its prior 1 sigma, so the priors alone give the
        unit matrix.
        """
        known = [
            self.axis_information(each, 0) for each in self.belief.struck if each.axis.id not in leave_out
        ]
        return np.asarray(sum(known, np.eye(SHARED_COUNT)), dtype=np.float64)

    def covariance(self, chosen: Sequence[Candidate], repeats: Sequence[int]) -> Array:
        """Covariance (14, 14) of the shared unknowns, in SI units, after the strikes made and further ones.

        Shared are centre of mass [m] (3), inertia about it [kg m^2] (6), and the errors of mass and gravity
        (relative), tilt of gravity [rad], the shape's scale (relative) and edge radius [m], in this order.

        Args:
            chosen: Axes of the further strikes.
            repeats: Number of strikes on each of `chosen`.
        """
        total = self.before([each.axis.id for each in chosen])
        for each, many in zip(chosen, repeats, strict=True):
            total = total + self.axis_information(each, many)
        units = self.units
        return np.linalg.inv(total) * np.outer(units, units)

    def sources(self, chosen: Sequence[Candidate], repeats: Sequence[int]) -> dict[str, float]:
        """Rms error [m] of the 3-D position of the centre of mass c from each error source, by its name.

        The squares add up to the square of the whole rms error. Sources are those of `SOURCES`, "place of the
        edges", "angle error of an axis" and, for the remainder, "noise of the angles": the strikes' noise,
        the axes' errors of ln k (k is the rate constant m g R / I_edge of the tip), and the priors of c and
        the inertia.

        Args:
            chosen: Axes of further strikes.
            repeats: Number of further strikes on each of `chosen`; the strikes made count too.
        """
        here = {each.axis.id for each in chosen}
        axes = [*chosen, *(each for each in self.belief.struck if each.axis.id not in here)]
        many = [*repeats, *[0] * (len(axes) - len(chosen))]
        known = [self.measurements(each, strikes) for each, strikes in zip(axes, many, strict=True)]
        count = SHARED_COUNT + sum(own.shape[1] for _, own, _ in known)
        information, first = np.eye(count), SHARED_COUNT
        place, angle = np.zeros(count, dtype=bool), np.zeros(count, dtype=bool)
        for shared, own, weight in known:
            last = first + own.shape[1]
            rows = np.zeros((len(shared), count))
            rows[:, :SHARED_COUNT], rows[:, first:last] = shared, own
            information += rows.T @ weight @ rows
            place[first : first + ANGLE] = angle[first + ANGLE] = True
            angle[first + AXIS_COUNT : last] = True
            first = last
        P = np.linalg.inv(information)
        gain = P[COM] * self.belief.com_sd
        # Each prior has unit variance and causes P[c, i]^2; the remainder is mainly the strikes' noise.
        caused = np.sum(gain**2, axis=0)
        total = float(np.trace(P[COM, COM])) * self.belief.com_sd**2
        parts = {name: float(sum(caused[i] for i in which)) for name, which in SOURCES.items()}
        parts["place of the edges"] = float(caused[place].sum())
        parts["angle error of an axis"] = float(caused[angle].sum())
        parts["noise of the angles"] = max(total - sum(parts.values()), 0.0)
        return {name: float(np.sqrt(value)) for name, value in parts.items()}


def moment_row(direction: Array) -> Array:
    """Row (6,) that gives the moment l.I.l of an inertia tensor I about the unit `direction` l (3,).

    It multiplies the tensor's entries in the order of `TENSOR_ENTRIES`: xx, yy, zz, xy, xz, yz.
    """
    return np.array([direction[i] * direction[j] * (1 if i == j else 2) for i, j in TENSOR_ENTRIES])


def normal_spread(normals: Array) -> float:
    """Measure of how well n planes fix a common point: 0 if they leave a direction of it unknown.

    It is the smallest singular value of the planes' unit normals (n, 3) over sqrt(n), at most 1/sqrt(3); 0 if
    n < 3.
    """
    if len(normals) < 3:
        return 0.0
    least = float(np.linalg.eigvalsh(normals.T @ normals)[0])
    return float(np.sqrt(max(least, 0.0) / len(normals)))


def unknown_direction(normals: Array) -> Array:
    """Unit vector (3,) along which the common point of n planes is least well determined by them.

    `normals` are the planes' unit normals (n, 3); the vector is in their frame. Its largest component is
    positive, and components below 1e-6 are 0.
    """
    _, _, vt = np.linalg.svd(np.vstack([np.zeros((3, 3)), normals]))
    worst = vt[2]
    worst = worst * np.sign(worst[int(np.argmax(np.abs(worst)))])
    return np.where(np.abs(worst) < 1e-6, 0.0, worst)
