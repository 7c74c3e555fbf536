"""Result of the registration's least-squares problem: marker poses and tables.

Registration estimates where an object's markers are glued on.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping

    from analyze.types import Array


@dataclass(frozen=True)
class Solution:
    """Best fit of the poses of all markers on the object and of the table, with covariances.

    O is the object frame, M a marker's, W the world frame (z up). The error of a marker's pose is a small
    rotation about its centre, as a rotation vector in O [rad], then a shift of the centre in O [m].
    """

    T_object_marker: Mapping[int | str, Array]
    """(4, 4) pose of M in O per marker"""
    covariance: Mapping[int | str, Array]
    """(6, 6) per marker, of its turn in O [rad] and its centre in O [m]"""
    table: Mapping[int, Array]
    """per recording (3,) pose of the table: tilts about W's x and y [rad], and the height [m]"""
    table_covariance: Mapping[int, Array]
    """per recording (3, 3) covariance of that pose [rad, m]"""
    pulls: Mapping[int | str, float]
    """per marker held to the surface: its height over it less its card's thickness, in sd of that"""
    misfit: Mapping[str, float]
    """per strike: chi^2 per degree of freedom"""
    rms_px: Mapping[int | str, float]
    """per marker: rms residual of its corners [px]"""
    converged: bool
    """False if the iteration still moved after its last step, along a direction that is hardly determined"""
