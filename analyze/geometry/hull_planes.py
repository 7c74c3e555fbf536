"""Robust planes of a noisy point cloud's hull, each with its covariance (method 1.2); lengths in m.

The raw convex hull of a noisy cloud consists of the noise's extremes: at 5 mm noise its edges lie 5 mm too
far out. Here a plane is fitted to all points of a face, and an edge is where two such planes meet. A bias of
the noise (all points too far out by the same) moves the planes with it: the points cannot show it, the object
file states it (`shape.surface_sd_m`), or it is assumed.
"""

# scipy is only partly typed.
# pyright: reportMissingTypeStubs=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false, reportUnknownMemberType=false

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import ConvexHull, QhullError
from scipy.special import ndtr

from analyze.geometry.cloud_noise import CloudNoise
from analyze.geometry.plane_search import SEARCH_BAND_SDS, bending, in_plane_basis, planes_of_faces
from analyze.types import Array

FIT_BAND_SDS = 4.0
"""Distance from a plane, in sd of the noise, up to which a point belongs to it in the fit: wide, so that
truncating the tails does not move the plane."""
WALL_MARGIN_SDS = 3.0
"""Smallest depth of a face's points below neighbouring faces in the fit, in sd of the noise."""
MIN_NOISE_FRACTION = 5e-4
"""Lower bound of the noise over the cloud's extent: real faces are not flatter."""
SAME_PLANE_COSINE = np.cos(np.radians(4.0))
"""Cosine of the angle within which two planes at one place are the same."""
MAX_SCATTER_RATIO = 1.35
"""Scatter of a plane, over the median of all, above which it is no face but a slant over an edge."""
MAX_BENDING_SDS = 0.5
"""Bending of a fitted face, in sd of the noise, above which the face is curved and dropped."""
MIN_FACE_POINTS = 25
"""Smallest number of points of a face."""
EDGE_COSINE = np.cos(np.radians(12.0))
"""Cosine of the angle above which two planes form no edge."""
FIRST_ROUNDS, LAST_ROUNDS = 3, 8
"""Largest numbers of rounds of refinement: with the noise of patches, and in the end."""
WALL_REACH_SPACINGS = 3.0
"""Distance from a neighbouring face, in spacings, within which a face that ends there has points."""


@dataclass(frozen=True, eq=False)
class FittedPlane:
    """Planar face of a point cloud's hull, with the uncertainty of its height and slopes.

    The plane is n.x = offset [m] in the frame of the cloud, n the outward unit `normal`. The covariance (3,
    3) is that of the height [m] over the points' centroid `centre` and of the slopes along u and v, the two
    unit vectors in the plane that are the rows of `basis`.
    """

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
    """Sum of the weights of the points used, rounded."""
    bending: float
    """Range of the quadratic part of the points' heights [m]."""
    bending_sd: float
    """1 sigma of `bending` [m]."""

    def heights(self, points: Array) -> Array:
        """Heights (n,) [m] of `points` (n, 3) [m] over the plane, positive outside the body."""
        return np.asarray(points @ self.normal - self.offset)

    def variance(self, points: Array) -> Array:
        """Variance (n,) [m^2] of the plane's height at `points` (n, 3) [m], from its covariance."""
        row = np.column_stack([np.ones(len(points)), (points - self.centre) @ self.basis.T])
        return np.einsum("ni,ij,nj->n", row, self.covariance, row)


def fitted_planes(points: Array, noise: CloudNoise) -> tuple[FittedPlane, ...]:
    """Planar faces of a point cloud's hull, those with most points first; empty if there are none.

    Planes grow from small patches of points, and are kept if hardly a point lies outside them. Each is then
    fitted to the points of its inner part, where the noise of neighbouring faces hardly matters. These points
    lie below the planes of the neighbouring faces by `WALL_MARGIN_SDS` times the noise's 1 sigma plus one
    point spacing, but by at least 10 and at most 25 % of the face's depth (largest distance of its points
    from its outline). Curved parts of the hull have no plane.

    Args:
        points: (n, 3) points of the cloud [m].
        noise: Noise and spacing of the cloud.

    Returns:
        Per plane outward unit normal (3,) and offset [m] (normal . x = offset), with the covariance of its
        height and slopes.
    """
    extent = float(np.ptp(points, axis=0).max())
    sd = max(noise.sd, MIN_NOISE_FRACTION * extent)
    found = _refined_planes(
        points, planes_of_faces(points, sd, noise.spacing), sd, noise.spacing, FIRST_ROUNDS
    )
    if not found:
        return ()
    # Whole faces determine the noise better than patches.
    sd = max(float(np.median([plane.scatter for plane in found])), MIN_NOISE_FRACTION * extent)
    believed = [(plane.normal, plane.offset) for plane in found if plane.scatter < MAX_SCATTER_RATIO * sd]
    found = [
        plane
        for plane in _refined_planes(points, believed, sd, noise.spacing, FIRST_ROUNDS)
        if plane.bending < MAX_BENDING_SDS * sd + 3 * plane.bending_sd
    ]
    return tuple(
        _refined_planes(
            points, [(plane.normal, plane.offset) for plane in found], sd, noise.spacing, LAST_ROUNDS
        )
    )


