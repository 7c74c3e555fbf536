"""Region Q believed to hold the centre of mass, the paper's and ours (VISAPP 2013, eq. 1; method 1.1)."""

# scipy is only partly typed.
# pyright: reportMissingTypeStubs=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false, reportUnknownMemberType=false

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import ConvexHull

from analyze.geometry.even_samples import bisected
from analyze.geometry.object_model import ObjectModel
from analyze.geometry.polyhedron import area_vectors
from analyze.types import Array

FILLING_ASYMMETRY = 0.2
"""Fraction of the half extent by which an unknown filling may shift c."""
SAMPLES_ACROSS = 36
"""Number of surface samples along the body's size."""
NEEDLE_WIDTH = 0.5
"""Width of a triangle, over the samples' spacing, below which it is cut along its length only."""
TIED_EIGENVALUES = 1e-3
"""Relative difference of two eigenvalues below which their directions are arbitrary."""
ROUND_EIGENVALUES = 0.05
"""Relative difference of two eigenvalues below which our Q is round across their axes, so that it depends
neither on the choice of these axes nor on noise that would decide it."""
MAX_DIRECTIONS = 500
"""Largest number of directions in which the body's asymmetry is measured."""
MAX_SIGNS = 60_000
"""Number of signs computed at a time: as many as the caches hold."""


@dataclass(frozen=True)
class Region:
    """Region Q that is believed to hold the centre of mass c, in the object frame O (the shape file's).

    Q is a box along three axes. Axes of equal spread form a group, across which Q is round: a cylinder for a
    group of two, a ball for a group of three.
    """

    centre: Array
    """(3,) centre [m]."""
    axes: Array
    """(3, 3) orthonormal unit vectors as rows."""
    half: Array
    """(3,) half edges along `axes` [m]; radii across axes of one group."""
    groups: tuple[int, int, int] = (0, 1, 2)
    """Group of each axis; Q is round across the axes of one group."""

    def reach(self, directions: Array) -> Array:
        """Extent (k,) [m] of this region of possible centres of mass, from its centre along k directions.

        Args:
            directions: (k, 3) unit vectors, in the object frame.
        """
        along = np.atleast_2d(directions) @ self.axes.T * self.half
        members = [[i for i in range(3) if self.groups[i] == group] for group in set(self.groups)]
        return np.sum([np.linalg.norm(along[:, each], axis=1) for each in members], axis=0)

    def covariance(self) -> Array:
        """Covariance (3, 3) [m^2] of the centre of mass over this region, in the object frame.

        The half edges (or radii) of the region count as two standard deviations.
        """
        return (self.axes.T * (self.half / 2) ** 2) @ self.axes


@dataclass(frozen=True)
class Hypothesis:
    """Region that holds the centre of mass, and expected inertia, on which the planning of strikes rests.

    They follow from the exterior shape, or from an earlier result if there is one.
    """

    region: Region
    """Region Q of the centre of mass c."""
    unit_inertia: Array
    """(3, 3) inertia about c per kilogram [m^2], in O: an earlier result's, or the mean of those of the
    uniform solid and of its surface, each about its own centroid."""


def paper_hypothesis(points: Array, weight: float = 1.0) -> Region:
    """Region Q of the centre of mass by the paper's eq. (1) (VISAPP 2013, 3.1.1).

    Half edges along the principal axes e are w abs(sum_{v.e<0} norm(v) - sum_{v.e>0} norm(v)) + 1 in
    millimetres, v the points relative to their mean. As printed (w = 1) the sums are not normalised, so Q
    grows with the number of points; with w one over that number they are means, and it does not. Q is clipped
    to the points' extent. Where eigenvalues are equal (a square base), the paper leaves the principal axes
    open: here coordinate axes are projected into their common space.

    Args:
        points: (n, 3) surface points [m], in the object frame.
        weight: Factor w of the sums.

    Returns:
        A box in the object frame, centred on the mean of the points.
    """
    centre = points.mean(axis=0)
    offset = points - centre
    axes = principal_axes(offset.T @ offset / len(points))
    along = offset @ axes.T
    # A point in the middle plane belongs to neither sum, whatever its rounding error.
    along = np.where(np.abs(along) < 1e-12, 0.0, along)
    length = np.linalg.norm(offset, axis=1)
    delta = weight * np.abs([length[a < 0].sum() - length[a > 0].sum() for a in along.T]) + 0.001
    return Region(centre, axes, np.minimum(delta, np.abs(along).max(axis=0)))


