"""Draw an object in its own frame O: shape, equi-planes, centre of mass, mass regions and voxels.

An equi-plane is the plane through a strike's pivot axis that contains the centre of mass.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import rerun as rr

from analyze.geometry.rotations import wxyz_from_matrix
from analyze.geometry.station import turned_camera
from analyze.replay import views
from analyze.replay.overlay import sharp_edges
from analyze.replay.palette import BRIGHT, GREY, REGIONS, SKY, Colour
from analyze.result.headline import edge_labels

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from analyze.geometry.object_model import ObjectModel
    from analyze.replay.views import DrawnAnswer
    from analyze.types import Array, CameraModel, Marker
    from schemas.strike_plan import PlannedStrike, StrikePlan

_NAME_HEIGHT = 0.085
"""height of a name in the scene, as a fraction of the object's extent, at the size at which it is shown"""
_MIN_HALF_AXIS, _CROSS_HALF_LENGTH = 0.035, 0.12
"""Least half axis of the drawn ellipsoid and half length of the cross through it, as fractions of the longest
extent of the object."""
_MAX_VOXELS = 4000
"""Approximate number of cells drawn; of more, a sample is drawn."""


@dataclass(frozen=True)
class SceneInputs:
    """Object model, plan, camera and markers from which the scene of a strike is drawn."""

    model: ObjectModel
    """exterior of the object"""
    plan: StrikePlan
    """strike plan of the recording"""
    camera: CameraModel
    """first camera, with its pose in the world frame W of a strike whose object is not turned on the table"""
    markers: tuple[Marker, ...]
    """markers on the object"""

    def planned(self, plan_strike_id: str) -> PlannedStrike | None:
        """Planned strike with the given id; None if the plan has none."""
        return next((strike for strike in self.plan.strikes if strike.id == plan_strike_id), None)

    def seen_from(self, own_pose: Sequence[float]) -> SceneInputs:
        """Copy with the camera's pose that a strike's record states.

        Args:
            own_pose: 16 numbers of the pose (4, 4), row by row; empty for this pose.
        """
        if not own_pose:
            return self
        T_world_camera = np.array(own_pose, dtype=float).reshape(4, 4)
        return replace(self, camera=replace(self.camera, T_world_camera=T_world_camera))

    def camera_of(self, planned: PlannedStrike) -> CameraModel:
        """First camera of the recording, with its pose in the world frame W that belongs to a planned strike.

        Each strike has its own W: its x axis points in the direction in which this strike tips the object.
        """
        return turned_camera(self.camera, planned.heading_rad)


def flat_mesh(model: ObjectModel, colour: tuple[int, int, int, int]) -> rr.Mesh3D:
    """Mesh of the exterior in the object frame O [m], faces flat shaded in one colour (RGBA, 0 to 255)."""
    corners = model.vertices[model.faces].reshape(-1, 3)
    normals = np.repeat(np.cross(corners[1::3] - corners[::3], corners[2::3] - corners[::3]), 3, axis=0)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30)
    return rr.Mesh3D(
        vertex_positions=corners,
        triangle_indices=np.arange(len(corners)).reshape(-1, 3),
        vertex_normals=normals,
        albedo_factor=colour,
    )


def log_shape(stream: rr.RecordingStream, root: str, model: ObjectModel) -> None:
    """Log the object's half transparent faces and its sharp edges.

    Args:
        stream: destination.
        root: parent entity, in the object's frame.
        model: exterior of the object.
    """
    mesh = flat_mesh(model, (190, 200, 215, 45))
    stream.log(f"{root}/shape", mesh, static=True)
    edges = rr.LineStrips3D(
        sharp_edges(model.vertices, model.faces), colors=[(175, 185, 200)], radii=[0.0004]
    )
    stream.log(f"{root}/edges", edges, static=True)


def log_inside(
    stream: rr.RecordingStream,
    root: str,
    model: ObjectModel,
    answer: DrawnAnswer,
    colours: Mapping[str, Colour],
    strike_id: str | None = None,
) -> None:
    """Log the inside of the object: equi-planes, centre of mass with 95 % ellipsoid, and interior parts.

    An equi-plane contains a strike's pivot axis and the centre of mass; one that misses the object is left
    out. The interior parts are those whose masses are estimated; the shell (outer wall), whose mass is
    estimated too, is not drawn, as the shape shows it.

    Args:
        stream: destination.
        root: parent entity, in the object's frame.
        model: exterior of the object.
        answer: estimate to be drawn, in the object's frame.
        colours: colour of each strike, by its id.
        strike_id: draw the equi-plane of this strike only; None draws all, and names the centre of mass.
    """
    for plane in answer.planes:
        if strike_id is not None and plane.strike_id != strike_id:
            continue
        cut = views.plane_section(model, plane.point, plane.normal)
        if len(cut) == 0:
            continue
        colour = colours.get(plane.strike_id, SKY)
        quad = rr.Mesh3D(
            vertex_positions=cut, triangle_indices=views.fan_triangles(cut), albedo_factor=(*colour, 42)
        )
        outline = rr.LineStrips3D([np.vstack([cut, cut[:1]])], colors=[colour], radii=[0.0004])
        stream.log(f"{root}/planes{rr.new_entity_path([plane.strike_id])}", quad, outline, static=True)
    _centre(stream, root, model, answer, named=strike_id is None)
    if strike_id is None:
        _edge_labels(stream, root, model, answer)
    # The first region is the shell: the shape itself shows it.
    for region, colour in zip(answer.regions[1:], REGIONS, strict=False):
        points = rr.Points3D(region.points, colors=[colour], radii=[0.0007])
        stream.log(f"{root}/regions{rr.new_entity_path([region.name])}", points, static=True)


