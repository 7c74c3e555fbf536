"""Inertial parameters of an object without the fixture that it was struck in, with all errors of both.

The fixture's mass, centre and inertia are known with standard deviations, and so is the object's pose in it.
They are subtracted after the joint estimate, by the parallel-axis theorem.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from analyze.estimation.inertia import MAX_MEASURED_SHARE
from analyze.estimation.mass_properties import AxisInertia, InertialParameters
from analyze.estimation.moment_prior import MomentPrior, UnitPrior
from analyze.geometry.held_object import HeldObject, KnownBody, point_inertia
from analyze.geometry.rotations import hat
from analyze.geometry.second_moments import symmetric_entries, symmetric_matrix
from analyze.least_squares.intervals import SIGMAS_95
from analyze.types import Array

MASS, COM, TENSOR = 0, slice(1, 4), slice(4, 10)
"""Places of mass, centre of mass and tensor entries among the ten parameters."""
STRIKES_CAUSE = "strikes"
MASS_CAUSE = "mass of the fixture"
CENTRE_CAUSE = "centre of mass of the fixture"
INERTIA_CAUSE = "inertia of the fixture"
PLACE_CAUSE = "place of the object in the fixture"
TURN_CAUSE = "rotation of the object in the fixture"
BODY_COUNT = 10
"""Number of unknowns of a fixture's body: mass, centre (3), entries of its inertia per kilogram (6)."""
RELATIVE_STEP = 1e-5
"""Step of the numerical derivatives, in standard deviations or relative to each parameter's size."""


@dataclass(frozen=True)
class FixtureShare:
    """Errors of the object's centre of mass and tensor from one cause alone."""

    cause: str
    """Cause in words."""
    com_covariance: Array
    """(3, 3) its part of the covariance of the centre of mass [m^2], in O."""
    tensor_sd: Array
    """(3, 3) 1 sigma of the tensor's entries that it alone causes [kg m^2]."""


@dataclass(frozen=True)
class WithoutFixture:
    """Object without its fixture, with the share of each cause in its errors."""

    inertial: InertialParameters
    """Mass, centre of mass and moments of the object alone, in the object frame O."""
    shares: tuple[FixtureShare, ...]
    """Parts of the errors: of the strikes, of the fixture's mass, centre and inertia, of the object's place
    and rotation in the fixture. Covariances of the centre of mass add up."""


def fixture_prior(held: HeldObject, alone: MomentPrior) -> MomentPrior:
    """Prior of the inertia per kilogram of object and fixture, from the shape's prior of the object alone.

    Args:
        held: Object in its fixture.
        alone: Prior of the object alone, a function of its centre of mass.

    Returns:
        Function of the centre of mass (3,) [m] of both together that gives mean and sd, each (3, 3) [m^2].
    """
    share = held.mass / (held.mass + held.fixture_mass)

    def prior(com: Array) -> UnitPrior:
        own = held.com_alone(com)
        shape = alone(own)
        fixture = [
            body.mass * body.unit_inertia_sd * _sizes(body) / (held.mass + held.fixture_mass)
            for body in held.fixture
        ]
        return UnitPrior(
            held.unit_inertia_struck(own, shape.mean),
            np.sqrt((share * shape.sd) ** 2 + sum(each**2 for each in fixture)),
        )

    return prior


