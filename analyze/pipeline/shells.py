"""The wall's thickness where the object's file gives none: the body cut anew for each that may be."""

from __future__ import annotations

from typing import TYPE_CHECKING

from analyze.estimation.cells import Cells, cells_from_voxels, possible_thicknesses
from analyze.estimation.regions import Wall, mass_distribution, mass_distribution_over
from analyze.geometry.voxels import voxelise

if TYPE_CHECKING:
    import numpy as np

    from analyze.geometry.object_model import ObjectModel
    from analyze.types import InertialParameters, MassDistribution
    from schemas.object_spec import ObjectSpec


def possible_walls(model: ObjectModel, pitch: float) -> list[Wall]:
    """The body in cells of `pitch` [m], for every thickness that leaves an inside."""
    walls = [Wall(float(t), cells_from_voxels(voxelise(model, pitch, float(t)))) for t in possible_thicknesses(model)]
    return [wall for wall in walls if wall.cells.interior.any()]


def regions_of(
    spec: ObjectSpec, model: ObjectModel, cells: Cells, parameters: InertialParameters, rng: np.random.Generator
) -> MassDistribution:
    """Region masses, with the wall that is given, or over all that may be.

    Args:
        spec: of the object.
        model: its exterior.
        cells: the body with the wall that is given, or assumed.
        parameters: mass, c and moments.
        rng: for the draws.
    """
    walls = [] if spec.shell_thickness_m is not None else possible_walls(model, cells.pitch)
    return mass_distribution_over(parameters, walls, rng) if len(walls) > 1 else mass_distribution(parameters, cells, rng)
