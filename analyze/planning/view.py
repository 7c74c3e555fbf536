"""Which markers the camera sees through a whole tip, looking along the pivot axis (METHOD section 2)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from analyze.geometry import polyhedron
from analyze.geometry.object_model import ObjectModel
from analyze.geometry.rotations import apply, inverse_transform, matrix_from_vector
from analyze.planning.pivots import PivotAxis
from analyze.types import Array, CameraModel
from schemas.documents import MarkerSpec, ObjectSpec

FACING = np.radians(15.0)
"""angle between a marker's normal and the pivot axis up to which its pose does not flip"""
PAST_BALANCE = np.radians(25.0)
"""how far past phi the marker must stay in view"""
BORDER_PX = 10.0
STEPS = 9
HAIR = 1e-9
"""m"""


@dataclass(frozen=True)
class Sight:
    """Markers seen through a tip; if there are none, the least angle [rad] of any marker's normal from the axis."""

    markers: list[int]
    least_angle: float
    pixels: float = 0.0
    """edge of the first one's black square in the image at rest [px]"""


def default_camera() -> CameraModel:
    """The rig's nominal camera: 0.55 m beside the pivot, 2.6 px/mm there, looking along the axis."""
    T_world_camera = np.array([[1.0, 0, 0, 0.03], [0, 0, 1, -0.55], [0, -1, 0, 0.08], [0, 0, 0, 1]])
    K = np.array([[1430.0, 0, 327.5], [0, 1430, 245.5], [0, 0, 1]])
    return CameraModel(656, 492, K, np.zeros(5), T_world_camera)


def visible_markers(model: ObjectModel, spec: ObjectSpec, axis: PivotAxis, phi: float, camera: CameraModel) -> Sight:
    """Markers that look along the axis at the camera, in the image and hidden by nothing from rest until `PAST_BALANCE` past phi.

    Lens distortion is left out: it is a few px at the border, within `BORDER_PX`.
    """
    seen: list[tuple[float, int]] = []
    least = np.pi
    for marker in spec.marker:
        if marker.T_object_marker is None:
            continue
        T_object_marker = np.array(marker.T_object_marker)
        angle = float(np.arccos(np.clip(-T_object_marker[:3, 2] @ axis.direction, -1, 1)))
        least = min(least, angle)
        if (
            angle <= FACING
            and _in_view(axis, marker, T_object_marker, phi, camera)
            and not _hidden(model, axis, T_object_marker, phi, camera)
        ):
            seen.append((round(angle, 3), marker.id))
    ids = [marker_id for _, marker_id in sorted(seen)]
    if not ids:
        return Sight(ids, least)
    first = next(marker for marker in spec.marker if marker.id == ids[0])
    centre = axis.R_world_object @ np.array(first.T_object_marker)[:3, 3] + axis.p_world_object
    far = float(np.linalg.norm(centre - camera.T_world_camera[:3, 3]))
    return Sight(ids, least, float(camera.K[0, 0]) * first.size_m / far)


def _in_view(axis: PivotAxis, marker: MarkerSpec, T_object_marker: Array, phi: float, camera: CameraModel) -> bool:
    half = marker.size_m / 2
    corners = apply(T_object_marker, np.array([[-half, half, 0], [half, half, 0], [half, -half, 0], [-half, -half, 0]]))
    world = corners @ axis.R_world_object.T + axis.p_world_object
    pivot = np.array([0.0, 0.0, axis.radius])
    T_camera_world = inverse_transform(camera.T_world_camera)
    for step in range(STEPS):
        theta = (phi + float(PAST_BALANCE)) * step / (STEPS - 1)
        turned = (world - pivot) @ matrix_from_vector(np.array([0.0, theta, 0.0])).T + pivot
        in_camera = apply(T_camera_world, turned)
        if in_camera[:, 2].min() <= 0:
            return False
        pixel = in_camera @ camera.K.T
        pixel = pixel[:, :2] / pixel[:, 2:]
        if pixel.min() < BORDER_PX or np.any(pixel.max(axis=0) > np.array([camera.width, camera.height]) - 1 - BORDER_PX):
            return False
    return True


def _hidden(model: ObjectModel, axis: PivotAxis, T_object_marker: Array, phi: float, camera: CameraModel) -> bool:
    """Whether the object itself stands between the marker's centre and the camera, at rest, at balance or past it."""
    start = T_object_marker[:3, 3] + 0.002 * T_object_marker[:3, 2]
    pivot = np.array([0.0, 0.0, axis.radius])
    for theta in (0.0, phi, phi + float(PAST_BALANCE)):
        # The camera, turned back with the object.
        back = matrix_from_vector(np.array([0.0, -theta, 0.0]))
        camera_world = back @ (camera.T_world_camera[:3, 3] - pivot) + pivot
        ray = axis.R_world_object.T @ (camera_world - axis.p_world_object) - start
        far = float(np.linalg.norm(ray))
        if _meets(model, start, ray / far, far):
            return True
    return False


def _meets(model: ObjectModel, start: Array, direction: Array, far: float) -> bool:
    """Whether the ray along the unit `direction` (3,) meets a face nearer than `far` [m]; only faces that straddle it are asked."""
    across = np.linalg.svd(direction[None])[2][1:]
    near = np.ones(len(model.faces), dtype=bool)
    for row in across:
        left = (model.vertices - start) @ row < HAIR
        right = (model.vertices - start) @ row > -HAIR
        near &= left[model.faces].any(axis=1) & right[model.faces].any(axis=1)
    if not near.any():
        return False
    hit = polyhedron.first_hit(model.vertices, model.faces[near], start, direction)
    return hit is not None and hit[0] < far
