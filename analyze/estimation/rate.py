"""Check of the stated frame rate: the strikes' k scale with its square, and the shape bounds k.

k = m g R / I_edge [rad/s^2] is the rate constant of a tip, with m the mass, g gravity, I_edge the moment of
inertia about the edge and R the distance of the centre of mass c from it. With r the true frame rate over the
stated one, the true k is k r^2, so that for every axis

    I_edge / m = s g R / k,    s = 1 / r^2.

Any filling of the shape with the centre of mass estimated from the balance angles phi has I_edge / m = sum of
mass shares times squared distances from the edge: the smallest and the largest s for which some filling has
all moments at once is a linear programme in the shares and s (moment problems: Karlin and Studden 1966).
Parallel axes with different R share one moment about c, and then

    s = (R1^2 - R2^2) / (g (R1 / k1 - R2 / k2))

needs no filling at all; a joint estimate from all strikes, with a free rate, combines this over all axes.
"""

# scipy is only partly typed.
# pyright: reportMissingTypeStubs=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false, reportUnknownMemberType=false

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import linprog

from analyze.estimation.joint import JointSolution, MomentModel, solve_joint
from analyze.estimation.joint_model import COM, GRAVITY, SECOND
from analyze.estimation.moment_prior import UnitPrior, widened
from analyze.estimation.priors import ComPrior, Scale, SystematicErrors
from analyze.geometry.second_moments import symmetric_entries
from analyze.types import Array, EquiPlane

SIGMAS = 3.0
"""Half-width of all bounds in standard deviations."""
MIN_TOLERANCE = 0.02
"""Smallest relative tolerance of each axis's k R, which covers slip and air."""
MAX_TOLERANCE = 0.5
"""Relative tolerance of k R above which a strike is not used for a bound."""
MIN_COM_DISTANCE = 0.1
"""Smallest distance of c from an edge, over the shape's rms distance from it."""
TOLERANCE_FACTORS = (1.0, 2.0, 4.0, 8.0)
"""Factors on the tolerances, tried in turn until the strikes are consistent."""
MIN_ROBUST_WEIGHT = 0.3
"""Robust weight below which a strike is not used for a bound."""
OPEN_LOG_GRAVITY_SD = 3.0
"""1 sigma of ln g where the rate is estimated; a factor of 64 is 1.4 sigma."""
ANY_FILLING_FACTOR = 10.0
"""Factor on the shape's prior sd of the moments, so that nothing is assumed of the filling."""
RATE_K_FLOOR = 1e-3
"""Relative 1 sigma of an axis's k beside the stated errors, which contain hop and creep of the edge. In 81
sessions of a contact simulator the estimated rate errs by 0.87 of its sd, and one false alarm is raised."""
MAX_RATE_SD = 0.05
"""Largest relative sd at which the rate counts as determined by the axes."""


@dataclass(frozen=True)
class RateEstimate:
    """Estimate of the ratio of true to stated frame rate, whatever the mass distribution in the shape.

    It is found from pivot axes at different distances from the centre of mass.
    """

    ratio: float
    """True over stated frame rate."""
    sd: float
    """1 sigma of `ratio`."""

    @property
    def agrees(self) -> bool:
        """True if the stated frame rate is within `SIGMAS` standard deviations of the estimated one."""
        return abs(self.ratio - 1) <= SIGMAS * self.sd


@dataclass(frozen=True)
class RateCheck:
    """Bounds and estimate of the ratio of true to stated frame rate of one recording.

    The bounds are the smallest and largest ratio that some filling of the shape allows; the estimate is None
    if no axes determine it.
    """

    low: float
    """Smallest ratio that some filling of the shape allows."""
    high: float
    """Largest ratio that some filling of the shape allows."""
    estimate: RateEstimate | None
    """Estimate of the ratio; None if no axes determine it."""

    @property
    def possible(self) -> bool:
        """True if the stated frame rate is within the strikes' bounds and not contradicted by their estimate.

        Bounds and estimate are of the true rate; without an estimate the bounds alone count.
        """
        return self.low <= 1 <= self.high and (self.estimate is None or self.estimate.agrees)


