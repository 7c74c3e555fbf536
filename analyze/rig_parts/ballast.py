"""Ballast of the arm: washers on a bolt through its tip."""

from __future__ import annotations

from dataclasses import dataclass

from analyze.rig_parts.arm_part import ARM_HEIGHT
from analyze.rig_parts.bought import (
    M8_HEAD_KG,
    M8_KG_PER_MM,
    M8_NUT_HEIGHT,
    M8_NUT_KG,
    WASHER_KG,
    WASHER_THICKNESS,
)
from analyze.rig_parts.hinge_parts import bolt_length

MOST_WASHERS = 28
"""Largest number of washers: more would touch the pendulum's post."""


@dataclass(frozen=True)
class Ballast:
    """Large M8 washers on a bolt through the arm's tip, half of them on each side."""

    washers: int
    """Number of washers; 0 if there is no bolt either."""
    bolt_mm: float
    """Length of the M8 bolt [mm]."""

    @property
    def mass_kg(self) -> float:
        """Mass of washers, bolt and nut [kg]."""
        if not self.washers:
            return 0.0
        return self.washers * WASHER_KG + M8_HEAD_KG + M8_KG_PER_MM * self.bolt_mm + M8_NUT_KG


def ballast_of(mass_kg: float) -> Ballast:
    """Ballast of the mass that is nearest to the wanted one [kg]; at most `MOST_WASHERS`."""
    choices = [Ballast(0, 0.0)]
    for washers in range(2, MOST_WASHERS + 1, 2):
        grip = ARM_HEIGHT + washers * WASHER_THICKNESS + M8_NUT_HEIGHT
        choices.append(Ballast(washers, bolt_length(grip)))
    return min(choices, key=lambda each: abs(each.mass_kg - mass_kg))
