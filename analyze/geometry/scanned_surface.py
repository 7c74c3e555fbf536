"""Parts of a closed surface that were not scanned, where no strike may rest or tip.

Where a cloud has no points near its hull there is either a hollow, which was scanned, or a side that was not
scanned. A line straight inwards distinguishes them: through a hollow it meets the hollow's floor and then the
far side, through a gap of the scan the far side alone. A wall scanned from both sides is two layers, if it is
about four times as thick as the noise.
"""

# scipy is only partly typed.
# pyright: reportMissingTypeStubs=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false, reportUnknownMemberType=false

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import KDTree

from analyze.geometry.cloud_noise import patch_scatter
from analyze.geometry.even_samples import even_samples
from analyze.geometry.polyhedron import BoolArray, area_vectors
from analyze.types import Array, IntArray

SAMPLES = 6000
"""Number of samples of the surface."""
MAX_STEPS = 80
"""Largest number of steps along a line inwards."""
PATCH_POINTS = 24
"""Number of points of a patch whose scatter shows whether it is one layer or two."""
TWO_LAYER_SCATTER = 2.0
"""Scatter of a patch over the noise above which it is a thin wall scanned from both sides."""
HOLLOW_LAYERS = 2
"""Number of layers that a line inwards through a hollow meets: its floor and the far side."""


@dataclass(frozen=True, eq=False)
class ScannedSurface:
    """Samples of a closed surface in the object frame: points [m], normals, mask of the unscanned.

    Each sample stands for the same area.
    """

    points: Array
    """(n, 3) samples [m]."""
    normals: Array
    """(n, 3) outward unit normals."""
    bare: BoolArray
    """(n,) True where the surface was not scanned."""
    area: float
    """Area of the whole surface [m^2]."""
    reach: float
    """Distance from a scanned point up to which the surface counts as scanned [m]."""

    @property
    def bare_share(self) -> float:
        """Fraction of the surface that was not scanned."""
        return float(self.bare.mean())

    def uncertainty_at(self, point: Array) -> float:
        """Uncertainty [m] of the surface near `point` (3,) [m]: 0 where it was scanned.

        In a gap of the scan it is the gap's width, taken as the root of the whole unscanned area, of all gaps
        together.
        """
        nearest = int(np.argmin(np.linalg.norm(self.points - point, axis=1)))
        return float(np.sqrt(self.bare_share * self.area)) if self.bare[nearest] else 0.0

    def surely_scanned(self) -> Array:
        """Samples (k, 3) [m, object frame] of the surface farther than twice `reach` from any unscanned one.

        `reach` is the distance [m] from a scanned point up to which the surface counts as scanned.
        """
        if not self.bare.any():
            return self.points
        away = KDTree(self.points[self.bare]).query(self.points)[0]
        return self.points[away > 2 * self.reach]


def scanned_cloud(
    vertices: Array, faces: IntArray, tree: KDTree, reach: float, probe: float, sd: float
) -> ScannedSurface:
    """Samples of the convex hull of a point cloud, with a mask of those that were not scanned.

    They are points (s, 3) [m], spread evenly over the hull and in the frame of its vertices, with outward
    unit normals (s, 3); the mask (s,) is True where the hull was not scanned.

    A sample was scanned if a point of the cloud lies within `reach`, or if a line straight inwards from it
    meets a hollow's floor before the far side.

    Args:
        vertices: (n, 3) vertices of the hull [m].
        faces: (f, 3) faces, counter-clockwise from outside.
        tree: Search tree of the cloud's points [m].
        reach: Distance from a point up to which the hull counts as scanned [m].
        probe: Width of the lines inwards that distinguish a hollow from a gap of the scan [m].
        sd: 1 sigma of the cloud about its surface [m].
    """
    points, normals, _, area = _surface_samples(vertices, faces)
    bare = np.asarray(tree.query(points, distance_upper_bound=reach)[0]) > reach
    bare[bare] = _layers(points[bare], normals[bare], tree, probe, sd) < HOLLOW_LAYERS
    return ScannedSurface(points, normals, bare, area, reach)


def scanned_mesh(vertices: Array, faces: IntArray, added: BoolArray) -> ScannedSurface:
    """Samples of a repaired mesh, marked as not scanned on the faces that close holes.

    The samples are points with outward normals, each for the same area, in the frame of `vertices`.

    Args:
        vertices: (n, 3) vertices [m].
        faces: (f, 3) faces, counter-clockwise from outside.
        added: (f,) True for faces that were added to close holes.
    """
    points, normals, owner, area = _surface_samples(vertices, faces)
    return ScannedSurface(points, normals, added[owner], area, 0.0)


def _layers(points: Array, normals: Array, tree: KDTree, probe: float, sd: float) -> IntArray:
    """Number (n,) of a cloud's layers that straight lines into the body meet.

    Layers four probe widths or more apart are counted separately. Nearer layers that run together count as
    two if their points scatter about their common middle by more than twice the noise. A line that meets
    nothing is given the count of the nearest line that does; if none does, all counts are 0.

    Args:
        points: (n, 3) starts of the lines [m].
        normals: (n, 3) outward unit normals; the lines run against them.
        tree: Search tree of the cloud's points [m].
        probe: Width of the lines [m]; at least the cloud's size over `MAX_STEPS` is used.
        sd: 1 sigma of the noise [m].
    """
    if not len(points):
        return np.zeros(0, dtype=np.int64)
    size = float(np.linalg.norm(np.ptp(np.asarray(tree.data), axis=0)))
    probe = max(probe, size / MAX_STEPS)
    depth = np.arange(probe, size + probe, probe)
    along = points[:, None] - depth[:, None] * normals[:, None]
    distance, nearest = tree.query(along.reshape(-1, 3), distance_upper_bound=probe)
    met = np.isfinite(distance).reshape(along.shape[:2])
    met[:, 1:-1] |= met[:, :-2] & met[:, 2:]
    begins = met & ~np.pad(met, ((0, 0), (1, 0)))[:, :-1]
    count = np.sum(begins, axis=1)
    single = np.flatnonzero(count == 1)
    found = np.asarray(nearest).reshape(met.shape)[single, np.argmax(begins[single], axis=1)]
    if len(single):
        patches = np.asarray(tree.data)[tree.query(np.asarray(tree.data)[found], k=PATCH_POINTS)[1]]
        count[single[patch_scatter(patches) > TWO_LAYER_SCATTER * sd]] = HOLLOW_LAYERS
    through, met_some = np.flatnonzero(count == 0), np.flatnonzero(count)
    if len(through) and len(met_some):
        # A line that meets nothing is given the count of the nearest line that does.
        count[through] = count[met_some[KDTree(points[met_some]).query(points[through])[1]]]
    return count


def _surface_samples(vertices: Array, faces: IntArray) -> tuple[Array, Array, IntArray, float]:
    """Points at equal steps of the area of a mesh, `SAMPLES` of them.

    Args:
        vertices: (n, 3) vertices [m].
        faces: (f, 3) faces, counter-clockwise from outside.

    Returns:
        Points (s, 3) [m], outward unit normals (s, 3), face (s,) of each point, and the surface's area [m^2].
    """
    points, owner = even_samples(vertices, faces, SAMPLES)
    across = area_vectors(vertices[faces])
    double = np.linalg.norm(across, axis=1)
    return points, across[owner] / double[owner, None], owner, float(double.sum()) / 2
