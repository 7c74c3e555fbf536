"""The paper's own estimators, faithful, so that its tables can be reproduced and printed beside ours (paper 3.2.2, 3.3)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from analyze.estimation.cells import Cells
from analyze.types import Array, EquiPlane, MotionFit, TipAngle, TipMotion

ERR = np.radians(1.85)
"""the paper's scatter of ang(t2), Fig. 9(a)"""
GRID = 24
ZOOMS = 5
I_STEPS = 11
I_RANGE = 0.05
"""dI / I, "the estimated error of the motion capturing system" """
BORDER_STEPS = 30
TIE = 1e-4
"""m: solutions whose c differ by less come equally close"""
SINGULAR = 1e-12
"""determinant of eq. (9)'s coefficients, in units of the pivot's distance from c, below which it is not solved"""
NEAR_BALANCE = np.radians(5.0)
"""eq. (5) is 0/0 at t2: this much on either side is left out"""
STAGE_TWO_SAMPLES = 12
REACH = 4
"""samples on either side that a smoothed second derivative hangs on: those at the ends of stage two are left out, or the landing enters"""


@dataclass(frozen=True)
class PaperCentre:
    """Centroid of the volume in which all regions R^E overlap."""

    position: Array
    """(3,) m, in O"""
    err: float
    """rad, half-angle of the regions: widened until they meet"""
    volume: float
    """m^3, of the overlap"""


def paper_centre_of_mass(planes: Sequence[EquiPlane], cells: Cells, err: float = ERR) -> PaperCentre:
    """Centre of mass by 3.2.2: centroid of all points in the body whose angle about each pivot is within `err` of that strike's phi.

    Where the regions do not meet, `err` grows by a quarter until they do.

    Args:
        planes: one per strike.
        cells: the body.
        err: rad.
    """
    while True:
        lower, upper = cells.points.min(axis=0) - cells.pitch / 2, cells.points.max(axis=0) + cells.pitch / 2
        inside = np.empty((0, 3))
        step = np.zeros(3)
        for _ in range(ZOOMS):
            step = (upper - lower) / GRID
            grid = _grid(lower, step)
            # Half a cell's diagonal may reach in where the cell's centre does not; about each pivot as far as it is from that.
            reaching, within = _overlap(planes, grid, err, float(np.linalg.norm(step)) / 2)
            near, inside = grid[reaching], grid[within]
            if not len(near):
                break
            lower, upper = near.min(axis=0) - step / 2, near.max(axis=0) + step / 2
        if len(inside):
            return PaperCentre(inside.mean(axis=0), float(err), float(len(inside) * np.prod(step)))
        err *= 1.25


def _grid(lower: Array, step: Array) -> Array:
    axes = [lower[i] + step[i] * (np.arange(GRID) + 0.5) for i in range(3)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)


def _overlap(planes: Sequence[EquiPlane], points: Array, err: float, reach: float) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Which of `points` (n, 3) come within `reach` [m] of all regions' overlap, about each pivot, and which lie in it."""
    reaching, within = np.ones(len(points), dtype=bool), np.ones(len(points), dtype=bool)
    for plane in planes:
        arm = points - plane.point
        # As standing_angle has it; the distance from the pivot comes of the same two lengths.
        back, up = -(arm @ np.cross(plane.direction, plane.up)), arm @ plane.up
        off = np.abs(np.arctan2(back, up) - plane.phi)
        reaching &= off <= err + reach / np.maximum(np.hypot(back, up), 1e-3)
        within &= off <= err
    return reaching, within


@dataclass(frozen=True)
class PaperInertia:
    """Eq. (5): mean over stage two of m*|g x r| / alpha."""

    i_edge: float
    """kg m^2"""
    left_out: float
    """part of stage two's samples too near balance, or with alpha <= 0"""


def paper_axis_inertia(plane: EquiPlane, motion: TipMotion, fit: MotionFit, com: Array, weight: float) -> PaperInertia | None:
    """I about a strike's edge by eq. (5), R measured to the paper's own centre of mass; None where stage two is too short.

    Args:
        plane: of the strike.
        motion: its theta(t).
        fit: gives phi.
        com: (3,) m, in O.
        weight: m*g [N].
    """
    if motion.angle is None or motion.phases is None or motion.phases.stage_two is None:
        return None
    return paper_edge_inertia(motion.angle, fit, motion.phases.stage_two, weight * distance_from(plane, com))


