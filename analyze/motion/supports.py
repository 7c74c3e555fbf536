"""Support lines of a tip: the lines over which the object turns in succession, from rest to landing.

A box turns over one edge until its side lands at 90 deg. An object with a chamfered foot turns over the
foot's edge until the chamfer lies on the table, then over the chamfer's other edge; one on four feet, over
the feet's outer edges and then over the body's. Balance angle phi and rate k, in theta'' = -k sin(phi -
theta), belong to the line that carries at balance, so that a strike counts for that line only.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class SupportLine:
    """Line parallel to the pivot axis over which the object turns for a range of tipping angles theta.

    The line is the centre line of the rounding of the edge (or corner) that touches the table. Its place is
    given in the rest pose, from the centre line of the planned pivot. It carries until the next line of the
    sequence takes over.
    """

    along_m: float
    """place from the planned pivot's centre line, horizontally towards where the object tips, at rest [m]"""
    up_m: float
    """place from the planned pivot's centre line, vertically, at rest [m]"""
    takes_over_rad: float
    """tipping angle theta [rad] from which this line carries, as the face before it lies on the table; 0 for
    the first line, at which the resting face ends"""
    takes_over_sd_rad: float = 0.0
    """standard deviation of that angle [rad], from the errors of the shape"""
    radius_m: float = 0.0
    """radius of the rounding [m]"""
    is_curve: bool = False
    """True if a curved flank touches from here on, which rolls: the place is that of its centre of curvature
    at the take-over angle, and holds for that angle only"""
