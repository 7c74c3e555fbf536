"""Repair of a mesh into one closed surface; repairs are reported.

Holes are closed first (`mesh_holes`); the closing faces are marked. Overlapping bodies are united
(manifold3d); inner surfaces are dropped. A single surface that intersects itself is kept: its volume counts
once wherever the surface winds round a point.
"""

# scipy and manifold3d are only partly typed.
# pyright: reportMissingTypeStubs=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false, reportUnknownMemberType=false

from __future__ import annotations

from dataclasses import dataclass

import manifold3d
import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import ConvexHull, QhullError

from analyze.errors import ShapeError
from analyze.geometry import polyhedron
from analyze.geometry.mesh_holes import fill_holes
from analyze.geometry.mesh_shells import cut_apart, separated
from analyze.geometry.polyhedron import BoolArray, MassProperties
from analyze.types import Array, IntArray

MIN_VOLUME_RATIO = 1e-5
"""Volume of a separate body, over that of the largest one, below which it is an artefact of the export."""
PROBES = 4000
"""Number of points at which the winding number is computed to find self-intersections."""
MAX_MULTIPLE_SHARE = 0.002
"""Largest fraction of the volume that may have a winding number other than 1."""
MASS_PROBES = 200_000
"""Number of points from which the volume of a surface that intersects itself is computed."""
TWO_SIDED_SHARE = 0.6
"""Faces without repetitions over all faces, up to which a surface counts as having each triangle twice."""
CRACK = 1e-5
"""Distance, over the mesh's extent, up to which vertices of open edges are merged."""


@dataclass(frozen=True)
class ClosedMesh:
    """Closed surface of a repaired mesh, with the repairs made."""

    vertices: Array
    """(n, 3) vertices [m]."""
    faces: IntArray
    """(f, 3) faces, counter-clockwise from outside."""
    added: BoolArray
    """(f,) True for faces that close holes, where the true surface is unknown."""
    notes: tuple[str, ...]
    """Repairs made, in sentences for the user."""
    properties: MassProperties
    """Mass properties of the uniform solid."""
    doubt: str = ""
    """Reason why the volume is not known; empty if it is known."""


def closed_mesh(vertices: Array, faces: IntArray, name: str) -> ClosedMesh:
    """Repair a mesh into one closed surface.

    Args:
        vertices: (n, 3) vertices [m].
        faces: (f, 3) faces.
        name: Name of the file, for messages.

    Returns:
        The closed surface (vertices [m] and faces), with a mask of the faces that close holes and notes on
        the repairs.

    Raises:
        ShapeError: there are too many holes, most of the surface is missing, or it is flat.
    """
    notes: list[str] = []
    try:
        ConvexHull(vertices)
    except QhullError:
        raise ShapeError(f"{name}: all vertices lie in one plane: export the solid's exterior") from None
    repeated = _without_repeats(faces)
    # A surface with each triangle on both its sides encloses nothing.
    two_sided = len(repeated) <= TWO_SIDED_SHARE * len(faces)
    torn = two_sided or polyhedron.open_edges(faces) > 0
    if torn:
        # Only for open meshes: two closed bodies that share a face need it twice.
        faces = repeated if two_sided else min(faces, repeated, key=polyhedron.open_edges)
        vertices, faces = _without_cracks(vertices, faces)
    faces, body, turned = polyhedron.consistently_wound(faces)
    added, doubt = np.zeros(len(faces), dtype=bool), ""
    if torn and polyhedron.open_edges(faces):
        vertices, faces = cut_apart(vertices, _mostly_outward(vertices, faces))
        filled = fill_holes(vertices, faces, name)
        vertices, faces, doubt = filled.vertices, filled.faces, filled.doubt
        notes.append(filled.note)
        added = np.arange(len(faces)) >= len(added)
        faces, body, more = polyhedron.consistently_wound(faces)
        turned = max(turned, more)
    body = _touching_apart(vertices, faces, body)
    inside_out = polyhedron.body_volumes(vertices, faces, body) < 0
    faces, _ = polyhedron.outward(vertices, faces, body)
    if turned:
        notes.append(f"{name}: {turned} faces were wound against their neighbours and have been turned")
    vertices, faces, added = _exterior(vertices, faces, added, body, inside_out, name, notes)
    properties, crossing = _mass_properties(vertices, faces, name)
    notes += [crossing] if crossing else []
    if doubt:
        notes.append(f"{name}: {doubt}: its volume, and masses of inner parts with it, are not known")
    return ClosedMesh(vertices, faces, added, tuple(notes), properties, doubt)


def _mostly_outward(vertices: Array, faces: IntArray) -> IntArray:
    """Faces (f, 3) of a mesh, all reversed if those at its hull's corners are mostly clockwise from outside.

    Unlike the sign of the volume, this is sure for an open mesh too.

    Args:
        vertices: (n, 3) vertices [m].
        faces: (f, 3) faces, consistently wound.
    """
    hull = ConvexHull(vertices)
    outwards = np.zeros_like(vertices)
    np.add.at(outwards, hull.simplices, hull.equations[:, None, :3])
    across = polyhedron.area_vectors(vertices[faces])
    agreement = float(np.einsum("fi,fki->", across, outwards[faces]))
    return faces[:, ::-1] if agreement < 0 else faces