def _refined_planes(
    points: Array, planes: list[tuple[Array, float]], sd: float, spacing: float, rounds: int
) -> list[FittedPlane]:
    """Planes fitted repeatedly to the points of their faces until they settle, most points first.

    Planes with fewer than `MIN_FACE_POINTS` points, and those that coincide with an earlier one, are dropped.

    Args:
        points: (n, 3) points of the cloud [m].
        planes: Outward unit normal (3,) and offset [m] of each plane, as a first approximation.
        sd: 1 sigma of the noise [m].
        spacing: Distance of neighbouring points [m].
        rounds: Largest number of fits.

    Returns:
        The planes of the last fit, each with the covariance (3, 3) of its height [m] and two slopes.
    """
    current = list(planes)
    centre = points.mean(axis=0)
    fitted: list[FittedPlane] = []
    for _ in range(rounds):
        fitted = []
        heights = _heights(points, current, sd)
        for index in range(len(current)):
            plane = weighted_fit(points, face_weights(points, current, index, sd, spacing, heights), centre)
            if plane is not None and not any(
                plane.normal @ other.normal > SAME_PLANE_COSINE
                and abs(other.heights(plane.centre[None])[0]) < SEARCH_BAND_SDS * sd
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
    """Heights (n, p) of `points` (n, 3) [m] over each of p planes, in units of `sd` [m].

    A plane is given by its outward unit normal (3,) and offset [m]; heights are positive outside.
    """
    return (
        np.column_stack([points @ normal - offset for normal, offset in planes]) / sd
        if planes
        else np.zeros((len(points), 0))
    )


def face_weights(
    points: Array, planes: list[tuple[Array, float]], index: int, sd: float, spacing: float, heights: Array
) -> Array:
    """Probability (n,) that each point was measured on face `index`; 0 near the face's outline.

    A uniformly sampled face, blurred by the noise, has the density phi(d_i) * prod Phi(-d_j) at heights d_i
    over itself and d_j over its walls (neighbouring faces), in units of the noise, with phi and Phi the
    normal density and distribution; the probability of face i is its share of the sum over the faces
    (McLachlan and Peel, Finite Mixture Models, 2000, section 2.8). With these weights, points of the walls do
    not pull the face inwards, however near the edge. All are 0 if fewer than `MIN_FACE_POINTS` points lie in
    the face's band (`FIT_BAND_SDS`), or these lie on a line.

    Args:
        points: (n, 3) points of the cloud [m].
        planes: Outward unit normals (3,) and offsets [m] of p planes.
        index: Index of the face among the planes.
        sd: 1 sigma of the noise [m].
        spacing: Distance of neighbouring points [m].
        heights: (n, p) heights of the points over the planes, in units of `sd`.
    """
    mine = np.abs(heights[:, index]) < FIT_BAND_SDS
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
    flat = points[mine] @ in_plane_basis(normals[index]).T
    try:
        outline = ConvexHull(flat)
    except QhullError:
        return np.zeros(len(points))
    depth = -(flat @ outline.equations[:, :2].T + outline.equations[:, 2]).max(axis=1)
    deepest = float(depth.max())
    margin = float(np.clip(WALL_MARGIN_SDS * sd + spacing, 0.1 * deepest, 0.25 * deepest))
    kept = near[:, walls[index]].max(axis=1, initial=-np.inf) * sd <= -margin
    met = near.max(axis=0) * sd > -(FIT_BAND_SDS * sd + WALL_REACH_SPACINGS * spacing)
    if not _has_walls_all_round(normals[met & walls[index]], normals[index]):
        # Curved neighbours, and ledges under the hull, have no plane: keep away from the
        # outline, which noise moves out.
        kept &= depth >= min(2 * WALL_MARGIN_SDS * sd + spacing, 0.5 * deepest)
    selected = np.flatnonzero(mine)
    weights[selected[~kept]] = 0.0
    return weights


def _has_walls_all_round(walls: Array, normal: Array) -> bool:
    """True if planes with unit normals `walls` (w, 3) bound the face of unit `normal` (3,) on all sides.

    There must be three walls or more, with no gap of 150 degrees or more between successive ones. Points of
    other neighbours then cannot be mixed with the face's.
    """
    return len(walls) >= 3 and widest_gap(walls @ in_plane_basis(normal).T) < np.radians(150)


def widest_gap(flat: Array) -> float:
    """Largest angle [rad] between successive directions of n >= 1 plane vectors `flat` (n, 2).

    It is 2 pi for one vector.
    """
    angle = np.sort(np.arctan2(flat[:, 1], flat[:, 0]))
    return float(np.diff(np.append(angle, angle[0] + 2 * np.pi)).max())


def weighted_fit(
    points: Array, weights: Array, inside: Array, fewest: int = MIN_FACE_POINTS
) -> FittedPlane | None:
    """Plane by weighted total least squares, with its covariance from the residuals (White 1980).

    The covariance (3, 3) is that of the plane's height [m] at the weighted centroid of the points used, and
    of its slopes along two axes in the plane.

    Args:
        points: (n, 3) points of the cloud [m].
        weights: (n,) weights of the points, 0 to 1.
        inside: (3,) point within the body [m]; the normal points away from it.
        fewest: Smallest number of points.

    Returns:
        The plane; None if the weights add up to less than `fewest`.
    """
    used = weights > 1e-3
    if weights.sum() < fewest:
        return None
    chosen, weight = points[used], weights[used]
    total = float(weight.sum())
    centre = weight @ chosen / total
    offset = chosen - centre
    _, vectors = np.linalg.eigh((offset * weight[:, None]).T @ offset)
    normal = vectors[:, 0] if float(vectors[:, 0] @ (centre - inside)) > 0 else -vectors[:, 0]
    basis = in_plane_basis(normal)
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
        bending(chosen[weight > 0.5], normal),
        4 * scatter / np.sqrt(total),
    )
