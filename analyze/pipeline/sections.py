"""Outline or lines over which an object turns in one strike, and angle at which its next face lands."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import PurePath
from typing import TYPE_CHECKING

import numpy as np

from analyze.errors import EstimationError, ShapeError
from analyze.geometry import mesh_files
from analyze.geometry.edge_radius import edge_radius
from analyze.geometry.object_model import LINE_SD, load_object_model
from analyze.motion.landing import landing_angle, rolling_landing_angle
from analyze.motion.outline import HIGH
from analyze.motion.rolling_choice import PAST_PHI_RAD, is_curved, rolls_until
from analyze.motion.support_function import support_of_outline
from analyze.motion.supports import carrying_line, support_lines
from analyze.planning.corrected import inward_shift

if TYPE_CHECKING:
    from collections.abc import Callable

    from analyze.geometry.object_model import ObjectModel
    from analyze.motion.support_function import SupportFunction
    from analyze.types import Array, IntArray, SupportLine
    from schemas.object_spec import ObjectSpec
    from schemas.strike_plan import PlannedStrike

SCANNED_EDGE_SD = 1.5e-3
"""1 sigma [m] of the place of a scan's edges beyond their radius

Of 166 axes of scans with 0.5 mm of noise, the lines that carried lay within 0.6 mm of those planned in half,
within 2.5 mm in nine of ten.
"""


def rolling_outline(model: ObjectModel, planned: PlannedStrike) -> SupportFunction | None:
    """Support function of the curved flank on which the object rolls in a strike, or None.

    The support function is the height [m] of the pivot point over the table by tipping angle [rad]. It is
    that of the hull's outline as seen along the pivot axis, not of a cut: the table touches the lowest point
    of the whole hull, wherever along the axis that lies.

    Args:
        model: the object's exterior, in the object frame O.
        planned: rest pose and pivot of the strike.

    Returns:
        Support function with the sd [m] of the outline. None if the object does not roll but tips about a
        corner or bevel, for which the radius of the edge suffices, or if the outline has no area.
    """
    section = _across(model, planned)
    lands = None if section is None else rolls_until(section, planned.phi_predicted_rad)
    if section is None or lands is None:
        return None
    # What touches later, such as a handle, is no error of the curve on which the object rolls.
    until = _across(model, planned, min(lands, planned.phi_predicted_rad + PAST_PHI_RAD))
    section = until if until is not None and is_curved(until, planned.phi_predicted_rad) else section
    # A mesh's outline is as accurate as the mesh, a cloud's as the edge that was fitted to it.
    outline_sd = math.hypot(LINE_SD, model.surface_sd) if model.cloud is None else planned.pivot.sd_m
    return replace(section, sd=math.hypot(section.sd, outline_sd))


def next_face_angle(model: ObjectModel, planned: PlannedStrike) -> float | None:
    """Tipping angle [rad] from which the object's next face may land on the table after balance, or None.

    The next face is the first that lands after the predicted balance, while the object turns over the planned
    edge or, if a face landed before the balance, over the edge at which that face ends.

    Args:
        model: the object's exterior, in the object frame O.
        planned: rest pose and pivot of the strike.

    Returns:
        Angle at which the face lands by the shape, less a margin for errors of the shape. None if no further
        face comes to the table after the predicted balance, or, where the object rolls on a curved flank, up
        to 25 deg past it; None too if the outline has no area.
    """
    section = _across(model, planned)
    if section is None:
        return None
    if is_curved(section, planned.phi_predicted_rad):
        return rolling_landing_angle(section, planned)
    lands = landing_angle(section, planned)
    if lands is not None:
        return lands
    points, radius = _projected(model, planned), planned.pivot.radius_m
    supports = support_lines(points, radius, planned.pivot.sd_m)
    line = supports[carrying_line(supports, planned.phi_predicted_rad)]
    place = np.array([line.along_m, line.up_m])
    return landing_angle(support_of_outline(points, place, radius), planned) if line.takes_over_rad else None


def strike_supports(model: ObjectModel, planned: PlannedStrike) -> tuple[SupportLine, ...] | None:
    """Lines over which the object turns in succession in a strike, from rest on, or None.

    Args:
        model: the object's exterior, in the object frame O.
        planned: rest pose and pivot of the strike.

    Returns:
        The lines, ordered by the tipping angle [rad] at which each lands and the object begins to turn over
        it. Their places [m] are those at rest, from the centre line of the planned pivot's rounding:
        horizontally in the direction of the tip, and upwards. None if the object rolls mainly on a curved
        flank, or if the outline has no area.
    """
    section = _across(model, planned)
    if section is None or is_curved(section, planned.phi_predicted_rad):
        return None
    return support_lines(_projected(model, planned), planned.pivot.radius_m, planned.pivot.sd_m)


def scanned_edge_sd(spec: ObjectSpec, model: ObjectModel, planned: PlannedStrike) -> float:
    """1 sigma [m] by which a strike's edge may lie ahead of the planned one, at balance, as it was scanned.

    It joins the radius where the scan leaves it open, and `SCANNED_EDGE_SD`; 0 for a mesh that is no scan.

    Args:
        spec: object file, with the edges' radii where they are stated.
        model: the object's exterior, in the object frame O.
        planned: rest pose and pivot of the strike.
    """
    if model.cloud is None or not model.cloud.meshed:
        return 0.0
    pivot, phi = planned.pivot, planned.phi_predicted_rad
    shift = inward_shift(pivot, np.array(planned.R_world_object), model)
    corner = np.array(pivot.point) - pivot.radius_m * shift
    prior = edge_radius(spec, model, planned.axis_id, corner, np.array(pivot.direction))
    return float(np.hypot(SCANNED_EDGE_SD, (np.cos(phi) - np.sin(phi)) * (prior.blurred_sd or 0.0)))


def _projected(model: ObjectModel, planned: PlannedStrike) -> Array:
    """Corners (n, 2) [m] of the object's convex hull at rest, seen along the pivot axis.

    They are given from the pivot's centre line: x in the direction of the tip, z up.
    """
    R_world_object = np.array(planned.R_world_object)
    return (model.hull_vertices - np.array(planned.pivot.point)) @ R_world_object[[0, 2]].T


def _across(model: ObjectModel, planned: PlannedStrike, until: float = HIGH) -> SupportFunction | None:
    """Support function of the hull's outline, seen along the pivot axis; None if the outline has no area.

    It is the pivot point's height [m] over the table by tipping angle [rad], as the hull rolls on the table.
    Its errors are those of the outline up to the tipping angle `until` [rad].
    """
    try:
        return support_of_outline(_projected(model, planned), np.zeros(2), planned.pivot.radius_m, until)
    except EstimationError:
        return None


class MeshSections:
    """Outline, support lines and landing angle of a mesh object for each strike, while the session runs.

    The outline is that of the curved flank on which the object rolls; the support lines are those over which
    it turns in succession; the landing angle is the tipping angle from which its next face may land. The
    shape is loaded once, on first use. All answers are None if it was not available then, that is if its file
    was not recorded yet or cannot be used. They are None too for a primitive (box, cylinder), which has no
    file, and for a point cloud: fitting its surface takes seconds, and the estimate does it later.

    Args:
        spec: the object's file: mass, shape, markers.
        shape_bytes: called for the contents of the shape file; it returns None while they are not recorded.
    """

    def __init__(self, spec: ObjectSpec, shape_bytes: Callable[[], bytes | None]) -> None:
        self._spec = spec
        self._shape_bytes = shape_bytes
        self._model: ObjectModel | None = None
        self._load_tried = False

    def outline(self, planned: PlannedStrike) -> SupportFunction | None:
        """Support function of the curved flank on which the object rolls in a planned strike, or None.

        The support function is the pivot point's height [m] over the table by tipping angle [rad]. None if
        the object tips about a corner or bevel, if the outline has no area, or if the shape is not available.
        """
        model = self._loaded()
        return None if model is None else rolling_outline(model, planned)

    def landing_angle_rad(self, planned: PlannedStrike) -> float | None:
        """Tipping angle [rad] from which the object's next face may land on the table, or None.

        None if no further face comes to the table after the predicted balance, if the outline has no area, or
        if the shape is not available.
        """
        model = self._loaded()
        return None if model is None else next_face_angle(model, planned)

    def supports(self, planned: PlannedStrike) -> tuple[SupportLine, ...] | None:
        """Lines over which the object turns in succession in a planned strike, from rest on, or None.

        None if the object rolls on a curved flank, if the outline has no area, or if the shape is not
        available.
        """
        model = self._loaded()
        return None if model is None else strike_supports(model, planned)

    def edge_sd(self, planned: PlannedStrike) -> float:
        """1 sigma [m] of a planned strike's edge, ahead at balance, by a scan; 0 for other meshes."""
        model = self._loaded()
        return 0.0 if model is None else scanned_edge_sd(self._spec, model, planned)

    def hull_vertices(self) -> Array | None:
        """Vertices (n, 3) of the object's convex hull [m], in O; None for a cloud or an unavailable shape."""
        model = self._primitive_or_mesh()
        return None if model is None else model.hull_vertices

    def surface(self) -> tuple[Array, IntArray] | None:
        """Vertices (v, 3) [m], in O, and triangles (t, 3); None for a cloud or an unavailable shape."""
        model = self._primitive_or_mesh()
        return None if model is None else (model.vertices, model.faces)

    def _primitive_or_mesh(self) -> ObjectModel | None:
        """The object's exterior, also of a primitive, or None."""
        if self._spec.shape.file is not None:
            return self._loaded()
        try:
            return load_object_model(self._spec, None, self._spec.name)
        except ShapeError:
            return None

    def _loaded(self) -> ObjectModel | None:
        """The object's exterior, loaded at the first call; None if it was not available at that call."""
        if not self._load_tried:
            self._load_tried = True
            self._model = self._load()
        return self._model

    def _load(self) -> ObjectModel | None:
        """The object's exterior from its mesh file, or None.

        None if there is no file, or it holds a point cloud or a shape that cannot be used.
        """
        name, data = self._spec.shape.file or "", self._shape_bytes()
        suffix = PurePath(name).suffix.lower().removeprefix(".")
        if data is None or not mesh_files.is_mesh(data, suffix):
            return None
        try:
            return load_object_model(self._spec, data, name)
        except ShapeError:
            return None
