"""Centre of mass c and inertia of a body from contacts at an edge or corner, with any friction.

Forces that act at the contact have no moment about it. With q a point of the body in contact, b = c - q, g
the gravity vector and w the angular velocity, all per mass:

    (b x (q'' - g) + d/dt L_q) . e = 0        L_q = J_q w

If an edge touches, this holds for one vector e, the unit vector along the edge; at a corner it holds for
any e, which gives three equations. J_q is the inertia per mass about q. Where edge or corner is rounded with
radius rho, q lies on the centre line of the rounding and the contact rho below it, which adds
rho (e x z) . (c'' - g), z pointing up. All of it is linear in b and J_O (inertia per mass about the object
frame's origin O).

Weak form: multiplied by windows (functions of time) that vanish at both ends, and integrated by parts, so
that no acceleration is ever needed (the modulating functions of Shinbrot 1957, "On the analysis of linear
and nonlinear systems"). During a contact the body may slide and turn on it freely.
"""

# scipy is only partly typed.
# pyright: reportMissingTypeStubs=false, reportUnknownMemberType=false, reportUnknownVariableType=false

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import product
from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import least_squares

from analyze.errors import EstimationError
from analyze.least_squares.grouped_errors import group_freedom, grouped_covariance
from analyze.least_squares.intervals import student_sigmas_95
from analyze.least_squares.robust import huber_weights, median_scale
from analyze.motion.body_motion import BodyMotion, trapezoid_weights

if TYPE_CHECKING:
    from collections.abc import Sequence

    from analyze.types import Array

_WINDOWS_PER_CONTACT = 2
"""number of test functions per direction of a contact: sin^2, and sin^2 cos"""
_UP = np.array([0.0, 0.0, 1.0])
_ENTRIES = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
_UNITS = np.zeros((6, 3, 3))
for _i, (_r, _c) in enumerate(_ENTRIES):
    _UNITS[_i, _r, _c] = _UNITS[_i, _c, _r] = 1.0
MIN_THROWS = 10
"""least number of throws: one for each unknown"""
MIN_FREEDOM = 1.5
"""least degrees of freedom of a variance; with fewer, one throw alone decides it"""
_MAX_CONDITION = 1e12
"""condition number of the normal matrix above which the contacts do not determine all parameters"""
_HUBER_SIGMAS = 1.5
"""standard deviations above which a residual counts less (Huber 1964)"""


@dataclass(frozen=True)
class Contact:
    """Stretch of motion in which the body touches the table at one edge or corner only.

    It has the body's poses, and the place of that edge or corner in the object frame O.
    """

    motion: BodyMotion
    """poses of the body"""
    corner: Array
    """(3,) the sharp corner, or any point of the sharp edge, in O [m]"""
    inward: Array
    """(3,) vector in O from `corner` to the rounding's centre, per unit of the rounding's radius"""
    edge: Array | None
    """(3,) unit vector along the edge in O; None at a corner"""
    group: int
    """number of the throw or strike; contacts of one group may share errors"""


@dataclass(frozen=True)
class BalancedBody:
    """Centre of mass c, inertia per mass about c and edge rounding of a body, fitted to its motion.

    It was fitted to contacts: stretches in which the body touches the table at one edge or corner only. c [m]
    and the inertia [m^2] are in the object frame O.
    """

    com: Array
    """(3,) c in O [m]"""
    inertia: Array
    """(3, 3) inertia about c per mass, axes of O [m^2]"""
    rounding: float
    """radius of the edges' rounding [m]"""
    covariance: Array
    """(10, 10) covariance of (c, J_c as xx yy zz xy xz yz, rounding)"""
    freedom: Array
    """(10,) degrees of freedom of the variances of c, inertia and rounding, in the order of `covariance`"""
    contacts: int
    """number of contacts"""
    explained: float
    """share of the sum of squares that the balance explains"""

    @property
    def com_sd(self) -> Array:
        """Standard deviation (3,) of the centre of mass along the axes of the object frame O [m]."""
        return np.sqrt(np.diag(self.covariance)[:3])

    @property
    def inertia_sd(self) -> Array:
        """Standard deviations (3, 3) [m^2] of the entries of `inertia`, the inertia per mass.

        It is about the centre of mass, along the axes of the object frame O.
        """
        return tensor(np.sqrt(np.diag(self.covariance)[3:9]))

    @property
    def rounding_sd(self) -> float:
        """Standard deviation of the radius of the edges' rounding [m]."""
        return math.sqrt(float(self.covariance[9, 9]))

    @property
    def half_width(self) -> Array:
        """Half-widths (10,) of the 95 % intervals of centre of mass, inertia per mass and edge radius.

        In this order: centre of mass (3) [m, in the object frame O]; inertia per mass [m^2] as xx, yy, zz,
        xy, xz, yz; radius of the rounding [m]. They are by Student's t.
        """
        return student_sigmas_95(self.freedom) * np.sqrt(np.diag(self.covariance))


