"""Options of `acquire strike`, and which of them go together."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import click


@dataclass(frozen=True)
class StrikeOptions:
    """Options of `acquire strike` that select a single strike or the calibration of the striker."""

    speed: float | None
    """tip speed [m/s]; None if not given"""
    plan: Path | None
    """plan file; None if not given"""
    strike_id: str | None
    """id of the strike in the plan; None if not given"""
    energy: float | None
    """energy ratio of the planned strike: kinetic energy after it over that needed to reach balance; None if
    not given"""
    calibrate: bool
    """True to calibrate the bare striker in place of one strike"""
    bodies: tuple[float, ...]
    """masses of the bodies to strike [kg]; infinite for a wall"""
    speeds: str | None
    """tip speeds [m/s] of a calibration, comma-separated; None if not given"""
    repeats: int
    """number of swings of a calibration at each speed and target"""
    write: bool
    """True to write a calibration's estimates into the rig file"""

    def refuse_contradictions(self, rig: Path | None) -> None:
        """Refuse options that contradict each other or lack one another.

        Args:
            rig: rig file of the option --rig; None if not given.

        Raises:
            click.UsageError: the options cannot be used together.
        """
        if self.calibrate:
            if rig is None or self.speed is not None or self.plan is not None:
                raise click.UsageError("--calibrate needs --rig; give --speeds instead of --speed or --plan")
            return
        one_source = (self.speed is None) != (self.plan is None) and (self.plan is None) == (
            self.strike_id is None
        )
        if self.bodies or self.speeds or self.write or not one_source:
            raise click.UsageError(
                "give either --speed, or --plan with --strike; "
                "--body-mass-kg, --speeds and --write belong to --calibrate"
            )
        if self.energy is not None and self.plan is None:
            raise click.UsageError(
                "--energy needs --plan and --strike: without an object a speed has no energy ratio"
            )
