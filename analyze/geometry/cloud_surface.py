"""Exterior of an object from a noisy point cloud: hull of fitted planes and smoothed curved parts.

Edges are the virtual sharp ones, where the fitted faces meet; the points beside them give the radius of their
rounding (cloud_roundings.py). Hollows are bridged and places without points are closed flat; both are
reported.
"""

# scipy is only partly typed.
# pyright: reportMissingTypeStubs=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false, reportUnknownMemberType=false

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import ConvexHull, HalfspaceIntersection, KDTree, QhullError

from analyze.geometry import scanned_surface
from analyze.geometry.cloud_noise import CloudNoise, cloud_noise
from analyze.geometry.cloud_rims import (
    FACE_BAND_SCATTERS,
    MIN_OUTLINE_POINTS,
    rim_of_face,
    rim_within_outline,
)
from analyze.geometry.cloud_roundings import EdgeRounding, bevels, edge_roundings
from analyze.geometry.cloud_smoothing import MIN_HOLLOW_DEPTH, smoothed_points
from analyze.geometry.distance import largest_height
from analyze.geometry.hull_planes import MIN_NOISE_FRACTION, FittedPlane, fitted_planes
from analyze.geometry.polyhedron import BoolArray, hull_faces
from analyze.geometry.scanned_surface import ScannedSurface
from analyze.types import Array, IntArray

STRAY_DISTANCE_RATIO = 8.0
"""Distance to the eighth neighbour, over its median, beyond which a point is a stray."""
MIN_CLUMP_SHARE = 0.02
"""Fraction of the points below which a separate clump is stray."""
MAX_ROUNDING_FRACTION = 0.02
"""Distance of a rounded corner from the virtual one, over the cloud's extent, up to which points support
it."""
EDGE_STEPS = 60
"""Steps along an edge at which its support by points is examined."""
ON_PLANE_FRACTION = 1e-6
"""Distance from a plane, over the cloud's extent, up to which a vertex lies on it."""
DEPTH_SAMPLES = 4000
"""Number of points whose depth below the hull is measured."""
EXTRAPOLATED_SDS = 0.25
"""1 sigma of an edge to which a wall was extrapolated, over the noise."""
MIN_TABLE_MARGIN = 0.05
"""Smallest distance, over the cloud's extent, by which a table extends beyond the object on it."""
OUTLINE_GAP_SPACINGS = 0.5
"""Distance of a face's outermost points from its true outline, over the spacing."""
TWO_SIDES_RATIO = 1.2
"""Scatter of a foot of two sides over that of one, above which they are distinguished: at a foot 1.3 times as
thick as the noise."""
MIN_NOISE_POINTS = 96
"""Smallest number of points whose noise is determined."""
MIN_TABLE_SHARE = 0.15
"""Fraction of a plane's points beyond what stands on it above which the plane is a table."""


@dataclass(frozen=True)
class Overhang:
    """Plane of a point cloud, without measurable thickness, that extends beyond what stands on it."""

    length: float
    """Distance [m] by which it extends beyond."""
    two_sided: bool
    """True if its points are the two sides of a foot, thin within the noise; False for a table."""

    def refusal(self, noise: float) -> str:
        """Why a cloud with this plane gives no exterior, and the remedy.

        Args:
            noise: 1 sigma [m] of the points' scatter.
        """
        length, scatter = 1000 * self.length, f"{1000 * noise:.1f} mm"
        if self.two_sided:
            return (
                f"has a foot or flange that extends {length:.0f} mm beyond what stands on it and is about as "
                f"thin as the points scatter ({scatter}), so that its edges cannot be found: scan it with "
                "less noise, or give a mesh"
            )
        return (
            f"seems to contain the table: a plane without measurable thickness extends {length:.0f} mm "
            "beyond what stands on it: cut it off; if it is a foot of the object, thinner than the points "
            f"scatter ({scatter}), give a mesh"
        )


