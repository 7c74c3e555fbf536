"""Faces of a scanned mesh's hull that are flat within the scan's error, with covariances; lengths in m."""

# scipy is only partly typed.
# pyright: reportMissingTypeStubs=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false, reportUnknownMemberType=false

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from analyze.geometry.hull_planes import FittedPlane
from analyze.geometry.plane_search import in_plane_basis
from analyze.geometry.polyhedron import BoolArray, area_vectors
from analyze.types import Array, IntArray

FLAT_FRACTIONS = (4e-3, 8e-3, 1.2e-2)
"""Deviations of a face from its plane, over the extent, up to which it counts as flat. The flattest faces are
taken first; the panels of cardboard boxes bulge by 1 % of their length."""
SCAN_ERRORS, MAX_ERROR_FRACTION = (5e-4, 8e-4, 1.5e-3), 0.03
"""Smallest deviations [m] up to which a face counts as flat, one for each of `FLAT_FRACTIONS`; but at most
that fraction of the extent."""
MIN_FACE_SHARE = 0.01
"""Smallest area of a flat face, over the hull's area."""
MAX_FACES = 24
"""Largest number of flat faces that are looked for."""
SEEDS = 300
"""Number of the hull's largest facets that are tried as seeds of a face."""
CLUSTER_COSINE = np.cos(np.radians(10.0))
"""Cosine of the angle within which facets first belong to one face."""
MEMBER_COSINE = np.cos(np.radians(25.0))
"""Cosine of the angle between a facet and its face; smaller facets of a rough mesh may point elsewhere."""
FIT_ROUNDS = 8
"""Rounds of fitting a plane to the facets near it."""
BOUNDARY_STEPS = 72
"""Number of points of a face's outline beyond which the hull's direction is examined."""
BOUNDARY_REACH = 0.03
"""Distance beyond a face's outline, over the extent, at which the hull must have turned away."""
ROUNDED_REACH, ROUNDED_FRACTION = 5e-3, 0.08
"""The same for the rounded edges of small objects: [m], but at most this fraction of the extent."""
BOUNDARY_COSINE = np.cos(np.radians(40.0))
"""Cosine of the angle by which the hull must have turned there: less is a curved surface, not a flat face."""
MIN_SHARP_SHARE = 0.85
"""Smallest share of the outline at which it must have turned."""
MIN_INDEPENDENT_PARTS, INDEPENDENT_AREA = 2.0, 9e-4
"""Number of parts of a face whose deviations are independent: one for each such area [m^2], but at least so
many. A scan's error extends over centimetres."""
SAME_FACE_COSINE = np.cos(np.radians(4.0))
"""Cosine of the angle within which two faces are tried as one: noise divides a face along a low ridge."""


@dataclass(frozen=True, eq=False)
class FlatFace:
    """Flat face: plane, and the facets of the hull that belong to it."""

    plane: FittedPlane
    """Plane fitted to the facets, with its covariance."""
    members: IntArray
    """(m,) indices of the hull's facets."""


