"""Convex hull of a scanned mesh with its nearly flat faces made flat; lengths in m.

A scan has no exactly flat face: what was flat is bowed by some tenths of a millimetre and has hundreds of
facets, about each of which the object would seem to tip. Here the faces that are flat within the scan's error
become planes with a covariance, as those of a point cloud do (cloud_surface.py).
"""

# scipy is only partly typed.
# pyright: reportMissingTypeStubs=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false, reportUnknownMemberType=false

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.sparse import coo_array
from scipy.spatial import ConvexHull, KDTree

from analyze.geometry.cloud_noise import CloudNoise, cloud_noise
from analyze.geometry.cloud_roundings import edge_roundings
from analyze.geometry.cloud_surface import CloudSurface, virtual_corners
from analyze.geometry.even_samples import even_samples
from analyze.geometry.flat_faces import (
    FIT_ROUNDS,
    FLAT_FRACTIONS,
    FlatFace,
    flat_faces,
    shared_covariance,
)
from analyze.geometry.hull_planes import FittedPlane, weighted_fit
from analyze.geometry.outermost_radius import outermost_radius
from analyze.geometry.polyhedron import BoolArray, area_vectors, hull_faces
from analyze.geometry.scanned_surface import ScannedSurface, scanned_mesh
from analyze.geometry.surface_error import ASSUMED_FILE_SD
from analyze.types import Array, IntArray

SAMPLES = 20_000
"""Number of points on a smooth mesh that show the rounding of its edges."""
SMOOTHING_ROUNDS, SMOOTHING_STEP = 12, 0.5
"""Rounds, and step over the distance to the neighbours' mean, of the smoothing of a rough mesh."""
REFIT_SCATTERS, REFIT_BAND = 3.0, 8e-4
"""Distance from a face's plane, over its scatter and at least in m, up to which a rough mesh's points belong
to it."""
REFIT_INSET = 0.06
"""Distance from a face's outline, over the root of its area, from which points belong to the face alone."""
MIN_REFIT_COSINE = np.cos(np.radians(3.0))
"""Cosine of the angle by which the fit to the mesh's points may turn a face's plane."""
EXACT_FRACTION, MIN_EXACT = 5e-6, 2e-7
"""Distance of a triangle's corners from a plane, over the extent and at least in m, up to which it lies in
the plane exactly, as in a drawing: what the rounding of a file's numbers leaves."""
EXACT_SHARE = 0.02
"""Share of the hull's area that exactly flat triangles of one plane have at least in a drawing."""
EXACT_TURN = 1 / 30
"""Angle between neighbouring triangles, over the median one, up to which they lie in one plane exactly."""
EXACT_PAIRS = 0.05
"""Share of a drawing's edges, at least, whose two triangles lie in one plane exactly.

Of 179 meshes as scanners make them the largest was 0.019, which is chance."""
EXAMINED_FACETS = 150
"""Number of the hull's largest facets whose planes are examined."""
ROUGH_ANGLE = np.radians(4.0)
"""Angle [rad] by which neighbouring triangles must form a valley to be counted as rough."""
ROUGH_SHARE = 0.3
"""Share of a mesh's edges in such valleys from which on its surface is noise: half of the edges would be."""
MIN_SCAN_FACES = 400
"""Smallest number of a scan's faces: meshes with fewer are simplified or drawn, and are taken as they are."""
DRAWN_SD = 1e-4
"""Stated 1 sigma of the surface [m] up to which a mesh is taken as it is, as a drawing."""
CLIP_ROUNDS = 6
"""Rounds in which vertices outside of the flat faces are moved onto them."""
MAX_VOLUME_CHANGE = 0.025
"""Relative change of the hull's volume by flattening, from which on fewer faces count as flat.

Curved bodies, such as fruit, change by more."""


