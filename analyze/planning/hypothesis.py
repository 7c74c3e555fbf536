"""Where the centre of mass may be before any strike: the region Q (paper 3.1.1), faithful and ours."""

# scipy is only partly typed; its unknowns are no mistakes of ours.
# pyright: reportMissingTypeStubs=false, reportUnknownVariableType=false, reportUnknownArgumentType=false, reportUnknownMemberType=false

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import ConvexHull

from analyze.geometry.even_samples import even_samples
from analyze.geometry.object_model import ObjectModel
from analyze.types import Array

UNEVEN_FILLING = 0.2
"""part of the half extent by which an unknown filling may shift c"""
SAMPLES_ACROSS = 36
"""surface samples along the body's size"""
NEEDLE = 0.5
"""part of the samples' spacing below whose width a triangle is only cut along its length"""
TIE = 1e-3
"""relative difference of two eigenvalues below which their directions are a free choice"""
ROUND = 0.05
"""the same where Q of ours is round across them, so that nothing hangs on the choice, nor on the noise that would make it"""
MOST_DIRECTIONS = 500
SIGNS = 60_000
"""of samples along directions, at a time: as many as the caches hold"""


@dataclass(frozen=True)
class Region:
    """Q in O, which is believed to hold c: a box; round (a cylinder, a ball) across axes that are in one group."""

    centre: Array
    """(3,) m"""
    axes: Array
    """(3, 3) rows are unit vectors, longest spread first"""
    half: Array
    """(3,) m, half edges along `axes`, radii where they are in one group"""
    groups: tuple[int, int, int] = (0, 1, 2)
    """of each axis"""

    def reach(self, directions: Array) -> Array:
        """How far Q extends from its centre along unit `directions` (k, 3), as (k,) [m]."""
        along = np.atleast_2d(directions) @ self.axes.T * self.half
        members = [[i for i in range(3) if self.groups[i] == group] for group in set(self.groups)]
        return np.sum([np.linalg.norm(along[:, each], axis=1) for each in members], axis=0)

    def covariance(self) -> Array:
        """Covariance (3, 3) [m^2] of c, if Q's half edges are two standard deviations."""
        return (self.axes.T * (self.half / 2) ** 2) @ self.axes


@dataclass(frozen=True)
class Hypothesis:
    """What the exterior says of the inside."""

    region: Region
    unit_inertia: Array
    """(3, 3) m^2 about the region's centre per kilogram, midway between a solid and a shell"""


def paper_hypothesis(points: Array) -> Region:
    """Q by eq. (1), as printed: half edges |sum_{v.e<0} |v| - sum_{v.e>0} |v|| + 1 in millimetres, v from the points' mean.

    The sum is not normalised, so Q grows with the number of points; clipped to the points' extent. Where eigenvalues tie (a square base),
    the paper leaves the axes open: here they are O's axes projected into the tied space, x before y before z.

    Args:
        points: (n, 3) m, the cloud P.
    """
    return _paper_region(points, 1.0)


def paper_hypothesis_of_means(points: Array) -> Region:
    """The same with means over all points in place of the sums, which does not depend on how many there are."""
    return _paper_region(points, 1.0 / len(points))


def _paper_region(points: Array, weight: float) -> Region:
    centre = points.mean(axis=0)
    offset = points - centre
    axes = principal_axes(offset.T @ offset / len(points))
    along = offset @ axes.T
    # A point in the middle plane belongs to neither sum, whatever the last bit says.
    along = np.where(np.abs(along) < 1e-12, 0.0, along)
    length = np.linalg.norm(offset, axis=1)
    delta = weight * np.abs([length[a < 0].sum() - length[a > 0].sum() for a in along.T]) + 0.001
    return Region(centre, axes, np.minimum(delta, np.abs(along).max(axis=0)))


def hypothesis(model: ObjectModel) -> Hypothesis:
    """Q by area: centre midway between solid and shell; half edges by eq. (1) as means over the area, plus sampling step and filling.

    `UNEVEN_FILLING` of the half extent is added, because masses are hidden: symmetry of the outside says nothing of them. Clipped.
    """
    return model.once("hypothesis", _hypothesis)


def _hypothesis(model: ObjectModel) -> Hypothesis:
    points, areas = surface_samples(model, SAMPLES_ACROSS)
    weight = areas / areas.sum()
    shell_centre = weight @ points
    centre = (shell_centre + model.centroid) / 2
    arm = points - shell_centre
    second = (arm * weight[:, None]).T @ arm
    axes = principal_axes(second)
    groups = _groups(np.einsum("ai,ij,aj->a", axes, second, axes))
    length = np.linalg.norm(arm, axis=1)
    step = body_size(model) / SAMPLES_ACROSS
    half = np.zeros(3)
    for group in set(groups):
        members = np.array(groups) == group
        directions = _directions(model, axes[members])
        asymmetry = np.abs(_differences(directions, arm, length * weight)).max()
        extent = np.ptp(model.hull_vertices @ directions.T, axis=0).min() / 2
        half[members] = min(asymmetry + step + UNEVEN_FILLING * extent, extent)
    shell = np.trace(second) * np.eye(3) - second
    return Hypothesis(Region(centre, axes, half, groups), (shell + model.unit_inertia) / 2)


