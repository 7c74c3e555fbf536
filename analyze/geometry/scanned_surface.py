"""Which parts of a closed surface were never scanned: a scan's gaps are closed flat, and nothing may rest or turn on what closes them.

Where a cloud has no points near its hull there is either a hollow, which was seen, or a side that was not scanned. A line straight
inwards tells them apart: through a hollow it meets the hollow's floor and then the far side, through a gap of the scan the far side alone.
A wall scanned from both sides is two layers, as long as it is some four times as thick as the noise.
"""

# scipy is only partly typed; its unknowns are no mistakes of ours.
# pyright: reportMissingTypeStubs=false, reportUnknownVariableType=false, reportUnknownArgumentType=false, reportUnknownMemberType=false

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import KDTree

from analyze.geometry.cloud_noise import patch_scatter
from analyze.geometry.even_samples import even_samples
from analyze.geometry.polyhedron import BoolArray
from analyze.types import Array, IntArray

SAMPLES = 6000
MOST_STEPS = 80
PATCH = 24
"""points by which a layer is judged"""
DOUBLE = 2.0
"""scatter of a patch over the noise, above which it is a thin wall seen from both sides"""
LAYERS = 2
"""that a line inwards through a hollow meets"""


@dataclass(frozen=True, eq=False)
class ScannedSurface:
    """Samples of a closed surface, each for the same share of its area."""

    points: Array
    """(n, 3) m"""
    normals: Array
    """(n, 3) unit, outwards"""
    bare: BoolArray
    """(n,) not scanned there"""
    area: float
    """m^2, of the whole surface"""
    reach: float
    """m, up to which from what was seen the surface counts as seen"""

    @property
    def bare_share(self) -> float:
        """Part of the surface that was not scanned."""
        return float(self.bare.mean())

    def unknown_at(self, point: Array) -> float:
        """How far [m] the true surface near `point` (3,) [m] may lie off what closes a gap: as far as gaps are wide; else 0."""
        nearest = int(np.argmin(np.linalg.norm(self.points - point, axis=1)))
        return float(np.sqrt(self.bare_share * self.area)) if self.bare[nearest] else 0.0

    def surely_seen(self) -> Array:
        """Samples (k, 3) [m] that do not lie on what closes a gap, near its border either."""
        if not self.bare.any():
            return self.points
        away = KDTree(self.points[self.bare]).query(self.points)[0]
        return self.points[away > 2 * self.reach]


def of_cloud(vertices: Array, faces: IntArray, tree: KDTree, reach: float, probe: float, sd: float) -> ScannedSurface:
    """The hull of a cloud: bare where no point lies within `reach` and a line inwards meets no hollow.

    Args:
        vertices: (n, 3) m, of the hull.
        faces: (f, 3), counter-clockwise from outside.
        tree: the cloud [m].
        reach: m.
        probe: m, width of the line.
        sd: m, 1 sigma of the cloud about its surface.
    """
    points, normals, _, area = _spread(vertices, faces)
    bare = np.asarray(tree.query(points, distance_upper_bound=reach)[0]) > reach
    bare[bare] = _layers(points[bare], normals[bare], tree, probe, sd) < LAYERS
    return ScannedSurface(points, normals, bare, area, reach)


def of_mesh(vertices: Array, faces: IntArray, added: BoolArray) -> ScannedSurface:
    """A repaired mesh: bare are the faces that were `added` (f,) to close holes."""
    points, normals, owner, area = _spread(vertices, faces)
    return ScannedSurface(points, normals, added[owner], area, 0.0)


def _layers(points: Array, normals: Array, tree: KDTree, probe: float, sd: float) -> IntArray:
    """How many layers of the cloud lines from `points` (n, 3) against `normals` (n, 3) meet.

    Layers lie apart by two probes [m] or more; nearer ones show by scattering about their common middle more than the noise does.
    """
    if not len(points):
        return np.zeros(0, dtype=np.int64)
    size = float(np.linalg.norm(np.ptp(np.asarray(tree.data), axis=0)))
    probe = max(probe, size / MOST_STEPS)
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
        patches = np.asarray(tree.data)[tree.query(np.asarray(tree.data)[found], k=PATCH)[1]]
        count[single[patch_scatter(patches) > DOUBLE * sd]] = LAYERS
    through, met_some = np.flatnonzero(count == 0), np.flatnonzero(count)
    if len(through) and len(met_some):
        # Past everything and out again: as the next line that met something.
        count[through] = count[met_some[KDTree(points[met_some]).query(points[through])[1]]]
    return count


def _spread(vertices: Array, faces: IntArray) -> tuple[Array, Array, IntArray, float]:
    """`SAMPLES` points (n, 3) evenly over the surface, normals (n, 3), faces (n,), and its area."""
    points, owner = even_samples(vertices, faces, SAMPLES)
    a, b, c = np.moveaxis(vertices[faces], 1, 0)
    across = np.cross(b - a, c - a)
    double = np.linalg.norm(across, axis=1)
    return points, across[owner] / double[owner, None], owner, float(double.sum()) / 2
