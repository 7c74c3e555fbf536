"""How a point cloud scatters about its surface, and how far its points lie apart. Lengths in m."""

# scipy is only partly typed; its unknowns are no mistakes of ours.
# pyright: reportMissingTypeStubs=false, reportUnknownVariableType=false, reportUnknownArgumentType=false, reportUnknownMemberType=false

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import ConvexHull, KDTree, QhullError

from analyze.types import Array

SEEDS = 250
"""patches that are looked at"""
SCALES = (24, 96, 384)
"""points of a patch, to see the noise"""
WIDEST_PATCH = 0.15
"""part of the largest extent"""


@dataclass(frozen=True)
class CloudNoise:
    """How the cloud scatters about its surface, seen in small patches."""

    sd: float
    """m, across the surface"""
    spacing: float
    """m between neighbouring points along the surface"""


def cloud_noise(points: Array, tree: KDTree) -> CloudNoise:
    """Scatter of `points` (n, 3) about smooth patches: the smallest patch that is at least 4 sd wide, its flattest quarter.

    Patches of too few points lie inside the noise and see too little of it; too large ones see the shape.
    """
    extent = float(np.ptp(points, axis=0).max())
    seeds = points[:: max(1, len(points) // SEEDS)]
    sd = 0.0
    for many in SCALES:
        if many > len(points) / 4:
            break
        distance, index = tree.query(seeds, k=many)
        radius = distance[:, -1]
        small = radius < WIDEST_PATCH * extent
        if sd > 0 and small.mean() < 0.3:
            break
        residual = patch_scatter(points[index])
        # The flattest quarter: the others hold an edge.
        flattest = float(np.quantile(residual, 0.25))
        sd = max(sd, flattest)
        if float(np.median(radius)) > 4 * sd:
            break
    return CloudNoise(sd, _surface_spacing(points))


def patch_scatter(patches: Array) -> Array:
    """RMS distance (p,) of the points of each patch (p, k, 3) from a quadric over its plane."""
    many = patches.shape[1]
    centred = patches - patches.mean(axis=1, keepdims=True)
    _, _, vt = np.linalg.svd(centred, full_matrices=False)
    local = np.einsum("pki,pji->pkj", centred, vt)
    scale = np.abs(local[..., 0]).max(axis=1)[:, None]
    u, v, z = local[..., 0] / scale, local[..., 1] / scale, local[..., 2]
    design = np.stack([np.ones_like(u), u, v, u * u, u * v, v * v], axis=-1)
    normal = np.einsum("pki,pkj->pij", design, design) + 1e-9 * np.eye(6)
    answer = np.linalg.solve(normal, np.einsum("pki,pk->pi", design, z)[..., None])
    residual = z - (design @ answer)[..., 0]
    return np.sqrt(np.sum(residual**2, axis=1) / max(many - 6, 1))


def _surface_spacing(points: Array) -> float:
    """Spacing [m] if the points were spread evenly over the hull's surface."""
    try:
        area = float(ConvexHull(points).area)
    except QhullError:
        return 0.0
    return float(np.sqrt(area / len(points)))