def rate_check(
    planes: Sequence[EquiPlane],
    systematic: SystematicErrors,
    prior: ComPrior,
    moments: MomentModel,
    points: Array,
) -> RateCheck | None:
    """Bounds and estimate of the ratio of true to stated frame rate, from one recording's strikes.

    The bounds hold for any filling of the shape. The estimate needs pivot axes at different distances from
    the centre of mass.

    Args:
        planes: Equi-planes of one recording's strikes (plane through pivot line and centre of mass), in the
            object frame O, with the rate constants k [rad/s^2] of their motions at the stated frame rate.
        systematic: Standard deviations of errors that strikes share (table tilt, shape scale, edge radius).
        prior: Prior of the centre of mass.
        moments: Mass, gravity, and the shape's prior of the moments.
        points: (n, 3) places [m, in O] where mass can be: throughout the shape and at its ends.

    Returns:
        Bounds and, if the axes determine it, the estimate; None if no strike has a usable k, or no filling
        of the shape fits at any rate.
    """
    by_phi = solve_joint(planes, systematic, prior)
    bounds = rate_bounds(by_phi, moments.scale, points)
    if bounds is None:
        return None
    return RateCheck(
        *bounds, estimated_rate(planes, systematic, prior, moments, (bounds[0] * bounds[1]) ** 0.5)
    )


def rate_bounds(by_phi: JointSolution, scale: Scale, points: Array) -> tuple[float, float] | None:
    """Smallest and largest ratio of true to stated frame rate at which some filling of the shape fits k.

    k = m g R / I_edge [rad/s^2] is the rate constant of a strike's motion, with R the distance of the centre
    of mass c from the edge and I_edge the moment of inertia about it. The filling is any distribution of mass
    over `points` that has the c estimated from the balance angles phi. If no filling fits all strikes at any
    rate, the tolerances of all moments are multiplied by `TOLERANCE_FACTORS`, in turn, until one does. If phi
    does not determine the distance of c from any edge (as with edges of one corner), each strike bounds the
    rate by itself.

    Args:
        by_phi: Joint solution by phi alone; its planes have k at the stated frame rate.
        scale: Gravity, and the error of k that strikes share.
        points: (n, 3) places [m, in the object frame O] where mass can be.

    Returns:
        Smallest and largest ratio; None if no strike has a usable k, no filling fits at any rate, or the
        bounds of single strikes exclude each other.
    """
    model, x, P = by_phi.model, by_phi.x, by_phi.covariance
    R, by_c = model.distances(x), model.distance_design(x)
    com_tolerance = np.sqrt(np.einsum("si,ij,sj->s", by_c, P, by_c)) / R
    about, lever, stated, tolerance, alone = [], [], [], [], []
    for i, plane in enumerate(model.planes):
        if plane.k is None or not plane.sd_k or by_phi.weight[i] < MIN_ROBUST_WEIGHT:
            continue
        by_k = SIGMAS * float(np.hypot(plane.sd_k / plane.k, scale.k_relative_sd))
        own = max(MIN_TOLERANCE, float(np.hypot(by_k, SIGMAS * com_tolerance[i])))
        if own > MAX_TOLERANCE:
            if by_k <= MAX_TOLERANCE:
                alone.append(_extremes(plane, plane.k / scale.gravity, max(MIN_TOLERANCE, by_k), points))
            continue
        arm = points - plane.point
        about.append(np.sum(arm**2, axis=1) - (arm @ plane.direction) ** 2)
        lever.append((R[i] + plane.edge_radius) ** 2 - R[i] ** 2)
        stated.append(scale.gravity * R[i] / plane.k)
        tolerance.append(own)
    if not about:
        return _intersection([each for each in alone if each is not None])
    variance, along = np.linalg.eigh(P[COM, COM])
    middle, reach = along.T @ x[COM], SIGMAS * np.sqrt(variance)
    programme = _Programme(
        np.array(about),
        np.array(lever),
        np.array(stated),
        (points @ along).T,
        np.stack([middle - reach, middle + reach], axis=1),
    )
    for times in TOLERANCE_FACTORS:
        wide = np.minimum(times * np.array(tolerance), MAX_TOLERANCE)
        least, most = programme.extreme(wide, 1.0), programme.extreme(wide, -1.0)
        if least is not None and most is not None and least > 0:
            return most**-0.5, least**-0.5
    return None


