"""Markers that the camera sees through a whole tip, looking along the pivot axis (method 2)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from analyze.errors import PlanError
from analyze.geometry import polyhedron
from analyze.geometry.object_model import ObjectModel
from analyze.geometry.rotations import apply, inverse_transform, matrix_from_vector
from analyze.planning.pivots import PivotAxis
from analyze.planning.precision import PAST_BALANCE
from analyze.tracking.camera_model import project
from analyze.types import Array, CameraModel
from schemas.object_spec import MarkerSpec, ObjectSpec
from schemas.rig_limits import MIN_TAG_EDGE_PX
from schemas.tags import name_order

MAX_MARKER_ANGLE = np.radians(15.0)
"""Largest angle [rad] between a marker's normal and the pivot axis at which its pose does not flip."""
BORDER_PX = 10.0
"""Smallest distance of a marker from the image's border [px]."""
VISIBILITY_STEPS = 9
"""Number of tip angles at which a marker is checked."""
PLACE_TOLERANCE = 0.003
"""Tolerance [m] of a glued tag's place, which is measured by hand."""
SURFACE_SDS = 2.0
"""Number of the surface's standard deviations that are added to `PLACE_TOLERANCE`."""
FAULT_CODES = ("no_marker", "out_of_image", "tag_small", "hidden")
"""Codes of faults, in the order in which a marker is checked."""
RAY_TOLERANCE = 1e-9
"""Tolerance of a ray's contact with a face [m]."""


@dataclass(frozen=True)
class Fault:
    """Reason why a marker cannot be tracked through a tip: rejection code, number and message.

    The number is the measured quantity behind the fault, such as the marker's size in the image [px], in SI
    units or px; None if there is none.
    """

    code: str
    """One of `FAULT_CODES`."""
    number: float | None
    """Measured quantity behind the fault, in SI units or [px]; None if there is none."""
    text: str
    """Message with the number."""


@dataclass(frozen=True)
class MarkerVisibility:
    """Names of the markers visible through a whole tip, or the fault of the one nearest to being visible.

    The mean edge [px] of the first marker's black square is held too; 0 if none is visible.
    """

    markers: list[int | str]
    """Names of the visible markers, the one best aligned with the axis first."""
    fault: Fault
    """Fault of the marker nearest to being visible; without meaning if some are visible."""
    pixels: float = 0.0
    """Mean edge of the first marker's black square in the image at rest [px]; 0 if none is visible."""


def default_camera() -> CameraModel:
    """Nominal camera of the rig: 0.55 m beside the pivot, 2.6 px/mm there, looking along the axis.

    Its pose is in the world frame W of a strike at rest (z up, pivot edge along y).
    """
    T_world_camera = np.array([[1.0, 0, 0, 0.03], [0, 0, 1, -0.55], [0, -1, 0, 0.08], [0, 0, 0, 1]])
    K = np.array([[1430.0, 0, 327.5], [0, 1430, 245.5], [0, 0, 1]])
    return CameraModel(656, 492, K, np.zeros(5), T_world_camera)


def refuse_off_surface(model: ObjectModel, spec: ObjectSpec) -> None:
    """Refuse a marker off the surface or facing into the object: a wrong frame, unit or sign in its pose.

    The marker may extend beyond an edge. Within a gap of the scan the surface is uncertain by the gap's
    width. The model of a point cloud is its hull, with hollows filled: a marker may lie below it by the
    hollows' depth. Markers without a pose are not checked.

    Args:
        model: Shape of the object.
        spec: Markers, with their poses in the object frame.

    Raises:
        PlanError: a marker is off the surface, or faces inward; the message has its name, and its distance.
    """
    cloud = model.cloud
    unsure = model.surface_sd if cloud is None else float(np.hypot(model.surface_sd, cloud.smooth_sd))
    hollow = 0.0 if cloud is None else cloud.hollow_depth
    for marker in spec.marker:
        if marker.T_object_marker is None:
            continue
        centre = np.array(marker.T_object_marker)[:3, 3]
        outside = -float(model.depth(centre)[0])
        most = PLACE_TOLERANCE + marker.thickness_m + SURFACE_SDS * unsure
        if model.scanned is not None:
            most += model.scanned.uncertainty_at(centre)
        if -most - hollow <= outside <= most:
            _refuse_inward(model, spec, marker, 2 * most)
            continue
        where = "outside" if outside > 0 else "inside"
        raise PlanError(
            f"{spec.name}: marker {marker.name} lies {1000 * abs(outside):.0f} mm {where} the surface, its "
            f"centre must lie on it (within {1000 * most:.0f} mm): correct T_object_marker, "
            "its last column is the centre in the shape's frame, in metres"
        )