def distance_from(plane: EquiPlane, point: Array) -> float:
    """R [m], of a point (3,) from the plane's pivot."""
    arm = point - plane.point
    return float(np.linalg.norm(arm - plane.direction * (arm @ plane.direction)))


def paper_edge_inertia(angle: TipAngle, fit: MotionFit, stage_two: tuple[int, int], moment: float) -> PaperInertia | None:
    """I_edge by eq. (5) with alpha from theta differentiated twice; None where stage two is too short.

    Args:
        angle: the strike's theta.
        fit: gives phi.
        stage_two: index range.
        moment: m*g*R [N m].
    """
    start, stop = stage_two
    if stop - start < STAGE_TWO_SAMPLES:
        return None
    time = (angle.time_ns[start:stop] - angle.time_ns[start]) * 1e-9
    theta = angle.theta[start:stop]
    smooth = np.convolve(theta, np.ones(5) / 5, mode="valid")
    acceleration = np.gradient(np.gradient(smooth, time[2:-2]), time[2:-2])[2:-2]
    beyond = theta[REACH:-REACH] - fit.phi
    good = (beyond > NEAR_BALANCE) & (acceleration > 0)
    if not good.any():
        return None
    return PaperInertia(float(np.mean(moment * np.sin(beyond[good]) / acceleration[good])), float(1 - good.mean()))


@dataclass(frozen=True)
class PaperRegions:
    """Masses by eqs. (8), (9) and 3.3.2."""

    masses: Array
    """(3,) kg: surface, upper, lower; weighted mean over the axes, not made to sum to m (the paper's do not)"""
    border_normal: Array
    border_offset: float
    """of the axis that came closest to c"""
    corrected_i_edge: dict[str, float]
    """per axis: the moment whose solution came closest to c [kg m^2]"""


def paper_regions(planes: Sequence[EquiPlane], com: Array, i_edge: dict[str, float], mass: float, cells: Cells) -> PaperRegions | None:
    """Region masses by a sweep of the border plane and of I; None where no solution is positive.

    Readings where the paper is open: m_j is a region's mass (its sums are divided by N_j); the three parallel axes pass through the pivot,
    c, and the pivot's mirror image in c, thus lie on one line and fix the total mass; the plane
    sweeps along the body's principal directions.

    Args:
        planes: one per axis.
        com: (3,) m, taken as ground truth.
        i_edge: per axis [kg m^2].
        mass: kg.
        cells: the body.
    """
    sweep = _sweep(cells)
    found = [
        solution
        for plane in planes
        if plane.axis_id in i_edge and (solution := _axis_solution(plane, com, i_edge[plane.axis_id], mass, cells, sweep)) is not None
    ]
    if not found:
        return None
    weights = np.array([solution.areas for solution in found])
    masses = np.sum(weights * [solution.masses for solution in found], axis=0) / np.maximum(weights.sum(axis=0), 1e-12)
    closest = min(found, key=lambda solution: solution.error)
    corrected = {solution.axis_id: solution.i_edge for solution in found}
    return PaperRegions(masses, closest.normal, closest.offset, corrected)


@dataclass(frozen=True)
class _Solution:
    axis_id: str
    masses: Array
    areas: Array
    normal: Array
    offset: float
    i_edge: float
    error: float


@dataclass(frozen=True)
class _Sweep:
    """All places of the border plane, with what a kilogram in each of the three regions has."""

    normals: Array
    """(b, 3)"""
    offsets: Array
    """(b,) m"""
    centres: Array
    """(b, 3, 3) m, of the regions"""
    second: Array
    """(b, 3, 3, 3) m^2, their second moments about O; half of d^2/6 of eq. (8) is in each of the diagonal"""


