"""All printable parts of a rig, checked, and the mass that the arm brings to its tip."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from analyze.errors import FixtureError
from analyze.fixture.checks import PrintChecks, check_print
from analyze.fixture.print_mass import PrintMaterial, printed_mass
from analyze.rig_parts.holders import camera_holder, mat_clamp
from analyze.rig_parts.solids import RigPart
from analyze.rig_parts.striker_parts import HORNS, arm, bearing_hub, horn_adapter, pad

BOLT_KG = 0.0065
"""Mass of the tip's bolt with its nut, M4 x 50 in steel [kg]."""


@dataclass(frozen=True)
class CheckedPart:
    """Part with the results of its checks and its printed mass."""

    part: RigPart
    checks: PrintChecks
    """Watertightness, thinnest wall, size, overhangs."""
    mass_kg: float
    """Printed mass of one copy [kg]."""


@dataclass(frozen=True)
class RigPrints:
    """All parts of a rig, and what the printed arm weighs at its tip."""

    parts: tuple[CheckedPart, ...]
    arm_length_m: float
    """Distance from the hinge's axis to the tip [m]."""
    arm_effective_kg: float
    """Effective mass at the tip of arm, pad and bolt [kg]: moment of inertia about the hinge / length^2."""

    def ballast_kg(self, effective_mass_kg: float) -> float:
        """Mass to screw to the tip for an effective mass there [kg]; 0 if the arm alone has it.

        Args:
            effective_mass_kg: wanted effective mass [kg], less that of the servo's rotor.
        """
        return max(0.0, effective_mass_kg - self.arm_effective_kg)


def rig_prints(arm_length_m: float, material: PrintMaterial | None = None) -> RigPrints:
    """All printable parts for a rig with this arm length [m], each checked as the print of a fixture is.

    Args:
        arm_length_m: distance from the hinge's axis to the tip [m].
        material: filament and settings; None for PLA with 30 % infill.

    Raises:
        FixtureError: the arm cannot be printed in one piece, or a part fails a check.
    """
    material = material or PrintMaterial(infill=0.3)
    length = 1000 * arm_length_m
    parts = [
        arm(length),
        pad(),
        *(horn_adapter(horn) for horn in HORNS),
        bearing_hub(),
        camera_holder(),
        mat_clamp(),
    ]
    found = tuple(_checked(part, material) for part in parts)
    inertia = _inertia_about_hinge(found[0], material)
    at_tip = found[1].mass_kg + BOLT_KG
    return RigPrints(found, arm_length_m, inertia / arm_length_m**2 + at_tip)


def _checked(part: RigPart, material: PrintMaterial) -> CheckedPart:
    checks = check_print(part.mesh)
    if problems := checks.problems:
        raise FixtureError(f"{part.name}: {', '.join(problems)}: change arm_length_m")
    return CheckedPart(part, checks, printed_mass(part.mesh, material).mass)


def _inertia_about_hinge(arm_part: CheckedPart, material: PrintMaterial) -> float:
    """Moment of inertia of the printed arm about its hinge, the z axis [kg m^2]."""
    printed = printed_mass(arm_part.part.mesh, material)
    away = float(np.hypot(printed.com[0], printed.com[1]))
    return printed.mass * (float(printed.unit_inertia[2, 2]) + away**2)
