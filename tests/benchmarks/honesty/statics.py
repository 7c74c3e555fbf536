"""True balance of a body that stands on its contact spheres: angle, rate constant and line of contact.

Nothing of the estimators is used: the body is turned in small steps, and carried by the lowest sphere on
either side of c. These are the ends of an edge; if their radii differ, the body rolls aside by some tenths of
a degree to stand on both. Frames: O (object), W (world, z along the table's normal, the body tips towards
+x).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tests.benchmarks.honesty.bodies import Specimen

G = 9.80665
STEP = math.radians(0.02)
MAX_ANGLE = math.radians(88)
MAX_SIDE_ROLL = math.radians(1)
"""roll that a body takes at once, to stand on both ends of an edge; round bodies roll on along their rim"""
HEADINGS = 24
"""directions towards which a body at rest must not fall"""


@dataclass(frozen=True)
class TrueTip:
    """True values of a tip over the line that carries the body at balance."""

    phi: float
    """balance angle since rest on the true face [rad]"""
    k: float
    """m g R / I_edge [rad/s^2]"""
    i_edge: float
    """moment about the line of contact at balance [kg m^2]"""
    i_com: float
    """moment about its parallel through c [kg m^2]"""
    line: np.ndarray
    """(3,) point on the centre line of the rounding, in O [m]"""
    direction: np.ndarray
    """(3,) unit direction of the line, in O"""
    radius: float
    """radius of the rounding [m]"""
    rise: float
    """height [m] by which c rises from rest to balance"""


def gravity_direction(tilt: tuple[float, float] | np.ndarray) -> np.ndarray:
    """Unit gravity (3,) in W on a table that is higher by `tilt` (2,) [rad] towards x and y."""
    down = np.array([-math.tan(tilt[0]), -math.tan(tilt[1]), -1.0])
    return down / np.linalg.norm(down)


def stands(specimen: Specimen, R_world_object: np.ndarray, tilt: np.ndarray) -> bool:
    """True if a specimen at rest falls to no side: c is over the spheres that carry it, on the tilted table.

    Args:
        specimen: the body with its masses.
        R_world_object: (3, 3) true rest pose.
        tilt: (2,) tilt of the table towards x and y [rad].
    """
    centres, com = specimen.body.centres @ R_world_object.T, R_world_object @ specimen.com
    heading = 2 * np.pi * np.arange(HEADINGS) / HEADINGS
    towards = np.stack([np.cos(heading), np.sin(heading)])
    height = centres[:, 2:] - specimen.body.radii[:, None]
    carrier = np.argmin(height - STEP * (centres[:, :2] @ towards), axis=0)
    down = gravity_direction(tilt)
    foot = com[:2] - (com[2] - height.min()) * down[:2] / down[2]
    ahead = foot @ towards - np.sum(centres[carrier, :2] * towards.T, axis=1)
    return bool(np.all(ahead < 0))


@dataclass(frozen=True)
class _Carriers:
    """Spheres that carry a body while it tips, per angle (t,): one on either side of c."""

    first: np.ndarray
    second: np.ndarray
    share: np.ndarray
    """share of the second one in the line that carries c"""

    def at(self, values: np.ndarray) -> np.ndarray:
        """Values (t,) under c, on the line between the two, from those of all spheres (t, n) or (n,)."""
        table = np.broadcast_to(values, (len(self.share), values.shape[-1]))
        rows = np.arange(len(table))
        return (1 - self.share) * table[rows, self.first] + self.share * table[rows, self.second]


def _carriers(across: np.ndarray, com_across: float, height: np.ndarray) -> _Carriers:
    """Carriers by the places (n,) [m] of the spheres along the edge, that of c, and their heights (t, n)."""
    lowest = np.argmin(height, axis=1)
    alone = _Carriers(lowest, lowest, np.zeros(len(lowest)))
    before, beyond = np.flatnonzero(across <= com_across), np.flatnonzero(across > com_across)
    if not len(before) or not len(beyond):
        return alone
    first = before[np.argmin(height[:, before], axis=1)]
    second = beyond[np.argmin(height[:, beyond], axis=1)]
    apart, rows = across[second] - across[first], np.arange(len(height))
    if np.abs((height[rows, second] - height[rows, first]) / apart).max() > MAX_SIDE_ROLL:
        return alone
    return _Carriers(first, second, (com_across - across[first]) / apart)


def true_tip(specimen: Specimen, R_world_object: np.ndarray, tilt: np.ndarray) -> TrueTip | None:
    """True balance of a specimen that tips towards W's +x; None if it does not stand or never balances.

    Args:
        specimen: the body with its masses.
        R_world_object: (3, 3) true rest pose.
        tilt: (2,) tilt of the table towards x and y [rad].
    """
    if not stands(specimen, R_world_object, tilt):
        return None
    body = specimen.body
    centres, com = body.centres @ R_world_object.T, R_world_object @ specimen.com
    down = gravity_direction(tilt)
    lean = down[0] / down[2]
    theta = np.arange(STEP, MAX_ANGLE, STEP)
    cos, sin = np.cos(theta)[:, None], np.sin(theta)[:, None]
    height = -centres[:, 0] * sin + centres[:, 2] * cos - body.radii
    carriers = _carriers(centres[:, 1], com[1], height)
    contact_x = carriers.at(centres[:, 0]) * cos[:, 0] + carriers.at(centres[:, 2]) * sin[:, 0]
    com_x, com_z = com[0] * cos[:, 0] + com[2] * sin[:, 0], -com[0] * sin[:, 0] + com[2] * cos[:, 0]
    level = com_z - carriers.at(height)
    ahead = com_x - contact_x - level * lean
    over = np.flatnonzero(ahead >= 0)
    if not len(over) or over[0] == 0:
        return None
    at = int(over[0])
    share = -ahead[at - 1] / (ahead[at] - ahead[at - 1])
    phi = float(theta[at - 1] + STEP * share)
    line = np.array([carriers.at(axis)[at] for axis in body.centres.T])
    radius, direction = float(carriers.at(body.radii)[at]), R_world_object[1]
    ends = body.centres[[carriers.first[at], carriers.second[at]]]
    if np.any(ends[0] != ends[1]):
        direction = (ends[1] - ends[0]) / np.linalg.norm(ends[1] - ends[0])
    i_com = float(direction @ specimen.inertia @ direction)
    arm = specimen.com - line
    R = float(np.linalg.norm(arm - direction * (arm @ direction)))
    mass = float(specimen.masses.sum())
    i_edge = i_com + mass * (R + radius) ** 2
    rise = float(level[at] - level[0] + lean * (com_x[at] - com_x[0]))
    return TrueTip(phi, mass * G * R / i_edge, i_edge, i_com, line, direction, radius, rise)