def without_fixture(whole: InertialParameters, held: HeldObject) -> WithoutFixture:
    """Mass, centre of mass and moments of an object without its fixture, in the object frame O.

    The fixture is where the shape file has it; the object may sit otherwise, by its stated standard
    deviations, so that its parameters in its own frame are uncertain by as much. Quantities of single strikes
    (residuals, distances, planes, weights) stay those of the body that tipped.

    Args:
        whole: Parameters of object and fixture together.
        held: Object in its fixture.

    Returns:
        The object's parameters with their covariances, and the share of each cause. Intervals that are not
        1.96 sd keep their form, widened as the standard deviations are.
    """
    ten = np.concatenate([[whole.mass], whole.com.position, symmetric_entries(whole.inertia)])
    found, parts = subtracted(ten, whole.covariance, held)
    covariance = np.asarray(sum(parts.values()), dtype=np.float64)
    shares = tuple(
        FixtureShare(cause, part[COM, COM], symmetric_matrix(np.sqrt(np.diag(part)[TENSOR])))
        for cause, part in parts.items()
    )
    inertia, sd = symmetric_matrix(found[TENSOR]), np.sqrt(np.diag(covariance))
    before = np.sqrt(np.maximum(np.diag(whole.covariance), 1e-300))
    ends = _moved(whole.inertia_intervals, ten[TENSOR], found[TENSOR], sd[TENSOR] / before[TENSOR])
    half = SIGMAS_95 * symmetric_matrix(sd[TENSOR])
    if ends is not None:
        half = np.maximum(half, symmetric_matrix(np.diff(ends, axis=1)[:, 0] / 2))
    size = np.sqrt(np.outer(np.diag(inertia), np.diag(inertia)).clip(min=0))
    axes, to_joint = _axes(whole, held, found, covariance)
    return WithoutFixture(
        replace(
            whole,
            mass=float(found[MASS]),
            mass_sd=float(sd[MASS]),
            com=replace(
                whole.com,
                position=found[COM],
                covariance=covariance[COM, COM],
                intervals=_moved(whole.com.intervals, ten[COM], found[COM], sd[COM] / before[COM]),
            ),
            inertia=inertia,
            inertia_sd=symmetric_matrix(sd[TENSOR]),
            inertia_intervals=ends,
            measured=whole.measured & (half <= MAX_MEASURED_SHARE * size),
            axes=axes,
            joint_covariance=to_joint @ covariance @ to_joint.T,
            covariance=covariance,
        ),
        shares,
    )


def subtracted(ten: Array, covariance: Array, held: HeldObject) -> tuple[Array, dict[str, Array]]:
    """Ten parameters (10,) of the object alone, and the parts (10, 10) of their covariance by cause.

    Args:
        ten: (10,) mass [kg], centre of mass [m] and inertia about it [kg m^2] of object and fixture, the
            entries in the order xx, yy, zz, xy, xz, yz.
        covariance: (10, 10) their covariance from the strikes.
        held: Object in its fixture.
    """
    nuisance = BODY_COUNT * len(held.fixture) + 6
    sizes = np.array([ten[MASS], *[0.1] * 3, *[ten[4:7].sum()] * 6])
    by_ten = _derivative(lambda step: _alone(ten + step * sizes, np.zeros(nuisance), held), 10) / sizes
    by_fixture = _derivative(lambda step: _alone(ten, step, held), nuisance)
    parts = {STRIKES_CAUSE: by_ten @ covariance @ by_ten.T}
    for cause, columns in _causes(held).items():
        parts[cause] = by_fixture[:, columns] @ by_fixture[:, columns].T
    return _alone(ten, np.zeros(nuisance), held), parts


def _alone(ten: Array, errors: Array, held: HeldObject) -> Array:
    """Ten parameters (10,) of the object alone from those of the body that tipped.

    Args:
        ten: (10,) mass [kg], centre of mass [m] and inertia about it [kg m^2] of object and fixture.
        errors: (n,) errors of the fixture's bodies, ten each, then place and rotation of the object in the
            fixture, all in their standard deviations.
        held: Object in its fixture.
    """
    mass, first = ten[MASS], ten[MASS] * ten[COM]
    about_origin = symmetric_matrix(ten[TENSOR]) + mass * point_inertia(ten[COM])
    for body, own in zip(held.fixture, errors[:-6].reshape(-1, BODY_COUNT), strict=True):
        weight, com = body.mass + body.mass_sd * own[MASS], body.com + body.com_sd * own[COM]
        tensor = body.unit_inertia + body.unit_inertia_sd * _sizes(body) * symmetric_matrix(own[TENSOR])
        mass, first = mass - weight, first - weight * com
        about_origin = about_origin - weight * (tensor + point_inertia(com))
    com = first / mass
    inertia = about_origin - mass * point_inertia(com)
    shift, turn = held.place_sd * errors[-6:-3], held.turn_sd * errors[-3:]
    com = com - shift - np.cross(turn, com - held.about)
    inertia = inertia - hat(turn) @ inertia + inertia @ hat(turn)
    return np.concatenate([[mass], com, symmetric_entries(inertia)])


def _sizes(body: KnownBody) -> Array:
    """Geometric means (3, 3) [m^2] of the diagonal entries of row and column of a body's unit inertia."""
    diagonal = np.diag(body.unit_inertia)
    return np.sqrt(np.outer(diagonal, diagonal))


