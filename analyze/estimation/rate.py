"""Whether frame times may be true: k = m g R / I_edge goes with the square of the frame rate, and shape and c bound I_edge.

With r the true rate over the stated one, k is truly k r^2, so that of every axis

    I_edge / m = s g R / k,    s = 1 / r^2.

Whatever fills the shape, with phi's centre of mass, has some I_edge / m = sum of shares times squared distances from the edge: the least
and the greatest s for which any filling has all axes' moments at once is a linear programme in the shares and s (moment problems: Karlin
and Studden 1966). Parallel axes with different R share one moment about c, and then

    s = (R1^2 - R2^2) / (g (R1 / k1 - R2 / k2))

needs no filling at all; the joint problem with an open rate has that of all axes together.
"""

# scipy is only partly typed; its unknowns are no mistakes of ours.
# pyright: reportMissingTypeStubs=false, reportUnknownVariableType=false, reportUnknownArgumentType=false, reportUnknownMemberType=false

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import linprog

from analyze.estimation.joint import JointSolution, Moments, UnitPrior, solve_joint
from analyze.estimation.joint_model import COM, GRAVITY, SECOND
from analyze.estimation.second_moments import six
from analyze.estimation.stated import ComPrior, Scale, SystematicErrors
from analyze.types import Array, EquiPlane

SIGMAS = 3.0
LEAST_DOUBT = 0.02
"""relative, of each axis's k R: what slip and air may do to it at least"""
WIDEST = 0.5
"""of the same, above which a strike bounds nothing"""
NEAREST = 0.1
"""of the shape's mean distance from an edge, at which c is at least"""
BELIEVED_LESS = (1.0, 2.0, 4.0, 8.0)
TRUSTED = 0.3
"""weight of a strike among all, below which it bounds nothing"""
OPEN = 3.0
"""1 sigma of ln g where the rate is asked for: 64 times is 1.4 of it"""
ANY_FILLING = 10.0
"""times the shape's own sd of the moments, where nothing of the filling shall be assumed"""
TOLD = 0.05
"""relative sd of the rate up to which parallel axes are said to tell it"""


@dataclass(frozen=True)
class RateTold:
    """The true frame rate over the stated one, as axes with different R have it."""

    ratio: float
    sd: float

    @property
    def agrees(self) -> bool:
        """The stated one is within what it is known to."""
        return abs(self.ratio - 1) <= SIGMAS * self.sd


@dataclass(frozen=True)
class RateCheck:
    """What the strikes of one recording say of its frame rate."""

    low: float
    high: float
    """true rate over the stated one: what any filling of the shape allows"""
    told: RateTold | None
    """None: no axes tell it better"""

    @property
    def possible(self) -> bool:
        """The stated rate can be the true one."""
        return self.low <= 1 <= self.high and (self.told is None or self.told.agrees)


def rate_check(
    planes: Sequence[EquiPlane], systematic: SystematicErrors, prior: ComPrior, moments: Moments, points: Array
) -> RateCheck | None:
    """Bounds of the frame rate, and the rate itself where axes with different R tell it.

    Args:
        planes: of one recording's strikes.
        systematic: shared errors.
        prior: of c.
        moments: mass, gravity, and what the shape says of the moments.
        points: (n, 3) m, where mass can be: throughout the shape and at its ends.

    Returns:
        None where no strike has a k that can be used, or no filling fits at any rate.
    """
    by_phi = solve_joint(planes, systematic, prior)
    bounds = rate_bounds(by_phi, moments.scale, points)
    if bounds is None:
        return None
    return RateCheck(*bounds, rate_told(planes, systematic, prior, moments, (bounds[0] * bounds[1]) ** 0.5))


