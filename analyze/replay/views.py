"""Data that a replay draws, as plain arrays independent of a viewer: poses, curves, polygons."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import isotonic_regression
from scipy.spatial import ConvexHull

from analyze.estimation.mass_properties import CentreOfMass
from analyze.geometry.rotations import matrix_from_vector
from analyze.motion.contact_time import contact_time
from analyze.motion.settings import MotionSettings
from analyze.motion.sign_change import angular_acceleration
from analyze.result.document import result_document
from analyze.types import Array, EquiPlane, IntArray, MotionFit, TipAngle, TipMotion
from schemas.result import Result
from schemas.strike_plan import PlannedStrike

if TYPE_CHECKING:
    from analyze.estimation.voxel_map import VoxelMap
    from analyze.geometry.object_model import ObjectModel
    from analyze.motion.support_function import SupportFunction
    from analyze.pipeline.estimate import Estimate

_MAX_REGION_POINTS = 700
"""Greatest number of cells drawn per region."""


@dataclass(frozen=True)
class DrawnRegion:
    """Points to draw of one mass region of an object: the shell, or the interior on one side of a plane.

    They are the middles of some of the cells (small cubes) of the region, in O, the object's frame [m].
    """

    name: str
    """Name of the region."""
    points: Array
    """(n, 3) positions [m] in O of a sample of its cells."""


@dataclass(frozen=True)
class DrawnAnswer:
    """Parts of an estimate that a replay draws: equi-planes, centre of mass, mass regions, voxels, result.

    An equi-plane, one per strike, contains the axis about which the object tips, and the centre of mass. Mass
    regions are the shell and the interior on either side of a plane; voxels are cells with their densities.
    """

    result: Result
    """Result document of the estimate."""
    planes: tuple[EquiPlane, ...]
    """Equi-planes of the strikes used, each through the pivot axis and the centre of mass."""
    com: CentreOfMass
    """Centre of mass of the object without its markers, or with them if the pose of one with a mass is not
    known."""
    regions: tuple[DrawnRegion, ...]
    """Mass regions, the shell first."""
    voxels: VoxelMap | None = None
    """Density per cell; None to draw none."""


@dataclass(frozen=True)
class MotionCurves:
    """Motion of a strike in n frames: tipping angle [rad], rate [rad/s] and acceleration [rad/s^2]."""

    time_ns: IntArray
    """(n,) log times [ns]."""
    theta: Array
    """(n,) angle [rad]."""
    omega: Array
    """(n,) angular velocity, the rate of theta [rad/s], by differences."""
    alpha: Array
    """(n,) acceleration of theta [rad/s^2]; of a measured angle by differences of the smoothed angle, as the
    paper's estimator of the balance angle (VISAPP 2013) takes them."""


@dataclass(frozen=True)
class FittedCurves(MotionCurves):
    """Fitted motion of a strike at the n frames of the fit's time span, with its residual [rad].

    The motion is the tipping angle [rad] with its rate [rad/s] and acceleration [rad/s^2]; the residual is
    the measured less the fitted angle.
    """

    residual: Array
    """(n,) measured minus fitted angle [rad]."""


def drawn_answer(estimate: Estimate) -> DrawnAnswer:
    """Take from an estimate what a replay draws: equi-planes, centre of mass, mass regions, voxels.

    An equi-plane contains the axis about which a strike tips the object, and the centre of mass. Mass regions
    are the shell (outer wall) and the interior on either side of a plane; of each at most 700 cells (small
    pieces) are taken, at random. The Result document (JSON) of the estimate is added.
    """
    distribution, cells = estimate.distribution, estimate.cells
    upper = cells.points @ distribution.dividing_plane_normal > distribution.dividing_plane_offset
    inside = cells.interior >= cells.shell
    members = (~inside, inside & upper, inside & ~upper)
    regions = tuple(
        DrawnRegion(name, _thinned(cells.points[member]))
        for name, member in zip(distribution.names, members, strict=False)
    )
    return DrawnAnswer(
        result_document(estimate), estimate.planes, estimate.com_balanced, regions, estimate.voxels
    )


