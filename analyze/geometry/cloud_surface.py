"""Exterior of an object from a noisy point cloud: hull of fitted planes and smoothed curved parts.

Edges are the virtual sharp ones, where the fitted faces meet: their rounding is declared (`edge_radius_m`),
not measured. Hollows are bridged and places without points are closed flat; both are measured and reported.
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
from analyze.geometry.cloud_noise import CloudNoise, cloud_noise, quadric_terms
from analyze.geometry.distance import largest_height
from analyze.geometry.hull_planes import DIRECTIONS, FINEST, FittedPlane, even_directions, fitted_planes
from analyze.geometry.polyhedron import BoolArray
from analyze.geometry.scanned_surface import ScannedSurface
from analyze.types import Array, IntArray

STRAY_DISTANCE_RATIO = 8.0
"""Distance to the eighth neighbour, over its median, beyond which a point is a stray."""
MIN_CLUMP_SHARE = 0.02
"""Fraction of the points below which a separate clump is stray."""
ROUNDED = 0.02
"""Distance of a rounded corner from the virtual one, over the extent, up to which it is supported by
points."""
EDGE_STEPS = 60
"""Steps along an edge at which its support by points is examined."""
ON_PLANE = 1e-6
"""Distance over the extent up to which a vertex lies on a plane."""
DEPTH_SAMPLES = 4000
"""Number of points whose depth below the hull is measured."""
MAX_SMOOTHED = 1500
"""Largest number of smoothed points."""
MIN_NEIGHBOURS, MAX_NEIGHBOURS = 24, 400
"""Smallest and largest number of points of a smoothing patch."""
MIN_STEEPNESS = 0.35
"""Sine of the angle between a curved wall and a face above which the wall is extrapolated to meet the
face."""
FOLLOWED = 0.25
"""Share of the noise in the place of an edge to which a wall was extrapolated."""
CIRCLE_SIDES = 128
"""Vertices of a fitted circular rim."""
MAX_RIM_GAP = np.radians(60.0)
"""Largest angle [rad] of a rim without points at which a circle is still fitted."""
MIN_HOLLOW_DEPTH = 0.01
"""Depth below the hull, over the extent, beyond which a point lies in a hollow."""
SHEET = 4.5
"""Height over a plane, in units of its scatter, above which a point stands on it."""
SPREAD = 0.05
"""Distance, over the extent, by which a table extends beyond the object on it."""
POINTS_AT_A_TIME = 1000
"""Points projected on all directions at a time: as many as the caches hold."""
OUTLINE_NOISE_SDS = 2.5
"""Displacement of a face's outline by the noise, in units of its sd."""
OUTLINE_GAP = 0.5
"""Distance of the outermost points from the true outline, over the spacing."""
SPREAD_SHARE = 0.15
"""Fraction of a plane's points beyond the object above which the plane is a table."""


@dataclass(frozen=True, eq=False)
class CloudSurface:
    """Closed convex surface fitted to a point cloud, with the quality of the fit."""

    vertices: Array
    """(n, 3) vertices [m]."""
    faces: IntArray
    """(f, 3) faces, counter-clockwise from outside."""
    planes: tuple[FittedPlane, ...]
    noise: CloudNoise
    smooth_sd: float
    """1 sigma of the surface where no plane is fitted [m]."""
    strays: int
    """Number of stray points left out."""
    hollow_share: float
    """Fraction of the points deep below the hull."""
    hollow_depth: float
    """99 % quantile of the depth of these points [m]."""
    scanned: ScannedSurface
    """Parts of the surface with and without points nearby."""
    sheet: float
    """Distance [m] by which a plane thinner than the noise extends beyond all that stands on it, as a table;
    0: none."""
    unwalled: tuple[bool, ...]
    """For each plane True if only its own points show its outline, since the wall on it is too low to be
    extrapolated."""


