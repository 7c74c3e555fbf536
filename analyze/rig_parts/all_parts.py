"""All printable parts of a rig, checked, and the mass that the arm brings to its tip."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from analyze.errors import FixtureError
from analyze.fixture.checks import PrintChecks, check_print
from analyze.fixture.print_mass import PrintMaterial, printed_mass
from analyze.rig_parts.arm_part import BACK, PIN_STEP, arm
from analyze.rig_parts.ballast import Ballast, ballast_of
from analyze.rig_parts.bought import SERVOS
from analyze.rig_parts.hinge_parts import (
    LONG_SPACER,
    SHORT_SPACER,
    axle_plate,
    bearing_hub,
    horn_adapter,
    spacer,
)
from analyze.rig_parts.mat_clamp import mat_clamp
from analyze.rig_parts.solids import RigPart
from analyze.rig_parts.stand_parts import camera_holder, lamp_holder, servo_holder, solenoid_holder

G_M_S2 = 9.81
"""Gravity [m/s^2] for the speeds of a pendulum."""


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
    arm_inertia_kg_m2: float
    """Moment of inertia of the printed arm about the hinge [kg m^2]."""
    arm_moment_kg_m: tuple[float, float]
    """Printed arm's mass times its centre's distances below and behind the hinge [kg m]."""

    @property
    def arm_effective_kg(self) -> float:
        """Effective mass at the tip of the printed arm [kg]: moment of inertia about the hinge / length^2."""
        return self.arm_inertia_kg_m2 / self.arm_length_m**2

    def ballast(self, effective_mass_kg: float) -> Ballast:
        """Washers and bolt at the tip that come nearest to an effective mass there.

        Args:
            effective_mass_kg: wanted effective mass [kg], less that of the servo's rotor.
        """
        share = self._ballast_radius_m**2 / self.arm_length_m**2
        return ballast_of(max(0.0, effective_mass_kg - self.arm_effective_kg) / share)

    def effective_kg(self, ballast: Ballast) -> float:
        """Effective mass at the tip of the arm with its ballast [kg]."""
        share = self._ballast_radius_m**2 / self.arm_length_m**2
        return self.arm_effective_kg + ballast.mass_kg * share

    def pendulum_speed(self, ballast: Ballast, angle_rad: float) -> float:
        """Tip speed [m/s] at contact of a pendulum that is let go at an angle before contact.

        Energy of a rigid pendulum: I w^2 / 2 = m g (fall of the centre of mass), v = w L. The centre of mass
        lies behind the line from the hinge to the pad, so that it goes on falling beyond contact.

        Args:
            ballast: washers and bolt at its tip.
            angle_rad: angle by which it is drawn back from where the pad touches [rad].
        """
        below = self.arm_moment_kg_m[0] + ballast.mass_kg * self.arm_length_m
        behind = self.arm_moment_kg_m[1] + ballast.mass_kg * BACK / 1000
        # Height of the centre of mass at the angle a: -(below cos a) + behind sin a, a > 0 drawn back.
        fall = below * (1 - math.cos(angle_rad)) + behind * math.sin(angle_rad)
        inertia = self.effective_kg(ballast) * self.arm_length_m**2
        return self.arm_length_m * math.sqrt(max(0.0, 2 * G_M_S2 * fall / inertia))

    def pin_speeds(self, ballast: Ballast) -> dict[int, float]:
        """Tip speeds [m/s] by the angles [deg] at which the pin holds a pendulum back."""
        angles = [round(PIN_STEP / 2 * step) for step in range(1, 7)]
        return {angle: self.pendulum_speed(ballast, math.radians(angle)) for angle in angles}

    @property
    def _ballast_radius_m(self) -> float:
        return math.hypot(self.arm_length_m, BACK / 1000)


def rig_prints(arm_length_m: float, material: PrintMaterial | None = None) -> RigPrints:
    """All printable parts for a rig with this arm length [m], each checked as the print of a fixture is.

    Args:
        arm_length_m: distance from the hinge's axis to the tip [m].
        material: filament and settings; None for PLA with 30 % infill.

    Raises:
        FixtureError: the arm cannot be printed in one piece, or a part fails a check.
    """
    material = material or PrintMaterial(infill=0.3)
    parts = [
        arm(1000 * arm_length_m),
        *(make(servo) for servo in SERVOS for make in (horn_adapter, servo_holder)),
        bearing_hub(),
        spacer(SHORT_SPACER, "spacer-short", 2),
        spacer(LONG_SPACER, "spacer-long", 1),
        axle_plate(),
        solenoid_holder(),
        camera_holder(),
        lamp_holder(),
        mat_clamp(),
    ]
    found = tuple(_checked(part, material) for part in parts)
    printed = printed_mass(found[0].part.mesh, material)
    below, forward = printed.mass * printed.com[:2]
    away = float(np.hypot(printed.com[0], printed.com[1]))
    inertia = printed.mass * (float(printed.unit_inertia[2, 2]) + away**2)
    return RigPrints(found, arm_length_m, inertia, (float(below), float(-forward)))


def _checked(part: RigPart, material: PrintMaterial) -> CheckedPart:
    checks = check_print(part.mesh)
    if problems := checks.problems:
        raise FixtureError(f"{part.name}: {', '.join(problems)}: change arm_length_m")
    return CheckedPart(part, checks, printed_mass(part.mesh, material).mass)