def flat_faces(hull: ConvexHull, extent: float, fractions: Sequence[float]) -> list[FlatFace]:
    """Faces of a hull that are flat within a scan's error and end in edges, the flattest first.

    A face starts from the direction in which facets have most area; a plane is fitted to the facets near it,
    and again to those near the new plane. It is kept if the hull turns away all round its outline. This is
    done for each fraction in turn, with the facets that are left.

    Args:
        hull: Convex hull.
        extent: Longest extent of the object [m].
        fractions: Deviations from a plane, over the extent, ascending.
    """
    corners = np.asarray(hull.points)[hull.simplices]
    normals, area = np.asarray(hull.equations[:, :3]), np.linalg.norm(area_vectors(corners), axis=1) / 2
    free = np.ones(len(area), dtype=np.bool_)
    seeds = np.argsort(-area, kind="stable")[:SEEDS]
    alike = normals[seeds] @ normals.T > CLUSTER_COSINE
    smallest = MIN_FACE_SHARE * float(hull.area)
    found: list[FlatFace] = []
    for fraction in fractions:
        tolerance = _flatness(fraction, extent)
        reach = max(3 * tolerance, BOUNDARY_REACH * extent, min(ROUNDED_REACH, ROUNDED_FRACTION * extent))
        tried = np.zeros(len(area), dtype=np.bool_)
        while len(found) < MAX_FACES:
            worth = (alike @ (area * free)) * ~(tried | ~free)[seeds]
            best = int(np.argmax(worth))
            if worth[best] < smallest:
                break
            tried |= alike[best]
            face = _grown_face(corners, normals, area, free & alike[best], free, tolerance)
            if face is None or area[face.members].sum() < smallest:
                continue
            if _sharp_share(hull, corners[face.members], face.plane, reach) >= MIN_SHARP_SHARE:
                free[face.members] = False
                found.append(face)
    return _joined_faces(found, corners, normals, area, _flatness(FLAT_FRACTIONS[-1], extent))


def _flatness(fraction: float, extent: float) -> float:
    """Deviation [m] from a plane up to which a face of an object counts as flat.

    Args:
        fraction: Deviation over the extent, one of `FLAT_FRACTIONS`.
        extent: Longest extent of the object [m].
    """
    error = SCAN_ERRORS[FLAT_FRACTIONS.index(fraction)]
    return max(fraction * extent, min(error, MAX_ERROR_FRACTION * extent))


def _joined_faces(
    faces: list[FlatFace], corners: Array, normals: Array, area: Array, tolerance: float
) -> list[FlatFace]:
    """Faces of a hull, with those joined that a scan's error has divided along a low ridge.

    Two are joined if their normals agree within `SAME_FACE_COSINE` and one plane fits both.

    Args:
        faces: Flat faces, the flattest first.
        corners: (f, 3, 3) corners of the hull's facets [m].
        normals: (f, 3) their outward unit normals.
        area: (f,) their areas [m^2].
        tolerance: Largest distance of the corners from the common plane [m].
    """
    kept: list[FlatFace] = []
    for face in faces:
        for index, other in enumerate(kept):
            if face.plane.normal @ other.plane.normal < SAME_FACE_COSINE:
                continue
            members = np.concatenate([other.members, face.members])
            plane = _plane_of(corners[members], area[members], normals[members])
            if float(np.abs(plane.heights(corners[members].reshape(-1, 3))).max()) < tolerance:
                kept[index] = FlatFace(plane, members)
                break
        else:
            kept.append(face)
    return kept


def _grown_face(
    corners: Array, normals: Array, area: Array, start: BoolArray, free: BoolArray, tolerance: float
) -> FlatFace | None:
    """Flat face grown from a set of facets; None if no facet lies near the fitted plane.

    Args:
        corners: (f, 3, 3) corners of the hull's facets [m].
        normals: (f, 3) their outward unit normals.
        area: (f,) their areas [m^2].
        start: (f,) True for the facets to which the plane is fitted first.
        free: (f,) True for the facets that belong to no face yet.
        tolerance: Largest distance of a facet's corners from the plane [m].
    """
    members = np.flatnonzero(start)
    plane: FittedPlane | None = None
    for _ in range(FIT_ROUNDS):
        if len(members) == 0:
            return None
        plane = _plane_of(corners[members], area[members], normals[members])
        height = np.abs(corners @ plane.normal - plane.offset).max(axis=1)
        following = np.flatnonzero(free & (height < tolerance) & (normals @ plane.normal > MEMBER_COSINE))
        if np.array_equal(following, members):
            break
        members = following
    return None if plane is None or len(members) == 0 else FlatFace(plane, members)


