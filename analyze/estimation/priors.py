"""Priors stated before any strike: shared errors, centre of mass, table tilt, mass and gravity."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from analyze.types import Array


@dataclass(frozen=True)
class TiltPrior:
    """Prior of the vertical's lean from the table's normal towards x and y of the world frame W.

    It has a mean and an sd for each direction [rad].
    """

    lean: tuple[float, float]
    """Mean of the lean towards W's x and y [rad]."""
    sd: tuple[float, float]
    """1 sigma of the lean towards W's x and y [rad]."""


@dataclass(frozen=True)
class SystematicErrors:
    """Standard deviations of the strikes' errors beside those of the fits, most shared by several strikes.

    Repeats do not average out the shared ones: table tilt, shape scale, edge radius, and an angle per axis.
    Only the scatter of the balance angle (`strike_angle_sd`) is each strike's own. A levelling is a set-up of
    the table with one unknown lean of the vertical; levellings count from 0.
    """

    gravity_tilt_sd: float
    """1 sigma [rad] of the vertical's lean from the table's normal towards x and y of the world frame W;
    all strikes of levelling 0."""
    scale_sd: float = 0.0
    """Relative 1 sigma of the shape's scale; all strikes."""
    edge_radius_sd: float = 0.0
    """1 sigma [m] of the radius of edges without a prior of their own (`EquiPlane.radius_prior`): common to
    all of them, and a part of it (`OWN_RADIUS_FRACTION`) of each edge alone."""
    face_sd: float = 0.0
    """1 sigma [m] of the place of a face of the shape along its normal (a scan's error), each face its own;
    all strikes over edges of that face."""
    axis_angle_sd: float = 2e-4
    """1 sigma [rad] of the angle error common to the strikes on one axis (resting face, lens, slip of the
    edge)."""
    strike_angle_sd: float = 5e-4
    """1 sigma [rad] of the balance angle phi from strike to strike beyond the error of the fit (slip of the
    edge)."""
    other_tilt_sds: tuple[float, ...] = ()
    """`gravity_tilt_sd` [rad] of levellings 1, 2, ... (`EquiPlane.level`): each table has its own tilt."""
    readings: tuple[TiltPrior | None, ...] = ()
    """Leans read off a level for levellings 0, 1, ...; None or missing: a lean of 0 within the sd assumed for
    that levelling."""

    def tilts(self) -> list[TiltPrior]:
        """Prior of the vertical's lean for every levelling of the table, in the order of their numbers.

        The lean is from the table's normal towards x and y of the world frame W, with a mean and an sd for
        each of the two [rad]. A levelling is a set-up of the table with one lean. Where it was read off a
        level (the instrument), mean and sd are those of the reading; otherwise the mean is 0 and the sd the
        one assumed for the levelling.
        """
        plain = [TiltPrior((0.0, 0.0), (sd, sd)) for sd in (self.gravity_tilt_sd, *self.other_tilt_sds)]
        read = [*self.readings, *[None] * (len(plain) - len(self.readings))]
        return [prior if reading is None else reading for prior, reading in zip(plain, read, strict=True)]

    def with_tilt_factor(self, factor: float) -> SystematicErrors:
        """Copy with the sd of the vertical's lean multiplied by `factor`, for every levelling of the table.

        A levelling is a set-up of the table with one lean of the vertical from its normal. Leans that were
        read off a level (the instrument) are included.
        """
        return replace(
            self,
            gravity_tilt_sd=factor * self.gravity_tilt_sd,
            other_tilt_sds=tuple(factor * sd for sd in self.other_tilt_sds),
            readings=tuple(
                None if each is None else TiltPrior(each.lean, (factor * each.sd[0], factor * each.sd[1]))
                for each in self.readings
            ),
        )


@dataclass(frozen=True)
class ComPrior:
    """Prior of the centre of mass before any strike: mean and sd [m] along the axes of the object frame O.

    It follows from the shape's bounding box.
    """

    mean: Array
    """(3,) mean [m], in the object frame O."""
    sd: Array
    """(3,) 1 sigma [m] along O's axes."""

    @staticmethod
    def from_bounds(lower: Array, upper: Array) -> ComPrior:
        """Prior of the centre of mass: the centre of the bounding box, with half its edges as sd.

        It is weak enough to have no effect on directions that strikes determine. Both are (3,) [m], in O.

        Args:
            lower: (3,) lower corner of the box [m], in the object frame O.
            upper: (3,) upper corner of the box [m], in O.
        """
        return ComPrior((np.asarray(lower) + upper) / 2, (np.asarray(upper) - lower) / 2)


@dataclass(frozen=True)
class Scale:
    """Mass and gravity with their standard deviations, and the sd of the error of k that strikes share.

    k = m g R / I_edge [rad/s^2] is the rate constant fitted to each strike's motion, with m g the weight, R
    the distance of the centre of mass from the edge and I_edge the moment of inertia about it. Strikes on one
    axis share an error of k.
    """

    mass: float
    """Mass of the body that tips [kg]."""
    mass_sd: float
    """1 sigma of the mass [kg]."""
    gravity: float
    """Gravity [m/s^2]."""
    gravity_sd: float
    """1 sigma of gravity [m/s^2]."""
    k_relative_sd: float = 2e-3
    """Relative 1 sigma of the error of k that the strikes on one axis share: air, play of the edge."""
