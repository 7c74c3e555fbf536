"""State of the simulated world at one instant, and a completed contact: what the world reports.

Frames: W (world, z up, table at z = 0) and O (the object's shape file).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray


@dataclass(frozen=True)
class WorldState:
    """State at one instant: pose and velocity of the object, angle and angular velocity of the arm.

    Vectors are in W (world frame, z up); lengths in m, angles in rad, time in ns (host monotonic).
    """

    time_ns: int
    """world time (host monotonic) [ns]"""
    p_world_object: NDArray[np.float64]
    """(3,) position of the object's origin [m]"""
    q_world_object_wxyz: NDArray[np.float64]
    """(4,) unit quaternion (w, x, y, z) that rotates from O, the object's frame, to W"""
    linear_velocity: NDArray[np.float64]
    """(3,) velocity of O's origin in W [m/s]"""
    angular_velocity: NDArray[np.float64]
    """(3,) angular velocity in W [rad/s]"""
    arm_angle: float
    """angle of the arm [rad], 0 when it hangs, positive towards +x"""
    arm_velocity: float
    """angular velocity of the arm [rad/s]"""
    p_world_hinge: NDArray[np.float64]
    """(3,) position of the arm's hinge [m]"""
    at_rest: bool
    """True if the object is at rest"""


@dataclass(frozen=True)
class StrikerContact:
    """Completed contact of the striker's tip with the object, or completed push by a finger.

    It has time of first contact (host monotonic) [ns], magnitude of the impulse [N s], point (3,) of first
    contact in W, the world frame [m], and duration [s].
    """

    time_ns: int
    """world time of first contact (host monotonic) [ns]"""
    impulse_n_s: float
    """magnitude of the impulse on the object [N s]; for the tip, of the normal force alone"""
    p_world_contact: NDArray[np.float64]
    """(3,) point of first contact in W (world frame) [m]"""
    duration_s: float
    """time from first to last contact [s]; for a push, the requested duration"""