def hypothesis(model: ObjectModel) -> Hypothesis:
    """Region Q believed to hold the centre of mass, and the expected inertia, from the exterior shape.

    Q's centre lies midway between the centroids of the uniform solid and of its surface; its axes are the
    surface's principal axes. A half edge is the sum of three lengths, but at most the half extent:

    - the asymmetry of the surface along the axis, as in eq. (1) of VISAPP 2013: the absolute mean over the
      area of the distance from the surface's centroid, taken as negative behind the centroid;
    - the step at which the surface is sampled;
    - `FILLING_ASYMMETRY` of the half extent, since a symmetric exterior may hide an asymmetric filling.

    Axes with nearly equal spread share one half edge. Q is a box [m] in the object frame O, the inertia
    (3, 3) is per kilogram [m^2], along O's axes. Of an object in a fixture of known mass this holds for the
    object alone; the fixture adds its own mass, and Q shrinks by the object's share. The result is cached on
    the model.
    """
    return model.cached("hypothesis", _hypothesis if model.held is None else _with_fixture)


def _with_fixture(model: ObjectModel) -> Hypothesis:
    """Hypothesis of an object and its fixture, from that of the object alone and the known fixture."""
    held = model.held
    if held is None:
        return _hypothesis(model)
    alone = _hypothesis(model.own)
    region, total = alone.region, held.mass + held.fixture_mass
    # The object's place in the fixture, and the fixture's own centre, move c as well.
    loose = held.mass * held.place_sd + sum(body.mass * body.com_sd for body in held.fixture)
    half = (held.mass * region.half + 2 * loose) / total
    return Hypothesis(
        Region(held.com_struck(region.centre), region.axes, half, region.groups),
        held.unit_inertia_struck(region.centre, alone.unit_inertia),
    )


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
        half[members] = min(asymmetry + step + FILLING_ASYMMETRY * extent, extent)
    shell = np.trace(second) * np.eye(3) - second
    return Hypothesis(Region(centre, axes, half, groups), (shell + model.unit_inertia) / 2)


def _groups(values: Array) -> tuple[int, int, int]:
    """Group number of each of three principal axes, from their eigenvalues (3,), largest first.

    Neighbours whose eigenvalues differ by at most `ROUND_EIGENVALUES` of the larger share one group. The
    numbers are in the order of the eigenvalues and begin with 0, such as 0, 0, 1.
    """
    first = int(values[0] - values[1] > ROUND_EIGENVALUES * values[0])
    return 0, first, first + int(values[1] - values[2] > ROUND_EIGENVALUES * values[1])