def cloud_surface(points: Array) -> CloudSurface:
    """Exterior of a point cloud, `points` (n, 3) [m].

    Raises:
        ValueError: the points lie in one plane or are too few.
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
    sharp = _corners(kept, tree, planes, sd, noise.spacing, extent)
    smoothed, normals, smooth_sd = _smoothed(kept, planes, sharp, sd, noise.spacing, extent)
    rims, thin = [], []
    for plane in planes:
        rim, pulled = _within_outline(
            _rim(smoothed, normals, plane, planes, sd, noise.spacing, smooth_sd),
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
    vertices, faces = _oriented(hull)
    equations = np.unique(np.round(hull.equations, 6), axis=0)
    some = kept[:: max(1, len(kept) // DEPTH_SAMPLES)]
    depth = -largest_height(equations, some)
    deep = depth > max(4 * sd, MIN_HOLLOW_DEPTH * extent)
    reach = max(4 * sd, MIN_HOLLOW_DEPTH * extent) + 2.5 * noise.spacing
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
            vertices, faces, tree, reach, max(2 * sd, 1.5 * noise.spacing), max(sd, FINEST * extent)
        ),
        _sheet(kept, planes, noise.spacing, extent),
        tuple(thin),
    )


def line_sd(surface: CloudSurface, ends: Array) -> float:
    """1 sigma [m] of the place across itself of a hull edge with `ends` (2, 3) [m], worst direction.

    Where two fitted planes meet, it follows from N x = delta with their variances there. With one plane it
    combines that plane's variance, the smoothed wall's, and `FOLLOWED` of the noise, because the wall is
    extrapolated over the band in which it cannot be distinguished from the face (all of the noise, and the
    spacing, where the wall is too low for that). Without planes it is the noise and the spacing: the object
    ends somewhere between two points, and smoothing rounds off an edge that is not resolved.
    """
    planes, sd = surface.planes, max([surface.noise.sd, *(plane.scatter for plane in surface.planes)])
    scale = float(np.linalg.norm(ends).max()) + 1e-3
    middle = ends.mean(axis=0, keepdims=True)
    meeting = [plane for plane in planes if np.abs(plane.heights(ends)).max() < 10 * ON_PLANE * scale]
    if len(meeting) >= 2:
        first = meeting[0]
        second = min(meeting[1:], key=lambda plane: abs(float(plane.normal @ first.normal)))
        across = np.stack([first.normal, second.normal])
        inverse = np.linalg.pinv(across)
        variance = np.diag([float(plane.variance(middle)[0]) for plane in (first, second)])
        return float(np.sqrt(np.linalg.eigvalsh(inverse @ variance @ inverse.T)[-1]))
    if meeting:
        followed = (FOLLOWED * sd) ** 2
        if surface.unwalled[planes.index(meeting[0])]:
            followed = sd**2 + (OUTLINE_GAP * surface.noise.spacing) ** 2
        return float(np.sqrt(meeting[0].variance(middle)[0] + surface.smooth_sd**2 + followed))
    return float(np.hypot(sd, surface.noise.spacing))


def _without_strays(points: Array) -> tuple[Array, int]:
    """Points (k, 3) [m] without isolated ones and specks, and the number left out."""
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


def _sheet(points: Array, planes: tuple[FittedPlane, ...], spacing: float, extent: float) -> float:
    """Distance [m] by which a plane without thickness extends beyond what stands on it; 0 if none does.

    A foot, a flange or a plate that was scanned all round has its other side above it, with the same outline.
    """
    for plane in planes:
        height = plane.heights(points)
        over = points[height < -SHEET * plane.scatter]
        if len(over) < MIN_NEIGHBOURS:
            continue
        try:
            outline = ConvexHull(over @ plane.basis.T).equations
        except QhullError:
            continue
        on = points[np.abs(height) <= SHEET * plane.scatter]
        beyond = (on @ plane.basis.T @ outline[:, :2].T + outline[:, 2]).max(axis=1)
        # A slanting wall has left its foot's outline where it can be distinguished from the plane.
        far = beyond > SPREAD * extent + 2 * spacing + 2 * SHEET * plane.scatter
        if far.mean() > SPREAD_SHARE:
            return float(beyond.max())
    return 0.0


def _corners(
    points: Array, tree: KDTree, planes: tuple[FittedPlane, ...], sd: float, spacing: float, extent: float
) -> Array:
    """Corners and supported places (k, 3) [m] along the edges of the body that the fitted planes bound."""
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
    on = np.abs(heights) < ON_PLANE * extent
    reach = 4 * sd + 3 * spacing + ROUNDED * extent
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


def _smoothed(
    points: Array, planes: tuple[FittedPlane, ...], sharp: Array, sd: float, spacing: float, extent: float
) -> tuple[Array, Array, float]:
    """Points (k, 3) [m] of curved parts on local quadrics, normals (k, 3), 1 sigma [m] (Levin 2004)."""
    heights = (
        np.column_stack([plane.heights(points) for plane in planes])
        if planes
        else np.full((len(points), 1), -np.inf)
    )
    rest = points[(heights < -3 * sd).all(axis=1)]
    if len(rest) < MIN_NEIGHBOURS:
        return np.zeros((0, 3)), np.zeros((0, 3)), sd
    outer = rest[_near_hull(rest, sharp, max(5 * sd, MIN_HOLLOW_DEPTH * extent))]
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
    # Where the patch determines the quadric badly (a far end), it diverges.
    steady = lever < 2 * float(np.median(lever))
    return moved[steady], normals[steady], sd * float(np.sqrt(np.median(lever)))


def _onto_quadrics(points: Array, patches: Array) -> tuple[Array, Array, Array]:
    """Points (p, 3) on quadrics of their patches (p, k, 3), normals (p, 3), variances (p,) over sd^2."""
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
    """Mask (n,) of `points` (n, 3) within `margin` [m] of the hull of all points."""
    across = even_directions(DIRECTIONS).T
    pieces = [points[start : start + POINTS_AT_A_TIME] for start in range(0, len(points), POINTS_AT_A_TIME)]
    level = np.max([(piece @ across).max(axis=0) for piece in pieces], axis=0)
    if len(others):
        level = np.maximum(level, (others @ across).max(axis=0))
    return np.concatenate([(piece @ across - level).max(axis=1) > -margin for piece in pieces])


def _rim(
    smoothed: Array,
    normals: Array,
    plane: FittedPlane,
    planes: tuple[FittedPlane, ...],
    sd: float,
    spacing: float,
    smooth_sd: float,
) -> Array:
    """Places (k, 3) [m] where curved walls, extrapolated, meet `plane`; a circle where one fits."""
    if not len(smoothed):
        return np.zeros((0, 3))
    height = plane.heights(smoothed)
    towards = plane.normal - normals * (normals @ plane.normal)[:, None]
    steepness = np.linalg.norm(towards, axis=1)
    near = (height < 0) & (height > -(6 * sd + 4 * spacing)) & (steepness > MIN_STEEPNESS)
    if near.sum() < 3:
        return np.zeros((0, 3))
    rim = smoothed[near] - towards[near] * (height[near] / steepness[near] ** 2)[:, None]
    for other in planes:
        if other is not plane and abs(float(other.normal @ plane.normal)) < 0.99:
            rim = rim[other.heights(rim) <= 0]
    return _on_circle(rim, plane, max(2.5 * smooth_sd, 0.3 * spacing))


def _within_outline(
    rim: Array, points: Array, plane: FittedPlane, sd: float, spacing: float
) -> tuple[Array, bool]:
    """Rim (k, 3) [m] limited to the outline of the points of `plane`, and True if it was.

    The noise pushes the outline of the points out, by some `OUTLINE_NOISE_SDS` sd [m]; where they are sparse
    they end up to a `spacing` [m] early.
    """
    face = points[np.abs(plane.heights(points)) <= SHEET * plane.scatter]
    if not len(rim) or len(face) < MIN_NEIGHBOURS:
        return rim, False
    try:
        outline = ConvexHull(face @ plane.basis.T)
    except QhullError:
        return rim, False
    middle = outline.points[outline.vertices].mean(axis=0)
    flat = rim @ plane.basis.T - middle
    room = -(outline.equations[:, :2] @ middle + outline.equations[:, 2])
    if (flat @ outline.equations[:, :2].T <= room + spacing + sd).all():
        return rim, False
    rise = flat @ outline.equations[:, :2].T / np.maximum(room - OUTLINE_NOISE_SDS * sd, 0.5 * room)
    drawn = flat / np.maximum(rise.max(axis=1), 1.0)[:, None] - flat
    return rim + drawn @ plane.basis, True


def _on_circle(rim: Array, plane: FittedPlane, tolerance: float) -> Array:
    """Rim (k, 3) [m] as a regular polygon if a circle fits it within `tolerance` [m] (Kasa 1976, trimmed)."""
    if len(rim) < 12:
        return rim
    origin = rim.mean(axis=0)
    flat = (rim - origin) @ plane.basis.T
    used = np.ones(len(flat), dtype=bool)
    x = y = radius = 0.0
    away, residual = flat, np.zeros(len(flat))
    for _ in range(4):
        kept = flat[used]
        (x, y, c), *_ = np.linalg.lstsq(
            np.column_stack([2 * kept, np.ones(len(kept))]), np.sum(kept**2, axis=1), rcond=None
        )
        radius = float(np.sqrt(max(c + x * x + y * y, 0.0)))
        away = flat - [x, y]
        residual = np.linalg.norm(away, axis=1) - radius
        # Walls are followed over some noise: a few directions go astray.
        used = np.abs(residual) <= max(3 * 1.48 * float(np.median(np.abs(residual))), 1e-3 * tolerance)
    away, residual = away[used], residual[used]
    angle = np.sort(np.arctan2(away[:, 1], away[:, 0]))
    gap = float(np.diff(np.append(angle, angle[0] + 2 * np.pi)).max())
    if gap > MAX_RIM_GAP or float(np.sqrt(np.mean(residual**2))) > tolerance:
        return rim
    turn = np.arange(CIRCLE_SIDES) * 2 * np.pi / CIRCLE_SIDES
    ring = np.column_stack([x + radius * np.cos(turn), y + radius * np.sin(turn)])
    return origin + ring @ plane.basis


def _oriented(hull: ConvexHull) -> tuple[Array, IntArray]:
    used, faces = np.unique(hull.simplices, return_inverse=True)
    vertices = hull.points[used]
    faces = faces.reshape(-1, 3).astype(np.int64)
    a, b, c = np.moveaxis(vertices[faces], 1, 0)
    inwards = np.einsum("ij,ij->i", np.cross(b - a, c - a), hull.equations[:, :3]) < 0
    faces[inwards] = faces[inwards][:, ::-1]
    return vertices, faces
