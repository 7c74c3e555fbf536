"""Search for the planes on which a noisy point cloud's hull rests (method 1.2); lengths in m.

Planes grow from small patches, or from the densest outer layers where patches would be as large as faces. A
plane is a pair of its outward unit normal (3,) and its offset n.x [m].
"""

# scipy is only partly typed.
# pyright: reportMissingTypeStubs=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false, reportUnknownMemberType=false

from __future__ import annotations

import numpy as np
from scipy.spatial import ConvexHull, KDTree, QhullError

from analyze.geometry.polyhedron import BoolArray
from analyze.geometry.rotations import plane_basis
from analyze.types import Array

SEED_PATCHES = 250
"""Number of patches from which planes grow."""
MAX_SEARCH_POINTS = 5000
"""Number of points used in the search, approximately; the later fit uses all points."""
SEARCH_BAND_SDS = 2.5
"""Distance from a plane, in sd of the noise, up to which a point belongs to it during the search."""
MAX_OUTSIDE_SHARE = 0.04
"""Largest number of points outside a plane's band, over those in it, of a plane that the hull rests on."""
COARSE_PATCH_FRACTION = 0.02
"""Radius of a patch, over the cloud's extent, above which it includes a face's neighbours."""
HULL_DIRECTIONS = 500
"""Number of directions, uniform over the sphere, in which a cloud's outer points are searched."""
MAX_LAYERS = 60
"""Largest number of outer layers from which planes grow."""
SEED_STEP_AFTER_LAYERS = 4
"""Step between the seed patches that are still tried after a search for outer layers."""
MAX_GROWING_OUTSIDE_SHARE = 0.25
"""Largest number of points outside twice a plane's band, over those in the band, while the plane still grows
and is not yet parallel to the face."""
ERODED_BANDS = 2.4
"""Margin, in bands, from a face's outline during the search: noise moves the outline out and neighbours'
points in."""
CONVERGED_COSINE = np.cos(np.radians(0.2))
"""Cosine of the angle between successive normals above which a plane has converged."""
MIN_FACE_SHARE = 0.004
"""Smallest number of points of a face, over that of all points."""
MAX_BENDING_BANDS = 0.45
"""Bending of a face, in bands, above which it is curved."""
SAME_FACE_COSINE = np.cos(np.radians(15.0))
"""Cosine of the largest angle between a patch and the face that it belongs to."""


