"""What a replay shows, as plain arrays: poses, curves, polygons. No viewer here."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial import ConvexHull

from analyze.geometry.rotations import matrix_from_vector
from analyze.motion.fit_choice import MotionSettings
from analyze.motion.sign_change import angular_acceleration
from analyze.types import Array, CentreOfMass, EquiPlane, IntArray, MotionFit, Phases, TipAngle, TipMotion
from schemas.result import Result
from schemas.strike_plan import PlannedStrike

if TYPE_CHECKING:
    from analyze.estimation.voxel_map import VoxelMap
    from analyze.geometry.object_model import ObjectModel
    from analyze.motion.flank import Flank
    from analyze.pipeline.estimate import Estimate

_MOST_POINTS = 700
_PHASE_NAMES = ("rest", "strike", "stage_one", "stage_two", "landing")


@dataclass(frozen=True)
class Region:
    """Cells of one region, in O."""

    name: str
    mass: float
    """kg"""
    points: Array
    """(n, 3) m"""


@dataclass(frozen=True)
class Answer:
    """What is drawn of an estimate."""

    result: Result
    planes: tuple[EquiPlane, ...]
    com: CentreOfMass
    regions: tuple[Region, ...]
    voxels: VoxelMap | None = None


@dataclass(frozen=True)
class Curves:
    """A strike's motion over time."""

    time_ns: IntArray
    """(n,) log times"""
    theta: Array
    """(n,) rad"""
    omega: Array
    """(n,) rad/s, central differences"""
    alpha: Array
    """(n,) rad/s^2, twice differentiated and smoothed as the paper's estimator has it"""


@dataclass(frozen=True)
class FittedCurves:
    """What the fit says of the same motion, within its window."""

    time_ns: IntArray
    """(m,)"""
    theta: Array
    """(m,) rad"""
    omega: Array
    """(m,) rad/s"""
    alpha: Array
    """(m,) rad/s^2"""
    residual: Array
    """(m,) rad, measured - fitted"""


def answer_of(estimate: Estimate) -> Answer:
    """What an estimate has to show."""
    distribution, cells = estimate.distribution, estimate.cells
    upper = cells.points @ distribution.border_normal > distribution.border_offset
    inside = cells.interior >= cells.wall
    members = (~inside, inside & upper, inside & ~upper)
    regions = tuple(
        Region(name, float(mass), _thinned(cells.points[member]))
        for name, mass, member in zip(distribution.names, distribution.masses, members, strict=False)
    )
    return Answer(estimate.result, estimate.planes, estimate.com, regions, estimate.voxels)


def moment_of(motion: TipMotion | None) -> float:
    """A moment [s since contact] that shows something: when the object stands on its edge."""
    if motion is not None and motion.angle is not None and motion.phases is not None and motion.phases.stage_one is not None:
        first, last = motion.phases.stage_one
        time_ns = motion.angle.time_ns
        return float(time_ns[min(last, len(time_ns) - 1)] - time_ns[first]) * 1e-9
    return 0.2


def curves(angle: TipAngle) -> Curves:
    """Measured angle, rate and acceleration."""
    if len(angle.time_ns) < 2:
        return Curves(angle.time_ns, angle.theta, np.zeros_like(angle.theta), np.zeros_like(angle.theta))
    time = (angle.time_ns - angle.time_ns[0]).astype(np.float64) * 1e-9
    _, alpha = angular_acceleration(angle, MotionSettings().smoothing_points)
    return Curves(angle.time_ns, angle.theta, np.gradient(angle.theta, time), alpha)


def fitted_curves(angle: TipAngle, fit: MotionFit) -> FittedCurves | None:
    """The fit's own motion at the frames of its window, whatever its equation; None where it knows no k."""
    first, last = fit.window
    time_ns = angle.time_ns[first:last]
    if fit.k is None or len(time_ns) < 3:
        return None
    theta, time = angle.theta[first:last] - fit.residual, (time_ns - time_ns[0]) * 1e-9
    omega = np.gradient(theta, time, edge_order=2)
    return FittedCurves(time_ns, theta, omega, np.gradient(omega, time, edge_order=2), fit.residual)