def _directions(model: ObjectModel, axes: Array) -> Array:
    """Unit directions (k, 3), in the space of the unit `axes` (d, 3), to measure a body's asymmetry in.

    For one axis it is the axis itself; for two or three, the outward normals of the convex hull of the
    object's projection on the space of the axes, at most `MAX_DIRECTIONS`. All are in the object frame.
    """
    if len(axes) == 1:
        return axes
    hull = ConvexHull(model.hull_vertices @ axes.T)
    normals = np.unique(hull.equations[:, :-1].round(6), axis=0)
    normals = normals[:: -(-len(normals) // MAX_DIRECTIONS)] @ axes
    return normals / np.linalg.norm(normals, axis=1, keepdims=True)


def _differences(directions: Array, arm: Array, value: Array) -> Array:
    """Sum (k,) of `value` over samples ahead of the origin minus that behind, for k directions.

    A sample is ahead if its vector from the origin has a positive component along the direction.

    Args:
        directions: (k, 3) unit directions.
        arm: (n, 3) samples relative to the origin.
        value: (n,) value of each sample.
    """
    total = np.zeros(len(directions))
    step = max(1, MAX_SIGNS // len(directions))
    for start in range(0, len(arm), step):
        piece = slice(start, start + step)
        total += np.sign(directions @ arm[piece].T) @ value[piece]
    return total


def principal_axes(second_moments: Array) -> Array:
    """Eigenvectors (3, 3), as rows, of the symmetric `second_moments` (3, 3), largest eigenvalue first.

    Signs and ties are fixed: the largest component of each is positive; eigenvectors of (nearly) equal
    eigenvalues are coordinate axes projected into their common space, the best aligned first, x before y
    before z.
    """
    values, vectors = np.linalg.eigh(second_moments)
    values, vectors = values[::-1], vectors.T[::-1]
    rows: list[Array] = []
    for value in values:
        tied = vectors[np.abs(values - value) <= TIED_EIGENVALUES * values[0] + 1e-18]
        projector = tied.T @ tied
        for row in rows:
            projector = projector - np.outer(row, row) @ projector
        length = np.linalg.norm(projector, axis=0)
        best = int(np.flatnonzero(length > length.max() - 1e-6)[0])
        row = projector[:, best] / length[best]
        rows.append(row * np.sign(row[np.argmax(np.abs(row))]))
    return np.array(rows)


def body_size(model: ObjectModel) -> float:
    """Size of the body [m]: twice the largest distance of a hull vertex from the solid's centroid.

    It does not depend on the frame.
    """
    return 2 * float(np.linalg.norm(model.hull_vertices - model.centroid, axis=1).max())


def surface_samples(model: ObjectModel, across: int) -> tuple[Array, Array]:
    """Sample the surface in pieces whose longest edge is at most the body's size divided by `across`.

    Args:
        model: Shape of the object.
        across: Number of samples along the body's size.

    Returns:
        Centroids (n, 3) [m, in the object frame] and areas (n,) [m^2] of the pieces.
    """
    spacing = body_size(model) / across
    triangles = model.vertices[model.faces]
    longest = np.linalg.norm(triangles - np.roll(triangles, 1, axis=1), axis=2).max(axis=1)
    area = np.linalg.norm(area_vectors(triangles), axis=1) / 2
    needle = (2 * area < NEEDLE_WIDTH * spacing * longest) & (longest > spacing)
    pieces, _ = bisected(triangles[needle], spacing)
    points = [pieces.mean(axis=1)]
    areas = [np.linalg.norm(area_vectors(pieces), axis=1) / 2]
    triangles, longest, area = triangles[~needle], longest[~needle], area[~needle]
    steps = np.maximum(1, np.ceil(longest / spacing)).astype(int)
    for many in np.unique(steps):
        mine = steps == many
        weights = _subtriangles(int(many))
        points.append(np.einsum("wk,fki->fwi", weights, triangles[mine]).reshape(-1, 3))
        areas.append(np.repeat(area[mine] / len(weights), len(weights)))
    return np.vstack(points), np.concatenate(areas)


def _subtriangles(many: int) -> Array:
    """Barycentric coordinates (many^2, 3) of the centroids of a triangle's equal subtriangles.

    Each edge of the triangle is divided into `many` parts.
    """
    grid = np.argwhere(np.ones((many, many)))
    upright = grid[grid.sum(axis=1) < many] + 1 / 3
    hanging = grid[grid.sum(axis=1) < many - 1] + 2 / 3
    u, v = np.vstack([upright, hanging]).T / many
    return np.stack([u, v, 1 - u - v], axis=1)
