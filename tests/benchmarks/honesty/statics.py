"""True balance of a body that stands on its contact spheres: angle, rate constant and line of contact.

Nothing of the estimators is used: the body is turned in small steps, and the sphere that carries it is the
lowest one. Frames: O (object), W (world, z along the table's normal, the body tips towards +x).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tests.benchmarks.honesty.bodies import Specimen

G = 9.80665
STEP = math.radians(0.02)
MAX_ANGLE = math.radians(88)


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


def true_tip(specimen: Specimen, R_world_object: np.ndarray, tilt: np.ndarray) -> TrueTip | None:
    """True balance of a specimen that tips towards W's +x; None if it falls at once or never balances.

    Args:
        specimen: the body with its masses.
        R_world_object: (3, 3) true rest pose.
        tilt: (2,) tilt of the table towards x and y [rad].
    """
    body = specimen.body
    centres, com = body.centres @ R_world_object[[0, 2]].T, R_world_object[[0, 2]] @ specimen.com
    down = gravity_direction(tilt)
    lean = down[0] / down[2]
    theta = np.arange(STEP, MAX_ANGLE, STEP)
    cos, sin = np.cos(theta)[:, None], np.sin(theta)[:, None]
    height = -centres[:, 0] * sin + centres[:, 1] * cos - body.radii
    lowest = np.argmin(height, axis=1)
    contact_x = (centres[lowest, 0] * cos[:, 0]) + centres[lowest, 1] * sin[:, 0]
    com_x, com_z = com[0] * cos[:, 0] + com[1] * sin[:, 0], -com[0] * sin[:, 0] + com[1] * cos[:, 0]
    level = com_z - height.min(axis=1)
    ahead = com_x - contact_x - level * lean
    over = np.flatnonzero(ahead >= 0)
    if not len(over) or over[0] == 0:
        return None
    at = int(over[0])
    share = -ahead[at - 1] / (ahead[at] - ahead[at - 1])
    phi = float(theta[at - 1] + STEP * share)
    line, radius = body.centres[lowest[at]], float(body.radii[lowest[at]])
    direction = R_world_object[1]
    i_com = float(direction @ specimen.inertia @ direction)
    arm = com - centres[lowest[at]]
    R = float(np.hypot(*arm))
    mass = float(specimen.masses.sum())
    i_edge = i_com + mass * (R + radius) ** 2
    rise = float(level[at] - level[0] + lean * (com_x[at] - com_x[0]))
    return TrueTip(phi, mass * G * R / i_edge, i_edge, i_com, line, direction, radius, rise)
