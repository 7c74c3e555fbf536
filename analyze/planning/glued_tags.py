"""Tags on every face of an object where a user could glue one, to try whether other places give a plan."""

from __future__ import annotations

import numpy as np

from analyze.geometry import polyhedron
from analyze.geometry.object_model import ObjectModel
from analyze.geometry.rotations import plane_basis
from analyze.planning.stable_planes import resting_planes
from analyze.types import Array
from schemas.object_spec import MarkerSpec, ObjectSpec

FLAT_ANGLE = np.radians(1.0)
"""Largest angle [rad] between facets of one flat face."""
FLAT_FRACTION = 2e-4
"""Distance of facets from a common plane, over the longest extent, up to which they are one face."""
MAX_FACES = 16
"""Largest number of flat faces that get a tag, the largest first."""
SAME_ANGLE = np.radians(10.0)
"""Angle [rad] to the normal of a tag on a flat face from which a side of the object gets one of its own."""


def with_glued_tags(model: ObjectModel, spec: ObjectSpec) -> ObjectSpec:
    """Object file with more tags: one on each flat face as large as a tag, and one on each round side.

    They have the size of the largest tag of the object file, whose own tags are kept. A tag lies in the
    middle of its face, or of the facet nearest to it. A round side is one of six directions, along and across
    the largest resting face, in which no flat face lies: there the tag touches along a line.

    Args:
        model: Shape of the object.
        spec: Object file with at least one marker.
    """
    largest = max(spec.marker, key=lambda each: each.size_m)
    places = _flat_places(model, largest.size_m)
    normals = np.array([normal for _, normal in places]).reshape(-1, 3)
    places += [
        (point, normal)
        for point, normal in _round_places(model)
        if not np.any(normals @ normal > np.cos(SAME_ANGLE))
    ]
    free = [
        number for number in range(largest.family.size) if number not in {each.id for each in spec.marker}
    ]
    glued = [
        _glued(largest, number, point, normal) for number, (point, normal) in zip(free, places, strict=False)
    ]
    return spec.model_copy(update={"marker": [*spec.marker, *glued]})


def _flat_places(model: ObjectModel, size: float) -> list[tuple[Array, Array]]:
    """Points (3,) [m] and outward normals (3,) of the flat faces as large as a tag of edge `size` [m]."""
    corners = model.vertices[model.faces]
    vectors = polyhedron.area_vectors(corners)
    areas = np.linalg.norm(vectors, axis=1)
    normals = vectors / np.maximum(areas, 1e-18)[:, None]
    centres = corners.mean(axis=1)
    tolerance = FLAT_FRACTION * float(model.extent.max())
    left = areas > 0
    found: list[tuple[float, Array, Array]] = []
    for seed in np.argsort(-areas)[: 8 * MAX_FACES]:
        if not left[seed]:
            continue
        normal = normals[seed]
        member = left & (normals @ normal > np.cos(FLAT_ANGLE))
        member &= np.abs((centres - centres[seed]) @ normal) < tolerance
        left &= ~member
        area = float(areas[member].sum())
        if area >= size**2:
            middle = areas[member] @ centres[member] / area
            nearest = centres[member][int(np.argmin(np.linalg.norm(centres[member] - middle, axis=1)))]
            on_face = abs(float(model.depth(middle)[0])) < tolerance
            found.append((area, middle if on_face else nearest, normal))
    found.sort(key=lambda each: -each[0])
    return [(point, normal) for _, point, normal in found[:MAX_FACES]]


def _round_places(model: ObjectModel) -> list[tuple[Array, Array]]:
    """Outermost points (3,) [m] towards six sides of the object, with these directions (3,)."""
    planes = resting_planes(model)
    up = planes[0].up if planes else np.array([0.0, 0.0, 1.0])
    far = 2 * float(model.extent.max())
    places: list[tuple[Array, Array]] = []
    for axis in (up, *plane_basis(up)):
        for side in (axis, -axis):
            away = polyhedron.first_hit(model.vertices, model.faces, model.centroid + far * side, -side)
            if np.isfinite(away):
                places.append((model.centroid + (far - away) * side, side))
    return places


def _glued(like: MarkerSpec, number: int, point: Array, normal: Array) -> MarkerSpec:
    """Tag like another one, with its own number, that lies at a point [m] and faces along a normal."""
    right, up = plane_basis(normal)
    pose = np.eye(4)
    pose[:3] = np.column_stack([right, up, normal, point])
    return like.model_copy(update={"id": number, "T_object_marker": pose.tolist()})