def _edge_labels(stream: rr.RecordingStream, root: str, model: ObjectModel, answer: DrawnAnswer) -> None:
    """Name each struck edge beside its place, with its strikes: the legend of the planes that start there.

    Names stand at heights at which they do not cover one another, nor that of the centre of mass; a thin line
    leads from each to its edge.
    """
    names = edge_labels(answer.result)
    strikes: dict[str, list[str]] = {}
    points: dict[str, Array] = {}
    for plane in answer.planes:
        strikes.setdefault(plane.axis_id, []).append(plane.strike_id)
        points.setdefault(plane.axis_id, plane.point)
    if points:
        labels = [f"{names.get(axis_id, axis_id)}: {', '.join(strikes[axis_id])}" for axis_id in points]
        reach = float(model.extent.max())
        edges, places = np.array(list(points.values())), np.array(list(points.values()))
        heights = np.append(edges[:, 2], _name_of_centre(answer, reach)[2])
        places[:, 2] = views.spread(heights, _NAME_HEIGHT * reach)[:-1]
        marks = rr.Points3D(places, colors=[GREY], radii=[0.0], labels=labels, show_labels=True)
        stream.log(f"{root}/edge_names", marks, static=True)
        leaders = rr.LineStrips3D(list(np.stack([edges, places], axis=1)), colors=[GREY], radii=[0.0003])
        stream.log(f"{root}/edge_names/lines", leaders, static=True)


def _name_of_centre(answer: DrawnAnswer, reach: float) -> Array:
    """Place (3,) [m] above the centre of mass for its name, in the object frame; `reach`: extent [m]."""
    return answer.com.position + np.array([0.0, 0.0, 2.2 * _CROSS_HALF_LENGTH * reach])


def _centre(
    stream: rr.RecordingStream, root: str, model: ObjectModel, answer: DrawnAnswer, *, named: bool
) -> None:
    """Draw the 95 % ellipsoid of the centre of mass, enlarged where it would be too small to be seen.

    Args:
        stream: stream that the viewer or a file receives.
        root: path of the object's frame in the stream.
        model: shape of the object, of which the extent is used.
        answer: estimate, of which the centre of mass is used.
        named: True to draw a cross and the label "centre of mass" too.
    """
    reach = float(model.extent.max())
    half, axes = views.ellipsoid(answer.com.covariance, _MIN_HALF_AXIS * reach)
    ball = rr.Ellipsoids3D(
        centers=[answer.com.position],
        half_sizes=[half],
        quaternions=[wxyz_from_matrix(axes)[[1, 2, 3, 0]]],
        colors=[BRIGHT],
        fill_mode="solid",
    )
    stream.log(f"{root}/centre_of_mass", ball, static=True)
    if named:
        cross = answer.com.position + _CROSS_HALF_LENGTH * reach * np.stack([-np.eye(3), np.eye(3)], axis=1)
        lines = rr.LineStrips3D(list(cross), colors=[BRIGHT], radii=[0.003 * reach])
        stream.log(f"{root}/centre_of_mass/cross", lines, static=True)
        above = _name_of_centre(answer, reach)
        name = rr.Points3D([above], colors=[BRIGHT], radii=[0.0], labels=["centre of mass"], show_labels=True)
        stream.log(f"{root}/centre_of_mass/name", name, static=True)


def log_voxels(stream: rr.RecordingStream, path: str, answer: DrawnAnswer) -> None:
    """Draw the cells of the voxel map (estimated density), coloured from dark (low) to bright (high).

    Of 8000 cells or more, every second, third ... is drawn, 4000 to 6000 in all; nothing is drawn if the
    answer has no map.

    Args:
        stream: stream that the viewer or a file receives.
        path: path of the cells in the stream.
        answer: estimate with its map.
    """
    voxels = answer.voxels
    if voxels is None:
        return
    shown = np.arange(len(voxels.points))[:: max(1, len(voxels.points) // _MAX_VOXELS)]
    half = 0.42 * np.cbrt(voxels.volumes[shown])[:, None] * np.ones(3)
    low, high = np.quantile(voxels.density, [0.02, 0.98])
    colours = _shade((voxels.density[shown] - low) / max(high - low, 1e-9))
    boxes = rr.Boxes3D(centers=voxels.points[shown], half_sizes=half, colors=colours, fill_mode="solid")
    stream.log(path, boxes, static=True)


def _shade(level: Array) -> NDArray[np.uint8]:
    """Colours (n, 3), 0 to 255, of levels (n,) from 0 (dark blue) to 1 (bright yellow).

    Lightness rises evenly. Levels outside are clipped. The colours resemble those of the colour map cividis.
    """
    dark, middle, bright = np.array([10, 40, 100]), np.array([125, 124, 120]), np.array([253, 231, 55])
    at = np.clip(level, 0.0, 1.0)[:, None]
    colours = np.where(at < 0.5, dark + 2 * at * (middle - dark), middle + (2 * at - 1) * (bright - middle))
    return np.asarray(colours, dtype=np.uint8)