def _plane_of(corners: Array, area: Array, normals: Array) -> FittedPlane:
    """Plane fitted to facets by total least squares over their area, with its covariance.

    The deviations count as those of few independent measurements (`shared_covariance`).

    Args:
        corners: (m, 3, 3) corners of the facets [m].
        area: (m,) their areas [m^2].
        normals: (m, 3) their outward unit normals.
    """
    middles = (corners + np.roll(corners, 1, axis=1)) / 2
    weight = np.repeat(area / area.sum() / 3, 3)
    points = middles.reshape(-1, 3)
    centre = weight @ points
    offset = points - centre
    _, vectors = np.linalg.eigh((offset * weight[:, None]).T @ offset)
    normal = vectors[:, 0]
    if float(area @ (normals @ normal)) < 0:
        normal = -normal
    basis = in_plane_basis(normal)
    scatter = float(np.sqrt(weight @ (offset @ normal) ** 2))
    plane = FittedPlane(
        normal, float(normal @ centre), centre, basis, np.zeros((3, 3)), scatter, len(corners), 0.0, 0.0
    )
    return replace(plane, covariance=shared_covariance(offset, weight, plane))


def shared_covariance(offset: Array, weight: Array, plane: FittedPlane) -> Array:
    """Covariance (3, 3) of a plane's height [m] and slopes from an error that neighbouring points share.

    Args:
        offset: (n, 3) points relative to the plane's centre [m].
        weight: (n,) their weights, of sum 1.
        plane: Plane through the points.
    """
    residual = offset @ plane.normal
    row = np.column_stack([np.ones(len(offset)), offset @ plane.basis.T])
    spread = (row * weight[:, None]).T @ row
    # Of a rectangle; other faces of this spread have nearly the same area.
    area = 12 * float(np.sqrt(max(np.linalg.det(spread[1:, 1:]), 0.0)))
    variance = float(weight @ residual**2) / max(area / INDEPENDENT_AREA, MIN_INDEPENDENT_PARTS)
    return np.asarray(variance * np.linalg.pinv(spread), dtype=np.float64)


def _sharp_share(hull: ConvexHull, corners: Array, plane: FittedPlane, reach: float) -> float:
    """Share of a face's outline beyond which the hull turns away, as at an edge.

    On a curved flank the normal turns by little more than the face's own curvature.

    Args:
        hull: Convex hull.
        corners: (m, 3, 3) corners of the face's facets [m].
        plane: Plane of the face.
        reach: Distance beyond the outline at which the hull's normal is examined [m].
    """
    flat = (corners.reshape(-1, 3) - plane.centre) @ plane.basis.T
    try:
        outline = flat[ConvexHull(flat).vertices]
    except QhullError:
        return 0.0
    following = np.roll(outline, -1, axis=0)
    length = np.linalg.norm(following - outline, axis=1)
    at = (np.arange(BOUNDARY_STEPS) + 0.5) / BOUNDARY_STEPS * length.sum()
    side = np.searchsorted(np.cumsum(length), at).clip(max=len(length) - 1)
    along = (following - outline)[side] / length[side, None]
    place = outline[side] + along * (at - (np.cumsum(length) - length)[side])[:, None]
    outwards = np.column_stack([along[:, 1], -along[:, 0]])
    beyond = plane.centre + (place + reach * outwards) @ plane.basis
    normals, offsets = np.asarray(hull.equations[:, :3]), np.asarray(hull.equations[:, 3])
    cosine = normals @ plane.normal
    # Where a line along the normal leaves the body: the lowest of the planes that face the normal.
    facing = np.flatnonzero(cosine > 1e-9)
    leaves = (-offsets[facing, None] - normals[facing] @ beyond.T) / cosine[facing, None]
    top = np.argmin(leaves, axis=0)
    surface = beyond + leaves[top, np.arange(len(beyond))][:, None] * plane.normal
    missed = (normals @ surface.T + offsets[:, None]).max(axis=0) > 1e-6
    return float(np.mean(missed | (cosine[facing][top] < BOUNDARY_COSINE)))
