"""What an object's shape says of a strike: the section that it rolls on, its outline as seen along the pivot
axis, and where it lands."""

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


def section_of(model: ObjectModel, planned: PlannedStrike) -> SupportFunction | None:
    """The flank about the strike's pivot point; None where it is a corner or a bevel, of which the plan's
    rounding says all.

    The table touches the lowest point of the whole hull, wherever along the axis that is: so the outline
    counts, not a cut.

    Args:
        model: the object's exterior, in O.
        planned: how it lies, and its pivot.
    """
    section = _across(model, planned)
    if section is None or not is_curved(section, planned):
        return None
    # A mesh's flank is where the mesh is, a cloud's as well known as the edge that was fitted to it.
    place = math.hypot(LINE_SD, model.surface_sd) if model.cloud is None else planned.pivot.sd_m
    return replace(section, sd=math.hypot(section.sd, place))


def landing_of(model: ObjectModel, planned: PlannedStrike) -> float | None:
    """Angle [rad] from which on the shape's next face may touch; None where it rolls on a flank, or where no
    face is known.

    Args:
        model: the object's exterior, in O.
        planned: how it lies, and its pivot.
    """
    section = _across(model, planned)
    return None if section is None or is_curved(section, planned) else landing_angle(section, planned)


def _across(model: ObjectModel, planned: PlannedStrike) -> SupportFunction | None:
    """The whole outline as seen along the pivot axis; None where it has no area."""
    R_world_object = np.array(planned.R_world_object)
    across = (model.hull_vertices - np.array(planned.pivot.point)) @ R_world_object[[0, 2]].T
    try:
        return support_of_outline(across, np.zeros(2), planned.pivot.radius_m)
    except EstimationError:
        return None


class MeshSections:
    """Sections of an object whose shape file may still be on its way, for who must judge a strike at once.

    Loads the shape with the first question. Of a primitive there is none; of a point cloud none is made here,
    because its surface takes seconds: the estimate afterwards has it.
    """

    def __init__(self, spec: ObjectSpec, shape_bytes: Callable[[], bytes | None]) -> None:
        self._spec = spec
        self._shape_bytes = shape_bytes
        self._model: ObjectModel | None = None
        self._asked = False

    def of(self, planned: PlannedStrike) -> SupportFunction | None:
        """As `section_of`; None too where the shape cannot be had."""
        model = self._loaded()
        return None if model is None else section_of(model, planned)

    def landing_angle_rad(self, planned: PlannedStrike) -> float | None:
        """As `landing_of`; None too where the shape cannot be had."""
        model = self._loaded()
        return None if model is None else landing_of(model, planned)

    def _loaded(self) -> ObjectModel | None:
        if not self._asked:
            self._asked = True
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
