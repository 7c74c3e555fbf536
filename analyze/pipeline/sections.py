"""Rolling outline of an object for one strike, and the angle at which its next face lands."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import PurePath
from typing import TYPE_CHECKING

import numpy as np

from analyze.errors import EstimationError, ShapeError
from analyze.geometry import mesh_files
from analyze.geometry.object_model import LINE_SD, load_object_model
from analyze.motion.landing import landing_angle
from analyze.motion.rolling_choice import is_curved
from analyze.motion.support_function import support_of_outline

if TYPE_CHECKING:
    from collections.abc import Callable

    from analyze.geometry.object_model import ObjectModel
    from analyze.motion.support_function import SupportFunction
    from schemas.object_spec import ObjectSpec
    from schemas.strike_plan import PlannedStrike


def rolling_outline(model: ObjectModel, planned: PlannedStrike) -> SupportFunction | None:
    """Support function of a curved flank about the strike's pivot point; None at a corner or bevel.

    A corner or bevel needs none: its edge radius describes it.

    The table touches the lowest point of the whole hull, wherever along the axis it lies, so that the
    outline seen along the axis counts, not a cut.

    Args:
        model: the object's exterior, in O.
        planned: pose and pivot of the strike.
    """
    section = _across(model, planned)
    if section is None or not is_curved(section, planned):
        return None
    # A mesh's outline is as accurate as the mesh, a cloud's as the edge that was fitted to it.
    outline_sd = math.hypot(LINE_SD, model.surface_sd) if model.cloud is None else planned.pivot.sd_m
    return replace(section, sd=math.hypot(section.sd, outline_sd))


def next_face_angle(model: ObjectModel, planned: PlannedStrike) -> float | None:
    """Least theta [rad] at which the next face may touch the table; None on a flank or if no face is known.

    Args:
        model: the object's exterior, in O.
        planned: pose and pivot of the strike.
    """
    section = _across(model, planned)
    return None if section is None or is_curved(section, planned) else landing_angle(section, planned)


def _across(model: ObjectModel, planned: PlannedStrike) -> SupportFunction | None:
    """Outline of the hull as seen along the pivot axis; None if it has no area."""
    R_world_object = np.array(planned.R_world_object)
    across = (model.hull_vertices - np.array(planned.pivot.point)) @ R_world_object[[0, 2]].T
    try:
        return support_of_outline(across, np.zeros(2), planned.pivot.radius_m)
    except EstimationError:
        return None


class MeshSections:
    """Outlines and landing angles of an object, for judging a strike while the session is running.

    The shape is loaded on first use, when its file may not have been recorded yet. A primitive has none; a
    point cloud gets none here, since fitting its surface takes seconds; the estimate fits it later.
    """

    def __init__(self, spec: ObjectSpec, shape_bytes: Callable[[], bytes | None]) -> None:
        self._spec = spec
        self._shape_bytes = shape_bytes
        self._model: ObjectModel | None = None
        self._load_tried = False

    def outline(self, planned: PlannedStrike) -> SupportFunction | None:
        """Support function as of `rolling_outline`; also None if the shape is not available."""
        model = self._loaded()
        return None if model is None else rolling_outline(model, planned)

    def landing_angle_rad(self, planned: PlannedStrike) -> float | None:
        """Angle [rad] as of `next_face_angle`; also None if the shape is not available."""
        model = self._loaded()
        return None if model is None else next_face_angle(model, planned)

    def _loaded(self) -> ObjectModel | None:
        if not self._load_tried:
            self._load_tried = True
            self._model = self._load()
        return self._model

    def _load(self) -> ObjectModel | None:
        name, data = self._spec.shape.file or "", self._shape_bytes()
        suffix = PurePath(name).suffix.lower().removeprefix(".")
        if (
            data is None
            or suffix not in mesh_files.FORMATS
            or (suffix == "ply" and not mesh_files.ply_has_faces(data))
        ):
            return None
        try:
            return load_object_model(self._spec, data, name)
        except ShapeError:
            return None