def _touching_apart(vertices: Array, faces: IntArray, body: IntArray) -> IntArray:
    """Number (f,) of the body that each face belongs to, with bodies that touch over faces kept apart.

    Bodies are distinguished by their wedges of material at common edges. Where that fails, as the mesh is
    open or bodies overlap there, `body` is returned.

    Args:
        vertices: (n, 3) vertices [m].
        faces: (f, 3) faces, consistently wound.
        body: (f,) number of the connected part of each face, by edges of exactly two faces alone.
    """
    _, shell, closed = separated(vertices, _mostly_outward(vertices, faces))
    return shell if closed.all() else body


def _without_repeats(faces: IntArray) -> IntArray:
    """Faces (k, 3) of `faces` (f, 3) without repetitions of the same three vertices in any order."""
    _, first = np.unique(np.sort(faces, axis=1), axis=0, return_index=True)
    return faces[np.sort(first)]


def _without_cracks(vertices: Array, faces: IntArray) -> tuple[Array, IntArray]:
    """Mesh with vertices merged that lie very close together, to close cracks between faces.

    Close is within the share `CRACK` of the mesh's largest extent. The mesh is returned as given if merging
    leaves no fewer open edges (edges of one face only).

    Args:
        vertices: (n, 3) vertices [m].
        faces: (f, 3) vertex indices of the faces.

    Returns:
        Vertices (k, 3) [m], and the vertex indices (g, 3) of the faces.
    """
    step = float(np.ptp(vertices, axis=0).max()) * CRACK
    _, first, inverse = np.unique(np.round(vertices / step), axis=0, return_index=True, return_inverse=True)
    merged = _without_repeats(polyhedron.without_degenerate(inverse.ravel()[faces].astype(np.int64)))
    if polyhedron.open_edges(merged) < polyhedron.open_edges(faces):
        return vertices[first], merged
    return vertices, faces


def _exterior(
    vertices: Array,
    faces: IntArray,
    added: BoolArray,
    body: IntArray,
    inside_out: BoolArray,
    name: str,
    notes: list[str],
) -> tuple[Array, IntArray, BoolArray]:
    """Keep the outer bodies (connected parts) of a mesh, and unite those that overlap.

    Bodies within another one, and specks almost without volume, are left out. If the bodies cannot be united
    they are kept as they are, with a note.

    Args:
        vertices: (n, 3) vertices [m].
        faces: (f, 3) faces, counter-clockwise from outside.
        added: (f,) True for faces that close holes.
        body: (f,) number of the body (connected part) of each face, from 0.
        inside_out: (b,) True for bodies whose normals pointed inwards and have been turned: within another
            body, such a one was a cavity.
        name: Name of the file, for the notes.
        notes: Notes on repairs, to which this function appends.

    Returns:
        Vertices (k, 3) [m], faces (g, 3), and mask (g,) of those that close holes.
    """
    volumes = polyhedron.body_volumes(vertices, faces, body)
    dust = volumes < MIN_VOLUME_RATIO * volumes.max()
    buried = _buried(vertices, faces, body, dust)
    if np.any(inside_out & ~dust & ~buried):
        notes.append(f"{name}: the normals pointed inwards and have been turned outwards")
    if len(volumes) == 1:
        return vertices, faces, added
    if dust.any():
        notes.append(f"{name}: {int(dust.sum())} specks without volume are left out")
    if buried.any():
        notes.append(f"{name}: inner surfaces are ignored: only the exterior counts")
    outer = np.flatnonzero(~dust & ~buried)
    kept = np.isin(body, outer)
    faces, added, body = faces[kept], added[kept], body[kept]
    if len(outer) > 1:
        united = _united(vertices, faces, [np.flatnonzero(body == index) for index in outer])
        if united is None:
            notes.append(
                f"{name}: {len(outer)} separate bodies that cannot be united; where they overlap, volume "
                "counts twice: unite them in the CAD program"
            )
        else:
            apart = float(volumes[outer].sum()) - polyhedron.mass_properties(*united[:2]).volume
            if apart > 1e-6 * float(volumes.max()):
                vertices, faces, source = united
                added = added[source]
                notes.append(f"{name}: {len(outer)} bodies overlapped and have been united")
            left = _pieces(faces)
            if left > 1:
                notes.append(
                    f"{name}: {left} separate bodies: they are taken as one rigid object, connected by "
                    "something that the file does not contain"
                )
    used, faces = np.unique(faces, return_inverse=True)
    return vertices[used], faces.reshape(-1, 3).astype(np.int64), added