def contact_from_motion(motion: TipMotion) -> int | None:
    """Log time [ns] of the contact as a strike's motion shows it; None if the motion has no strike phase.

    It is the impact to which the fitted pendulum leads back, else the first frame that moves. None also if
    no motion was measured.
    """
    if motion.angle is None or motion.phases is None or motion.phases.strike is None:
        return None
    time_ns, (first, last) = motion.angle.time_ns, motion.phases.strike
    impact = None if motion.fit is None else contact_time(motion.fit)
    if impact is None:
        return int(time_ns[first])
    # Whatever the fit says, not before the last frame at rest, nor after the begin of the free motion.
    low, high = time_ns[max(first - 1, 0)], time_ns[min(last, len(time_ns) - 1)]
    return int(np.clip(impact.time_ns, low, high))


def balance_moment(motion: TipMotion | None, contact_ns: int | None) -> float:
    """Time since contact [s] at which the object is at its balance; 0.2 s if not known.

    It is the end of stage one, the free motion up to the balance, or up to its end if the balance is not
    reached. 0.2 s is returned if no tipping angle was measured or stage one did not occur.

    Args:
        motion: motion of the strike; None if there is none.
        contact_ns: log time of the contact [ns]; None if there is no strike.
    """
    if (
        motion is None
        or contact_ns is None
        or motion.angle is None
        or motion.phases is None
        or motion.phases.stage_one is None
    ):
        return 0.2
    time_ns = motion.angle.time_ns
    return float(time_ns[min(motion.phases.stage_one[1], len(time_ns) - 1)] - contact_ns) * 1e-9


def measured_curves(angle: TipAngle) -> MotionCurves:
    """Measured tipping angle [rad] with its rate [rad/s] and acceleration [rad/s^2], each (n,).

    They are those at the n log times [ns] of `angle`, the measured angle of one strike; n is at least 2.
    """
    time = (angle.time_ns - angle.time_ns[0]).astype(np.float64) * 1e-9
    _, alpha = angular_acceleration(angle, MotionSettings().smoothing_points)
    return MotionCurves(angle.time_ns, angle.theta, np.gradient(angle.theta, time), alpha)


def fitted_curves(angle: TipAngle, fit: MotionFit) -> FittedCurves | None:
    """Fitted tipping angle, its rate, acceleration and residual, at the frames of the fit's window.

    All are arrays (n,), with the frames' log times [ns]; angle and residual (measured minus fitted) in rad,
    rate in rad/s, acceleration in rad/s^2, the last two as differences of the fitted angle. None if the fit
    has no k (rate constant of the motion), or if its window, the n frames that were fitted, has fewer than
    three. `angle` is the measured tipping angle that was fitted.
    """
    first, last = fit.window
    time_ns = angle.time_ns[first:last]
    if fit.k is None or len(time_ns) < 3:
        return None
    theta, time = angle.theta[first:last] - fit.residual, (time_ns - time_ns[0]) * 1e-9
    omega = np.gradient(theta, time, edge_order=2)
    return FittedCurves(time_ns, theta, omega, np.gradient(omega, time, edge_order=2), fit.residual)


def fitted_angle(angle: TipAngle, fit: MotionFit, fitted: FittedCurves) -> TipAngle:
    """Measured tipping motion, with the fitted tipping angle theta in place of the measured one.

    It has the frames that `fit` was made from. Time and theta [rad] are those of `fitted`, the curve of
    `fit`. Standard deviation, rotation off the axis and slip are copied from `angle`, the measured motion.
    """
    first, last = fit.window
    return TipAngle(
        fitted.time_ns,
        fitted.theta,
        angle.sd[first:last],
        angle.off_axis[first:last],
        angle.slip[first:last],
        angle.zero_sd,
    )


def angle_at(angle: TipAngle, time_ns: IntArray, theta: Array) -> TipAngle:
    """Tipping motion at other times, with given angles and the measured motion's other fields, interpolated.

    Args:
        angle: measured motion.
        time_ns: (n,) log times [ns].
        theta: (n,) tipping angles [rad] at these times.
    """
    sd, off_axis, slip = (
        np.interp(time_ns, angle.time_ns, each) for each in (angle.sd, angle.off_axis, angle.slip)
    )
    return replace(angle, time_ns=time_ns, theta=theta, sd=sd, off_axis=off_axis, slip=slip)