def tensor(entries: Array) -> Array:
    """Symmetric matrix (3, 3) with entries (6,) in the order xx, yy, zz, xy, xz, yz."""
    return np.einsum("i,irc->rc", entries, _UNITS)


def about_com(inertia_origin: Array, com: Array) -> Array:
    """Inertia per mass (3, 3) about the centre of mass [m^2], by Steiner's theorem.

    Args:
        inertia_origin: (3, 3) inertia per mass about the origin of the object frame O [m^2].
        com: (3,) centre of mass in O [m].
    """
    return inertia_origin - (float(com @ com) * np.eye(3) - np.outer(com, com))


def moment_rows(contact: Contact, radius: float, gravity: float) -> tuple[Array, Array]:
    """Moment balance of one contact, as linear equations in centre of mass and inertia.

    It is in weak form: integrated over time with window functions (weights that are 0 at both ends), so that
    no acceleration is needed.

    Args:
        contact: the motion and its point of contact.
        radius: radius of the rounding [m].
        gravity: magnitude g of gravity [m/s^2].

    Returns:
        (rows, 9) coefficients of (c, J_O as xx yy zz xy xz yz) and (rows,) right side [m^2/s^1.5]; c is the
        centre of mass in the object frame O [m], J_O the inertia per mass about its origin [m^2]. There is
        one row per window function (two) and direction (three at a corner, one at an edge). Rows are divided
        by the root of the contact's duration: white noise in the moment then gives all the same sd.
    """
    motion = contact.motion
    n, dt = len(motion), motion.dt[:, None]
    centre = contact.corner + radius * contact.inward
    step = np.diff(motion.path_of(centre), axis=0) / dt
    R = motion.R_world_object
    directions = [np.tile(axis, (n, 1)) for axis in np.eye(3)] if contact.edge is None else [R @ contact.edge]
    # L_q = J_q w with J_q = J_O - 2 (c.q) 1 + c q^T + q c^T + (q.q) 1 - q q^T
    units_com = [
        -2.0 * float(axis @ centre) * np.eye(3) + np.outer(axis, centre) + np.outer(centre, axis)
        for axis in np.eye(3)
    ]
    own = float(centre @ centre) * np.eye(3) - np.outer(centre, centre)
    momentum = [
        motion.halfway @ matrix @ motion.angular_velocity[..., None] for matrix in (*units_com, *_UNITS, own)
    ]
    span = float(motion.time[-1] - motion.time[0])
    phase = (motion.time - motion.time[0]) / span
    weights = trapezoid_weights(motion.time)
    g = np.array([0.0, 0.0, -gravity])
    coefficients: list[list[float]] = []
    wanted: list[float] = []
    for e, number in product(directions, range(_WINDOWS_PER_CONTACT)):
        window = (np.sin(math.pi * phase) ** 2 * np.cos(math.pi * phase) ** number)[:, None]
        d_direction = np.diff(window * e, axis=0)
        below = radius * window * np.cross(e, _UP)
        d_below = np.diff(below, axis=0)

        def moment_of(arm: Array, window: Array = window, e: Array = e, d_below: Array = d_below) -> float:
            """Time integral, weighted by `window`, of a moment about the contact, per kilogram [m^2/s].

            It is the component along the direction e of a part of the moment on a mass at `arm`: e . (a x
            (q'' - g) + radius z x a''). Here a is `arm` in the world frame, q the point `radius` above the
            contact (on the centre line of the edge's rounding), z the unit vector upwards, g the gravity
            vector, '' the second derivative by time. Partial integration replaces the accelerations by
            velocities.

            Args:
                arm: (3,) vector from q to the mass, in the object frame O [m].
                window: (n, 1) weight of each time, 0 at both ends.
                e: (n, 3) unit direction of the component, in the world frame, at each time.
                d_below: (n - 1, 3) differences of window times radius times e x z, z pointing up [m].
            """
            arms = R @ arm
            turned = window * np.cross(e, arms)
            return -float(
                np.sum(step * np.diff(turned, axis=0))
                + weights @ (turned @ g)
                + np.sum(np.diff(arms, axis=0) / dt * d_below)
            )

        by_spin = [-float(np.sum(d_direction * each[..., 0])) for each in momentum]
        fixed = moment_of(-centre) + by_spin[9] - float(np.sum(step * d_below) + weights @ (below @ g))
        coefficients.append(
            [moment_of(axis) + spin for axis, spin in zip(np.eye(3), by_spin[:3], strict=True)] + by_spin[3:9]
        )
        wanted.append(-fixed)
    scale = 1.0 / math.sqrt(span)
    return np.array(coefficients) * scale, np.array(wanted) * scale