def _buried(
    vertices: Array, faces: IntArray, body: IntArray, dust: polyhedron.BoolArray
) -> polyhedron.BoolArray:
    """Mask (b,) of the bodies (connected parts) of a mesh that lie inside another one.

    A body is judged by the centroids of some of its faces.

    Args:
        vertices: (n, 3) vertices [m].
        faces: (f, 3) faces, counter-clockwise from outside.
        body: (f,) number of the body (connected part) of each face, from 0.
        dust: (b,) True for bodies almost without volume, which are ignored.
    """
    count = len(dust)
    buried = np.zeros(count, dtype=bool)
    corners = [vertices[faces[body == index]] for index in range(count)]
    samples = [each.mean(axis=1)[:: max(1, len(each) // 20)] for each in corners]
    owner = np.repeat(np.arange(count), [len(each) for each in samples])
    points = np.vstack(samples)
    boxes = [(each.min(axis=(0, 1)), each.max(axis=(0, 1))) for each in corners]
    for index in np.flatnonzero(~dust):
        low, high = boxes[index]
        others = [
            k
            for k in range(count)
            if k != index and not dust[k] and np.all(boxes[k][0] >= low) and np.all(boxes[k][1] <= high)
        ]
        if not others:
            continue
        asked = np.isin(owner, others)
        within = polyhedron.inside(vertices, faces[body == index], points[asked])
        for other in others:
            buried[other] |= bool(within[owner[asked] == other].all())
    return buried


def _united(
    vertices: Array, faces: IntArray, bodies: list[IntArray]
) -> tuple[Array, IntArray, IntArray] | None:
    """Union of closed bodies by the library manifold3d; None if it refuses one.

    Args:
        vertices: (n, 3) vertices [m].
        faces: (f, 3) faces, counter-clockwise from outside.
        bodies: Indices of the faces of each body.

    Returns:
        Vertices (k, 3) [m], faces (g, 3), and for each of these the index (g,) of the face that it is part
        of.
    """
    solids: list[manifold3d.Manifold] = []
    for body in bodies:
        used, local = np.unique(faces[body], return_inverse=True)
        corners = np.ascontiguousarray(local.reshape(-1, 3).astype(np.uint64))
        mesh = manifold3d.Mesh64(
            np.ascontiguousarray(vertices[used]), corners, face_id=body.astype(np.uint64)
        )
        solid = manifold3d.Manifold(mesh)
        if solid.status() != manifold3d.Error.NoError or solid.is_empty():
            return None
        solids.append(solid)
    mesh = manifold3d.Manifold.batch_boolean(solids, manifold3d.OpType.Add).to_mesh64()
    return (
        np.asarray(mesh.vert_properties)[:, :3].astype(np.float64),
        np.asarray(mesh.tri_verts).astype(np.int64),
        np.asarray(mesh.face_id, dtype=np.int64),
    )


def _mass_properties(vertices: Array, faces: IntArray, name: str) -> tuple[MassProperties, str]:
    """Mass properties of the solid that a closed surface bounds, also where it intersects itself.

    Where a surface intersects itself, its winding number is neither 0 nor 1 at some points. If more than
    `MAX_MULTIPLE_SHARE` of the sampled points inside have another value, volume, centroid and inertia are
    those of the points about which the surface winds at all, each counted once.

    Args:
        vertices: (n, 3) vertices [m].
        faces: (f, 3) faces, counter-clockwise from outside.
        name: Name of the file, for the note.

    Returns:
        Mass properties, and a note for the user; empty if the surface does not intersect itself.
    """
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    points = low + (high - low) * low_discrepancy(PROBES)
    times = polyhedron.winding(vertices, faces, points)
    inside = int(np.sum(times != 0))
    wrong = int(np.sum((times != 0) & (times != 1)))
    if wrong <= max(MAX_MULTIPLE_SHARE * inside, 2):
        return polyhedron.mass_properties(vertices, faces), ""
    points = low + (high - low) * low_discrepancy(MASS_PROBES)
    points = points[polyhedron.winding(vertices, faces, points) != 0]
    arm = points - points.mean(axis=0)
    second = arm.T @ arm / len(arm)
    properties = MassProperties(
        float(np.prod(high - low)) * len(points) / MASS_PROBES,
        points.mean(axis=0),
        np.trace(second) * np.eye(3) - second,
    )
    share = 100 * wrong / inside
    return (
        properties,
        f"{name}: the surface intersects itself in {share:.1f} % of its inside: that counts once",
    )


def low_discrepancy(count: int) -> Array:
    """Evenly spread points (count, 3) in the unit cube, the same at every call.

    Point i is 0.5 + i times the first three inverse powers of the golden ratio generalised to three
    dimensions, modulo 1 (a quasi-random sequence).
    """
    i = np.arange(1, count + 1)[:, None]
    steps = np.array([0.8191725133961645, 0.6710436067037893, 0.5497004779019703])
    return np.asarray((0.5 + i * steps) % 1, dtype=np.float64)


def _pieces(faces: IntArray) -> int:
    """Number of parts of a mesh with `faces` (f, 3) that share no vertex."""
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]]])
    size = int(faces.max()) + 1
    _, label = connected_components(
        coo_array((np.ones(len(edges)), (edges[:, 0], edges[:, 1])), shape=(size, size)), directed=False
    )
    return len(np.unique(label[faces[:, 0]]))
