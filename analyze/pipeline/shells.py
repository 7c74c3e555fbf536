"""Masses of shell (outer wall) and interior parts, averaged over possible shell thicknesses.

A thickness that the object file gives is used alone.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from analyze.estimation.cells import Cells, ShellCells, candidate_shell_thicknesses, cells_from_voxels
from analyze.estimation.region_masses import mass_distribution, mass_distribution_over
from analyze.geometry.voxels import voxelise

if TYPE_CHECKING:
    import numpy as np

    from analyze.estimation.mass_properties import InertialParameters, MassDistribution
    from analyze.geometry.object_model import ObjectModel
    from schemas.object_spec import ObjectSpec


MIN_WALL = 2e-4
"""Thinnest wall [m] that an object whose shell thickness is not given can have: stiff paper, foil."""
THICK_WALL_FRACTION = 0.25
"""Thickest hollow wall considered where none is given, over the cube root of the volume; the next is a
solid body."""


def possible_shells(model: ObjectModel, pitch: float) -> list[ShellCells]:
    """The body divided into cells with edge `pitch` [m], once for each possible thickness of its shell.

    The body is that of the shape `model`; the shell is its outer wall. Candidate thicknesses that leave no
    interior are left out; the thinnest is first. Empty if no thickness leaves an interior.
    """
    shells = [
        ShellCells(float(t), cells_from_voxels(voxelise(model, pitch, float(t))))
        for t in candidate_shell_thicknesses(model)
    ]
    return [shell for shell in shells if shell.cells.interior.any()]


def limiting_walls(model: ObjectModel, pitch: float) -> list[ShellCells]:
    """The body divided into cubic cells twice: with the thinnest and the thickest outer wall considered.

    The shell is this wall; the candidates for its thickness lie between the two.

    Args:
        model: shape of the object.
        pitch: edge of the cells [m].

    Returns:
        Thickness [m] and cells, for the thicknesses `MIN_WALL` and `THICK_WALL_FRACTION` times the cube root
        of the shape's volume.
    """
    thick = THICK_WALL_FRACTION * model.volume ** (1 / 3)
    return [ShellCells(t, cells_from_voxels(voxelise(model, pitch, t))) for t in (MIN_WALL, thick)]


def region_masses(
    spec: ObjectSpec,
    model: ObjectModel,
    cells: Cells,
    parameters: InertialParameters,
    rng: np.random.Generator,
) -> MassDistribution:
    """Masses of shell and interior parts, at the given shell thickness or averaged over possible ones.

    They are averaged if the thickness is not given, and two or more possible ones leave an interior.

    Args:
        spec: object file, which may give the thickness.
        model: exterior shape.
        cells: the body cut into pieces, with a shell of the given thickness or an assumed one; used if the
            masses are not averaged.
        parameters: mass, centre of mass and moments.
        rng: generator of the draws behind the intervals.

    Returns:
        Masses [kg] of the shell and of the interior on either side of a plane, with 95 % intervals.
    """
    if spec.shell_thickness_m is not None:
        return mass_distribution(parameters, cells, rng)
    shells, walls = possible_shells(model, cells.pitch), limiting_walls(model, cells.pitch)
    return (
        mass_distribution_over(parameters, shells, rng, walls)
        if len(shells) > 1
        else mass_distribution(parameters, cells, rng, walls)
    )