def balance_moments(contacts: Sequence[Contact], gravity: float, radius: tuple[float, float]) -> BalancedBody:
    """Fit centre of mass, inertia per mass and rounding of the touching edges to all contacts together.

    Args:
        contacts: stretches of one body's motion, in each of which it touches the table at one edge or corner
            only.
        gravity: magnitude g of gravity [m/s^2].
        radius: expected radius of the rounding and its standard deviation [m].

    Returns:
        Centre of mass c (3,) in the object frame O [m], inertia per mass about c (3, 3) [m^2], radius of the
        rounding [m], and the covariance (10, 10) of these ten numbers in this order, with the inertia's
        entries as xx, yy, zz, xy, xz, yz.

    Raises:
        EstimationError: there are contacts of fewer than `MIN_THROWS` throws, or they are too similar to
            determine the body and its errors.
    """
    throws = len({contact.group for contact in contacts})
    if throws < MIN_THROWS:
        raise EstimationError(
            f"{len(contacts)} contacts of {throws} throws are too few for centre of mass and inertia:"
            f" {MIN_THROWS} throws are the least, 50 a good number"
        )
    # The rows are quadratic in the radius: three radii determine them.
    nodes = np.array([0.0, 0.5, 1.0]) * max(2.0 * radius[0], 4.0 * radius[1], 1e-4)
    found = [[moment_rows(contact, float(node), gravity) for contact in contacts] for node in nodes]
    rows = [np.concatenate([each[0] for each in at]) for at in found]
    wanted = [np.concatenate([each[1] for each in at]) for at in found]
    powers = np.linalg.inv(np.vander(nodes, 3, increasing=True))
    by_power = (
        np.einsum("pk,krc->prc", powers, np.array(rows)),
        np.einsum("pk,kr->pr", powers, np.array(wanted)),
    )
    groups = np.concatenate(
        [np.full(len(each[1]), contact.group) for contact, each in zip(contacts, found[0], strict=True)]
    )

    def balance(x: Array) -> tuple[Array, Array]:
        """Residuals (n,) of the moment balance at x (10,), and their derivatives (n, 10) by x.

        Forces at a contact have no moment about it (the balance). A residual is the time integral of the
        moment per mass about a contact, over the root of the contact's duration [m^2/s^1.5]. x holds, in the
        object frame O, the centre of mass [m] (3) and the inertia per mass about O's origin as xx yy zz xy xz
        yz [m^2] (6), then the radius of the edges' rounding [m].
        """
        power, slope = np.array([1.0, x[9], x[9] ** 2]), np.array([0.0, 1.0, 2 * x[9]])
        matrix, level = np.einsum("p,prc->rc", power, by_power[0]), power @ by_power[1]
        by_radius = np.einsum("p,prc->rc", slope, by_power[0]) @ x[:9] - slope @ by_power[1]
        return matrix @ x[:9] - level, np.column_stack([matrix, by_radius])

    start = np.array([*np.linalg.lstsq(rows[1], wanted[1], rcond=None)[0], nodes[1]])
    sizes = np.array([1e-3, 1e-3, 1e-3, *[1e-4] * 6, 1e-3])
    spread = median_scale(balance(start)[0])
    prior_row = np.zeros(10)
    x = start
    for _ in range(4):
        prior_row[9] = spread / radius[1]

        def residual(x: Array) -> Array:
            """Residuals (n + 1,) at x (10,): n errors of moments about contacts, and one of the radius.

            Each of the n is an imbalance of moments per mass about a contact, integrated over time, over the
            root of the contact's duration [m^2/s^1.5]. The last one is the radius less its expected value,
            scaled to the spread of the others. x holds, in the object frame O, the centre of mass [m] (3) and
            the inertia per mass about O's origin as xx yy zz xy xz yz [m^2] (6), then the radius of the
            edges' rounding [m].
            """
            return np.append(balance(x)[0], prior_row[9] * (x[9] - radius[0]))

        def jacobian(x: Array) -> Array:
            """Derivatives (n + 1, 10) by x: of n residuals of the moment balance, then of the radius's prior.

            A residual of the balance is the time integral of the moment per mass about a contact, over the
            root of the contact's duration [m^2/s^1.5]; that of the prior is the radius's deviation from it,
            scaled to the same spread. x (10,) holds, in the object frame O, the centre of mass [m] (3) and
            the inertia per mass about O's origin as xx yy zz xy xz yz [m^2] (6), then the radius of the
            edges' rounding [m].
            """
            return np.vstack([balance(x)[1], prior_row])

        # scipy's type hints admit only the names of its built-in derivatives.
        solved = least_squares(
            residual,
            x,
            jacobian,  # pyright: ignore[reportArgumentType]
            x_scale=sizes,
            loss="huber",
            f_scale=_HUBER_SIGMAS * spread,
        )
        x, before = np.asarray(solved.x, dtype=np.float64), spread
        spread = median_scale(balance(x)[0])
        if abs(spread - before) < 0.01 * spread:
            break
    left, J = balance(x)
    covariance, freedom = _grouped_covariance(J, left, groups, prior_row, spread)
    if freedom[:9].min() < MIN_FREEDOM:
        raise EstimationError(
            f"{len(contacts)} contacts determine centre of mass and inertia, but not their errors: a single"
            " throw decides one of them: add throws that land on other edges"
        )
    # From (c, J_O) to (c, J_c).
    to_com = np.eye(10)
    for i, (r, c) in enumerate(_ENTRIES):
        unit = np.eye(3)
        to_com[3 + i, :3] = [-2.0 * x[a] * (r == c) + unit[a, r] * x[c] + unit[a, c] * x[r] for a in range(3)]
    level = balance(np.array([*np.zeros(9), x[9]]))[0]
    return BalancedBody(
        com=x[:3],
        inertia=about_com(tensor(x[3:9]), x[:3]),
        rounding=float(x[9]),
        covariance=to_com @ covariance @ to_com.T,
        freedom=freedom,
        contacts=len(contacts),
        explained=1.0 - float(np.sum(left**2) / np.sum(level**2)),
    )