def _extremes(
    plane: EquiPlane, k_over_g: float, tolerance: float, points: Array
) -> tuple[float, float] | None:
    """Smallest and largest s = 1 / r^2 of one strike, for any masses with their centre on its equi-plane.

    r is the true over the stated frame rate. s = (k / g) I_edge / (m R), with k the rate constant, g gravity,
    m the mass, I_edge the moment of inertia about the edge and R the distance of the centre of mass from it.
    s is a ratio of two sums over the shares of mass at the points; a linear programme in the shares over R
    finds its extremes (Charnes and Cooper 1962).

    Args:
        plane: Equi-plane of the strike, through its pivot line and the centre of mass.
        k_over_g: k at the stated rate over gravity [1/m].
        tolerance: Relative tolerance of k, by which both ends are widened.
        points: (n, 3) places [m, in the object frame O] where mass can be.

    Returns:
        Smallest and largest s; None if no masses have their centre on the plane.
    """
    arm = points - plane.point
    towards = np.cross(plane.normal, plane.direction)
    towards = towards if towards @ plane.up > 0 else -towards
    about = np.sum(arm**2, axis=1) - (arm @ plane.direction) ** 2
    size = float(about.mean()) ** 0.5
    along, across, about = arm @ towards / size, arm @ plane.normal / size, about / size**2
    off = float(np.tan(SIGMAS * plane.sd_phi + MIN_TOLERANCE))
    ends: list[float] = []
    for sign in (1.0, -1.0):
        rows, most = np.stack([across, -across, np.ones(len(points))]), [off, off, 1 / MIN_COM_DISTANCE]
        found = linprog(sign * about, A_ub=rows, b_ub=most, A_eq=along[None], b_eq=[1.0], method="highs")
        if found.status != 0:
            return None
        ends.append(
            (sign * float(found.fun) * size + 2 * plane.edge_radius) * k_over_g * (1 - sign * tolerance)
        )
    return ends[0], ends[1]


def _intersection(each: Sequence[tuple[float, float]]) -> tuple[float, float] | None:
    """Bounds of r, the ratio of true to stated frame rate, that agree with all strikes' bounds of 1 / r^2.

    Args:
        each: Smallest and largest 1 / r^2 of each strike.

    Returns:
        Smallest and largest r; None if there are no bounds, or if they exclude each other.
    """
    if not each:
        return None
    least, most = max(low for low, _ in each), min(high for _, high in each)
    return (float(most) ** -0.5, float(least) ** -0.5) if 0 < least <= most else None


@dataclass(frozen=True)
class _Programme:
    """Linear programme for the bounds that strikes set on r, the true over the stated frame rate.

    The unknowns are shares of the mass at n places in the shape, none negative, and s = 1 / r^2. The
    constraints are each strike's moment of inertia about the edge, within a tolerance, and bounds of the
    centre of mass.
    """

    about: Array
    """(strikes, n) squared distances of the places from each edge [m^2]."""
    lever: Array
    """(strikes,) contribution of the edge's rounding of radius rho, (R + rho)^2 - R^2 [m^2]."""
    stated: Array
    """(strikes,) I_edge / m at the stated rate, g R / k [m^2]."""
    across: Array
    """(3, n) coordinates of the places along the principal directions of the covariance of c, the centre of
    mass [m]."""
    com: Array
    """(3, 2) lower and upper bounds of c [m] along the principal directions of its covariance."""

    def extreme(self, tolerance: Array, sign: float) -> float | None:
        """Smallest or largest s = 1 / r^2 for which some distribution of the mass explains all strikes.

        r is the true over the stated frame rate. A distribution explains a strike if it has the strike's
        moment of inertia about the edge, per kilogram, at that r.

        Args:
            tolerance: (strikes,) relative tolerance of the moments.
            sign: 1 for the smallest s, -1 for the largest.

        Returns:
            s; None if no distribution explains the strikes at any s.
        """
        size = float(self.about.mean())
        below = np.column_stack([(1 - tolerance)[:, None] * self.about, -self.stated]) / size
        above = np.column_stack([-(1 + tolerance)[:, None] * self.about, self.stated]) / size
        across = np.column_stack([self.across, np.zeros(3)]) / size**0.5
        A = np.vstack([below, above, across, -across])
        com = self.com / size**0.5
        b = np.concatenate(
            [-(1 - tolerance) * self.lever / size, (1 + tolerance) * self.lever / size, com[:, 1], -com[:, 0]]
        )
        many = self.about.shape[1]
        whole = np.append(np.ones(many), 0.0)[None]
        # s is near the ratio of the moments: in this unit the scaling stays good even if 240 fps are stated
        # as 30.
        unit = size / float(self.stated.mean())
        A[:, -1] *= unit
        found = linprog(
            np.append(np.zeros(many), sign), A_ub=A, b_ub=b, A_eq=whole, b_eq=[1.0], method="highs"
        )
        return sign * float(found.fun) * unit if found.status == 0 else None


