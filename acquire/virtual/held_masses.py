"""Hidden mass of an object in a fixture: the fixture as stated, the object's own as drawn or given."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from acquire.errors import ConfigError
from acquire.virtual.hidden import HiddenBody, mesh_depth
from acquire.virtual.mesh_samples import sample_mesh

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from schemas.object_spec import ObjectSpec

SAMPLES = 400_000
"""number of points in the bounding box of a mesh at which masses are placed"""
SAME_PLACE_M = 1e-8
"""distance of two corners of triangles up to which they are one vertex [m]"""


@dataclass(frozen=True)
class SeparateSurfaces:
    """Surfaces of an object and of the fixture that it is struck in, as triangles [m, in O]."""

    own: NDArray[np.float64]
    """(m, 3, 3) corners of the object's triangles"""
    fixture: dict[int, NDArray[np.float64]]
    """corners (m, 3, 3) of the triangles of each body of the fixture, by its number"""


def alone(spec: ObjectSpec) -> ObjectSpec:
    """Content of an object file for the object without its fixture."""
    mass_kg = spec.mass_kg - sum(body.mass_kg for body in spec.fixture or [])
    return spec.model_copy(update={"mass_kg": mass_kg, "fixture": None, "held": None})


def separate_surfaces(spec: ObjectSpec, triangles: NDArray[np.float64]) -> SeparateSurfaces:
    """Split the surface of object and fixture into its closed bodies, numbered from the largest volume.

    Args:
        spec: content of the object file, with the numbers of the fixture's bodies.
        triangles: (m, 3, 3) corners of all triangles [m].

    Raises:
        ConfigError: the fixture names a body that the surface does not have, or the object has none.
    """
    flat = np.round(triangles.reshape(-1, 3) / SAME_PLACE_M).astype(np.int64)
    _, vertex = np.unique(flat, axis=0, return_inverse=True)
    faces = vertex.reshape(-1, 3)
    count = int(faces.max()) + 1
    links = coo_array(
        (np.ones(2 * len(faces)), (faces[:, [0, 1]].ravel(), faces[:, [1, 2]].ravel())), shape=(count, count)
    )
    piece = connected_components(links, directed=False)[1][faces[:, 0]]
    volumes = np.bincount(piece, _signed_volumes(triangles))
    solids = [int(each) for each in np.argsort(-volumes) if volumes[each] > 0]
    numbers = {number for body in spec.fixture or [] for number in body.bodies}
    if not numbers or max(numbers) > len(solids) or len(numbers) == len(solids):
        raise ConfigError(
            f"{spec.name}: its shape file has {len(solids)} bodies, the fixture names {sorted(numbers)}: "
            "correct them, `analyze parts` lists the bodies"
        )
    named = {number: solids[number - 1] for number in numbers}
    own = triangles[~np.isin(piece, list(named.values()))]
    return SeparateSurfaces(own, {number: triangles[piece == each] for number, each in named.items()})


def with_fixture(spec: ObjectSpec, body: HiddenBody, surfaces: SeparateSurfaces) -> HiddenBody:
    """Hidden mass properties of object and fixture; the regions stay those of the object.

    Args:
        spec: content of the object file, of both together.
        body: the object alone.
        surfaces: surfaces of both, for a body of the fixture that is uniform.
    """
    parts = [(body.mass_kg, np.array(body.com_object), np.array(body.inertia_com))]
    for stated in spec.fixture or []:
        com, unit = stated.com_m, stated.unit_inertia_m2
        if com is None or unit is None:
            uniform = np.concatenate([surfaces.fixture[number] for number in stated.bodies])
            found_com, found_unit = _uniform(uniform)
            com = found_com.tolist() if com is None else com
            unit = found_unit.tolist() if unit is None else unit
        parts.append((stated.mass_kg, np.array(com), stated.mass_kg * np.array(unit)))
    mass = sum(each for each, _, _ in parts)
    middle = np.sum([each * com for each, com, _ in parts], axis=0) / mass
    inertia = np.zeros((3, 3))
    for each, com, about in parts:
        arm = com - middle
        inertia = inertia + about + each * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    return HiddenBody(mass, middle, inertia, body.region_masses, body.region_plane, body.shell_thickness_m)


def _signed_volumes(triangles: NDArray[np.float64]) -> NDArray[np.float64]:
    """Volumes (m,) [m^3] between the origin of O and each triangle, positive where it faces away."""
    a, b, c = np.moveaxis(triangles, 1, 0)
    return np.einsum("ij,ij->i", a, np.cross(b, c)) / 6


def _uniform(triangles: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Centre (3,) [m] of a uniform solid, and its inertia (3, 3) about it per kilogram [m^2]."""
    volumes = _signed_volumes(triangles)
    total = triangles.sum(axis=1)
    com = volumes @ total / 4 / volumes.sum()
    corners = triangles - com
    volumes = _signed_volumes(corners)
    total = corners.sum(axis=1)
    second = np.einsum("f,fki,fkj->ij", volumes, corners, corners)
    second = (second + np.einsum("f,fi,fj->ij", volumes, total, total)) / 20 / volumes.sum()
    return com, np.trace(second) * np.eye(3) - second


def mesh_points(
    triangles: NDArray[np.float64], shell_m: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Points (n, 3) spread uniformly inside a closed surface [m], and their depths (n,) below it [m].

    Args:
        triangles: (m, 3, 3) corners of the triangles [m].
        shell_m: depth down to which depths are exact [m].
    """
    points = sample_mesh(triangles, SAMPLES)
    depth = mesh_depth(triangles, lambda found: np.ones(len(found), dtype=bool), shell_m)
    return points, depth(points)