def scanned_hull(
    vertices: Array, faces: IntArray, added: BoolArray, stated_sd: float | None
) -> CloudSurface | None:
    """Convex hull of a mesh that comes from a scan, with flat faces; None for a drawing.

    A mesh is a drawing if many pairs of neighbouring triangles lie in one plane exactly, or if it is smooth
    and a whole face of its hull is exactly flat. A rough scan is smoothed first: its raw hull would consist
    of the noise's extremes. The flat faces of the hull are found, and its vertices near them are moved onto
    them. A mesh is taken as it is if it is a drawing, if the stated error of its surface is at most
    `DRAWN_SD`, if it has fewer than `MIN_SCAN_FACES` faces, or if it is smooth and its hull has no flat face.

    Args:
        vertices: (n, 3) vertices of the closed mesh [m]; the result is in their frame.
        faces: (f, 3) faces, counter-clockwise from outside.
        added: (f,) True for faces that were added to close holes.
        stated_sd: 1 sigma of the surface's place as stated in the object file [m]; None if it is not.

    Returns:
        The surface with its planes, edges' roundings and noise; None if the mesh is to be taken as it is.
    """
    if (stated_sd is not None and stated_sd <= DRAWN_SD) or len(faces) < MIN_SCAN_FACES:
        return None
    turned, valley = _at_edges(vertices, faces[~added])
    if float(np.mean(turned < EXACT_TURN * np.median(turned))) > EXACT_PAIRS:
        return None
    rough = float(np.mean(valley & (turned > np.sin(ROUGH_ANGLE)))) > ROUGH_SHARE
    smooth = smoothed(vertices, faces) if rough else vertices
    hull = ConvexHull(smooth)
    extent = float(np.ptp(vertices, axis=0).max())
    if not rough and _has_exact_face(hull, vertices[faces[~added]], extent):
        return None
    points = vertices if rough else even_samples(vertices, faces[~added], SAMPLES)[0]
    scanned = scanned_mesh(vertices, faces, added)
    surface: CloudSurface | None = None
    for levels in range(len(FLAT_FRACTIONS), -1, -1):
        flat = flat_faces(hull, extent, FLAT_FRACTIONS[:levels])
        if not rough and not flat:
            return None
        moved = 0.0
        if rough:
            refitted = [_refitted(face, hull, vertices, smooth) for face in flat]
            moved = max(
                (
                    float(face.plane.heights(new.centre[None])[0])
                    for face, new in zip(flat, refitted, strict=True)
                ),
                key=abs,
                default=0.0,
            )
            flat = [replace(face, plane=new) for face, new in zip(flat, refitted, strict=True)]
        surface = _flattened(hull, flat, points, extent, scanned)
        # Refitted planes lie under the noise's extremes, of which the hull consists.
        limit = MAX_VOLUME_CHANGE + abs(moved) * float(hull.area / hull.volume)
        if abs(ConvexHull(surface.vertices).volume / float(hull.volume) - 1) < limit:
            break
    return surface


def scan_note(surface: CloudSurface, name: str) -> str:
    """Note for the user that a mesh is taken for a scan, with what that means and how to state otherwise."""
    scatter = 1000 * max((plane.scatter for plane in surface.planes), default=0.0)
    return (
        f"{name}: taken for a scan, as none of its faces is exactly flat; {len(surface.planes)} faces "
        f"of its hull count as flat (within {scatter:.2f} mm). If it is a drawing, state "
        "surface_sd_m = 0.0001 in [shape]"
    )


