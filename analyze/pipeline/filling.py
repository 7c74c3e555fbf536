"""What fills an object up to a level that nobody knows: from its file and moments to an answer in the result, and in words."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from analyze.estimation.cells import Cells
from analyze.estimation.fill_level import FillLevel, KnownDensity, Marginal, Shell, fill_level
from analyze.pipeline.shells import possible_walls
from schemas.result import Filling, Quantity, ResultWarning, WarningCode

if TYPE_CHECKING:
    from analyze.estimation.part_masses import MeasuredMoments
    from analyze.pipeline.evidence import Evidence
    from schemas.object_spec import PartLabel

DENSITY_SD = 0.05
"""relative, of a filling whose density is given without one"""
UNEXPLAINED = 2.5
"""rms of the residuals over their sd"""


def filling_of(evidence: Evidence, cells: Cells, moments: MeasuredMoments, rng: np.random.Generator) -> FillLevel | None:
    """The posterior of what fills the object; None where its file names no such part.

    Args:
        evidence: of the object.
        cells: the body with the wall that is given, or assumed.
        moments: of the whole.
        rng: for the draws.

    Raises:
        EstimationError: the object has no inside.
    """
    label = filling_label(evidence)
    if label is None:
        return None
    model, given = evidence.model, evidence.spec.shell_thickness_m
    if given is not None:
        shells = [Shell(given, cells, model.hull_vertices)]
    else:
        shells = [Shell(wall.thickness, wall.cells, model.hull_vertices) for wall in possible_walls(model, cells.pitch)]
    density = None
    if label.density_kg_m3 is not None:
        density = KnownDensity(label.density_kg_m3, label.density_sd_kg_m3 or DENSITY_SD * label.density_kg_m3)
    return fill_level(moments, shells, np.array(label.along), density, rng)


def filling_label(evidence: Evidence) -> PartLabel | None:
    """The part that fills the object."""
    return next((label for label in evidence.spec.labels or [] if label.fills), None)


def filling_document(name: str, found: FillLevel) -> Filling:
    """As the result has it."""
    return Filling(
        name=name,
        along=found.along.tolist(),
        level=_quantity(found.level, "m", frame="O"),
        filled_share=_quantity(found.filled, "1"),
        mass=_quantity(found.mass, "kg"),
        density=_quantity(found.density, "kg/m^3"),
        wall=_quantity(found.wall_mass, "kg"),
        shell_thickness=None if found.thickness is None else _quantity(found.thickness, "m"),
        misfit=found.misfit,
    )


def filling_warnings(filling: Filling | None) -> Iterator[ResultWarning]:
    """What is assumed of a filling, what the moments leave of it open, and whether it is one."""
    if filling is None:
        return
    text = f"{filling.name} is taken to turn with the object (powder that does not run; frozen, set or viscous): a free liquid sloshes"
    yield ResultWarning(code=WarningCode.FILLING_TURNS_WITH_IT, text=f"{text}, and none of this holds for it")
    if filling.misfit > UNEXPLAINED:
        text = f"a wall and {filling.name} up to a level do not explain the moments ({filling.misfit:.1f} times their sd)"
        yield ResultWarning(code=WarningCode.FILLING_UNEXPLAINED, text=f"{text}: look at `along`; or there is more inside")
    numbers = {
        "level": filling.level,
        "mass": filling.mass,
        "density": filling.density,
        "wall's mass": filling.wall,
        "wall's thickness": filling.shell_thickness,
    }
    if open_ones := [name for name, number in numbers.items() if number is not None and not number.observed]:
        text = f"of {filling.name} the moments leave open: {', '.join(open_ones)}"
        yield ResultWarning(code=WarningCode.REGIONS_UNCERTAIN, text=f"{text}; its density (density_kg_m3), if it is known, would help")


def _quantity(found: Marginal, unit: str, frame: str | None = None) -> Quantity:
    return Quantity(value=found.value, sd=found.sd, unit=unit, interval95=list(found.interval), observed=found.observed, frame=frame)
