"""The paper's estimators (VISAPP 2013, 3.2.2, 3.3); one file, to be read beside the paper.

They serve for comparison, and give the centre of mass, moments about edges, and masses of the shell and of
two parts of the interior.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from analyze.estimation.cells import Cells
from analyze.types import Array, EquiPlane, MotionFit, TipMotion

REGION_HALF_ANGLE = np.radians(1.85)
"""Half-angle of the regions R^E [rad]: the paper's scatter of ang(t2), Fig. 9(a)."""
GRID_POINTS = 24
"""Grid points per side in the search for the regions' overlap."""
GRID_REFINEMENTS = 5
"""Number of refinements of that grid."""
I_STEPS = 11
"""Number of values of I (moment about the edge) tried."""
I_RANGE = 0.05
"""Relative half range dI / I of the values tried: "the estimated error of the motion capturing system"."""
PLANE_STEPS = 30
"""Positions of the dividing plane per sweep direction."""
TIE_DISTANCE = 1e-4
"""Difference [m] in distance to c below which solutions count as equally close."""
MIN_DETERMINANT = 1e-12
"""Determinant of eq. (9)'s coefficients, in units of the squared distance of the pivot from c, below which it
is not solved."""
MIN_ANGLE_PAST_BALANCE = np.radians(5.0)
"""Smallest angle [rad] past phi of the samples used: eq. (5) is 0/0 at t2, where theta = phi."""
MIN_STAGE_TWO_SAMPLES = 12
"""Smallest number of samples of stage two."""
DERIVATIVE_REACH = 4
"""Samples on either side that a smoothed second derivative depends on; as many are excluded at both ends of
stage two, so that the landing has no effect."""


@dataclass(frozen=True)
class PaperCentre:
    """The paper's centre of mass: centroid of the volume in which all regions R^E overlap.

    The region R^E of a strike is a wedge about its equi-plane (the plane through pivot line and centre of
    mass), with the pivot line as its edge. `err` is the wedges' half-angle, widened until they overlap.
    """

    position: Array
    """(3,) centre of mass [m], in the object frame O."""
    err: float
    """Half-angle of the regions [rad], widened until they overlap."""
    volume: float
    """Volume of the overlap [m^3]."""


def paper_centre_of_mass(
    planes: Sequence[EquiPlane], cells: Cells, err: float = REGION_HALF_ANGLE
) -> PaperCentre:
    """Centre of mass by the paper's intersection of regions (VISAPP 2013, 3.2.2).

    A region is a wedge along a strike's pivot line. The result is the centroid of all points of the body's
    bounding box whose angle about each pivot is within `err` of that strike's balance angle phi. If there is
    no such point, `err` grows by a quarter until there is one.

    Args:
        planes: Equi-planes (planes through pivot line and centre of mass, given by pivot line and phi) in the
            object frame O, one per strike.
        cells: Cells of the body, of which only the bounding box counts.
        err: Half-angle of the regions [rad].

    Returns:
        Centre of mass in O [m], with the half-angle reached [rad] and the volume of the overlap [m^3].
    """
    while True:
        lower, upper = cells.points.min(axis=0) - cells.pitch / 2, cells.points.max(axis=0) + cells.pitch / 2
        inside = np.empty((0, 3))
        step = np.zeros(3)
        for _ in range(GRID_REFINEMENTS):
            step = (upper - lower) / GRID_POINTS
            grid = _grid(lower, step)
            # A grid cell may overlap by half its diagonal where its centre does not.
            reaching, within = _overlap(planes, grid, err, float(np.linalg.norm(step)) / 2)
            near, inside = grid[reaching], grid[within]
            if not len(near):
                break
            lower, upper = near.min(axis=0) - step / 2, near.max(axis=0) + step / 2
        if len(inside):
            return PaperCentre(inside.mean(axis=0), float(err), float(len(inside) * np.prod(step)))
        err *= 1.25


