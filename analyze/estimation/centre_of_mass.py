"""Centre of mass from equi-planes: weighted least squares with shared systematic errors (METHOD: "ours")."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from analyze.errors import EstimationError
from analyze.estimation.equiplane import plumb
from analyze.types import Array, CentreOfMass, EquiPlane, TableTilt

ITERATIONS = 60
CONVERGED = 1e-11
"""m, and sd of shared errors"""
TURNING_POINT = 2.5
"""standard deviations from which a strike is taken for an outlier and loses weight"""
UNOBSERVED_FRACTION = 0.15
"""a direction whose sd is above this part of the prior's was not measured"""
SMALLEST_DISTANCE = 1e-3
GLOBAL_TERMS = 4
AXIS_TERMS = 3
LEVEL_TERMS = 2
RADIUS_TERM = 6


@dataclass(frozen=True)
class TiltPrior:
    """How far the vertical leans from the table's normal, towards W's x and y, before any strike [rad]; 1 sigma each."""

    lean: tuple[float, float]
    sd: tuple[float, float]


@dataclass(frozen=True)
class SystematicErrors:
    """Errors that several strikes share, 1 sigma each. What repeats cannot average out."""

    gravity_tilt_sd: float
    """rad, of the vertical's lean from the table's normal towards W's x and y; all strikes on one levelling"""
    scale_sd: float = 0.0
    """relative, of the shape; all strikes"""
    edge_radius_sd: float = 0.0
    """m, of the edges' rounding; all strikes"""
    axis_angle_sd: float = 2e-4
    """rad, angle error common to the strikes on one axis (resting face, lens, slip of the edge)"""
    strike_angle_sd: float = 5e-4
    """rad, scatter of phi from strike to strike beyond what the fit of one motion can know (slip of the edge)"""
    other_tilt_sds: tuple[float, ...] = ()
    """rad, the same as `gravity_tilt_sd` of levellings 1, 2, ... (EquiPlane.level): each table has a tilt of its own"""
    readings: tuple[TiltPrior | None, ...] = ()
    """of levellings 0, 1, ...: what a level showed; None, or none: 0 within the sd above"""

    def tilts(self) -> list[TiltPrior]:
        """Of every levelling."""
        plain = [TiltPrior((0.0, 0.0), (sd, sd)) for sd in (self.gravity_tilt_sd, *self.other_tilt_sds)]
        read = [*self.readings, *[None] * (len(plain) - len(self.readings))]
        return [prior if reading is None else reading for prior, reading in zip(plain, read, strict=True)]


@dataclass(frozen=True)
class ComPrior:
    """Where c lies before any strike: inside the shape."""

    mean: Array
    """(3,) m"""
    sd: Array
    """(3,) m"""

    @staticmethod
    def from_bounds(lower: Array, upper: Array) -> ComPrior:
        """Centre of the bounding box, half its edges as 1 sigma: weak enough not to be felt by what is measured."""
        return ComPrior((np.asarray(lower) + upper) / 2, (np.asarray(upper) - lower) / 2)


def centre_of_mass(planes: Sequence[EquiPlane], systematic: SystematicErrors, prior: ComPrior) -> CentreOfMass:
    """The point nearest all equi-planes, n_j.(c - p_j) = 0, and how well it is known.

    Beside c the shared errors are unknowns with priors: the lean of the vertical towards W's x and y, the shape's scale, the edges'
    radius, and per axis the edge's place (two directions across itself) and, per heading, an angle; every levelling of the table has its
    own lean. So repeats of one axis average their own scatter only. A tip at heading h feels lean . (cos h, sin h): strikes of one edge
    at two headings, best 180 deg apart, tell the lean from everything else (half the difference of their phi). Residuals are angles,
    n_j.(c - p_j) / R_j at the measured phi_j, so that weights follow R_j and no c is favoured for being near an edge. A strike far off
    all others loses weight (Huber 1964, with redescending weights). If the strikes scatter more than they should, all random parts are
    widened (Birge 1932).

    Args:
        planes: one per strike, in O.
        systematic: shared errors.
        prior: used where strikes do not tell.

    Raises:
        EstimationError: no plane.
    """
    if not planes:
        raise EstimationError("no good strike: strike again, or lower the number of excluded strikes")
    terms = Terms(planes, systematic)
    precision = np.diag(np.concatenate([1 / prior.sd**2, np.ones(terms.count - 3)]))
    start = np.concatenate([prior.mean, np.zeros(terms.count - 3)])
    sd = np.hypot([plane.sd_phi for plane in planes], systematic.strike_angle_sd)
    weight = _weights_among_repeats(planes, sd)
    solution = start
    for _ in range(ITERATIONS):
        before = solution
        solution = _step(terms, precision, start, solution, weight / sd**2)
        residual, design = terms.residual(solution), terms.design(solution)
        z = residual / sd
        freedom = len(planes) - _effective(precision, design, weight / sd**2)
        spread = max(1.0, 1.4826 * float(np.median(np.abs(z))) * np.sqrt(len(planes) / max(freedom, 1.0)))
        weight = np.minimum(1.0, (TURNING_POINT * spread / np.maximum(np.abs(z), 1e-9)) ** 2)
        if float(np.abs(solution - before).max()) < CONVERGED:
            break
    residual, design = terms.residual(solution), terms.design(solution)
    freedom = float(weight.sum()) - _effective(precision, design, weight / sd**2)
    birge = max(1.0, float(np.sum(weight * (residual / sd) ** 2)) / freedom) if freedom >= 1.0 else 1.0
    covariance: Array = np.linalg.inv(precision + design.T @ (design * (weight / sd**2 / birge)[:, None])).astype(np.float64)
    return _result(terms, solution, covariance, weight, sd, prior, systematic.edge_radius_sd)