def rate_bounds(by_phi: JointSolution, scale: Scale, points: Array) -> tuple[float, float] | None:
    """Least and greatest ratio of the true rate to the stated one, for any masses at `points` (n, 3) with the c that phi alone tells.

    Strikes that contradict each other at any rate are each believed less, until they do not. Where phi leaves c open (edges of one
    corner), so that no R is known, each strike bounds the rate by itself.

    None where no strike has a k that can be used, or no filling fits at any rate.
    """
    model, x, P = by_phi.model, by_phi.x, by_phi.covariance
    R, by_c = model.distances(x), model.distance_design(x)
    doubt = np.sqrt(np.einsum("si,ij,sj->s", by_c, P, by_c)) / R
    about, lever, stated, loose, alone = [], [], [], [], []
    for i, plane in enumerate(model.planes):
        if plane.k is None or not plane.sd_k or by_phi.weight[i] < TRUSTED:
            continue
        by_k = SIGMAS * float(np.hypot(plane.sd_k / plane.k, scale.k_relative_sd))
        own = max(LEAST_DOUBT, float(np.hypot(by_k, SIGMAS * doubt[i])))
        if own > WIDEST:
            alone += [] if by_k > WIDEST else [_extremes(plane, plane.k / scale.gravity, max(LEAST_DOUBT, by_k), points)]
            continue
        arm = points - plane.point
        about.append(np.sum(arm**2, axis=1) - (arm @ plane.direction) ** 2)
        lever.append((R[i] + plane.edge_radius) ** 2 - R[i] ** 2)
        stated.append(scale.gravity * R[i] / plane.k)
        loose.append(own)
    if not about:
        return _common([each for each in alone if each is not None])
    variance, along = np.linalg.eigh(P[COM, COM])
    middle, reach = along.T @ x[COM], SIGMAS * np.sqrt(variance)
    programme = _Programme(
        np.array(about), np.array(lever), np.array(stated), (points @ along).T, np.stack([middle - reach, middle + reach], axis=1)
    )
    for times in BELIEVED_LESS:
        ends = [programme.extreme(np.minimum(times * np.array(loose), WIDEST), sign) for sign in (1.0, -1.0)]
        least, most = ends
        if least is not None and most is not None and least > 0:
            return most**-0.5, least**-0.5
    return None


def _extremes(plane: EquiPlane, k_over_g: float, loose: float, points: Array) -> tuple[float, float] | None:
    """Least and greatest s of one strike, for any masses at `points` (n, 3) whose c lies on its plane; None where no c does.

    s = (k / g) I_edge / (m R) is a ratio of two sums over the shares, a linear programme in the shares over R (Charnes and Cooper 1962).

    Args:
        plane: of the strike.
        k_over_g: its k over gravity [1/m].
        loose: relative, of k.
        points: (n, 3) m.
    """
    arm = points - plane.point
    towards = np.cross(plane.normal, plane.direction)
    towards = towards if towards @ plane.up > 0 else -towards
    about = np.sum(arm**2, axis=1) - (arm @ plane.direction) ** 2
    size = float(about.mean()) ** 0.5
    along, across, about = arm @ towards / size, arm @ plane.normal / size, about / size**2
    off = float(np.tan(SIGMAS * plane.sd_phi + LEAST_DOUBT))
    ends: list[float] = []
    for sign in (1.0, -1.0):
        rows, most = np.stack([across, -across, np.ones(len(points))]), [off, off, 1 / NEAREST]
        found = linprog(sign * about, A_ub=rows, b_ub=most, A_eq=along[None], b_eq=[1.0], method="highs")
        if found.status != 0:
            return None
        ends.append((sign * float(found.fun) * size + 2 * plane.edge_radius) * k_over_g * (1 - sign * loose))
    return ends[0], ends[1]


def _common(each: Sequence[tuple[float, float]]) -> tuple[float, float] | None:
    """Least and greatest ratio of the rates that all of some bounds of s allow; None where there are none, or they exclude each other."""
    if not each:
        return None
    least, most = max(low for low, _ in each), min(high for _, high in each)
    return (float(most) ** -0.5, float(least) ** -0.5) if 0 < least <= most else None


