"""The paper's own estimators, faithful, so that its tables can be reproduced and printed beside ours (paper 3.2.2, 3.3)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from analyze.estimation.cells import Cells
from analyze.estimation.equiplane import standing_angle
from analyze.types import Array, CentreOfMass, EquiPlane, MotionFit, TipAngle

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
            off, arms = _off_angles(planes, grid), _arms(planes, grid)
            # Half a cell's diagonal may reach in where the cell's centre does not; about each pivot as far as it is from that.
            slack = float(np.linalg.norm(step)) / 2 / arms
            near = grid[np.all(off <= err + slack, axis=0)]
            inside = grid[np.all(off <= err, axis=0)]
            if not len(near):
                break
            lower, upper = near.min(axis=0) - step / 2, near.max(axis=0) + step / 2
        if len(inside):
            return PaperCentre(inside.mean(axis=0), float(err), float(len(inside) * np.prod(step)))
        err *= 1.25


def _grid(lower: Array, step: Array) -> Array:
    axes = [lower[i] + step[i] * (np.arange(GRID) + 0.5) for i in range(3)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)


def _off_angles(planes: Sequence[EquiPlane], points: Array) -> Array:
    """(planes, n) rad, of each point from each equi-plane, about its pivot."""
    return np.abs([standing_angle(points, plane.direction, plane.up, plane.point) - plane.phi for plane in planes])


def _arms(planes: Sequence[EquiPlane], points: Array) -> Array:
    """(planes, n) m, of each point from each pivot, and a millimetre at least."""
    arms = [np.linalg.norm(np.cross(points - plane.point, plane.direction), axis=1) for plane in planes]
    return np.maximum(arms, 1e-3)


@dataclass(frozen=True)
class PaperInertia:
    """Eq. (5): mean over stage two of m*|g x r| / alpha."""

    i_edge: float
    """kg m^2"""
    left_out: float
    """part of stage two's samples too near balance, or with alpha <= 0"""


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


def paper_regions(
    planes: Sequence[EquiPlane], com: CentreOfMass, i_edge: dict[str, float], mass: float, cells: Cells
) -> PaperRegions | None:
    """Region masses by a sweep of the border plane and of I; None where no solution is positive.

    Readings where the paper is open: m_j is a region's mass (its sums are divided by N_j); the three parallel axes pass through the pivot,
    c, and the pivot's mirror image in c, thus lie on one line and fix the total mass; the plane
    sweeps along the body's principal directions.

    Args:
        planes: one per axis.
        com: section 4's, taken as ground truth.
        i_edge: per axis [kg m^2].
        mass: kg.
        cells: the body.
    """
    normals = list(cells.principal_directions())
    found = [
        solution
        for plane in planes
        if plane.axis_id in i_edge
        and (solution := _axis_solution(plane, com.position, i_edge[plane.axis_id], mass, cells, normals)) is not None
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


def _axis_solution(plane: EquiPlane, com: Array, i_edge: float, mass: float, cells: Cells, normals: Sequence[Array]) -> _Solution | None:
    arm = com - plane.point
    arm = arm - plane.direction * (arm @ plane.direction)
    distance = float(np.linalg.norm(arm))
    lines = [plane.point, plane.point + arm, plane.point + 2 * arm]
    # d^2/6 + r^2 of eq. (8), about each line; a region's mean is its coefficient in eq. (9).
    squares = [np.sum(np.cross(cells.points - line, plane.direction) ** 2, axis=1) + cells.own for line in lines]
    features = np.column_stack([*squares, cells.points])
    found: list[_Solution] = []
    for normal in normals:
        height = cells.points @ normal
        for offset in _between(float(height.min()), float(height.max())):
            parts = _parts(cells, height > offset)
            if min(float(part.sum()) for part in parts) < cells.pitch**3:
                continue
            means = np.array([part @ features / part.sum() for part in parts])
            moments, centres = means[:, :3].T, means[:, 3:]
            for value in i_edge * np.linspace(1 - I_RANGE, 1 + I_RANGE, I_STEPS):
                about_c = value - mass * distance**2
                try:
                    masses = np.linalg.solve(moments, [value, about_c, about_c + mass * distance**2])
                except np.linalg.LinAlgError:
                    continue
                if masses.min() <= 0 or abs(masses.sum() - mass) > 0.02 * mass:
                    continue
                error = float(np.linalg.norm(masses @ centres / masses.sum() - com))
                found.append(_Solution(plane.axis_id, masses, np.zeros(3), normal, offset, float(value), error))
    if not found:
        return None
    # The three axes fix c along their line for every border, so that many solutions come equally close: then the I nearest the measured
    # one counts, and of its borders the middle one.
    closest = min(solution.error for solution in found)
    tied = [solution for solution in found if solution.error < closest + TIE]
    nearest = min(abs(solution.i_edge - i_edge) for solution in tied)
    tied = [solution for solution in tied if abs(solution.i_edge - i_edge) <= nearest * (1 + 1e-9)]
    middle = tied[len(tied) // 2]
    parts = _parts(cells, cells.points @ middle.normal > middle.offset)
    return replace(middle, areas=np.array([_projected_area(cells, part, plane) for part in parts]))


def _between(low: float, high: float) -> list[float]:
    return [low + (high - low) * step / (BORDER_STEPS + 1) for step in range(1, BORDER_STEPS + 1)]


def _parts(cells: Cells, upper: NDArray[np.bool_]) -> tuple[Array, Array, Array]:
    return cells.wall, cells.interior * upper, cells.interior * ~upper


def _projected_area(cells: Cells, part: Array, plane: EquiPlane) -> float:
    forward = np.cross(plane.direction, plane.up)
    points = cells.points[part > 0]
    pixels = np.unique(np.round(np.column_stack([points @ forward, points @ plane.up]) / cells.pitch).astype(int), axis=0)
    return float(len(pixels) * cells.pitch**2)
