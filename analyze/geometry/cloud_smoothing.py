"""Smoothed points of the curved parts of a point cloud, for the hull of a scanned object.

Points inside the hull, such as those of a hollow, are left out.
"""

# scipy is only partly typed.
# pyright: reportMissingTypeStubs=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false, reportUnknownMemberType=false

from __future__ import annotations

import numpy as np
from scipy.spatial import KDTree

from analyze.geometry.cloud_noise import quadric_terms
from analyze.geometry.hull_planes import FittedPlane
from analyze.geometry.plane_search import HULL_DIRECTIONS, even_directions
from analyze.geometry.polyhedron import BoolArray
from analyze.types import Array

MAX_SMOOTHED = 1500
"""Largest number of smoothed points."""
MIN_NEIGHBOURS, MAX_NEIGHBOURS = 24, 400
"""Smallest and largest number of points of the patch to which a smoothing quadric is fitted."""
MIN_HOLLOW_DEPTH = 0.01
"""Depth of a point below the hull, over the cloud's extent, above which it lies in a hollow."""
POINTS_AT_A_TIME = 1000
"""Points projected on all directions at a time: as many as the caches hold."""


def smoothed_points(
    points: Array, planes: tuple[FittedPlane, ...], sharp: Array, sd: float, spacing: float, extent: float
) -> tuple[Array, Array, float]:
    """Points of the curved parts, smoothed by projection onto local quadrics (Levin 2004).

    Args:
        points: (n, 3) points of the cloud [m].
        planes: Planar faces, whose points are left out.
        sharp: (c, 3) corners and places along the edges between planar faces [m].
        sd: 1 sigma of the noise [m].
        spacing: Distance of neighbouring points [m].
        extent: Largest extent of the cloud [m].

    Returns:
        Smoothed points (k, 3) [m], unit normals (k, 3) there (either sign), and one 1 sigma [m] for all
        smoothed points. If fewer than `MIN_NEIGHBOURS` points belong to curved parts, or none lies near the
        hull: no points, no normals, and `sd`.
    """
    heights = (
        np.column_stack([plane.heights(points) for plane in planes])
        if planes
        else np.full((len(points), 1), -np.inf)
    )
    rest = points[(heights < -3 * sd).all(axis=1)]
    outer = rest[:0]
    if len(rest) >= MIN_NEIGHBOURS:
        outer = rest[_near_hull(rest, sharp, max(5 * sd, MIN_HOLLOW_DEPTH * extent))]
    if not len(outer):
        return np.zeros((0, 3)), np.zeros((0, 3)), sd
    outer = outer[:: max(1, len(outer) // MAX_SMOOTHED)]
    many = min(int(np.clip(np.pi * (6 * sd / spacing) ** 2, MIN_NEIGHBOURS, MAX_NEIGHBOURS)), len(rest))
    tree = KDTree(rest)
    moved, normals, lever = outer, outer, np.ones(len(outer))
    for _ in range(2):
        # The second pass uses patches around the moved points: one around a point too far out is biased
        # outwards.
        moved, normals, lever = _onto_quadrics(moved, rest[tree.query(moved, k=many)[1]])
    for plane in planes:
        moved = moved - np.outer(np.maximum(plane.heights(moved), 0), plane.normal)
    # Far from the middle of its patch a quadric is badly determined and diverges.
    steady = lever < 2 * float(np.median(lever))
    return moved[steady], normals[steady], sd * float(np.sqrt(np.median(lever)))


def _onto_quadrics(points: Array, patches: Array) -> tuple[Array, Array, Array]:
    """Project points onto quadrics fitted to the patches of the cloud around them.

    Args:
        points: (p, 3) points [m]; inputs and results are in the cloud's frame.
        patches: (p, k, 3) k points of the cloud [m] nearest to each of these.

    Returns:
        Projected points (p, 3) [m], unit normals (p, 3) of the quadrics there (either sign), and variances
        (p,) of the projected points over that of the noise.
    """
    middle = patches.mean(axis=1, keepdims=True)
    centred = patches - middle
    _, frame = np.linalg.eigh(centred.transpose(0, 2, 1) @ centred)
    frame = frame[:, :, ::-1]
    local, own = centred @ frame, ((points[:, None] - middle) @ frame)[:, 0]
    scale = np.abs(local[..., :2]).max(axis=(1, 2))[:, None]
    design = quadric_terms(local[..., 0] / scale, local[..., 1] / scale)
    across = design.transpose(0, 2, 1)
    normal = across @ design + 1e-9 * np.eye(6)
    answer = np.linalg.solve(normal, across @ local[..., 2:])[..., 0]
    u, v = own[:, 0] / scale[:, 0], own[:, 1] / scale[:, 0]
    row = quadric_terms(u, v)
    lever = np.einsum("pi,pij,pj->p", row, np.linalg.inv(normal), row)
    own[:, 2] = np.einsum("pi,pi->p", row, answer)
    slope = np.stack(
        [
            answer[:, 1] + 2 * answer[:, 3] * u + answer[:, 4] * v,
            answer[:, 2] + answer[:, 4] * u + 2 * answer[:, 5] * v,
        ],
        axis=1,
    )
    upright = np.column_stack([-slope / scale, np.ones(len(own))])
    upright /= np.linalg.norm(upright, axis=1, keepdims=True)
    back = frame.transpose(0, 2, 1)
    return (own[:, None] @ back)[:, 0] + middle[:, 0], (upright[:, None] @ back)[:, 0], lever


def _near_hull(points: Array, others: Array, margin: float) -> BoolArray:
    """Mask (n,) of the `points` (n, 3) [m] that lie at most `margin` [m] below their convex hull.

    The hull is that of the points and `others` (m, 3) [m], approximated by its supporting planes in
    `HULL_DIRECTIONS` directions.
    """
    across = even_directions(HULL_DIRECTIONS).T
    pieces = [points[start : start + POINTS_AT_A_TIME] for start in range(0, len(points), POINTS_AT_A_TIME)]
    level = np.max([(piece @ across).max(axis=0) for piece in pieces], axis=0)
    if len(others):
        level = np.maximum(level, (others @ across).max(axis=0))
    return np.concatenate([(piece @ across - level).max(axis=1) > -margin for piece in pieces])