def with_scaled_k(plane: EquiPlane, factor: float) -> EquiPlane:
    """Copy of a strike's equi-plane with k, its sd and its covariance with phi multiplied by `factor`.

    An equi-plane passes through pivot line and centre of mass; k is the rate constant of the strike's motion
    [rad/s^2], phi the balance angle. A plane without k, or without its sd, is returned unchanged.
    """
    if plane.k is None or plane.sd_k is None:
        return plane
    return replace(plane, k=plane.k * factor, sd_k=plane.sd_k * factor, cov_phi_k=plane.cov_phi_k * factor)


def estimated_rate(
    planes: Sequence[EquiPlane],
    systematic: SystematicErrors,
    prior: ComPrior,
    moments: MomentModel,
    approximate: float,
) -> RateEstimate | None:
    """Estimate of the ratio of true to stated frame rate that holds whatever the filling of the shape is.

    It needs pivot axes at different distances from the centre of mass. All strikes are estimated jointly with
    gravity as a free parameter: a factor on it acts on the strikes' rate constants k (theta'' = -k sin(phi -
    theta), theta the tipping angle) as the square of a factor on the frame rate. The k of each axis has the
    further error `RATE_K_FLOOR`.

    Args:
        planes: Equi-planes (plane through pivot line and centre of mass) of one recording's strikes, in the
            object frame O, with k [rad/s^2] at the stated frame rate.
        systematic: Standard deviations of errors that strikes share (table tilt, shape scale, edge radius).
        prior: Prior of the centre of mass.
        moments: Mass, gravity, and the shape's prior of the moments, which is widened.
        approximate: Approximate ratio of true to stated frame rate, to start from.

    Returns:
        Ratio and its sd; None if the axes do not determine the ratio to `MAX_RATE_SD`.
    """
    k_factor = approximate**2

    wide = widened(moments.prior, ANY_FILLING_FACTOR)

    open_scale = replace(
        moments.scale,
        gravity_sd=OPEN_LOG_GRAVITY_SD * moments.scale.gravity,
        k_relative_sd=float(np.hypot(moments.scale.k_relative_sd, RATE_K_FLOOR)),
    )
    # Corrected by the approximate ratio, so that the problem starts near its solution.
    found = solve_joint(
        [with_scaled_k(plane, k_factor) for plane in planes], systematic, prior, MomentModel(open_scale, wide)
    )
    off = OPEN_LOG_GRAVITY_SD * float(found.x[GRAVITY])
    sd = OPEN_LOG_GRAVITY_SD * _unit_sd_of_g(found, prior, wide(found.x[COM]))
    # ln k = ln g + ...: a factor on g is equivalent to the square of one on the rate.
    ratio = approximate * float(np.exp(-off / 2))
    return RateEstimate(ratio, ratio * sd / 2) if sd / 2 <= MAX_RATE_SD else None


def _unit_sd_of_g(found: JointSolution, prior: ComPrior, wide: UnitPrior) -> float:
    """Posterior over prior sd of ln g, g the gravity: 0 if the strikes determine g, 1 if they do not.

    The inertia's unknowns in the solution are logarithms of lengths, by which an inertia near zero would look
    well known. The ratio is therefore computed with the entries of the inertia tensor in their place.

    Args:
        found: Joint solution with gravity as a free parameter.
        prior: Prior of the centre of mass.
        wide: Widened prior of the inertia per kilogram.
    """
    model, x, data = found.model, found.x, found.data
    along = np.array([plane.direction for plane in model.planes])
    twice = np.array([1.0, 1.0, 1.0, 2.0, 2.0, 2.0])
    by_k = model.log_k(x)[1]
    by_k[:, SECOND] = (
        -twice * symmetric_entries(along[:, :, None] * along[:, None, :]) / model.about_edge(x)[0][:, None]
    )
    both = np.stack([model.design(x), by_k * data.uses_k[:, None]], axis=1)
    rows = np.einsum("sij,sjc->sic", data.whiten, both) * np.sqrt(found.weight / found.spread)[:, None, None]
    sd = np.ones(model.count)
    sd[COM], sd[SECOND] = prior.sd, symmetric_entries(wide.sd)
    flat = rows.reshape(-1, model.count) * sd
    return float(np.sqrt(np.linalg.inv(np.eye(model.count) + flat.T @ flat)[GRAVITY, GRAVITY]))
