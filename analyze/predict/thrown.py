"""A body thrown in MuJoCo, from its exported file: free flight from a measured attitude, spin and velocity.

The air is MuJoCo's own, by its options `density` and `viscosity`: drag on the box of equal inertia, which
slows c and brakes the spin. MuJoCo is asked here, in `scene.py` and to read exported files back, never by an
estimator (tests/test_architecture.py).
"""

# mujoco takes its names from a compiled module that pyright cannot analyse.
# pyright: reportAttributeAccessIssue=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false, reportUnknownMemberType=false

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING
from xml.etree import ElementTree as ET

import numpy as np
from scipy.spatial.transform import Rotation

from analyze.export.mesh import mesh_file
from analyze.export.mjcf import mjcf_text
from analyze.geometry.rotations import matrix_from_vector
from analyze.result.urdf_inertial import numbers

if TYPE_CHECKING:
    from analyze.export.body import ExportBody
    from analyze.types import Array

STEP_S = 1e-3
"""time step [s], of Runge-Kutta's fourth order: 0.02 rad of turn at 3 turns/s"""


@dataclass(frozen=True)
class Air:
    """Air of the simulation, as MuJoCo's options give it."""

    density: float
    """density [kg/m^3]; 0 for none"""
    viscosity: float
    """dynamic viscosity [Pa s]"""


ROOM_AIR = Air(1.204, 1.82e-5)
"""dry air at 20 degrees C and 1 atm"""
NO_AIR = Air(0.0, 0.0)
"""vacuum"""


@dataclass(frozen=True)
class Throw:
    """State of a body in free flight at time 0, and what acts on it from then on."""

    R_world_object: Array
    """(3, 3) rotation from O to W"""
    spin: Array
    """(3,) angular velocity in O [rad/s]"""
    place: Array
    """(3,) place of c in W [m]"""
    velocity: Array
    """(3,) its velocity in W [m/s]"""
    gravity: Array
    """(3,) gravity in W [m/s^2]"""
    air: Air = ROOM_AIR
    """air that slows it"""


def thrown_attitudes(body: ExportBody, throw: Throw, time: Array) -> Array:
    """Attitudes (n, 3, 3), from O to W, of a body thrown in MuJoCo.

    Args:
        body: body as it is exported.
        throw: state at time 0.
        time: (n,) times [s], ascending, none below 0.
    """
    import mujoco

    text, assets = flight_text(body, throw)
    simulation = mujoco.MjModel.from_xml_string(text, assets)
    data = mujoco.MjData(simulation)
    R, com = throw.R_world_object, body.inertial.com
    data.qpos[:3] = throw.place - R @ com
    data.qpos[3:7] = Rotation.from_matrix(R).as_quat(scalar_first=True)
    data.qvel[:3] = throw.velocity - R @ np.cross(throw.spin, com)
    data.qvel[3:6] = throw.spin
    found = np.empty((len(time), 3, 3))
    for i, now in enumerate(time):
        while data.time < now - STEP_S / 2:
            mujoco.mj_step(simulation, data)
        reached = Rotation.from_quat(data.qpos[3:7], scalar_first=True).as_matrix()
        found[i] = reached @ matrix_from_vector(np.array(data.qvel[3:6]) * (now - data.time))
    return found


def flight_text(body: ExportBody, throw: Throw) -> tuple[str, dict[str, bytes]]:
    """MJCF text of a body in free flight, and the files that it names.

    Args:
        body: body as it is exported.
        throw: its flight, of which gravity and air are used.
    """
    mesh = mesh_file(body)
    root = ET.fromstring(mjcf_text(body, mesh))  # noqa: S314 - our own text
    ET.SubElement(
        root, "option", timestep=str(STEP_S), integrator="RK4", gravity=numbers(throw.gravity),
        density=numbers([throw.air.density]), viscosity=numbers([throw.air.viscosity]),
    )  # fmt: skip
    return ET.tostring(root, encoding="unicode"), {} if mesh is None else {mesh.name: mesh.data}