def _refuse_inward(model: ObjectModel, spec: ObjectSpec, marker: MarkerSpec, step: float) -> None:
    """Refuse a marker on the surface whose front is inside the object and whose back is outside.

    Where both are outside (a thin plate) or inside (a recess), nothing is refused.

    Args:
        model: Shape of the object.
        spec: The object, for its name.
        marker: Marker with a pose.
        step: Distance [m] in front of the marker, and behind it, at which the shape is asked.

    Raises:
        PlanError: the marker faces inward.
    """
    pose = np.array(marker.T_object_marker)
    centre, out = pose[:3, 3], pose[:3, 2]
    front, back = model.depth(np.array([centre + step * out, centre - step * out]))
    if front > 0 > back:
        raise PlanError(
            f"{spec.name}: marker {marker.name} looks into the object: correct T_object_marker, its third "
            "column is the direction out of the tag's face, the first points right on it, the second up"
        )


def visible_markers(
    model: ObjectModel, spec: ObjectSpec, axis: PivotAxis, phi: float, camera: CameraModel
) -> MarkerVisibility:
    """Markers visible through a whole tip: facing the camera, in the image, large enough, not hidden.

    The tip goes from rest to `PAST_BALANCE` past balance.

    Args:
        model: Shape of the object.
        spec: Markers with their poses in the object frame; those without a pose are ignored.
        axis: Pivot axis.
        phi: Expected balance angle [rad].
        camera: Camera, with its pose in the world frame of the strike.

    Returns:
        Names of the visible markers, the one best aligned with the pivot axis first; mean edge of the first
        one's black square in the image at rest [px], 0 if no marker is visible; and the fault of the marker
        nearest to being visible, which has a meaning only if none is.
    """
    # For a strike with the object turned by 180 degrees the camera sees the other end of the axis.
    looks = axis.direction * np.copysign(1.0, camera.T_world_camera[1, 2])
    seen: list[tuple[float, int | str, float]] = []
    least = np.pi
    faults: list[Fault] = []
    for marker in spec.marker:
        if marker.T_object_marker is None:
            continue
        T_object_marker = np.array(marker.T_object_marker)
        angle = float(np.arccos(np.clip(-T_object_marker[:3, 2] @ looks, -1, 1)))
        least = min(least, angle)
        if angle > MAX_MARKER_ANGLE:
            continue
        path = _marker_path(axis, marker, T_object_marker, phi, camera)
        fault = _out_of_image(path, marker.name, phi, camera) or _too_small(path, marker.name)
        fault = fault or _hidden(model, axis, marker.name, T_object_marker, phi, camera)
        if fault is None:
            seen.append((round(angle, 3), marker.name, _edge(path[0])))
        else:
            faults.append(fault)
    none = f"no marker faces the camera through the tip (best is {np.degrees(least):.0f} deg off the axis)"
    nearest = max([Fault("no_marker", least, none), *faults], key=lambda each: FAULT_CODES.index(each.code))
    seen.sort(key=lambda each: (each[0], name_order(each[1])))
    return MarkerVisibility([marker_id for _, marker_id, _ in seen], nearest, seen[0][2] if seen else 0.0)


def _marker_path(
    axis: PivotAxis, marker: MarkerSpec, T_object_marker: Array, phi: float, camera: CameraModel
) -> Array:
    """Corners (steps, 4, 2) [raw px] of a marker's black square in the image, at angles of the tip.

    The angles go in even steps from rest to `PAST_BALANCE` past balance. All corners of a
    step are inf if one lies behind the camera, or in its plane.

    Args:
        axis: Pivot axis, on whose rounding the object rolls.
        marker: Marker, with its size.
        T_object_marker: (4, 4) pose of the marker in the object frame.
        phi: Expected balance angle [rad].
        camera: Camera, with its pose in the world frame of the strike.
    """
    half = marker.size_m / 2
    corners = apply(
        T_object_marker, np.array([[-half, half, 0], [half, half, 0], [half, -half, 0], [-half, -half, 0]])
    )
    world = corners @ axis.R_world_object.T + axis.p_world_object
    pivot = np.array([0.0, 0.0, axis.radius])
    T_camera_world = inverse_transform(camera.T_world_camera)
    path = np.full((VISIBILITY_STEPS, 4, 2), np.inf)
    for step, theta in enumerate(_checked_angles(phi)):
        rolled = np.array([axis.radius * theta, 0.0, 0.0])
        turned = (world - pivot) @ matrix_from_vector(np.array([0.0, theta, 0.0])).T + pivot + rolled
        in_camera = apply(T_camera_world, turned)
        if in_camera[:, 2].min() > RAY_TOLERANCE:
            path[step] = project(camera, in_camera)
    return path


