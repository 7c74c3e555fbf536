"""The section that an object rolls on in a strike, from its shape: its outline as seen along the pivot axis."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from analyze.errors import EstimationError
from analyze.motion.flank import from_outline
from analyze.motion.rolling_choice import is_curved

if TYPE_CHECKING:
    from analyze.geometry.object_model import ObjectModel
    from analyze.motion.flank import Flank
    from schemas.strike_plan import PlannedStrike


def section_of(model: ObjectModel, planned: PlannedStrike) -> Flank | None:
    """The flank about the strike's pivot point; None where it is a corner or a bevel, of which the plan's rounding says all.

    The table touches the lowest point of the whole hull, wherever along the axis that is: so the outline counts, not a cut.

    Args:
        model: the object's exterior, in O.
        planned: how it lies, and its pivot.
    """
    R_world_object = np.array(planned.R_world_object)
    across = (model.hull_vertices - np.array(planned.pivot.point)) @ R_world_object[[0, 2]].T
    try:
        section = from_outline(across, np.zeros(2), planned.pivot.radius_m)
    except EstimationError:
        return None
    return section if is_curved(section, planned) else None
