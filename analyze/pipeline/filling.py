"""Fill level, mass and density of a filling that the object file names, from the measured moments."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from analyze.estimation.cells import Cells
from analyze.estimation.fill_level import Container, FillLevel, KnownDensity, fill_level
from analyze.pipeline.shells import possible_shells

if TYPE_CHECKING:
    from analyze.estimation.part_masses import MeasuredMoments
    from analyze.pipeline.evidence import Evidence
    from schemas.object_spec import PartLabel

RELATIVE_DENSITY_SD = 0.05
"""relative 1 sigma assumed for a filling's density that is given without one"""


def estimate_filling(
    evidence: Evidence, cells: Cells, moments: MeasuredMoments, rng: np.random.Generator
) -> FillLevel | None:
    """Posterior of fill level, mass and density of the object's filling; None if the object has none.

    Args:
        evidence: fitted strikes, of which only the object file and the shape are used.
        cells: the body divided into cells, with the given or assumed shell (outer wall).
        moments: measured mass, centre of mass and moments of the whole object.
        rng: generator of the posterior draws.

    Returns:
        Level [m] along the direction that pointed upwards when the object was filled, from the origin of the
        object frame O, mass [kg] and density [kg/m³], with 95 % intervals; None where the object file names
        no filling.

    Raises:
        EstimationError: the object has no interior.
    """
    label = filling_label(evidence)
    if label is None:
        return None
    model, given = evidence.model.own, evidence.spec.shell_thickness_m
    if given is not None:
        shells = [Container(given, cells, model.hull_vertices)]
    else:
        shells = [
            Container(shell.thickness, shell.cells, model.hull_vertices)
            for shell in possible_shells(model, cells.pitch)
        ]
    density = None
    if label.density_kg_m3 is not None:
        density = KnownDensity(
            label.density_kg_m3, label.density_sd_kg_m3 or RELATIVE_DENSITY_SD * label.density_kg_m3
        )
    return fill_level(moments, shells, np.array(label.along), density, rng)


def filling_label(evidence: Evidence) -> PartLabel | None:
    """Entry of the object file that names the part which fills the object; None where there is none."""
    return next((label for label in evidence.spec.labels or [] if label.fills), None)