def at_fit(angle: TipAngle, fit: MotionFit, fitted: FittedCurves) -> TipAngle:
    """The angle as fitted, at the frames of the fit's window; what the fit does not say of them is as measured."""
    first, last = fit.window
    return TipAngle(fitted.time_ns, fitted.theta, angle.sd[first:last], angle.off_axis[first:last], angle.slip[first:last], angle.zero_sd)


def object_poses(
    planned: PlannedStrike, angle: TipAngle, flank: Flank | None = None, rest: tuple[Array, Array] | None = None
) -> tuple[Array, Array]:
    """R_world_object (n, 3, 3) and p_world_object (n, 3) m: the rest pose turned by theta about the pivot line, moved by rolling and slip.

    Args:
        planned: how it lay.
        angle: how it turned; its slip is against rolling where it rolls.
        flank: that it rolls on, by which the line itself moves.
        rest: R_world_object (3, 3) and p_world_object (3,) m at theta = 0; as planned where it is not given.
    """
    R_rest, p_rest = rest or (np.array(planned.R_world_object), np.array(planned.p_world_object))
    pivot = R_rest @ np.array(planned.pivot.point) + p_rest
    turn = matrix_from_vector(np.outer(angle.theta, [0.0, 1.0, 0.0]))
    moved = np.outer(angle.slip, [1.0, 0.0, 0.0])
    if flank is None:  # it rolls on the edge's rounding, against which slip is measured
        moved[:, 0] += planned.pivot.radius_m * angle.theta
    else:
        along, over = flank.rolled(angle.theta)
        moved = moved + np.stack([along, np.zeros_like(along), over], axis=-1)
    return turn @ R_rest, turn @ (p_rest - pivot) + pivot + moved


def spans(phases: Phases) -> list[tuple[str, int, int]]:
    """(name, start, stop) of the phases that occurred, as index ranges."""
    found = [(name, getattr(phases, name)) for name in _PHASE_NAMES]
    return [(name, window[0], window[1]) for name, window in found if window is not None]


def section(model: ObjectModel, point: Array, normal: Array, margin: float = 1.12) -> Array:
    """Where a plane through `point` (3,) with unit `normal` (3,) cuts the hull: corners (n, 3) in order; (0, 3): nowhere.

    Enlarged by `margin` about its middle, so that it can be seen.
    """
    hull = ConvexHull(model.hull_vertices)
    edges = np.unique(np.sort(hull.simplices[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1), axis=0)
    height = (model.hull_vertices - point) @ normal
    a, b = height[edges[:, 0]], height[edges[:, 1]]
    crossing = a * b < 0
    share = (a[crossing] / (a[crossing] - b[crossing]))[:, None]
    corners = model.hull_vertices[edges[crossing, 0]] * (1 - share) + model.hull_vertices[edges[crossing, 1]] * share
    corners = np.concatenate([corners, model.hull_vertices[np.abs(height) < 1e-9]])
    if len(corners) < 3:
        return np.zeros((0, 3))
    centre = corners.mean(axis=0)
    right = np.linalg.svd(corners - centre)[2][0]
    up = np.cross(normal, right)
    order = np.argsort(np.arctan2((corners - centre) @ up, (corners - centre) @ right))
    return centre + margin * (corners[order] - centre)


def fan(corners: Array) -> IntArray:
    """Triangles (n - 2, 3) of a convex polygon (n, 3)."""
    i = np.arange(1, len(corners) - 1)
    return np.stack([np.zeros_like(i), i, i + 1], axis=1)


def ellipsoid(covariance: Array, least: float) -> tuple[Array, Array]:
    """Half axes (3,) m of the 95 % ellipsoid (chi2 with 3 degrees of freedom: 2.795 sd), at least `least`; directions (3, 3), columns."""
    values, vectors = np.linalg.eigh(covariance)
    vectors = vectors * np.sign(np.linalg.det(vectors))
    return np.maximum(2.795 * np.sqrt(np.maximum(values, 0.0)), least), vectors


def _thinned(points: Array) -> Array:
    """At most as many as a viewer draws easily, drawn at random: a regular grid would shimmer."""
    return np.random.default_rng(0).permutation(points)[:_MOST_POINTS]