def _grouped_covariance(
    J: Array, left: Array, groups: Array, prior: Array, spread: float
) -> tuple[Array, Array]:
    """Covariance (p, p) of the p parameters of a robust fit in which residuals of a group share errors.

    Args:
        J: (n, p) derivatives of the residuals by the parameters.
        left: (n,) residuals of the fit, in any unit.
        groups: (n,) number of the group of each residual.
        prior: (p,) derivatives by the parameters of one more residual, that of a prior.
        spread: robust standard deviation of the residuals.

    Returns:
        Covariance (p, p), and degrees of freedom (p,) of its diagonal.

    Raises:
        EstimationError: the residuals do not determine all parameters.
    """
    weight = huber_weights(left, _HUBER_SIGMAS, spread)
    size = np.asarray(np.sqrt(np.sum(J**2, axis=0)), dtype=np.float64)
    scaled, own = J / size, prior / size
    # Huber's loss is quadratic only inside its threshold: that, not the weights, is its second derivative.
    bent = np.abs(left) < _HUBER_SIGMAS * spread
    member = np.unique(groups, return_inverse=True)[1]
    normals, scores = np.zeros((member.max() + 1, 10, 10)), np.zeros((member.max() + 1, 10))
    np.add.at(normals, member[bent], scaled[bent, :, None] * scaled[bent, None, :])
    np.add.at(scores, member, scaled * (weight * left)[:, None])
    normal = normals.sum(axis=0) + np.outer(own, own)
    if np.linalg.cond(normal) > _MAX_CONDITION:
        raise EstimationError(
            "the contacts are too similar to determine centre of mass and inertia:"
            " use throws that land on other edges"
        )
    inverse = np.asarray(np.linalg.inv(normal), dtype=np.float64)
    by_prior = inverse @ own * spread
    covariance = grouped_covariance(normal, normals, scores) + np.outer(by_prior, by_prior)
    return covariance / np.outer(size, size), group_freedom(inverse, normals)
