"""Robust planes of a noisy point cloud's hull, each with its covariance (method 1.2); lengths in m.

The raw convex hull of a noisy cloud consists of the noise's extremes: at 5 mm noise its edges lie 5 mm too
far out. Here a plane is fitted to all points of a face, and an edge is where two such planes meet. A bias of
the noise (all points too far out by the same) moves the planes with it: the points cannot show it, the object
file must declare it (`shape.surface_sd_m`).
"""

# scipy is only partly typed.
# pyright: reportMissingTypeStubs=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false, reportUnknownMemberType=false

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import ConvexHull, KDTree, QhullError
from scipy.special import ndtr

from analyze.geometry.cloud_noise import CloudNoise
from analyze.geometry.polyhedron import BoolArray
from analyze.geometry.rotations import plane_basis
from analyze.types import Array

SEEDS = 250
"""Number of patches from which planes are grown."""
SEARCHED = 5000
"""Number of points among which planes are searched; the fit uses all."""
BAND = 2.5
"""Distance from a plane, in sd of the noise, up to which a point belongs to it during the search."""
FIT_BAND = 4.0
"""The same distance in the last fit: wide, so that truncating the tails does not move the plane."""
EROSION = 3.0
"""Smallest distance of points from neighbouring faces in the last fit, in sd of the noise."""
FINEST = 5e-4
"""Lower bound of the noise over the extent, as faces are not flatter."""
OUTSIDE = 0.04
"""Largest fraction of points outside the band of a plane of the hull."""
COARSE = 0.02
"""Width of a patch over the extent above which it includes a face's neighbours."""
DIRECTIONS = 500
"""Number of directions in which outer layers are searched."""
MAX_LAYERS = 60
"""Largest number of outer layers."""
COARSER = 4
"""Step between the patches tried after a search along directions."""
GROWING_OUTSIDE = 0.25
"""Largest fraction of points outside the band of a plane that still grows and is not yet level."""
ERODED_BANDS = 2.4
"""Margin, in bands, from a face's outline during the search: noise moves the outline out and neighbours'
points in."""
ALIKE = np.cos(np.radians(4.0))
"""Cosine of the angle within which two planes at one place are the same."""
BLURRED = 1.35
"""Scatter of a plane over that of the others above which it is no face but a slant over an edge."""
UNBENT = 0.5
"""Bending of a fitted face, in sd of the noise, above which it is curved."""
CONVERGED_COSINE = np.cos(np.radians(0.2))
"""Cosine of the angle between successive normals above which a plane has converged."""
MIN_FACE_SHARE = 0.004
"""Fraction of all points below which a group is no face."""
MIN_FACE_POINTS = 25
"""Smallest number of points of a face."""
FLAT = 0.45
"""Bending of a face, in bands, above which it is curved."""
SAME = np.cos(np.radians(15.0))
"""Cosine of the angle within which a patch belongs to the face it lies in."""
EDGE_COSINE = np.cos(np.radians(12.0))
"""Cosine of the angle above which two planes form no edge."""
FEW_ROUNDS, ROUNDS = 3, 8
"""Rounds of refinement, first and last."""
NEXT_ROW = 3.0
"""Distance from a wall, in spacings, within which a face that ends there has points."""


@dataclass(frozen=True, eq=False)
class FittedPlane:
    """Face of the cloud's hull, n.x = offset, with the covariance of its height and slopes about `centre`."""

    normal: Array
    """(3,) outward unit normal n."""
    offset: float
    """Offset n.x of the plane [m]."""
    centre: Array
    """(3,) centroid of the points used [m]."""
    basis: Array
    """(2, 3) unit vectors u, v in the plane as rows."""
    covariance: Array
    """(3, 3) covariance of (height [m], slope along u, slope along v)."""
    scatter: float
    """1 sigma of the points about the plane [m]."""
    count: int
    """Number of points used."""
    bending: float
    """Range of the quadratic part of the points' heights [m]."""
    bending_sd: float
    """1 sigma of `bending` [m]."""

    def heights(self, points: Array) -> Array:
        """Heights (n,) of `points` (n, 3) over the plane [m], positive outside."""
        return np.asarray(points @ self.normal - self.offset)

    def variance(self, points: Array) -> Array:
        """Variance (n,) of the plane's height at `points` (n, 3) [m^2]."""
        row = np.column_stack([np.ones(len(points)), (points - self.centre) @ self.basis.T])
        return np.einsum("ni,ij,nj->n", row, self.covariance, row)