def _checked_angles(phi: float) -> list[float]:
    """Tipping angles [rad], as a list, at which a marker's visibility is checked.

    They go evenly from 0 (rest) to `phi` + `PAST_BALANCE`, with `phi` the balance angle [rad].
    """
    return np.linspace(0.0, phi + float(PAST_BALANCE), VISIBILITY_STEPS).tolist()


def _edge(corners: Array) -> float:
    """Mean edge [px] of a square in the image with corners (4, 2) [px], given in order round it."""
    return float(np.linalg.norm(corners - np.roll(corners, 1, axis=0), axis=1).mean())


def _out_of_image(path: Array, marker_id: int | str, phi: float, camera: CameraModel) -> Fault | None:
    """Fault if a marker leaves the image during the tip; else None.

    A border of `BORDER_PX` counts as outside the image.

    Args:
        path: (steps, 4, 2) corners of the marker in the image through the tip [px].
        marker_id: Name of the marker, for the message.
        phi: Expected balance angle [rad].
        camera: Camera, of which the image size is used.
    """
    if not np.isfinite(path).all():
        return Fault(
            "out_of_image", None, f"marker {marker_id} is beside or behind the camera in some part of the tip"
        )
    last = np.array([camera.width, camera.height]) - 1 - BORDER_PX
    over = np.maximum(BORDER_PX - path, path - last).max(axis=(1, 2))
    worst = int(np.argmax(over))
    if over[worst] <= 0:
        return None
    turned = np.degrees(_checked_angles(phi)[worst])
    text = (
        f"marker {marker_id} is {over[worst]:.0f} px too far out for the image when the object has turned by "
        f"{turned:.0f} deg"
    )
    return Fault("out_of_image", float(over[worst]), text)


def _too_small(path: Array, marker_id: int | str) -> Fault | None:
    """Fault if a marker's black square is smaller in the image than `MIN_TAG_EDGE_PX`; else None.

    A fault holds rejection code, size [px] and message. The size is the mean edge at rest, which is step 0 of
    `path` (steps, 4, 2): the square's four corners in the image [raw px] at each step of the tip.
    """
    pixels = _edge(path[0])
    if pixels >= MIN_TAG_EDGE_PX:
        return None
    return Fault(
        "tag_small",
        pixels,
        f"marker {marker_id} is {pixels:.0f} px wide in the image: it needs {MIN_TAG_EDGE_PX:g} px",
    )


def _hidden(
    model: ObjectModel,
    axis: PivotAxis,
    marker_id: int | str,
    T_object_marker: Array,
    phi: float,
    camera: CameraModel,
) -> Fault | None:
    """Fault if the object hides the marker's centre at rest, at balance or past it; else None.

    A fault holds rejection code, number (here the tipping angle [rad] at which it is hidden) and message.

    Args:
        model: Shape of the object.
        axis: Pivot axis.
        marker_id: Name of the marker, for the message.
        T_object_marker: (4, 4) pose of the marker in the object frame.
        phi: Expected balance angle [rad].
        camera: Camera, with its pose in the world frame of the strike.
    """
    start = T_object_marker[:3, 3] + 0.002 * T_object_marker[:3, 2]
    pivot = np.array([0.0, 0.0, axis.radius])
    for theta in (0.0, phi, phi + float(PAST_BALANCE)):
        # Camera in the object's rest frame.
        back = matrix_from_vector(np.array([0.0, -theta, 0.0]))
        rolled = np.array([axis.radius * theta, 0.0, 0.0])
        camera_world = back @ (camera.T_world_camera[:3, 3] - pivot - rolled) + pivot
        ray = axis.R_world_object.T @ (camera_world - axis.p_world_object) - start
        far = float(np.linalg.norm(ray))
        if _hits_object(model, start, ray / far, far):
            text = (
                f"the object itself hides marker {marker_id} from the camera when it has turned by "
                f"{np.degrees(theta):.0f} deg"
            )
            return Fault("hidden", float(theta), text)
    return None


def _hits_object(model: ObjectModel, start: Array, direction: Array, far: float) -> bool:
    """True if a ray meets a face of the object nearer than `far` [m].

    Args:
        model: Shape of the object.
        start: (3,) start of the ray [m], in the object frame.
        direction: (3,) unit direction of the ray, in the object frame.
        far: Length of the ray [m].
    """
    across = np.linalg.svd(direction[None])[2][1:]
    near = np.ones(len(model.faces), dtype=bool)
    for row in across:
        left = (model.vertices - start) @ row < RAY_TOLERANCE
        right = (model.vertices - start) @ row > -RAY_TOLERANCE
        near &= left[model.faces].any(axis=1) & right[model.faces].any(axis=1)
    return polyhedron.first_hit(model.vertices, model.faces[near], start, direction) < far