def _groups(values: Array) -> tuple[int, int, int]:
    """Group of each of three eigenvalues, largest first: neighbours that differ by less than `ROUND` of the larger are in one."""
    first = int(values[0] - values[1] > ROUND * values[0])
    return 0, first, first + int(values[1] - values[2] > ROUND * values[1])


def _directions(model: ObjectModel, axes: Array) -> Array:
    """Unit vectors (k, 3) in the space of `axes` (d, 3) that turn with the body: the axis itself, or across the faces of its hull there."""
    if len(axes) == 1:
        return axes
    hull = ConvexHull(model.hull_vertices @ axes.T)
    normals = np.unique(hull.equations[:, :-1].round(6), axis=0)
    normals = normals[:: -(-len(normals) // MOST_DIRECTIONS)] @ axes
    return normals / np.linalg.norm(normals, axis=1, keepdims=True)


def _differences(directions: Array, arm: Array, value: Array) -> Array:
    """Sum (k,) of `value` (n,) over the samples `arm` (n, 3) on the side of each of `directions` (k, 3), less that of the others."""
    total = np.zeros(len(directions))
    step = max(1, SIGNS // len(directions))
    for start in range(0, len(arm), step):
        piece = slice(start, start + step)
        total += np.sign(directions @ arm[piece].T) @ value[piece]
    return total


def principal_axes(second_moments: Array) -> Array:
    """Eigenvectors (3, 3) as rows, largest first, signs and ties fixed: the same shape gives the same axes."""
    values, vectors = np.linalg.eigh(second_moments)
    values, vectors = values[::-1], vectors.T[::-1]
    rows: list[Array] = []
    for value in values:
        tied = vectors[np.abs(values - value) <= TIE * values[0] + 1e-18]
        projector = tied.T @ tied
        for row in rows:
            projector = projector - np.outer(row, row) @ projector
        length = np.linalg.norm(projector, axis=0)
        best = int(np.flatnonzero(length > length.max() - 1e-6)[0])
        row = projector[:, best] / length[best]
        rows.append(row * np.sign(row[np.argmax(np.abs(row))]))
    return np.array(rows)


def body_size(model: ObjectModel) -> float:
    """Twice the greatest distance of the surface from the centroid [m]: unlike the bounding box it does not change with the frame."""
    return 2 * float(np.linalg.norm(model.hull_vertices - model.centroid, axis=1).max())


def surface_samples(model: ObjectModel, across: int) -> tuple[Array, Array]:
    """Points (n, 3) [m] on the surface and the area (n,) [m^2] of each; about `across` along the body's size."""
    spacing = body_size(model) / across
    triangles = model.vertices[model.faces]
    longest = np.linalg.norm(triangles - np.roll(triangles, 1, axis=1), axis=2).max(axis=1)
    area = np.linalg.norm(np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]), axis=1) / 2
    needle = (2 * area < NEEDLE * spacing * longest) & (longest > spacing)
    pieces = _bisected(triangles[needle], spacing)
    points = [pieces.mean(axis=1)]
    areas = [np.linalg.norm(np.cross(pieces[:, 1] - pieces[:, 0], pieces[:, 2] - pieces[:, 0]), axis=1) / 2]
    triangles, longest, area = triangles[~needle], longest[~needle], area[~needle]
    steps = np.maximum(1, np.ceil(longest / spacing)).astype(int)
    for many in np.unique(steps):
        mine = steps == many
        weights = _subtriangles(int(many))
        points.append(np.einsum("wk,fki->fwi", weights, triangles[mine]).reshape(-1, 3))
        areas.append(np.repeat(area[mine] / len(weights), len(weights)))
    return np.vstack(points), np.concatenate(areas)


def _bisected(triangles: Array, longest: float) -> Array:
    """Triangles (n, 3, 3) halved at their longest edge until none is longer than `longest` [m]: along a needle, not across it."""
    done: list[Array] = []
    while len(triangles):
        sides = np.linalg.norm(np.roll(triangles, -1, axis=1) - triangles, axis=2)
        long = sides.max(axis=1) > longest
        done.append(triangles[~long])
        start = np.argmax(sides[long], axis=1)
        a, b, c = (triangles[long][np.arange(len(start)), (start + i) % 3] for i in range(3))
        middle = (a + b) / 2
        triangles = np.concatenate([np.stack([a, middle, c], axis=1), np.stack([middle, b, c], axis=1)])
    return np.concatenate(done) if done else triangles


def even_cloud(model: ObjectModel, count: int) -> Array:
    """`count` points (n, 3) [m] at equal steps of the surface's area; the same body gives the same points."""
    return even_samples(model.vertices, model.faces, count)[0]


def _subtriangles(many: int) -> Array:
    """Barycentric centroids (many^2, 3) of a triangle cut into equal ones."""
    grid = np.argwhere(np.ones((many, many)))
    upright = grid[grid.sum(axis=1) < many] + 1 / 3
    hanging = grid[grid.sum(axis=1) < many - 1] + 2 / 3
    u, v = np.vstack([upright, hanging]).T / many
    return np.stack([u, v, 1 - u - v], axis=1)
