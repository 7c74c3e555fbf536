"""Data types of the estimate from all strikes: centre of mass, inertia, masses of shell and interior.

SI units. Frame O is that of the object's shape file, "sd" one standard deviation, c the centre of mass.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from analyze.types import Array, EquiPlane


@dataclass(frozen=True)
class TableTilt:
    """Tilt [rad] of the vertical against the table's normal, for one levelling (set-up) of the table.

    It has two components, towards x and y of the world frame W, with covariance and prior sd.
    """

    lean: Array
    """(2,) tilt [rad] of the vertical towards W's x (the direction of tipping) and y; the table is higher on
    that side"""
    covariance: Array
    """(2, 2) covariance of `lean` [rad^2]"""
    prior_sd: Array
    """(2,) standard deviation of `lean` [rad] before any strike"""

    @property
    def sd(self) -> Array:
        """Standard deviation (2,) [rad] of the vertical's tilt towards x and y of the world frame W."""
        return np.sqrt(np.diag(self.covariance))


@dataclass(frozen=True)
class CentreOfMass:
    """Centre of mass c in the object frame O from all strikes used, with covariance.

    The residuals are its distances from the strikes' equi-planes (planes through a pivot line, in which that
    strike's own balance angle places c).
    """

    position: Array
    """(3,) c [m], in O"""
    covariance: Array
    """(3, 3) covariance of c [m^2]; unobserved directions carry the prior's variance"""
    observed: bool
    """True if the strikes determine all three coordinates"""
    unobserved_direction: Array | None
    """(3,) unit vector in O of the least certain direction; None if c is observed"""
    residuals: Array
    """(strikes,) signed distance of c from each of `planes` [m]"""
    weights: Array
    """(strikes,) share of each strike in the information about c, sum 1"""
    distances: Array
    """(strikes,) distance R of c from the centre line of each strike's pivot edge [m]"""
    distance_covariance: Array
    """(strikes, strikes) covariance of R [m^2]"""
    position_distance_covariance: Array
    """(3, strikes) covariance of c and R [m^2]"""
    robust: Array
    """(strikes,) robust weight: 1 for a strike within its sd, towards 0 for an outlier"""
    tilts: tuple[TableTilt, ...] = ()
    """tilt of each levelling of the table"""
    planes: tuple[EquiPlane, ...] = ()
    """equi-planes of the strikes, corrected for the estimated tilt of the table"""
    intervals: Array | None = None
    """(3, 2) 95 % intervals of c [m] where a direction of it is open; None where they are 1.96 sd"""


@dataclass(frozen=True)
class AxisInertia:
    """Moments of inertia [kg m^2] of the object about a pivot edge, and about its parallel through c.

    c is the centre of mass.
    """

    axis_id: str
    """id of the pivot axis"""
    direction: Array
    """(3,) unit vector of both axes, in the object frame O"""
    i_edge: float
    """moment of inertia about the line of contact with the table at balance [kg m^2]"""
    i_edge_sd: float
    """standard deviation of `i_edge` [kg m^2]"""
    i_com: float
    """moment of inertia about the parallel axis through the centre of mass c [kg m^2]"""
    i_com_sd: float
    """standard deviation of `i_com` [kg m^2]"""
    i_edge_interval: tuple[float, float] | None = None
    """95 % interval of `i_edge` [kg m^2]; None where it is 1.96 sd"""
    i_com_interval: tuple[float, float] | None = None
    """95 % interval of `i_com` [kg m^2]; None where it is 1.96 sd"""


@dataclass(frozen=True)
class InertialParameters:
    """Mass [kg], centre of mass c [m] and inertia tensor about c [kg m^2], in the object frame O, with sd."""

    mass: float
    """mass [kg]"""
    mass_sd: float
    """standard deviation of `mass` [kg]"""
    com: CentreOfMass
    """centre of mass"""
    inertia: Array
    """(3, 3) inertia tensor about the centre of mass, along the axes of the object frame O [kg m^2]"""
    inertia_sd: Array
    """(3, 3) standard deviations of the entries of `inertia` [kg m^2]"""
    measured: NDArray[np.bool_]
    """(3, 3) True if the strikes determine the entry of `inertia`: its interval is short, and the prior's far
    longer"""
    axes: tuple[AxisInertia, ...] = ()
    """moments of inertia about the pivot axes"""
    joint_covariance: Array = field(default_factory=lambda: np.zeros((0, 0)))
    """(4 + axes, 4 + axes) covariance of mass [kg], c (3) [m] and `i_com` of every axis [kg m^2]"""
    covariance: Array = field(default_factory=lambda: np.zeros((0, 0)))
    """(10, 10) covariance of mass [kg], c (3) [m] and Ixx, Iyy, Izz, Ixy, Ixz, Iyz [kg m^2]"""
    inertia_intervals: Array | None = None
    """(6, 2) 95 % intervals of Ixx, Iyy, Izz, Ixy, Ixz, Iyz [kg m^2]; None where they are 1.96 sd"""
    informed: NDArray[np.bool_] = field(default_factory=lambda: np.ones((3, 3), dtype=np.bool_))
    """(3, 3) True if the strikes informed the entry of `inertia`, measured or not; False if it is the
    prior's"""


@dataclass(frozen=True)
class ShellThickness:
    """Estimated thickness [m] of the object's shell (outer wall), with sd, interval and range tried.

    It is estimated from the moments of inertia if the object file states no thickness.
    """

    value: float
    """thickness [m]"""
    sd: float
    """standard deviation of the thickness [m]"""
    interval: tuple[float, float]
    """95 % interval of the thickness [m]"""
    swept: tuple[float, float]
    """least and greatest thickness that were tried [m]"""

    @property
    def observed(self) -> bool:
        """False if the measured moments leave the thickness open within the range that was tried."""
        return self.interval != self.swept


@dataclass(frozen=True)
class MassDistribution:
    """Masses of the shell (outer wall, region R1) and of the interior on either side of a dividing plane.

    Region R2 is the interior at points x (in the object frame O) where dividing_plane_normal . x >
    dividing_plane_offset; R3 is the rest of the interior. The body's own two parts may be divided by another
    plane that has the measured moments as well. Arrays have n entries, one per region.
    """

    names: tuple[str, ...]
    """names of the regions"""
    masses: Array
    """(n,) masses of the regions [kg]"""
    covariance: Array
    """(n, n) covariance of the masses [kg^2]"""
    intervals: Array
    """(n, 2) 95 % intervals [kg] if a plane or a ball divides the body, or `limits` if not `explained`"""
    limits: Array
    """(n, 2) bounds [kg] that hold for any filling of the interior of a uniform shell"""
    misfit: float
    """chi^2 of the measured moments of inertia for the best plane or ball that divides the interior"""
    explained: bool
    """True if `misfit` is within the errors of measurement"""
    dividing_plane_normal: Array
    """(3,) unit normal in O; the plane passes through the body's middle if `two_parts_explain` is False"""
    dividing_plane_offset: float
    """offset of the dividing plane from O's origin along its normal [m]"""
    dividing_plane_offset_interval: tuple[float, float]
    """95 % interval of `dividing_plane_offset` [m]"""
    baselines: dict[str, Array]
    """masses of the regions (n,) [kg] by naive assumptions (such as one density throughout), by the
    assumption's name"""
    shell: ShellThickness | None = None
    """shell thickness; None if the object file states it"""
    two_parts_explain: bool = True
    """True if two uniform parts on either side of a plane have the measured moments"""
    lump_explains: bool = False
    """True if two uniform parts inside and outside of a ball (a lump, a void) have the measured moments"""