def object_poses(
    planned: PlannedStrike,
    angle: TipAngle,
    flank: SupportFunction | None = None,
    rest: tuple[Array, Array] | None = None,
) -> tuple[Array, Array]:
    """Poses of a tipping object at n frames: the frame O of its shape file in the world frame W.

    The rest pose is turned by the tipping angle theta about the pivot line, which lies along W's y axis, and
    moved along x by rolling and slip; rolling on a flank moves it along z as well.

    Args:
        planned: planned strike, with pivot and pose.
        angle: measured or fitted tipping angle and slip; slip is the displacement in addition to rolling.
        flank: support function of the curved flank on which the object rolls: the contact's height over the
            table by tipping angle; None if it rolls on the rounding of its pivot edge.
        rest: R_world_object (3, 3) and p_world_object (3,) [m] at theta = 0; the planned pose if None.

    Returns:
        Rotations R_world_object (n, 3, 3), and positions p_world_object (n, 3) [m] of O's origin.
    """
    R_rest, p_rest = rest or (np.array(planned.R_world_object), np.array(planned.p_world_object))
    pivot = R_rest @ np.array(planned.pivot.point) + p_rest
    turn = matrix_from_vector(np.outer(angle.theta, [0.0, 1.0, 0.0]))
    moved = np.outer(angle.slip, [1.0, 0.0, 0.0])
    if flank is None:  # The object rolls on the edge's rounding; slip is measured relative to this.
        moved[:, 0] += planned.pivot.radius_m * angle.theta
    else:
        along, over = flank.rolling_displacement(angle.theta)
        moved = moved + np.stack([along, np.zeros_like(along), over], axis=-1)
    return turn @ R_rest, turn @ (p_rest - pivot) + pivot + moved


def spread(places: Array, apart: float) -> Array:
    """Places (n,) on a line, moved as little as possible (least squares) to be at least `apart` apart."""
    order, steps = np.argsort(places, kind="stable"), apart * np.arange(len(places))
    moved = np.empty(len(places))
    moved[order] = isotonic_regression(places[order] - steps).x + steps
    return moved


def plane_section(model: ObjectModel, point: Array, normal: Array, margin: float = 1.12) -> Array:
    """Polygon in which a plane cuts the object's convex hull, enlarged so that it can be seen.

    Args:
        model: exterior of the object.
        point: (3,) point on the plane, in O, the object's frame [m].
        normal: (3,) unit normal of the plane, in O.
        margin: factor by which the polygon is enlarged about its centre.

    Returns:
        Corners (n, 3) in O [m], in order around the polygon; (0, 3) if the plane misses the hull, or
        touches only a corner or an edge of it.
    """
    hull = ConvexHull(model.hull_vertices)
    edges = np.unique(np.sort(hull.simplices[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1), axis=0)
    height = (model.hull_vertices - point) @ normal
    a, b = height[edges[:, 0]], height[edges[:, 1]]
    crossing = a * b < 0
    fraction = (a[crossing] / (a[crossing] - b[crossing]))[:, None]
    corners = (
        model.hull_vertices[edges[crossing, 0]] * (1 - fraction)
        + model.hull_vertices[edges[crossing, 1]] * fraction
    )
    corners = np.concatenate([corners, model.hull_vertices[np.abs(height) < 1e-9]])
    if len(corners) < 3:
        return np.zeros((0, 3))
    centre = corners.mean(axis=0)
    right = np.linalg.svd(corners - centre)[2][0]
    up = np.cross(normal, right)
    order = np.argsort(np.arctan2((corners - centre) @ up, (corners - centre) @ right))
    return centre + margin * (corners[order] - centre)


def fan_triangles(corners: Array) -> IntArray:
    """Vertex indices (n - 2, 3) of triangles that fill a convex polygon with n corners, `corners` (n, 3)."""
    i = np.arange(1, len(corners) - 1)
    return np.stack([np.zeros_like(i), i, i + 1], axis=1)


def ellipsoid(covariance: Array, least: float) -> tuple[Array, Array]:
    """Half axes of the 95 % ellipsoid of an uncertain point, and their directions.

    A half axis is 2.795 sd (square root of chi squared with 3 degrees of freedom).

    Args:
        covariance: (3, 3) covariance of the point [m²].
        least: smallest half axis [m]; shorter ones are enlarged to it.

    Returns:
        Half axes (3,) [m], ascending; and rotation (3, 3) with their unit directions as columns.
    """
    values, vectors = np.linalg.eigh(covariance)
    vectors = vectors * np.sign(np.linalg.det(vectors))
    return np.maximum(2.795 * np.sqrt(np.maximum(values, 0.0)), least), vectors


def _thinned(points: Array) -> Array:
    """Random sample of at most 700 of the points (n, 3), the same one in every run.

    Points of a regular grid would shimmer when the view is turned.
    """
    return np.random.default_rng(0).permutation(points)[:_MAX_REGION_POINTS]