def planes_of_faces(points: Array, sd: float, spacing: float) -> list[tuple[Array, float]]:
    """Approximate planes of the faces of a cloud's hull, those with most points of their own first.

    Args:
        points: (n, 3) points of the cloud [m].
        sd: 1 sigma of the noise [m].
        spacing: Distance of neighbouring points [m].

    Returns:
        Outward unit normal (3,) and offset n.x [m] of each plane; empty if there are none.
    """
    sample = points[:: max(1, len(points) // MAX_SEARCH_POINTS)]
    centre = sample.mean(axis=0)
    tree = KDTree(sample)
    seeds = sample[:: max(1, len(sample) // SEED_PATCHES)]
    band = SEARCH_BAND_SDS * sd
    reach = max(4 * sd, 3 * spacing * np.sqrt(len(points) / len(sample)))
    candidates: list[tuple[Array, float, BoolArray]] = []
    if reach > COARSE_PATCH_FRACTION * float(np.ptp(sample, axis=0).max()):
        # Patches wider than the noise are hardly smaller than the faces: search along all directions instead.
        grown = [
            _grown_plane(sample, centre, start, band, np.inf, centre)
            for start in _dense_layers(sample[::2], sd)
        ]
        candidates += [each for each in grown if each is not None]
        seeds = seeds[::SEED_STEP_AFTER_LAYERS]
    for seed in seeds:
        near = np.asarray(tree.query_ball_point(seed, reach), dtype=np.int64)
        if len(near) < 8:
            near = np.asarray(tree.query(seed, k=min(12, len(sample)))[1])
        start = _least_squares_plane(sample[near], centre)
        # A seed within a face already grown would grow it again.
        if any(
            abs(seed @ normal - offset) < band / 2 and start[0] @ normal > SAME_FACE_COSINE
            for normal, offset, _ in candidates
        ):
            continue
        grown = _grown_plane(sample, seed, start, band, reach, centre)
        if grown is not None:
            candidates.append(grown)
    return [
        (normal, offset)
        for normal, offset in _largest_faces(sample, candidates)
        if _bending_bound(
            points[
                _inner_points(points, np.abs(points @ normal - offset) < band, normal, ERODED_BANDS * band)
            ],
            normal,
            band,
        )
        < MAX_BENDING_BANDS * band
    ]


def _dense_layers(sample: Array, sd: float) -> list[tuple[Array, float]]:
    """Planes along which a cloud has its densest thin outer layers, the densest first.

    Their normals are at least 15 degrees apart.

    Args:
        sample: (n, 3) points of the cloud [m].
        sd: 1 sigma of the noise [m]; a layer is two sd thick.

    Returns:
        Outward unit normal (3,) and offset [m] of up to `MAX_LAYERS` planes.
    """
    directions = even_directions(HULL_DIRECTIONS)
    heights = np.sort(directions @ sample.T, axis=1)
    tried = heights[:, -max(2, len(sample) // 100), None] - np.arange(0.0, 4.0, 0.5) * sd
    ends = [
        np.searchsorted(row, np.concatenate([level - sd, level + sd]))
        for row, level in zip(heights, tried, strict=True)
    ]
    below, within = np.split(np.array(ends), 2, axis=1)
    within = within - below
    # Of the levels with most points the highest.
    best = np.argmax(within, axis=1)
    counts, levels = within[np.arange(HULL_DIRECTIONS), best], tried[np.arange(HULL_DIRECTIONS), best]
    taken: list[tuple[Array, float]] = []
    free = np.ones(HULL_DIRECTIONS, dtype=bool)
    for index in np.argsort(-counts):
        if free[index]:
            taken.append((directions[index], float(levels[index])))
            free &= directions @ directions[index] < SAME_FACE_COSINE
    return taken[:MAX_LAYERS]


def even_directions(many: int) -> Array:
    """Unit vectors (many, 3) spread evenly over the sphere (golden spiral)."""
    i = np.arange(many) + 0.5
    z, turn = 1 - 2 * i / many, np.pi * (1 + 5**0.5) * i
    return np.column_stack([np.sqrt(1 - z**2) * np.cos(turn), np.sqrt(1 - z**2) * np.sin(turn), z])


def _grown_plane(
    sample: Array, seed: Array, start: tuple[Array, float], band: float, reach: float, centre: Array
) -> tuple[Array, float, BoolArray] | None:
    """Plane grown outwards from a seed point, until it is fitted to all points near it.

    Points are near if they lie in a band about the plane; those close to the outline of the band's points are
    left out of the last fits.

    Args:
        sample: (n, 3) points [m].
        seed: (3,) point [m] from which the plane grows.
        start: Outward unit normal (3,) and offset [m] of the plane at the seed.
        band: Half width of the plane's band [m].
        reach: Distance from the seed [m] up to which points count at first; doubled until it includes all.
        centre: (3,) centroid of the sample [m]; normals point away from it.

    Returns:
        Outward unit normal (3,), offset [m], and mask (n,) of the points in the band; None if the hull does
        not rest on the plane (too many points lie outside it), or fewer than 8 points lie in the band.
    """
    normal, offset = start
    distance = np.linalg.norm(sample - seed, axis=1)
    farthest = float(distance.max())
    inliers = np.zeros(len(sample), dtype=bool)
    inner = np.zeros(len(sample), dtype=bool)
    while reach < farthest:
        reach *= 2
        close = distance <= reach
        height = sample @ normal - offset
        inliers = (np.abs(height) < band) & close
        if (
            inliers.sum() < 8
            or np.sum((height > 2 * band) & close) > MAX_GROWING_OUTSIDE_SHARE * inliers.sum() + 2
        ):
            return None
        normal, offset = _least_squares_plane(sample[inliers], centre)
    for _ in range(4):
        inliers = np.abs(sample @ normal - offset) < band
        inner = _inner_points(sample, inliers, normal, ERODED_BANDS * band)
        if inner.sum() < 8:
            return None
        before = normal
        normal, offset = _least_squares_plane(sample[inner], centre)
        if before @ normal > CONVERGED_COSINE:
            break
    height = sample @ normal - offset
    inliers = np.abs(height) < band
    if np.sum(height > band) > MAX_OUTSIDE_SHARE * inliers.sum() + 1:
        return None
    return normal, offset, inliers


def _inner_points(points: Array, members: BoolArray, normal: Array, margin: float) -> BoolArray:
    """Mask (n,) of the points of one face that lie well within the outline of the face's points.

    Their depth, the distance from the outline, is at least `margin`, or half the largest depth if that is
    less. All are False if the points have no outline (too few, or on a line).

    Args:
        points: (n, 3) points of the cloud [m].
        members: (n,) True for the points of the face.
        normal: (3,) unit normal of the face.
        margin: Smallest distance from the outline [m].
    """
    flat = points[members] @ in_plane_basis(normal).T
    kept = np.zeros(len(points), dtype=bool)
    try:
        outline = ConvexHull(flat)
    except (QhullError, ValueError):
        return kept
    depth = -(flat @ outline.equations[:, :2].T + outline.equations[:, 2]).max(axis=1)
    kept[np.flatnonzero(members)[depth >= min(margin, 0.5 * float(depth.max()))]] = True
    return kept


def _largest_faces(
    sample: Array, candidates: list[tuple[Array, float, BoolArray]]
) -> list[tuple[Array, float]]:
    """Planes chosen one by one, each time the one with most points that no plane chosen before contains.

    A plane is left out if more than 85 % of its points belong to planes chosen before, or if fewer points are
    its own than the larger of 8 and `MIN_FACE_SHARE` of the sample.

    Args:
        sample: (n, 3) points [m].
        candidates: For each plane, unit normal (3,), offset (normal . x on the plane) [m], and mask (n,) of
            the points that it contains.

    Returns:
        Unit normal (3,) and offset [m] of each plane chosen, in the order of the choice.
    """
    fewest = max(MIN_FACE_SHARE * len(sample), 8)
    free = np.ones(len(sample), dtype=bool)
    chosen: list[tuple[Array, float]] = []
    members = (
        np.array([inliers for _, _, inliers in candidates], dtype=np.float32)
        if candidates
        else np.zeros((0, len(sample)))
    )
    alive = np.ones(len(candidates), dtype=bool)
    while alive.any():
        own = np.where(alive, members @ free, 0)
        best = int(np.argmax(own))
        if own[best] < fewest:
            break
        alive[best] = False
        normal, offset, inliers = candidates[best]
        # Planes with more points contain most of its own: it is a slant over an edge.
        if own[best] < 0.15 * inliers.sum():
            continue
        chosen.append((normal, offset))
        free &= ~inliers
    return chosen


def _bending_bound(points: Array, normal: Array, band: float) -> float:
    """Upper bound [m] of the bending of a face: how far it is from flat.

    Bending is the range of the curved part of a quadratic fit to the points' heights over the plane. The
    bound is the fitted bending plus 4 / sqrt(n) times the sd of the noise.

    Args:
        points: (n, 3) points of the face [m].
        normal: (3,) unit normal of the face.
        band: Half width [m] of the band about the plane in which the points lie: `SEARCH_BAND_SDS` sd.
    """
    return bending(points, normal) + 4 * band / SEARCH_BAND_SDS / np.sqrt(len(points))


def bending(points: Array, normal: Array) -> float:
    """Bending [m] of a face: range of the curved part of a quadratic fit to its points' heights.

    The curved part is what no plane can fit. Its 2 % largest and 2 % smallest values do not count.

    Args:
        points: (n, 3) points of the face [m].
        normal: (3,) unit normal of the face.
    """
    basis = in_plane_basis(normal)
    offset = points - points.mean(axis=0)
    u, v = basis @ offset.T
    scale = max(float(np.abs(u).max()), float(np.abs(v).max()), 1e-12)
    u, v, z = u / scale, v / scale, offset @ normal
    flat = np.column_stack([np.ones_like(u), u, v])
    curved = np.column_stack([u * u, u * v, v * v])
    # The part of the quadratic terms that no plane can fit.
    curved -= flat @ np.linalg.solve(flat.T @ flat + 1e-9 * np.eye(3), flat.T @ curved)
    bent = curved @ np.linalg.solve(curved.T @ curved + 1e-9 * np.eye(3), curved.T @ z)
    return float(np.ptp(np.quantile(bent, [0.02, 0.98])))


def _least_squares_plane(points: Array, inside: Array) -> tuple[Array, float]:
    """Unit normal (3,) and offset [m] of the least-squares plane of `points` (n, 3) [m].

    The normal points away from `inside` (3,) [m].
    """
    centre = points.mean(axis=0)
    offset = points - centre
    _, vectors = np.linalg.eigh(offset.T @ offset)
    normal = vectors[:, 0]
    if float(normal @ (centre - inside)) < 0:
        normal = -normal
    return normal, float(normal @ centre)


def in_plane_basis(normal: Array) -> Array:
    """Orthonormal vectors (2, 3), as rows, in the plane with unit `normal` (3,)."""
    return np.stack(plane_basis(normal))
