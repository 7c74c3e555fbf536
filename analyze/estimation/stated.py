"""What is stated before any strike: errors that strikes share, and where c and the table's tilt are expected."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from analyze.types import Array


@dataclass(frozen=True)
class TiltPrior:
    """How far the vertical leans from the table's normal, towards W's x and y, before any strike [rad]; 1 sigma each."""

    lean: tuple[float, float]
    sd: tuple[float, float]


@dataclass(frozen=True)
class SystematicErrors:
    """Errors that several strikes share, 1 sigma each. What repeats cannot average out."""

    gravity_tilt_sd: float
    """rad, of the vertical's lean from the table's normal towards W's x and y; all strikes on one levelling"""
    scale_sd: float = 0.0
    """relative, of the shape; all strikes"""
    edge_radius_sd: float = 0.0
    """m, of the edges' rounding: what all edges have in common, and a part of it (EDGE_TO_EDGE) of each by itself"""
    axis_angle_sd: float = 2e-4
    """rad, angle error common to the strikes on one axis (resting face, lens, slip of the edge)"""
    strike_angle_sd: float = 5e-4
    """rad, scatter of phi from strike to strike beyond what the fit of one motion can know (slip of the edge)"""
    other_tilt_sds: tuple[float, ...] = ()
    """rad, the same as `gravity_tilt_sd` of levellings 1, 2, ... (EquiPlane.level): each table has a tilt of its own"""
    readings: tuple[TiltPrior | None, ...] = ()
    """of levellings 0, 1, ...: what a level showed; None, or none: 0 within the sd above"""

    def tilts(self) -> list[TiltPrior]:
        """Of every levelling."""
        plain = [TiltPrior((0.0, 0.0), (sd, sd)) for sd in (self.gravity_tilt_sd, *self.other_tilt_sds)]
        read = [*self.readings, *[None] * (len(plain) - len(self.readings))]
        return [prior if reading is None else reading for prior, reading in zip(plain, read, strict=True)]


@dataclass(frozen=True)
class ComPrior:
    """Where c lies before any strike: inside the shape."""

    mean: Array
    """(3,) m"""
    sd: Array
    """(3,) m"""

    @staticmethod
    def from_bounds(lower: Array, upper: Array) -> ComPrior:
        """Centre of the bounding box, half its edges as 1 sigma: weak enough not to be felt by what is measured."""
        return ComPrior((np.asarray(lower) + upper) / 2, (np.asarray(upper) - lower) / 2)


@dataclass(frozen=True)
class Scale:
    """Mass and gravity, and what k cannot know; 1 sigma each."""

    mass: float
    mass_sd: float
    gravity: float
    gravity_sd: float
    k_relative_sd: float = 2e-3
    """error of k that the strikes on one axis share: air, play of the edge"""
