"""Virtual station: dimensions of the arm, gravity, friction, the camera's true calibration and pose."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

ARM_LENGTH_M = 0.12
"""distance from the hinge to the tip sphere's centre [m]"""
TIP_RADIUS_M = 0.008
ARM_INERTIA_KG_M2 = 0.0025
"""moment of inertia about the hinge [kg m^2]: 0.12 m arm, 8 mm tip and the reflected rotor of a geared
servo"""
G_M_S2 = 9.81
TABLE_FRICTION = (0.60, 0.80)
"""range of the coefficient of friction between objects and the strip of fine sandpaper under the pivot
line"""
DRAG_COEFFICIENT = (1.0, 1.2)
"""range of the coefficient of the air's pressure on the faces of an object in flight"""
WIDTH_PX, HEIGHT_PX = 656, 492
FOCAL_PX = 1430.0
DISTANCE_M = 0.55
"""usual distance of the camera from the pivot line [m]"""


@dataclass(frozen=True)
class Station:
    """Camera of one virtual rig: true camera matrix [px], distortion, and pose in W, the world frame [m]."""

    K: NDArray[np.float64]
    """(3, 3) camera matrix [px]"""
    distortion: NDArray[np.float64]
    """(5,) k1, k2, p1, p2, k3 (OpenCV)"""
    T_world_camera: NDArray[np.float64]
    """(4, 4) pose of the camera (x right, y down, z forward) in W, the world frame [m]"""


def station(seed: int, distance_m: float = DISTANCE_M) -> Station:
    """True camera calibration and pose of the virtual rig with a seed: nearly the nominal ones.

    The nominal camera is at (0.03, -0.55, 0.08) m in W, the world frame (z up; objects tip about the y axis,
    the pivot line, towards +x), and looks along +y; in the plane y = 0 it has 2.6 px/mm. The seed shifts it
    by up to 2 mm and turns it by up to 0.3 degrees, per axis, and changes principal point (up to 4 px) and
    distortion. At another distance the nominal position is scaled, so that the field of view grows with it.

    Args:
        seed: seed of the camera's calibration and pose.
        distance_m: nominal distance of the camera from the pivot line [m].
    """
    rng = np.random.default_rng((seed, 0x57A7))
    K = np.array([[FOCAL_PX, 0.0, 327.5], [0.0, FOCAL_PX, 245.5], [0.0, 0.0, 1.0]])
    K[:2, 2] += rng.uniform(-4.0, 4.0, 2)
    distortion = np.array([-0.12, 0.10, 0.0, 0.0, 0.0]) + np.array(
        [0.02, 0.03, 3e-4, 3e-4, 0.0]
    ) * rng.uniform(-1, 1, 5)
    R_nominal = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
    T_world_camera = np.eye(4)
    turn = Rotation.from_rotvec(np.radians(0.3) * rng.uniform(-1, 1, 3)).as_matrix()
    T_world_camera[:3, :3] = R_nominal @ turn
    nominal = np.array([0.03, -DISTANCE_M, 0.08]) * (distance_m / DISTANCE_M)
    T_world_camera[:3, 3] = nominal + 0.002 * rng.uniform(-1, 1, 3)
    return Station(K, distortion, T_world_camera)


def calibration_sheet(
    seed: int, distance_m: float = DISTANCE_M, arm_inertia_kg_m2: float = ARM_INERTIA_KG_M2
) -> dict[str, Any]:
    """True values of the virtual rig with a seed, for its rig file, as a nested dictionary.

    Keys: camera (width and height [px], K (camera matrix) [px], distortion, T_world_camera (pose) [m]),
    striker (arm_length_m, effective_mass_kg), g_m_s2, and table_friction (the least possible coefficient of
    friction).

    Args:
        seed: seed of the camera's calibration and pose.
        distance_m: nominal distance of the camera from the line about which objects tip [m].
        arm_inertia_kg_m2: moment of inertia of the striker's arm about its hinge [kg m2].
    """
    rig = station(seed, distance_m)
    return {
        "camera": {
            "width": WIDTH_PX,
            "height": HEIGHT_PX,
            "K": rig.K.tolist(),
            "distortion": rig.distortion.tolist(),
            "T_world_camera": rig.T_world_camera.tolist(),
        },
        "striker": {"arm_length_m": ARM_LENGTH_M, "effective_mass_kg": arm_inertia_kg_m2 / ARM_LENGTH_M**2},
        "g_m_s2": G_M_S2,
        "table_friction": TABLE_FRICTION[0],
    }