@dataclass(frozen=True, eq=False)
class CloudSurface:
    """Closed convex surface fitted to a point cloud, in the cloud's frame, with the quality of the fit."""

    vertices: Array
    """(n, 3) vertices [m]."""
    faces: IntArray
    """(f, 3) faces, counter-clockwise from outside."""
    planes: tuple[FittedPlane, ...]
    """Planar faces, those with most points first."""
    noise: CloudNoise
    """Noise and spacing of the cloud."""
    smooth_sd: float
    """1 sigma of the surface where no plane is fitted [m]."""
    strays: int
    """Number of stray points left out."""
    hollow_share: float
    """Fraction of the points in hollows: deeper below the hull than 4 sd and `MIN_HOLLOW_DEPTH`."""
    hollow_depth: float
    """99 % quantile of the depth of the points in hollows [m]; 0 if there are none."""
    scanned: ScannedSurface
    """Parts of the surface with and without points nearby."""
    overhang: Overhang | None
    """Plane without measurable thickness, such as a scanned table, that extends beyond what stands on it.

    None if there is none."""
    unwalled: tuple[bool, ...]
    """For each plane, True if its outline is that of its own points, as the wall on it is too low to be
    extrapolated."""
    roundings: tuple[EdgeRounding, ...] = ()
    """Roundings that the points show at edges between two planes."""
    meshed: bool = False
    """True if a scan's mesh was fitted, whose making rounds every edge: its true radius is at most the one
    seen."""


