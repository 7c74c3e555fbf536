"""Noise and spacing of a point cloud; lengths in m."""

# scipy is only partly typed.
# pyright: reportMissingTypeStubs=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false, reportUnknownMemberType=false

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import ConvexHull, KDTree, QhullError

from analyze.types import Array

PATCHES = 250
"""Number of patches examined."""
PATCH_POINTS = (24, 96, 384)
"""Numbers of points of a patch, tried in turn."""
MAX_PATCH_RADIUS = 0.15
"""Largest radius of a patch, over the cloud's extent."""


@dataclass(frozen=True)
class CloudNoise:
    """Noise of a point cloud (sd of the points across the surface) and spacing of its points, in m."""

    sd: float
    """1 sigma of the points across the surface [m]."""
    spacing: float
    """Distance of neighbouring points along the surface [m]."""


def cloud_noise(points: Array, tree: KDTree) -> CloudNoise:
    """Noise (1 sigma of the scatter about the surface) and spacing of a point cloud, both in m.

    The noise is the lower quartile, over small patches of points, of the scatter about a quadric fitted to
    each patch: patches of larger scatter may contain an edge. Patches are enlarged until their radius exceeds
    four times the noise found, since smaller ones underestimate it, or until they would include the object's
    shape. Clouds of fewer than 96 points are given the noise 0.

    Args:
        points: (n, 3) points of the cloud [m].
        tree: Search tree of these points.
    """
    extent = float(np.ptp(points, axis=0).max())
    seeds = points[:: max(1, len(points) // PATCHES)]
    sd = 0.0
    for many in PATCH_POINTS:
        if many > len(points) / 4:
            break
        distance, index = tree.query(seeds, k=many)
        radius = distance[:, -1]
        small = radius < MAX_PATCH_RADIUS * extent
        if sd > 0 and small.mean() < 0.3:
            break
        residual = patch_scatter(points[index])
        # The flattest quarter: the other patches may contain an edge.
        flattest = float(np.quantile(residual, 0.25))
        sd = max(sd, flattest)
        if float(np.median(radius)) > 4 * sd:
            break
    return CloudNoise(sd, _surface_spacing(points))


def patch_scatter(patches: Array) -> Array:
    """1 sigma (p,) [m] of the points of each patch across the quadric fitted to it.

    Args:
        patches: (p, k, 3) k > 6 points of each patch [m]; the quadric is one of heights over the patch's
            least-squares plane.
    """
    many = patches.shape[1]
    centred = patches - patches.mean(axis=1, keepdims=True)
    _, _, vt = np.linalg.svd(centred, full_matrices=False)
    local = np.einsum("pki,pji->pkj", centred, vt)
    scale = np.abs(local[..., 0]).max(axis=1)[:, None]
    u, v, z = local[..., 0] / scale, local[..., 1] / scale, local[..., 2]
    design = quadric_terms(u, v)
    normal = np.einsum("pki,pkj->pij", design, design) + 1e-9 * np.eye(6)
    answer = np.linalg.solve(normal, np.einsum("pki,pk->pi", design, z)[..., None])
    residual = z - (design @ answer)[..., 0]
    return np.sqrt(np.sum(residual**2, axis=1) / max(many - 6, 1))


def quadric_terms(u: Array, v: Array) -> Array:
    """Terms 1, u, v, u^2, u v, v^2 of a quadric, (..., 6), at plane coordinates `u`, `v` (...)."""
    return np.stack([np.ones_like(u), u, v, u * u, u * v, v * v], axis=-1)


def _surface_spacing(points: Array) -> float:
    """Distance [m] of neighbouring `points` (n, 3) [m] if they were uniform over their hull.

    It is 0 if the points are flat (have no hull).
    """
    try:
        area = float(ConvexHull(points).area)
    except QhullError:
        return 0.0
    return float(np.sqrt(area / len(points)))