def _causes(held: HeldObject) -> dict[str, list[int]]:
    """Indices of the errors of the fixture and of the object's pose in it, by their cause in words."""
    starts = [BODY_COUNT * i for i in range(len(held.fixture))]
    last = BODY_COUNT * len(held.fixture)
    return {
        MASS_CAUSE: starts,
        CENTRE_CAUSE: [start + 1 + i for start in starts for i in range(3)],
        INERTIA_CAUSE: [start + 4 + i for start in starts for i in range(6)],
        PLACE_CAUSE: [last + i for i in range(3)],
        TURN_CAUSE: [last + 3 + i for i in range(3)],
    }


def _derivative(function: Callable[[Array], Array], count: int) -> Array:
    """Derivatives (m, count) of a function (count,) -> (m,) at 0, by central differences."""
    steps = RELATIVE_STEP * np.eye(count)
    return np.array([(function(step) - function(-step)) / (2 * RELATIVE_STEP) for step in steps]).T


def _moved(ends: Array | None, before: Array, after: Array, wider: Array) -> Array | None:
    """Intervals (n, 2) about new values (n,), their distances from the old values scaled; None if none."""
    return None if ends is None else after[:, None] + (ends - before[:, None]) * wider[:, None]


def _axes(
    whole: InertialParameters, held: HeldObject, found: Array, covariance: Array
) -> tuple[tuple[AxisInertia, ...], Array]:
    """Moments of the object alone about the pivot edges and their parallels through its centre of mass.

    Args:
        whole: Parameters of object and fixture together.
        held: Object in its fixture.
        found: (10,) parameters of the object alone.
        covariance: (10, 10) their covariance.

    Returns:
        The moments, and the matrix (4 + axes, 10) that gives mass, centre of mass and the moments about the
        parallels from the ten parameters.
    """
    directions = np.array([axis.direction for axis in whole.axes]).reshape(-1, 3)
    lines = symmetric_entries(directions[:, :, None] * directions[:, None, :]) * [1, 1, 1, 2, 2, 2]
    to_joint = np.zeros((4 + len(lines), 10))
    to_joint[:4, :4] = np.eye(4)
    to_joint[4:, TENSOR] = lines
    planes = {plane.axis_id: plane for plane in whole.com.planes}
    axes: list[AxisInertia] = []
    for axis, line in zip(whole.axes, to_joint[4:], strict=True):
        plane = planes[axis.axis_id]
        arm = whole.com.position - plane.point
        arm = arm - axis.direction * float(arm @ axis.direction)
        contact = plane.point - plane.edge_radius * arm / np.linalg.norm(arm)
        value, sd = _about_edge(held, contact, axis.direction)
        edge_sd = float(np.hypot(axis.i_edge_sd, sd))
        i_com, i_com_sd = float(line @ found), float(np.sqrt(line @ covariance @ line))
        axes.append(
            replace(
                axis,
                i_edge=axis.i_edge - value,
                i_edge_sd=edge_sd,
                i_com=i_com,
                i_com_sd=i_com_sd,
                i_edge_interval=_moved_pair(
                    axis.i_edge_interval, axis.i_edge, axis.i_edge - value, edge_sd / axis.i_edge_sd
                ),
                i_com_interval=_moved_pair(axis.i_com_interval, axis.i_com, i_com, i_com_sd / axis.i_com_sd),
            )
        )
    return tuple(axes), to_joint


def _moved_pair(
    ends: tuple[float, float] | None, before: float, after: float, wider: float
) -> tuple[float, float] | None:
    """Interval (low, high) about a corrected value: each end keeps its scaled distance from the value.

    Args:
        ends: Interval about the value before the correction; None if there is none, which is returned then.
        before: Value before the correction.
        after: Value after it, in the same unit.
        wider: Standard deviation after the correction over that before it.
    """
    return None if ends is None else (after + (ends[0] - before) * wider, after + (ends[1] - before) * wider)


def _about_edge(held: HeldObject, point: Array, direction: Array) -> tuple[float, float]:
    """Moment of inertia of a fixture about a line and its 1 sigma [kg m^2].

    Args:
        held: Object in its fixture.
        point: (3,) point of the line [m], in O.
        direction: (3,) unit direction of the line, in O.
    """
    total, variance = 0.0, 0.0
    for body in held.fixture:
        arm = np.cross(body.com - point, direction)
        unit = float(direction @ body.unit_inertia @ direction)
        lever = float(np.linalg.norm(arm))
        total += body.mass * (unit + lever**2)
        variance += (body.mass_sd * (unit + lever**2)) ** 2 + (body.mass * unit * body.unit_inertia_sd) ** 2
        variance += (2 * body.mass * lever * body.com_sd) ** 2
    return total, float(np.sqrt(variance))
