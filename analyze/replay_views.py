"""What a replay shows, as plain arrays: poses, curves, polygons. No viewer here."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial import ConvexHull

from analyze.geometry.rotations import matrix_from_vector
from analyze.types import Array, CentreOfMass, EquiPlane, IntArray, MarkerTrack, MotionFit, Phases, TipAngle, TipMotion
from schemas.result import Result, Verdict
from schemas.strike_plan import PlannedStrike, StrikePlan

if TYPE_CHECKING:
    from analyze.geometry.object_model import ObjectModel
    from analyze.motion.flank import Flank
    from analyze.pipeline import Estimate

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
class ReplayContent:
    """Everything beside the recording itself that a replay draws. What is not known is left empty."""

    model: ObjectModel
    plan: StrikePlan
    motions: tuple[TipMotion, ...]
    tracks: Mapping[str, tuple[MarkerTrack, ...]] = field(default_factory=dict)
    """by strike id"""
    result: Result | None = None
    planes: tuple[EquiPlane, ...] = ()
    com: CentreOfMass | None = None
    regions: tuple[Region, ...] = ()

    def planned(self, motion: TipMotion) -> PlannedStrike | None:
        """The plan's entry for a strike."""
        return next((strike for strike in self.plan.strikes if strike.id == motion.plan_strike_id), None)

    def front(self) -> TipMotion | None:
        """The strike that is shown first: a good one, else one that was fitted."""
        fitted = [motion for motion in self.motions if motion.fit is not None and motion.angle is not None]
        return next((motion for motion in fitted if motion.verdict is Verdict.GOOD), fitted[0] if fitted else None)


@dataclass(frozen=True)
class Curves:
    """A strike's motion over time."""

    time_ns: IntArray
    """(n,) log times"""
    theta: Array
    """(n,) rad"""
    omega: Array
    """(n,) rad/s, central differences"""


@dataclass(frozen=True)
class FittedCurves:
    """What the fit says of the same motion, within its window."""

    time_ns: IntArray
    """(m,)"""
    theta: Array
    """(m,) rad"""
    omega: Array
    """(m,) rad/s"""
    residual: Array
    """(m,) rad, measured - fitted"""


def content_of(estimate: Estimate) -> ReplayContent:
    """What an estimate has to show."""
    evidence, distribution, cells = estimate.evidence, estimate.distribution, estimate.cells
    upper = cells.points @ distribution.border_normal > distribution.border_offset
    inside = cells.interior >= cells.wall
    members = (~inside, inside & upper, inside & ~upper)
    regions = tuple(
        Region(name, float(mass), _thinned(cells.points[member]))
        for name, mass, member in zip(distribution.names, distribution.masses, members, strict=False)
    )
    tracks = {strike: report.tracks for strike, report in evidence.tracking.items()}
    return ReplayContent(evidence.model, evidence.plan, evidence.motions, tracks, estimate.result, estimate.planes, estimate.com, regions)


def curves(angle: TipAngle) -> Curves:
    """Measured angle and rate."""
    time = (angle.time_ns - angle.time_ns[0]).astype(np.float64) * 1e-9
    omega = np.gradient(angle.theta, time) if len(time) > 1 else np.zeros_like(angle.theta)
    return Curves(angle.time_ns, angle.theta, omega)


def fitted_curves(angle: TipAngle, fit: MotionFit) -> FittedCurves | None:
    """The fit's own motion at the frames of its window, whatever its equation; None where it knows no k."""
    first, last = fit.window
    time_ns = angle.time_ns[first:last]
    if fit.k is None or len(time_ns) < 2:
        return None
    theta = angle.theta[first:last] - fit.residual
    return FittedCurves(time_ns, theta, np.gradient(theta, (time_ns - time_ns[0]) * 1e-9), fit.residual)


def object_poses(planned: PlannedStrike, angle: TipAngle, flank: Flank | None = None) -> tuple[Array, Array]:
    """R_world_object (n, 3, 3) and p_world_object (n, 3) m: the planned pose turned by theta about the pivot line, moved by slip.

    Args:
        planned: how it lay.
        angle: how it turned; its slip is against rolling where it rolls.
        flank: that it rolls on, by which the line itself moves.
    """
    R_rest, p_rest = np.array(planned.R_world_object), np.array(planned.p_world_object)
    pivot = R_rest @ np.array(planned.pivot.point) + p_rest
    turn = matrix_from_vector(np.outer(angle.theta, [0.0, 1.0, 0.0]))
    moved = np.outer(angle.slip, [1.0, 0.0, 0.0])
    if flank is not None:
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


def summary(result: Result | None, recording: Path) -> str:
    """Markdown: the answer in a few lines."""
    if result is None:
        return f"# {recording.name}\n\nNothing was estimated."
    used = sum(strike.used for strike in result.strikes)
    lines = [f"# {recording.name}", "", f"**{used} of {len(result.strikes)} strikes used**", "", "| | value | 1 sd |", "|---|---:|---:|"]
    centre, sd = result.centre_of_mass.value, result.centre_of_mass.sd
    if isinstance(centre, list):
        spread = sd if isinstance(sd, list) else [None] * 3
        lines += [
            f"| c {axis} | {1e3 * _number(c):.2f} mm | {_text(s, 1e3, '.2f')} |" for axis, c, s in zip("xyz", centre, spread, strict=False)
        ]
    for moment in result.moments:
        lines.append(
            f"| I edge {moment.axis_id} | {_text(moment.i_edge.value, 1e6, '.1f')} kg·mm² | {_text(moment.i_edge.sd, 1e6, '.1f')} |"
        )
    if result.regions is not None:
        lines += [
            f"| mass {r.name} | {_text(r.mass.value, 1e3, '.1f')} g | {_text(r.mass.sd, 1e3, '.1f')} |" for r in result.regions.regions
        ]
    lines += ["", *[f"- *{warning.text}*" for warning in result.warnings]]
    return "\n".join(lines)


def strike_text(motion: TipMotion) -> str:
    """Markdown: one strike in a few lines."""
    lines = [f"## {motion.strike_id}", f"**{motion.verdict.value.replace('_', ' ')}** {motion.reason}", ""]
    for fit, used in ((motion.fit, "used"), *((other, "beside it") for other in motion.alternatives)):
        if fit is not None:
            sd = np.degrees(np.sqrt(fit.covariance[0, 0]))
            k = "" if fit.k is None else f", k = {fit.k:.2f} ± {np.sqrt(fit.covariance[1, 1]):.2f} s⁻²"
            lines.append(f"- `{fit.estimator}` ({used}): φ = {np.degrees(fit.phi):.3f}° ± {sd:.3f}°{k}")
    if motion.energy_ratio is not None:
        lines.append(f"- energy over what the tip needs: {motion.energy_ratio:.2f}")
    return "\n".join(lines)


def _thinned(points: Array) -> Array:
    """At most as many as a viewer draws easily, drawn at random: a regular grid would shimmer."""
    return np.random.default_rng(0).permutation(points)[:_MOST_POINTS]


def _number(value: object) -> float:
    return float(value) if isinstance(value, int | float) else float("nan")


def _text(value: object, factor: float, form: str) -> str:
    return format(factor * value, form) if isinstance(value, int | float) else "–"