@dataclass(frozen=True)
class _Programme:
    """Shares of the mass (n,), none negative, and s; lengths over the shape's own, so that all numbers are of one size."""

    about: Array
    """(strikes, n) m^2, squared distances of the places from each edge"""
    lever: Array
    """(strikes,) m^2, what the edge's rounding adds"""
    stated: Array
    """(strikes,) m^2, I_edge / m as the stated times have it"""
    across: Array
    """(3, n) m, the places along c's principal directions"""
    com: Array
    """(3, 2) m, least and greatest of c along them"""

    def extreme(self, loose: Array, sign: float) -> float | None:
        """The least (sign 1) or greatest (-1) s, each strike's moment within `loose` (strikes,) of itself; None where there is no such."""
        size = float(self.about.mean())
        below = np.column_stack([(1 - loose)[:, None] * self.about, -self.stated]) / size
        above = np.column_stack([-(1 + loose)[:, None] * self.about, self.stated]) / size
        across = np.column_stack([self.across, np.zeros(3)]) / size**0.5
        A = np.vstack([below, above, across, -across])
        com = self.com / size**0.5
        b = np.concatenate([-(1 - loose) * self.lever / size, (1 + loose) * self.lever / size, com[:, 1], -com[:, 0]])
        many = self.about.shape[1]
        whole = np.append(np.ones(many), 0.0)[None]
        # s lies near the ratio of the moments: in units of that the programme is as well scaled for 240 taken for 30 as for 240.
        unit = size / float(self.stated.mean())
        A[:, -1] *= unit
        found = linprog(np.append(np.zeros(many), sign), A_ub=A, b_ub=b, A_eq=whole, b_eq=[1.0], method="highs")
        return sign * float(found.fun) * unit if found.status == 0 else None


def at_rate(plane: EquiPlane, faster: float) -> EquiPlane:
    """With k `faster` times as large."""
    if plane.k is None or plane.sd_k is None:
        return plane
    return replace(plane, k=plane.k * faster, sd_k=plane.sd_k * faster, cov_phi_k=plane.cov_phi_k * faster)


def rate_told(
    planes: Sequence[EquiPlane],
    systematic: SystematicErrors,
    prior: ComPrior,
    moments: Moments,
    about: float,
) -> RateTold | None:
    """The ratio of the true rate to the stated one as axes with different R have it, whatever the filling; None where none do.

    Args:
        planes: of one recording's strikes.
        systematic: shared errors.
        prior: of c.
        moments: mass, gravity, and what the shape says of the moments.
        about: the ratio, roughly.
    """
    faster = about**2

    def wide(com: Array) -> UnitPrior:
        shape = moments.prior(com)
        return UnitPrior(shape.mean, ANY_FILLING * shape.sd)

    open_scale = replace(moments.scale, gravity_sd=OPEN * moments.scale.gravity)
    # Roughly right beforehand, so that the problem begins near its answer.
    found = solve_joint([at_rate(plane, faster) for plane in planes], systematic, prior, Moments(open_scale, wide))
    off, sd = OPEN * float(found.x[GRAVITY]), OPEN * _unit_sd_of_g(found, prior, wide(found.x[COM]))
    # ln k = ln g + ...: a g found too large is a rate stated too large, by the root.
    ratio = about * float(np.exp(-off / 2))
    return RateTold(ratio, ratio * sd / 2) if sd / 2 <= TOLD else None


def _unit_sd_of_g(found: JointSolution, prior: ComPrior, wide: UnitPrior) -> float:
    """1 sigma of the unknown of ln g, the moments as they are; the solution's own are logarithms, which near 0 look known."""
    model, x, data = found.model, found.x, found.data
    along = np.array([plane.direction for plane in model.planes])
    twice = np.array([1.0, 1.0, 1.0, 2.0, 2.0, 2.0])
    by_k = model.log_k(x)[1]
    by_k[:, SECOND] = -twice * six(along[:, :, None] * along[:, None, :]) / model.about_edge(x)[0][:, None]
    both = np.stack([model.design(x), by_k * data.uses_k[:, None]], axis=1)
    rows = np.einsum("sij,sjc->sic", data.whiten, both) * np.sqrt(found.weight / found.spread)[:, None, None]
    sd = np.ones(model.count)
    sd[COM], sd[SECOND] = prior.sd, six(wide.sd)
    flat = rows.reshape(-1, model.count) * sd
    return float(np.sqrt(np.linalg.inv(np.eye(model.count) + flat.T @ flat)[GRAVITY, GRAVITY]))