def _sweep(cells: Cells) -> _Sweep:
    """Along the principal directions, where all three regions hold something."""
    normals: list[Array] = []
    offsets: list[float] = []
    for normal in cells.principal_directions():
        height = cells.points @ normal
        between = _between(float(height.min()), float(height.max()))
        normals += [normal] * len(between)
        offsets += between
    along, above = np.array(normals), np.array(offsets)
    # Rows: volume, first moments, second moments of every cell per volume.
    second = cells.points[:, :, None] * cells.points[:, None, :] + (cells.own / 2)[:, None, None] * np.eye(3)
    contents = np.column_stack([np.ones(len(cells.points)), cells.points, second.reshape(-1, 9)])
    upper = (along @ cells.points.T > above[:, None]).astype(np.float64) @ (cells.interior[:, None] * contents)
    wall = np.broadcast_to(cells.wall @ contents, upper.shape)
    parts = np.stack([wall, upper, cells.interior @ contents - upper], axis=1)
    kept = parts[:, :, 0].min(axis=1) >= cells.pitch**3
    parts = parts[kept]
    means = parts[:, :, 1:] / parts[:, :, :1]
    return _Sweep(along[kept], above[kept], means[:, :, :3], means[:, :, 3:].reshape(-1, 3, 3, 3))


def _moments(sweep: _Sweep, point: Array, direction: Array) -> Array:
    """(b, 3) m^2 of each region per kilogram about the line through `point` along `direction`: its coefficient in eq. (9)."""
    across = np.eye(3) - np.outer(direction, direction)
    about = np.einsum("brij,ij->br", sweep.second, across)
    return about - 2 * sweep.centres @ (across @ point) + point @ across @ point


def _axis_solution(plane: EquiPlane, com: Array, i_edge: float, mass: float, cells: Cells, sweep: _Sweep) -> _Solution | None:
    arm = com - plane.point
    arm = arm - plane.direction * (arm @ plane.direction)
    square = float(arm @ arm)
    lines = [plane.point, plane.point + arm, plane.point + 2 * arm]
    moments = np.stack([_moments(sweep, line, plane.direction) for line in lines], axis=1)
    solvable = np.abs(np.linalg.det(moments / square)) > SINGULAR
    values = i_edge * np.linspace(1 - I_RANGE, 1 + I_RANGE, I_STEPS)
    right = np.stack([values, values - mass * square, values], axis=0)
    masses = np.zeros((len(moments), 3, I_STEPS))
    masses[solvable] = np.linalg.solve(moments[solvable], np.broadcast_to(right, masses[solvable].shape))
    # (borders x values, 3), in the order of the sweep.
    masses = np.swapaxes(masses, 1, 2).reshape(-1, 3)
    good = (masses.min(axis=1) > 0) & (np.abs(masses.sum(axis=1) - mass) <= 0.02 * mass)
    if not good.any():
        return None
    masses, border = masses[good], np.repeat(np.arange(len(moments)), I_STEPS)[good]
    value = np.tile(values, len(moments))[good]
    centre = np.einsum("sr,sri->si", masses, sweep.centres[border]) / masses.sum(axis=1, keepdims=True)
    error = np.linalg.norm(centre - com, axis=1)
    # The three axes fix c along their line for every border, so that many solutions come equally close: then the I nearest the measured
    # one counts, and of its borders the middle one.
    tied = np.flatnonzero(error < error.min() + TIE)
    off = np.abs(value[tied] - i_edge)
    tied = tied[off <= off.min() + 1e-9 * i_edge]
    middle = int(tied[len(tied) // 2])
    normal, offset = sweep.normals[border[middle]], float(sweep.offsets[border[middle]])
    parts = _parts(cells, cells.points @ normal > offset)
    areas = np.array([_projected_area(cells, part, plane) for part in parts])
    return _Solution(plane.axis_id, masses[middle], areas, normal, offset, float(value[middle]), float(error[middle]))


def _between(low: float, high: float) -> list[float]:
    return [low + (high - low) * step / (BORDER_STEPS + 1) for step in range(1, BORDER_STEPS + 1)]


def _parts(cells: Cells, upper: NDArray[np.bool_]) -> tuple[Array, Array, Array]:
    return cells.wall, cells.interior * upper, cells.interior * ~upper


def _projected_area(cells: Cells, part: Array, plane: EquiPlane) -> float:
    forward = np.cross(plane.direction, plane.up)
    points = cells.points[part > 0]
    column, row = (np.round(points @ axis / cells.pitch).astype(np.int64) for axis in (forward, plane.up))
    pixels = np.unique((column - column.min()) * (int(np.ptp(row)) + 1) + row - row.min())
    return float(len(pixels) * cells.pitch**2)