def _step(terms: Terms, precision: Array, start: Array, solution: Array, weight: Array) -> Array:
    """One Gauss-Newton step (Levenberg's cure: halved until the misfit falls)."""

    def misfit(x: Array) -> float:
        return float(weight @ terms.residual(x) ** 2 + (x - start) @ precision @ (x - start))

    design = terms.design(solution)
    gradient = design.T @ (weight * terms.residual(solution)) + precision @ (solution - start)
    step = -np.linalg.solve(precision + design.T @ (design * weight[:, None]), gradient)
    before = misfit(solution)
    for _ in range(12):
        if misfit(solution + step) <= before:
            return solution + step
        step = step / 2
    return solution


def _effective(precision: Array, design: Array, weight: Array) -> float:
    """Number of parameters that the data determine: trace of the hat matrix."""
    information = design.T @ (design * weight[:, None])
    return float(np.trace(np.linalg.solve(precision + information, information)))


class Terms:
    """The unknowns: c (3) [m], then the shared errors, each in units of its sd.

    They are the vertical's lean towards W's x and y, scale, radius, three per axis, two of lean for each further levelling, and an angle
    for each further heading of an axis (the camera sees another side).
    """

    def __init__(self, planes: Sequence[EquiPlane], systematic: SystematicErrors) -> None:
        axes = sorted({plane.axis_id for plane in planes})
        self.planes = planes
        levels = 3 + GLOBAL_TERMS + AXIS_TERMS * len(axes)
        self._further_levels = levels
        self.tilts = systematic.tilts()
        further = levels + LEVEL_TERMS * (len(self.tilts) - 1)
        angles: dict[tuple[str, float], int] = {}
        for plane in planes:
            key = (plane.axis_id, plane.heading)
            if key not in angles:
                first_seen = all(axis != plane.axis_id for axis, _ in angles)
                angles[key] = 3 + GLOBAL_TERMS + AXIS_TERMS * axes.index(plane.axis_id) + 2 if first_seen else further
                further += not first_seen
        self.count = further
        self._point = np.array([plane.point for plane in planes])
        self._up = np.array([plane.up for plane in planes])
        self._forward = np.array([np.cross(plane.direction, plane.up) for plane in planes])
        self._phi = np.array([plane.phi for plane in planes])
        self._shift = np.zeros((len(planes), 3, self.count))
        self._turn = np.zeros((len(planes), self.count))
        self._lean = np.zeros(len(planes))
        for i, plane in enumerate(planes):
            forward = self._forward[i]
            first = 3 + GLOBAL_TERMS + AXIS_TERMS * axes.index(plane.axis_id)
            self._shift[i, :, 5] = plane.point * systematic.scale_sd
            # A larger radius moves the centre line inwards: up and away from the tip.
            self._shift[i, :, RADIUS_TERM] = (plane.up - forward) * systematic.edge_radius_sd
            self._shift[i, :, first] = forward * plane.edge_sd
            self._shift[i, :, first + 1] = plane.up * plane.edge_sd
            tilt, towards = self.tilts[plane.level], np.array([np.cos(plane.heading), np.sin(plane.heading)])
            self._lean[i] = towards @ tilt.lean
            self._turn[i, self.tilt_terms(plane.level)] = towards * tilt.sd
            self._turn[i, angles[plane.axis_id, plane.heading]] = systematic.axis_angle_sd

    def tilt_terms(self, level: int) -> slice:
        """Where a levelling's two terms of lean stand."""
        start = 3 if level == 0 else self._further_levels + LEVEL_TERMS * (level - 1)
        return slice(start, start + LEVEL_TERMS)

    def residual(self, x: Array) -> Array:
        """(strikes,) rad: the angle at which c would stand above the line, plus the vertical's lean, minus the measured phi."""
        forward, height = self._across(x)
        angles = np.arctan2(-forward, height) + self._lean - self._phi + self._turn @ x
        return np.remainder(angles + np.pi, 2 * np.pi) - np.pi

    def lean(self, x: Array) -> Array:
        """(strikes,) rad: the vertical's lean the way each of them tipped."""
        found = [self._turn[i, where] @ x[where] for i, where in enumerate(self.tilt_terms(plane.level) for plane in self.planes)]
        return self._lean + np.array(found)

    def distances(self, x: Array) -> Array:
        """(strikes,) R [m]."""
        return np.maximum(np.hypot(*self._across(x)), SMALLEST_DISTANCE)

    def design(self, x: Array) -> Array:
        """Derivative (strikes, count) of `residual`: n/R across c and the shifts."""
        forward, height = self._across(x)
        R = self.distances(x)
        # Eq. (4) at the phi of the present c.
        normals = (-self._forward * (height / R)[:, None] + self._up * (forward / R)[:, None]) / R[:, None]
        return self._rows(normals) + self._turn

    def distance_design(self, x: Array) -> Array:
        """Derivative (strikes, count) of R."""
        forward, height = self._across(x)
        R = self.distances(x)
        return self._rows((self._forward * forward[:, None] + self._up * height[:, None]) / R[:, None])

    def _across(self, x: Array) -> tuple[Array, Array]:
        """Components (strikes,) of the arm from the shifted centre line to c: forward and up [m]."""
        arm = x[:3] - self._point - self._shift @ x
        return np.sum(arm * self._forward, axis=1), np.sum(arm * self._up, axis=1)

    def _rows(self, across: Array) -> Array:
        rows = -np.einsum("si,sic->sc", across, self._shift)
        rows[:, :3] = across
        return rows