def _grid(lower: Array, step: Array) -> Array:
    """Centres (n, 3) [m] of the cells of a grid with `GRID_POINTS` cells along each side.

    The grid begins at the corner `lower` (3,) [m]; `step` (3,) are the edges of a cell along x, y and z [m].
    The centres are in the frame of `lower`; z varies fastest.
    """
    axes = [lower[i] + step[i] * (np.arange(GRID_POINTS) + 0.5) for i in range(3)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)


def _overlap(
    planes: Sequence[EquiPlane], points: Array, err: float, reach: float
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Two masks (n,) of points: True within `reach` of every region, and True inside every region.

    The region of a strike holds the points whose angle about the pivot is within `err` of the balance angle.

    Args:
        planes: Equi-planes of the strikes, one per region, for pivot and balance angle.
        points: (n, 3) points [m], in the object frame O.
        err: Half-angle of the regions [rad].
        reach: Distance from a region within which a point still counts in the first mask [m].
    """
    reaching, within = np.ones(len(points), dtype=bool), np.ones(len(points), dtype=bool)
    for plane in planes:
        arm = points - plane.point
        # The angle of equiplane.standing_angle; the distance from the pivot uses the same two lengths.
        back, up = -(arm @ np.cross(plane.direction, plane.up)), arm @ plane.up
        off = np.abs(np.arctan2(back, up) - plane.phi)
        reaching &= off <= err + reach / np.maximum(np.hypot(back, up), 1e-3)
        within &= off <= err
    return reaching, within


@dataclass(frozen=True)
class PaperInertia:
    """Moment of inertia about an edge by the paper's mean over stage two (VISAPP 2013, eq. 5).

    Stage two is the motion after balance. The moment is the mean of m norm(g x r) / alpha, with m the mass, g
    gravity, alpha the angular acceleration and r the arm from edge to centre of mass.
    """

    i_edge: float
    """Moment of inertia about the edge [kg m^2]."""
    excluded_share: float
    """Fraction of stage two's samples, without those at its ends, that are too near balance or have
    alpha <= 0, and are excluded."""


def paper_axis_inertia(
    plane: EquiPlane, motion: TipMotion, fit: MotionFit, com: Array, weight: float
) -> PaperInertia | None:
    """Moment of inertia about a strike's edge by VISAPP 2013, eq. 5, for a given centre of mass.

    It is the mean of m g R sin(theta - phi) / alpha over samples of stage two, the motion after balance. m g
    is the weight, R the distance of the centre of mass from the edge, phi the balance angle; alpha is the
    tipping angle theta differentiated twice. Samples count if they are further than `MIN_ANGLE_PAST_BALANCE`
    past phi and have alpha > 0.

    Args:
        plane: Equi-plane of the strike (plane through pivot line and centre of mass), for its pivot line.
        motion: Motion of the strike, with the tipping angle theta(t).
        fit: Fit of the motion, for the balance angle phi.
        com: (3,) centre of mass [m], in the object frame O.
        weight: Weight m g of the object [N].

    Returns:
        The moment [kg m^2] and the share of samples excluded; None if stage two is missing or has fewer than
        `MIN_STAGE_TWO_SAMPLES` samples, or no sample is usable.
    """
    angle = motion.angle
    if angle is None or motion.phases is None or motion.phases.stage_two is None:
        return None
    start, stop = motion.phases.stage_two
    if stop - start < MIN_STAGE_TWO_SAMPLES:
        return None
    time = (angle.time_ns[start:stop] - angle.time_ns[start]) * 1e-9
    theta = angle.theta[start:stop]
    smooth = np.convolve(theta, np.ones(5) / 5, mode="valid")
    acceleration = np.gradient(np.gradient(smooth, time[2:-2]), time[2:-2])[2:-2]
    beyond = theta[DERIVATIVE_REACH:-DERIVATIVE_REACH] - fit.phi
    good = (beyond > MIN_ANGLE_PAST_BALANCE) & (acceleration > 0)
    if not good.any():
        return None
    moment = weight * distance_from_pivot(plane, com)
    return PaperInertia(
        float(np.mean(moment * np.sin(beyond[good]) / acceleration[good])), float(1 - good.mean())
    )


def distance_from_pivot(plane: EquiPlane, point: Array) -> float:
    """Distance R [m] of `point` (3,) [m, in the object frame O] from a strike's pivot line."""
    arm = point - plane.point
    return float(np.linalg.norm(arm - plane.direction * (arm @ plane.direction)))


@dataclass(frozen=True)
class PaperRegions:
    """Result of the paper's method for masses [kg] of shell, upper and lower part (VISAPP 2013, 3.3.2).

    It also holds the plane that divides the interior into upper and lower part, and for each pivot axis the
    corrected moment: the moment of inertia about the edge [kg m^2], near the measured one, that goes with the
    masses found.
    """

    masses: Array
    """(3,) masses of shell, upper and lower part [kg]; weighted mean over the axes, whose sum is not m (as in
    the paper)."""
    dividing_plane_normal: Array
    """(3,) unit normal in the object frame O, towards the upper part; from the axis whose solution has its
    centre of mass closest to the given one."""
    dividing_plane_offset: float
    """Offset [m] along the normal from O's origin, from that axis too."""
    corrected_i_edge: dict[str, float]
    """The paper's corrected moment about the edge [kg m^2] by axis id: that of each axis's own solution."""


def paper_regions(
    planes: Sequence[EquiPlane], com: Array, i_edge: dict[str, float], mass: float, cells: Cells
) -> PaperRegions | None:
    """Masses of shell, upper and lower interior by the method of VISAPP 2013, 3.3.2.

    The plane that divides the interior, and the moment of inertia about the pivot edge, are swept over ranges
    of values. The paper is read as follows where it is ambiguous:

    - m_j is the mass of region j: the sums over the N_j voxels of a region, which multiply m_j in eq. 9, are
      divided by N_j;
    - the three parallel axes pass through the pivot, the centre of mass c, and the pivot's mirror image in c;
      all three lie in one plane, and thus determine the total mass;
    - the dividing plane sweeps along the body's principal directions.

    Args:
        planes: Equi-planes (through pivot line and c) in the object frame O, one per axis, for their lines.
        com: (3,) centre of mass c [m, in O], taken as exact.
        i_edge: Moment of inertia about the edge by axis id [kg m^2]; axes without one are left out.
        mass: Mass of the object [kg].
        cells: Cells of the body.

    Returns:
        Masses averaged over the axes, weighted by the regions' areas seen along each; the dividing plane of
        the axis whose solution has its centre of mass closest to c; and by axis the moment about the edge
        that the sweep chose (corrected moment). None if for no axis three positive masses add up to the mass
        within 2 %.
    """
    sweep = _sweep(cells)
    found = [
        solution
        for plane in planes
        if plane.axis_id in i_edge
        and (solution := _axis_solution(plane, com, i_edge[plane.axis_id], mass, cells, sweep)) is not None
    ]
    if not found:
        return None
    weights = np.array([solution.areas for solution in found])
    masses = np.sum(weights * [solution.masses for solution in found], axis=0) / np.maximum(
        weights.sum(axis=0), 1e-12
    )
    closest = min(found, key=lambda solution: solution.error)
    return PaperRegions(masses, closest.normal, closest.offset, {each.axis_id: each.i_edge for each in found})


@dataclass(frozen=True)
class _Solution:
    """Masses [kg] of shell, upper and lower interior for one pivot axis, by the paper's method.

    Of all possible masses and dividing planes for the axis, these put the centre of mass closest to the given
    one, c. The shell is the outer wall.
    """

    axis_id: str
    """Id of the pivot axis."""
    masses: Array
    """(3,) masses of shell, upper and lower part [kg]."""
    areas: Array
    """(3,) areas of the regions projected along the axis [m^2], the weights of the mean over axes."""
    normal: Array
    """(3,) unit normal of the dividing plane, in the object frame O."""
    offset: float
    """Offset of the dividing plane from O's origin along the normal [m]."""
    i_edge: float
    """Moment of inertia about the edge [kg m^2]."""
    error: float
    """Distance of the solution's centre of mass from c [m]."""


@dataclass(frozen=True)
class _Sweep:
    """All b tried planes that divide the interior, with centroids and moments of the regions they make.

    The regions are the shell, and the interior above and below the plane. Lengths are in the object frame O
    [m]; the moments are second moments about O's origin, per kilogram of the region [m^2].
    """

    normals: Array
    """(b, 3) unit normals, in the object frame O."""
    offsets: Array
    """(b,) offsets along the normals from O's origin [m]."""
    centres: Array
    """(b, 3, 3) centroids of the three regions [m], in O."""
    second: Array
    """(b, 3, 3, 3) second moments of the regions about O's origin [m^2]; each diagonal entry has half of eq.
    (8)'s d^2/6."""


def _sweep(cells: Cells) -> _Sweep:
    """Candidate planes that divide the interior, with centroids and second moments of the three regions.

    There are `PLANE_STEPS` evenly spaced planes along each principal direction of the body, each with unit
    normal and offset [m]. The regions are, in this order, the shell, and the interior above and below the
    plane; planes for which one of them has less volume than one voxel are left out. Centroids (3,) [m] are in
    the object frame O. Second moments (3, 3), the means of x x^T over a region [m^2], are about O's origin.

    Args:
        cells: Cells of the body.
    """
    normals: list[Array] = []
    offsets: list[float] = []
    for normal in cells.principal_directions():
        height = cells.points @ normal
        low, high = float(height.min()), float(height.max())
        normals += [normal] * PLANE_STEPS
        offsets += [low + (high - low) * step / (PLANE_STEPS + 1) for step in range(1, PLANE_STEPS + 1)]
    along, above = np.array(normals), np.array(offsets)
    # Rows: volume, first moments, second moments of every cell per volume.
    second = cells.points[:, :, None] * cells.points[:, None, :] + (cells.own_inertia / 2)[
        :, None, None
    ] * np.eye(3)
    contents = np.column_stack([np.ones(len(cells.points)), cells.points, second.reshape(-1, 9)])
    upper = (along @ cells.points.T > above[:, None]).astype(np.float64) @ (
        cells.interior[:, None] * contents
    )
    shell = np.broadcast_to(cells.shell @ contents, upper.shape)
    parts = np.stack([shell, upper, cells.interior @ contents - upper], axis=1)
    kept = parts[:, :, 0].min(axis=1) >= cells.pitch**3
    parts = parts[kept]
    means = parts[:, :, 1:] / parts[:, :, :1]
    return _Sweep(along[kept], above[kept], means[:, :, :3], means[:, :, 3:].reshape(-1, 3, 3, 3))


def _moments(sweep: _Sweep, point: Array, direction: Array) -> Array:
    """Moments of inertia (b, 3) [m^2] per kilogram of shell, upper and lower part, for b planes.

    `sweep` holds the planes, which divide the interior into the part above and the part below. The moments
    are the coefficients of VISAPP 2013, eq. 9. The axis passes through `point` (3,) [m] along the unit
    `direction` (3,), both in the object frame O.
    """
    across = np.eye(3) - np.outer(direction, direction)
    about = np.einsum("brij,ij->br", sweep.second, across)
    return about - 2 * sweep.centres @ (across @ point) + point @ across @ point


def _axis_solution(
    plane: EquiPlane, com: Array, i_edge: float, mass: float, cells: Cells, sweep: _Sweep
) -> _Solution | None:
    """Masses [kg] of shell, upper and lower interior by VISAPP 2013, eq. 9, for one pivot axis.

    Masses are possible if they give the right moments of inertia about three parallel lines: the pivot line,
    its parallel through `com`, and its mirror image in `com`. Of all possible masses and dividing planes,
    those are returned that put the centre of mass closest to `com`; of those equally close, the ones with the
    moment nearest to `i_edge`.

    Args:
        plane: Equi-plane (through pivot line and centre of mass) of a strike about the axis, for its pivot
            line.
        com: (3,) centre of mass [m], in the object frame O.
        i_edge: Measured moment about the edge [kg m^2]; values within the fraction `I_RANGE` of it are tried.
        mass: Mass of the object [kg].
        cells: The body divided into small cells, each of the shell (outer wall) or the interior.
        sweep: Dividing planes to try, with centroids and second moments of the regions that they make.

    Returns:
        Masses (3,) of shell, upper and lower part of the interior [kg], with the dividing plane in O, the
        moment about the edge [kg m^2] that goes with them and the distance [m] of their centre of mass from
        `com`; None if no solution has positive masses with the right sum, to 2 %.
    """
    arm = com - plane.point
    arm = arm - plane.direction * (arm @ plane.direction)
    square = float(arm @ arm)
    lines = [plane.point, plane.point + arm, plane.point + 2 * arm]
    # In units of the arm's square for both determinant and solution: what one finds regular, the other does.
    moments = np.stack([_moments(sweep, line, plane.direction) for line in lines], axis=1) / square
    solvable = np.abs(np.linalg.det(moments)) > MIN_DETERMINANT
    values = i_edge * np.linspace(1 - I_RANGE, 1 + I_RANGE, I_STEPS)
    right = np.stack([values, values - mass * square, values], axis=0) / square
    masses = np.zeros((len(moments), 3, I_STEPS))
    masses[solvable] = np.linalg.solve(moments[solvable], np.broadcast_to(right, masses[solvable].shape))
    # (planes x values, 3), in the order of the sweep.
    masses = np.swapaxes(masses, 1, 2).reshape(-1, 3)
    good = (masses.min(axis=1) > 0) & (np.abs(masses.sum(axis=1) - mass) <= 0.02 * mass)
    if not good.any():
        return None
    masses, place = masses[good], np.repeat(np.arange(len(moments)), I_STEPS)[good]
    value = np.tile(values, len(moments))[good]
    centre = np.einsum("sr,sri->si", masses, sweep.centres[place]) / masses.sum(axis=1, keepdims=True)
    error = np.linalg.norm(centre - com, axis=1)
    # The three axes fix c along one line for every dividing plane, so that many solutions are equally close:
    # then the I nearest the measured one counts, and of its planes the middle one.
    tied = np.flatnonzero(error < error.min() + TIE_DISTANCE)
    off = np.abs(value[tied] - i_edge)
    tied = tied[off <= off.min() + 1e-9 * i_edge]
    middle = int(tied[len(tied) // 2])
    normal, offset = sweep.normals[place[middle]], float(sweep.offsets[place[middle]])
    upper = cells.points @ normal > offset
    parts = cells.shell, cells.interior * upper, cells.interior * ~upper
    areas = np.array([_projected_area(cells, part, plane) for part in parts])
    return _Solution(
        plane.axis_id, masses[middle], areas, normal, offset, float(value[middle]), float(error[middle])
    )


def _projected_area(cells: Cells, part: Array, plane: EquiPlane) -> float:
    """Area [m^2] of a region (outer shell, upper or lower part inside) projected along the pivot axis.

    It is counted in squares with the edge of a cell (small cube of the body). `part` (n,) is the volume of
    each of the n cells that lies in the region [m^3]; `plane` gives the pivot axis.
    """
    forward = np.cross(plane.direction, plane.up)
    points = cells.points[part > 0]
    column, row = (np.round(points @ axis / cells.pitch).astype(np.int64) for axis in (forward, plane.up))
    pixels = np.unique((column - column.min()) * (int(np.ptp(row)) + 1) + row - row.min())
    return float(len(pixels) * cells.pitch**2)