def smoothed(vertices: Array, faces: IntArray) -> Array:
    """Vertices (n, 3) [m] of a mesh, smoothed without shrinking it (Taubin 1995).

    Args:
        vertices: (n, 3) vertices [m].
        faces: (f, 3) faces.
    """
    sides = np.concatenate([faces, faces[:, ::-1]])[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    count = len(vertices)
    links = coo_array((np.ones(len(sides)), (sides[:, 0], sides[:, 1])), shape=(count, count)).tocsr()
    degree = np.maximum(np.asarray(links.sum(axis=1)).ravel(), 1.0)[:, None]
    for _ in range(SMOOTHING_ROUNDS):
        for step in (SMOOTHING_STEP, -SMOOTHING_STEP - 0.03):
            vertices = vertices + step * (np.asarray(links @ vertices) / degree - vertices)
    return vertices


def _refitted(face: FlatFace, hull: ConvexHull, points: Array, smooth: Array) -> FittedPlane:
    """Plane of a face, fitted to the mesh's own points within it; the given one where these are too few.

    Its covariance is that of the points' own noise, and that of the error which neighbouring points share:
    the scatter of the smoothed points, as of few independent measurements (`shared_covariance`).

    Args:
        face: Face of the hull of the smoothed mesh.
        hull: Convex hull of the smoothed mesh.
        points: (n, 3) vertices of the rough mesh [m].
        smooth: (n, 3) the same vertices, smoothed [m].
    """
    plane = face.plane
    corners = np.asarray(hull.points)[hull.simplices[face.members]].reshape(-1, 3)
    outline = ConvexHull((corners - plane.centre) @ plane.basis.T)
    height = (points - plane.centre) @ plane.basis.T @ outline.equations[:, :2].T + outline.equations[:, 2]
    inside = np.flatnonzero(height.max(axis=1) < -REFIT_INSET * np.sqrt(float(outline.volume)))
    found, near = plane, np.zeros(len(inside), dtype=np.bool_)
    for _ in range(FIT_ROUNDS):
        near = np.abs(found.heights(points[inside])) < max(REFIT_SCATTERS * found.scatter, REFIT_BAND)
        refitted = weighted_fit(points[inside], near.astype(np.float64), plane.centre - plane.normal)
        if refitted is None or refitted.normal @ plane.normal < MIN_REFIT_COSINE:
            return plane
        found = refitted
    kept = smooth[inside[near]]
    shared = shared_covariance(kept - found.centre, np.full(len(kept), 1 / len(kept)), found)
    return replace(found, covariance=found.covariance + shared)


def _has_exact_face(hull: ConvexHull, corners: Array, extent: float) -> bool:
    """True if several triangles of a mesh lie in one plane exactly, with `EXACT_SHARE` of the hull's area.

    Args:
        hull: Convex hull of the mesh.
        corners: (f, 3, 3) corners of the mesh's own triangles [m], without those that close holes.
        extent: Longest extent of the object [m].
    """
    areas = np.linalg.norm(area_vectors(corners), axis=1) / 2
    near = max(EXACT_FRACTION * extent, MIN_EXACT)
    facets = np.linalg.norm(area_vectors(np.asarray(hull.points)[hull.simplices]), axis=1)
    for plane in hull.equations[np.argsort(-facets)[:EXAMINED_FACETS]]:
        exact = (np.abs(corners @ plane[:3] + plane[3]) < near).all(axis=1)
        if np.count_nonzero(exact) > 1 and areas[exact].sum() >= EXACT_SHARE * hull.area:
            return True
    return False


def _at_edges(vertices: Array, faces: IntArray) -> tuple[Array, BoolArray]:
    """Sine (e,) of the angle between the triangles at each of e edges, and mask (e,) of edges in a valley.

    Noise makes as many valleys as ridges; a smooth convex surface has ridges only. Of the triangles of a
    scan hardly any two lie in one plane; of a drawing those of every flat face and of every ruled strip do.

    Args:
        vertices: (n, 3) vertices [m].
        faces: (f, 3) faces, counter-clockwise from outside.
    """
    across = area_vectors(vertices[faces])
    normal = across / np.maximum(np.linalg.norm(across, axis=1), 1e-300)[:, None]
    edges = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    opposite = faces[:, [2, 0, 1]].ravel()
    owner = np.repeat(np.arange(len(faces)), 3)
    order = np.lexsort(edges.T)
    pair = np.flatnonzero((np.diff(edges[order], axis=0) == 0).all(axis=1))
    first, second = order[pair], order[pair + 1]
    turned = np.linalg.norm(np.cross(normal[owner[first]], normal[owner[second]]), axis=1)
    rises = vertices[opposite[second]] - vertices[edges[first, 0]]
    return turned, np.einsum("ij,ij->i", rises, normal[owner[first]]) > 0


def _flattened(
    hull: ConvexHull,
    flat: list[FlatFace],
    points: Array,
    extent: float,
    scanned: ScannedSurface,
) -> CloudSurface:
    """Surface of a hull with its flat faces made flat, and with sharp edges where two of them meet.

    Args:
        hull: Convex hull of the mesh.
        flat: Its flat faces.
        points: (n, 3) points of the mesh [m].
        extent: Longest extent of the object [m].
        scanned: Samples of the mesh, with the parts that were not scanned.
    """
    planes = tuple(face.plane for face in flat)
    tree = KDTree(points)
    noise = cloud_noise(points, tree)
    # A reconstruction is smooth: its facets do not show its error.
    sd = max(noise.sd, float(np.median([plane.scatter for plane in planes] or [0.0])), ASSUMED_FILE_SD)
    vertices = np.array(hull.points)
    for face in flat:
        members = np.unique(hull.simplices[face.members])
        vertices[members] -= np.outer(face.plane.heights(vertices[members]), face.plane.normal)
    vertices = vertices[hull.vertices]
    for _ in range(CLIP_ROUNDS):
        for plane in planes:
            vertices -= np.outer(np.maximum(plane.heights(vertices), 0.0), plane.normal)
    sharp = virtual_corners(points, tree, planes, sd, noise.spacing, extent)
    flattened = ConvexHull(np.vstack([sharp, vertices]))
    used, faces = np.unique(hull_faces(flattened), return_inverse=True)
    return CloudSurface(
        vertices=np.asarray(flattened.points)[used],
        faces=faces.reshape(-1, 3).astype(np.int64),
        planes=planes,
        noise=CloudNoise(sd, noise.spacing),
        smooth_sd=sd,
        strays=0,
        hollow_share=0.0,
        hollow_depth=0.0,
        scanned=scanned,
        overhang=None,
        unwalled=(False,) * len(planes),
        roundings=tuple(
            replace(each, radius=max(each.radius, outermost_radius(each, points, planes)))
            for each in edge_roundings(points, planes, sd, extent)
        ),
        meshed=True,
    )