def _result(terms: Terms, solution: Array, covariance: Array, weight: Array, sd: Array, prior: ComPrior, radius_sd: float) -> CentreOfMass:
    position = solution[:3]
    information = covariance[:3, :3] / np.outer(prior.sd, prior.sd)
    values, vectors = np.linalg.eigh((information + information.T) / 2)
    observed = bool(np.sqrt(values[-1]) < UNOBSERVED_FRACTION)
    worst = vectors[:, -1] * prior.sd
    worst = worst / np.linalg.norm(worst)
    worst = worst * np.sign(worst[np.argmax(np.abs(worst))])
    distances = terms.distances(solution)
    arms = terms.distance_design(solution)
    relative = weight / (distances * sd) ** 2
    upright = [plumb(plane, lean) for plane, lean in zip(terms.planes, terms.lean(solution).tolist(), strict=True)]
    return CentreOfMass(
        position=position,
        covariance=covariance[:3, :3],
        observed=observed,
        unobserved_direction=None if observed else worst,
        residuals=np.array([plane.normal @ (position - plane.point) for plane in upright]),
        weights=relative / relative.sum(),
        distances=distances,
        distance_covariance=arms @ covariance @ arms.T,
        position_distance_covariance=covariance[:3] @ arms.T,
        robust=weight,
        edge_radius_variance=float(covariance[RADIUS_TERM, RADIUS_TERM]) * radius_sd**2,
        edge_radius_distance_covariance=arms @ covariance[:, RADIUS_TERM] * radius_sd,
        tilts=tuple(_tilt(terms, solution, covariance, level) for level in range(len(terms.tilts))),
        planes=tuple(upright),
    )


def _tilt(terms: Terms, solution: Array, covariance: Array, level: int) -> TableTilt:
    where, prior = terms.tilt_terms(level), terms.tilts[level]
    sd = np.array(prior.sd)
    return TableTilt(np.array(prior.lean) + sd * solution[where], covariance[where, where] * np.outer(sd, sd), sd)


def _weights_among_repeats(planes: Sequence[EquiPlane], sd: Array) -> Array:
    """First weights (strikes,): distance from the median phi of the same axis, heading and levelling, where there are at least three."""
    weight = np.ones(len(planes))
    for i, plane in enumerate(planes):
        alike = (plane.axis_id, plane.heading, plane.level)
        same = [other.phi for other in planes if (other.axis_id, other.heading, other.level) == alike]
        if len(same) >= 3:
            middle = float(np.median(same))
            spread = max(float(sd[i]), 1.4826 * float(np.median(np.abs(np.array(same) - middle))))
            weight[i] = min(1.0, (TURNING_POINT * spread / max(abs(plane.phi - middle), 1e-12)) ** 2)
    return weight