def cloud_surface(points: Array) -> CloudSurface:
    """Closed convex surface fitted to a point cloud, with its faces' planes and the quality of the fit.

    The quality is given by noise, stray points, hollows, and parts of the surface without points.

    Args:
        points: (n, 3) points [m]; the result is in their frame.

    Raises:
        ValueError: the points lie in one plane, or there are fewer than 50.
    """
    kept, strays = _without_strays(points)
    try:
        ConvexHull(kept)
    except QhullError:
        raise ValueError("the points lie in one plane") from None
    tree = KDTree(kept)
    extent = float(np.ptp(kept, axis=0).max())
    noise = cloud_noise(kept, tree)
    planes = fitted_planes(kept, noise)
    sd = max([noise.sd, *(plane.scatter for plane in planes)])
    planes = (*planes, *bevels(kept, planes, sd, extent))
    sharp = virtual_corners(kept, tree, planes, sd, noise.spacing, extent)
    smoothed, normals, smooth_sd = smoothed_points(kept, planes, sharp, sd, noise.spacing, extent)
    rims, thin = [], []
    for plane in planes:
        rim, pulled = rim_within_outline(
            rim_of_face(smoothed, normals, plane, planes, sd, noise.spacing, smooth_sd),
            kept,
            plane,
            sd,
            noise.spacing,
        )
        rims.append(rim)
        thin.append(pulled)
    try:
        hull = ConvexHull(np.vstack([sharp, smoothed, *rims]))
    except (QhullError, ValueError):
        raise ValueError("the points lie in one plane") from None
    used, faces = np.unique(hull_faces(hull), return_inverse=True)
    vertices, faces = hull.points[used], faces.reshape(-1, 3).astype(np.int64)
    equations = np.unique(np.round(hull.equations, 6), axis=0)
    some = kept[:: max(1, len(kept) // DEPTH_SAMPLES)]
    depth = -largest_height(equations, some)
    deep = depth > max(4 * sd, MIN_HOLLOW_DEPTH * extent)
    reach = max(4 * sd, MIN_HOLLOW_DEPTH * extent) + 2.5 * noise.spacing
    gap = max(2 * sd, 1.5 * noise.spacing)
    return CloudSurface(
        vertices,
        faces,
        planes,
        noise,
        smooth_sd,
        strays,
        float(deep.mean()),
        float(np.quantile(depth[deep], 0.99)) if deep.any() else 0.0,
        scanned_surface.scanned_cloud(
            vertices, faces, tree, reach, gap, max(sd, MIN_NOISE_FRACTION * extent)
        ),
        _overhang(kept, planes, noise.spacing, extent),
        tuple(thin),
        edge_roundings(kept, planes, sd, extent),
    )


def line_sd(surface: CloudSurface, ends: Array) -> float:
    """1 sigma [m] of the place of a hull edge, perpendicular to the edge, in the worst direction.

    It depends on how many of the planes fitted to faces contain the edge.

    - Two or more: it follows from N x = delta, with N (2, 3) the normals of two of them, x the edge's
      displacement and delta the planes' displacements, of known variance.
    - One: the root of the summed variances of this plane, of the smoothed wall beside it, and of
      `EXTRAPOLATED_SDS` times the noise, since the wall is extrapolated over the band in which it cannot be
      distinguished from the face. For a wall too low for that, the third variance is the sum of those of the
      noise and of `OUTLINE_GAP_SPACINGS` times the spacing of the points.
    - None: the root of the summed squares of noise and spacing, as the object ends somewhere between two
      points, and smoothing rounds off the edge.

    Args:
        surface: Surface with its fitted planes, noise and spacing.
        ends: (2, 3) ends of the edge [m], in the frame of the cloud.
    """
    planes, sd = surface.planes, max([surface.noise.sd, *(plane.scatter for plane in surface.planes)])
    scale = float(np.linalg.norm(ends).max()) + 1e-3
    middle = ends.mean(axis=0, keepdims=True)
    meeting = [
        plane for plane in planes if np.abs(plane.heights(ends)).max() < 10 * ON_PLANE_FRACTION * scale
    ]
    if len(meeting) >= 2:
        first = meeting[0]
        second = min(meeting[1:], key=lambda plane: abs(float(plane.normal @ first.normal)))
        across = np.stack([first.normal, second.normal])
        inverse = np.linalg.pinv(across)
        variance = np.diag([float(plane.variance(middle)[0]) for plane in (first, second)])
        return float(np.sqrt(np.linalg.eigvalsh(inverse @ variance @ inverse.T)[-1]))
    if meeting:
        followed = (EXTRAPOLATED_SDS * sd) ** 2
        if surface.unwalled[planes.index(meeting[0])]:
            followed = sd**2 + (OUTLINE_GAP_SPACINGS * surface.noise.spacing) ** 2
        return float(np.sqrt(meeting[0].variance(middle)[0] + surface.smooth_sd**2 + followed))
    return float(np.hypot(sd, surface.noise.spacing))


def _without_strays(points: Array) -> tuple[Array, int]:
    """Points (k, 3) of `points` (n, 3) [m] that are not stray, and the number of those left out.

    Stray are isolated points and small separate clumps.

    Raises:
        ValueError: there are fewer than 50 points.
    """
    if len(points) < 50:
        raise ValueError("too few points")
    distance, index = KDTree(points).query(points, k=9)
    lonely = distance[:, -1] > STRAY_DISTANCE_RATIO * float(np.median(distance[:, -1]))
    linked = (distance[:, 1:] <= STRAY_DISTANCE_RATIO * float(np.median(distance[:, -1]))) & ~lonely[:, None]
    rows = np.repeat(np.arange(len(points)), 8)[linked.ravel()]
    columns = np.asarray(index)[:, 1:].ravel()[linked.ravel()]
    _, clump = connected_components(
        coo_array((np.ones(len(rows)), (rows, columns)), shape=(len(points),) * 2), directed=False
    )
    size = np.asarray(np.bincount(clump))
    keep = ~lonely & (size[clump] >= MIN_CLUMP_SHARE * len(points))
    return points[keep], int(np.sum(~keep))


def _overhang(
    points: Array, planes: tuple[FittedPlane, ...], spacing: float, extent: float
) -> Overhang | None:
    """Plane without measurable thickness that extends beyond what stands on it; None if there is none.

    A foot, a flange or a plate that was scanned all round is none if it is thicker than the noise: it has its
    other side above it, with the same outline.

    Args:
        points: (n, 3) points of the cloud [m].
        planes: Planar faces.
        spacing: Distance of neighbouring points [m].
        extent: Largest extent of the cloud [m].
    """
    for plane in planes:
        height = plane.heights(points)
        over = points[height < -FACE_BAND_SCATTERS * plane.scatter]
        if len(over) < MIN_OUTLINE_POINTS:
            continue
        try:
            outline = ConvexHull(over @ plane.basis.T).equations
        except QhullError:
            continue
        on = points[np.abs(height) <= FACE_BAND_SCATTERS * plane.scatter]
        beyond = (on @ plane.basis.T @ outline[:, :2].T + outline[:, 2]).max(axis=1)
        # A slanting wall has left its foot's outline where it can be distinguished from the plane.
        far = beyond > MIN_TABLE_MARGIN * extent + 2 * spacing + 2 * FACE_BAND_SCATTERS * plane.scatter
        if far.mean() > MIN_TABLE_SHARE:
            return Overhang(float(beyond.max()), _has_two_sides(on, over, beyond, far, spacing))
    return None


def _has_two_sides(on: Array, over: Array, beyond: Array, far: BoolArray, spacing: float) -> bool:
    """True if a plane's points beyond what stands on it are the two sides of a foot, thin within the noise.

    Two sides scatter more than one surface: more than the underside alone does, beneath what stands there,
    or, with few points beneath, than the surface of what stands there. A table is not scanned where
    something stands on it.

    Args:
        on: (n, 3) points of the plane [m].
        over: (k, 3) points of what stands on it [m].
        beyond: (n,) distance of the plane's points from the outline of what stands on it [m], negative
            within.
        far: (n,) True for points that lie beyond it by more than the plane's error.
        spacing: Distance of neighbouring points [m].
    """
    beneath = on[beyond < -2 * spacing]
    if len(beneath) < MIN_OUTLINE_POINTS:
        return False
    single = beneath if len(beneath) >= MIN_NOISE_POINTS else over
    sides, side = (cloud_noise(each, KDTree(each)).sd for each in (on[far], single))
    return sides > TWO_SIDES_RATIO * side


def virtual_corners(
    points: Array, tree: KDTree, planes: tuple[FittedPlane, ...], sd: float, spacing: float, extent: float
) -> Array:
    """Corners, and places along the edges, (k, 3) [m] of the body that the fitted planes bound.

    Only those with points of the cloud nearby are returned; none if there are no planes, or they bound no
    body.

    Args:
        points: (n, 3) points of the cloud [m].
        tree: Search tree of these points.
        planes: Planar faces.
        sd: 1 sigma of the noise [m].
        spacing: Distance of neighbouring points [m].
        extent: Largest extent of the cloud [m].
    """
    if not planes:
        return np.zeros((0, 3))
    room = 5 * sd + spacing + 0.05 * extent
    low, high = points.min(axis=0) - room, points.max(axis=0) + room
    box = [
        np.concatenate([sign * np.eye(3)[axis], [-sign * limit]])
        for sign, end in ((1, high), (-1, low))
        for axis, limit in enumerate(end)
    ]
    halfspaces = np.array([[*plane.normal, -plane.offset] for plane in planes] + box)
    try:
        body = HalfspaceIntersection(halfspaces, points.mean(axis=0))
    except QhullError:
        return np.zeros((0, 3))
    vertices = body.intersections[np.isfinite(body.intersections).all(axis=1)]
    heights = np.column_stack([plane.heights(vertices) for plane in planes])
    on = np.abs(heights) < ON_PLANE_FRACTION * extent
    reach = 4 * sd + 3 * spacing + MAX_ROUNDING_FRACTION * extent
    found: list[Array] = []
    for i in range(len(planes)):
        for j in range(i):
            shared = vertices[on[:, i] & on[:, j]]
            if len(shared) < 2:
                continue
            along = np.cross(planes[i].normal, planes[j].normal)
            place = shared @ along
            start, end = shared[int(np.argmin(place))], shared[int(np.argmax(place))]
            steps = start + np.linspace(0, 1, EDGE_STEPS + 1)[:, None] * (end - start)
            gap = np.asarray(tree.query(steps)[0])
            beside = (planes[i].heights(points) > -reach) & (planes[j].heights(points) > -reach)
            if (gap < reach).any() and beside.any():
                # No farther than the points beside the edge; corners have their own rule.
                first, last = np.quantile(points[beside] @ along, [0.002, 0.998])
                within = (steps @ along >= first) & (steps @ along <= last)
                found.append(steps[within & (gap < reach)])
    corner = vertices[(on.sum(axis=1) >= 3)]
    if len(corner):
        found.append(corner[np.asarray(tree.query(corner)[0]) < reach])
    return np.vstack(found) if found else np.zeros((0, 3))