def fitted_planes(points: Array, noise: CloudNoise) -> tuple[FittedPlane, ...]:
    """Planar faces of the hull of `points` (n, 3) [m], those with most points first.

    Planes grow from patches and are kept if hardly a point lies outside, those with most points of their own
    first. Each is then fitted to the points of its inner part, away from all neighbours by `EROSION` sd,
    where only its own noise affects it.
    """
    extent = float(np.ptp(points, axis=0).max())
    sd = max(noise.sd, FINEST * extent)
    found = _refined(points, _searched(points, sd, noise.spacing), sd, noise.spacing, FEW_ROUNDS)
    if not found:
        return ()
    # Whole faces determine the noise better than patches.
    sd = max(float(np.median([plane.scatter for plane in found])), FINEST * extent)
    believed = [(plane.normal, plane.offset) for plane in found if plane.scatter < BLURRED * sd]
    found = [
        plane
        for plane in _refined(points, believed, sd, noise.spacing, FEW_ROUNDS)
        if plane.bending < UNBENT * sd + 3 * plane.bending_sd
    ]
    return tuple(
        _refined(points, [(plane.normal, plane.offset) for plane in found], sd, noise.spacing, ROUNDS)
    )


def even_directions(many: int) -> Array:
    """Unit vectors (many, 3) spread evenly over the sphere (golden spiral)."""
    i = np.arange(many) + 0.5
    z, turn = 1 - 2 * i / many, np.pi * (1 + 5**0.5) * i
    return np.column_stack([np.sqrt(1 - z**2) * np.cos(turn), np.sqrt(1 - z**2) * np.sin(turn), z])


def _searched(points: Array, sd: float, spacing: float) -> list[tuple[Array, float]]:
    """Normal (3,) and offset [m] of each face, the one with most points of its own first."""
    sample = points[:: max(1, len(points) // SEARCHED)]
    centre = sample.mean(axis=0)
    tree = KDTree(sample)
    seeds = sample[:: max(1, len(sample) // SEEDS)]
    band = BAND * sd
    reach = max(4 * sd, 3 * spacing * np.sqrt(len(points) / len(sample)))
    candidates: list[tuple[Array, float, BoolArray]] = []
    if reach > COARSE * float(np.ptp(sample, axis=0).max()):
        # Patches wider than the noise are hardly smaller than the faces: search along all directions instead.
        grown = [_grown(sample, centre, start, band, np.inf, centre) for start in _peaks(sample[::2], sd)]
        candidates += [each for each in grown if each is not None]
        seeds = seeds[::COARSER]
    for seed in seeds:
        near = np.asarray(tree.query_ball_point(seed, reach), dtype=np.int64)
        if len(near) < 8:
            near = np.asarray(tree.query(seed, k=min(12, len(sample)))[1])
        start = _least_squares(sample[near], centre)
        # A seed within a face already grown would grow it again.
        if any(
            abs(seed @ normal - offset) < band / 2 and start[0] @ normal > SAME
            for normal, offset, _ in candidates
        ):
            continue
        grown = _grown(sample, seed, start, band, reach, centre)
        if grown is not None:
            candidates.append(grown)
    return [
        (normal, offset)
        for normal, offset in _chosen(sample, candidates)
        if _bending(
            points[_eroded(points, np.abs(points @ normal - offset) < band, normal, ERODED_BANDS * band)],
            normal,
            band,
        )
        < FLAT * band
    ]


def _peaks(sample: Array, sd: float) -> list[tuple[Array, float]]:
    """Normals (3,) and offsets [m] of thin outer layers with most points, best first and 15 degrees apart."""
    directions = even_directions(DIRECTIONS)
    heights = np.sort(directions @ sample.T, axis=1)
    tried = heights[:, -max(2, len(sample) // 100), None] - np.arange(0.0, 4.0, 0.5) * sd
    ends = [
        np.searchsorted(row, np.concatenate([level - sd, level + sd]))
        for row, level in zip(heights, tried, strict=True)
    ]
    below, within = np.split(np.array(ends), 2, axis=1)
    within = within - below
    # The first of those with most points, the largest_height.
    best = np.argmax(within, axis=1)
    counts, levels = within[np.arange(DIRECTIONS), best], tried[np.arange(DIRECTIONS), best]
    taken: list[tuple[Array, float]] = []
    free = np.ones(DIRECTIONS, dtype=bool)
    for index in np.argsort(-counts):
        if free[index]:
            taken.append((directions[index], float(levels[index])))
            free &= directions @ directions[index] < SAME
    return taken[:MAX_LAYERS]


def _grown(
    sample: Array, seed: Array, start: tuple[Array, float], band: float, reach: float, centre: Array
) -> tuple[Array, float, BoolArray] | None:
    """Plane grown from patch `start` to all points in its band, and their mask (n,); None off the hull."""
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
        if inliers.sum() < 8 or np.sum((height > 2 * band) & close) > GROWING_OUTSIDE * inliers.sum() + 2:
            return None
        normal, offset = _least_squares(sample[inliers], centre)
    for _ in range(4):
        inliers = np.abs(sample @ normal - offset) < band
        inner = _eroded(sample, inliers, normal, ERODED_BANDS * band)
        if inner.sum() < 8:
            return None
        before = normal
        normal, offset = _least_squares(sample[inner], centre)
        if before @ normal > CONVERGED_COSINE:
            break
    height = sample @ normal - offset
    inliers = np.abs(height) < band
    if np.sum(height > band) > OUTSIDE * inliers.sum() + 1:
        return None
    return normal, offset, inliers


def _eroded(points: Array, members: BoolArray, normal: Array, margin: float) -> BoolArray:
    """Mask (n,) of `members` (n,) at least `margin` [m], or half the largest depth, within their outline."""
    flat = points[members] @ _basis(normal).T
    kept = np.zeros(len(points), dtype=bool)
    try:
        outline = ConvexHull(flat)
    except (QhullError, ValueError):
        return kept
    depth = -(flat @ outline.equations[:, :2].T + outline.equations[:, 2]).max(axis=1)
    kept[np.flatnonzero(members)[depth >= min(margin, 0.5 * float(depth.max()))]] = True
    return kept


def _chosen(sample: Array, candidates: list[tuple[Array, float, BoolArray]]) -> list[tuple[Array, float]]:
    """Planes chosen one by one by their number of points that no chosen plane has."""
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
        # Mostly taken by planes that explain more: a slant over an edge.
        if own[best] < 0.15 * inliers.sum():
            continue
        chosen.append((normal, offset))
        free &= ~inliers
    return chosen


def _bending(points: Array, normal: Array, band: float) -> float:
    """Range [m] of the quadratic part of a fit to the points' heights, plus its uncertainty."""
    return _bent(points, normal) + 4 * band / BAND / np.sqrt(len(points))


def _bent(points: Array, normal: Array) -> float:
    """Range [m] over `points` (n, 3) of the quadratic part of a fit to their heights."""
    basis = _basis(normal)
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


def _refined(
    points: Array, planes: list[tuple[Array, float]], sd: float, spacing: float, rounds: int
) -> list[FittedPlane]:
    current = list(planes)
    centre = points.mean(axis=0)
    fitted: list[FittedPlane] = []
    for _ in range(rounds):
        fitted = []
        heights = _heights(points, current, sd)
        for index in range(len(current)):
            plane = _fit(points, face_weights(points, current, index, sd, spacing, heights), centre)
            if plane is not None and not any(
                plane.normal @ other.normal > ALIKE and abs(other.heights(plane.centre[None])[0]) < BAND * sd
                for other in fitted
            ):
                fitted.append(plane)
        following = [(plane.normal, plane.offset) for plane in fitted]
        settled = len(following) == len(current) and all(
            np.abs(new[0] - old[0]).max() < 1e-5 and abs(new[1] - old[1]) < 1e-2 * sd
            for new, old in zip(following, current, strict=True)
        )
        current = following
        if settled:
            break
    return sorted(fitted, key=lambda plane: -plane.count)


def _heights(points: Array, planes: list[tuple[Array, float]], sd: float) -> Array:
    """Heights (n, p) of `points` (n, 3) over each plane, in units of `sd`."""
    return (
        np.column_stack([points @ normal - offset for normal, offset in planes]) / sd
        if planes
        else np.zeros((len(points), 0))
    )


def face_weights(
    points: Array, planes: list[tuple[Array, float]], index: int, sd: float, spacing: float, heights: Array
) -> Array:
    """Probability (n,) that each point belongs to face `index`, and 0 near its outline.

    A uniformly sampled face, blurred by the noise, has the density phi(d_i) * prod Phi(-d_j) at heights d
    over itself and its walls; the probability of face i is its share of the sum over the faces (McLachlan and
    Peel, Finite Mixture Models, 2000, section 2.8). With these weights, points of the walls do not pull the
    face inwards, however near the edge.

    Args:
        points: (n, 3) [m].
        planes: Normals (3,) and offsets [m] of p planes.
        index: Index of the face among the planes.
        sd: 1 sigma of the noise [m].
        spacing: Distance of neighbouring points [m].
        heights: (n, p) heights of the points over the planes, in units of `sd`.
    """
    mine = np.abs(heights[:, index]) < FIT_BAND
    weights = np.zeros(len(points))
    if mine.sum() < MIN_FACE_POINTS:
        return weights
    normals = np.array([normal for normal, _ in planes])
    near = heights[mine]
    cosine = normals @ normals.T
    walls = (cosine > -0.99) & (cosine < EDGE_COSINE)
    below = ndtr(-near)
    density = np.exp(-0.5 * near**2)
    for face in range(len(planes)):
        density[:, face] *= np.prod(below[:, walls[face]], axis=1)
    weights[mine] = density[:, index] / np.maximum(density.sum(axis=1), 1e-12)
    flat = points[mine] @ _basis(normals[index]).T
    try:
        outline = ConvexHull(flat)
    except QhullError:
        return np.zeros(len(points))
    depth = -(flat @ outline.equations[:, :2].T + outline.equations[:, 2]).max(axis=1)
    deepest = float(depth.max())
    margin = float(np.clip(EROSION * sd + spacing, 0.1 * deepest, 0.25 * deepest))
    kept = near[:, walls[index]].max(axis=1, initial=-np.inf) * sd <= -margin
    met = near.max(axis=0) * sd > -(FIT_BAND * sd + NEXT_ROW * spacing)
    if not _walled([plane for plane, meets in zip(planes, met, strict=True) if meets], normals[index]):
        # Curved neighbours, and ledges under the hull, have no plane: keep away from the outline, which noise
        # moves out.
        kept &= depth >= min(2 * EROSION * sd + spacing, 0.5 * deepest)
    selected = np.flatnonzero(mine)
    weights[selected[~kept]] = 0.0
    return weights


def _walled(planes: list[tuple[Array, float]], normal: Array) -> bool:
    """True if `planes` bound the face with `normal` (3,) on all sides, so that it has no other neighbour."""
    basis = _basis(normal)
    walls = []
    for across, _ in planes:
        flat = basis @ across
        if -0.99 < float(across @ normal) < EDGE_COSINE:
            walls.append(flat / np.linalg.norm(flat))
    if len(walls) < 3:
        return False
    angle = np.sort(np.arctan2(np.array(walls)[:, 1], np.array(walls)[:, 0]))
    gap = np.diff(np.append(angle, angle[0] + 2 * np.pi))
    return bool(gap.max() < np.radians(150))


def _fit(points: Array, weights: Array, inside: Array) -> FittedPlane | None:
    """Plane by weighted total least squares, covariance from residuals (White 1980); None if too few."""
    used = weights > 1e-3
    if weights.sum() < MIN_FACE_POINTS:
        return None
    chosen, weight = points[used], weights[used]
    total = float(weight.sum())
    centre = weight @ chosen / total
    offset = chosen - centre
    _, vectors = np.linalg.eigh((offset * weight[:, None]).T @ offset)
    normal = vectors[:, 0] if float(vectors[:, 0] @ (centre - inside)) > 0 else -vectors[:, 0]
    basis = _basis(normal)
    residual = offset @ normal
    scatter = float(np.sqrt(weight @ residual**2 / max(total - 3, 1)))
    row = np.column_stack([np.ones(len(chosen)), offset @ basis.T])
    bread = np.linalg.inv((row * weight[:, None]).T @ row)
    pull = row * (weight * residual)[:, None]
    covariance = bread @ (pull.T @ pull) @ bread * total / max(total - 3, 1)
    return FittedPlane(
        normal,
        float(normal @ centre),
        centre,
        basis,
        covariance,
        scatter,
        round(total),
        _bent(chosen[weight > 0.5], normal),
        4 * scatter / np.sqrt(total),
    )


def _least_squares(points: Array, inside: Array) -> tuple[Array, float]:
    """Normal (3,), away from `inside` (3,), and offset [m] of the least-squares plane of points (n, 3)."""
    centre = points.mean(axis=0)
    offset = points - centre
    _, vectors = np.linalg.eigh(offset.T @ offset)
    normal = vectors[:, 0]
    if float(normal @ (centre - inside)) < 0:
        normal = -normal
    return normal, float(normal @ centre)


def _basis(normal: Array) -> Array:
    """Orthonormal vectors (2, 3) in the plane with unit `normal` (3,), as rows."""
    return np.stack(plane_basis(normal))
