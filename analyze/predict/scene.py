"""A body on its table in MuJoCo, from its exported file: a tip simulated from a state just after the impact.

The file's inertia is used as it is. Its collision shape has sharp edges, while the true body rolls on
rounded ones: the table therefore meets spheres of the edges' radius, inside the corners of the body's hull.
MuJoCo is asked here and to read exported files back, never by an estimator (tests/test_architecture.py).
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

from analyze.export.contact import MjcfContact
from analyze.export.mesh import mesh_file
from analyze.export.mjcf import mjcf_text
from analyze.result.urdf_inertial import numbers

if TYPE_CHECKING:
    from analyze.export.body import ExportBody
    from analyze.geometry.object_model import ObjectModel
    from analyze.types import Array
    from schemas.strike_plan import PlannedStrike

STEP_S = 2e-4
"""time step [s]"""
_NEAR_M = 4e-3
"""height [m] over the lowest point up to which a corner may touch during a tip"""
_LEAST_RADIUS_M = 1e-4
"""least radius [m] of a corner that touches the table"""
_SAME_POINT_M = 1e-5
"""distance [m] up to which two corners are one"""
_TURNS = np.radians(np.arange(-5.0, 135.0, 2.0))
"""tipping angles at which corners near the table are sought"""
_ROLLS = np.radians([-6.0, 0.0, 6.0])
"""turns about the direction of tipping at which they are sought"""


@dataclass(frozen=True)
class Start:
    """State just after the impact, in the plane across the pivot edge."""

    theta: float
    """tipping angle [rad]"""
    omega: float
    """angular speed [rad/s]"""


@dataclass(frozen=True)
class Surroundings:
    """Table and gravity of a strike."""

    gravity: float
    """magnitude of gravity [m/s^2]"""
    lean: tuple[float, float]
    """lean of the vertical against the table's normal, in the direction of tipping and to its left [rad]"""
    contact: MjcfContact
    """friction and restitution of the pair"""


def simulated_angle(
    body: ExportBody,
    model: ObjectModel,
    planned: PlannedStrike,
    start: Start,
    around: Surroundings,
    time: Array,
) -> Array:
    """Tipping angle (n,) [rad] of a body that tips about a planned edge.

    Args:
        body: body as it is exported.
        model: exterior of the body that tips, for its corners.
        planned: rest pose and edge.
        start: state at the first time; the edge rests on the table and rolls.
        around: table and gravity.
        time: (n,) times [s], ascending, the first being that of the start.
    """
    import mujoco

    text, assets = scene_text(body, model, planned, around)
    simulation = mujoco.MjModel.from_xml_string(text, assets)
    data = mujoco.MjData(simulation)
    R_rest = np.array(planned.R_world_object)
    turn = Rotation.from_euler("y", start.theta).as_matrix() @ R_rest
    radius = planned.pivot.radius_m
    edge = np.array([0.0, 0.0, radius])
    origin = edge - turn @ np.array(planned.pivot.point)
    spin = np.array([0.0, start.omega, 0.0])
    data.qpos[:3] = origin
    data.qpos[3:7] = Rotation.from_matrix(turn).as_quat(scalar_first=True)
    data.qvel[:3] = np.array([radius * start.omega, 0.0, 0.0]) + np.cross(spin, origin - edge)
    data.qvel[3:6] = turn.T @ spin
    found = np.empty(len(time))
    for i, now in enumerate(time):
        while data.time < now - time[0] - STEP_S / 2:
            mujoco.mj_step(simulation, data)
        w, x, y, z = data.qpos[3:7]
        turned = Rotation.from_quat([x, y, z, w]).as_matrix() @ R_rest.T
        found[i] = np.arctan2(turned[0, 2], turned[2, 2])
    return np.asarray(np.unwrap(found), dtype=np.float64)


def scene_text(
    body: ExportBody, model: ObjectModel, planned: PlannedStrike, around: Surroundings
) -> tuple[str, dict[str, bytes]]:
    """MJCF text of a body on its table, and the files that it names.

    Args:
        body: body as it is exported.
        model: exterior of the body that tips.
        planned: rest pose and edge.
        around: table and gravity.
    """
    mesh = mesh_file(body)
    root = ET.fromstring(mjcf_text(body, mesh))  # noqa: S314 - our own text
    up = np.array([np.tan(around.lean[0]), np.tan(around.lean[1]), 1.0])
    down = -around.gravity * up / np.linalg.norm(up)
    ET.SubElement(
        root, "option", timestep=str(STEP_S), integrator="implicitfast", cone="elliptic", impratio="100",
        gravity=numbers(down),
    )  # fmt: skip
    contact = around.contact.attributes()
    world = root.find("worldbody")
    own = None if world is None else world.find("body")
    if world is None or own is None:
        raise ValueError("the exported MJCF text holds no body")
    for geom in own.findall("geom"):
        geom.set("contype", "0")
        geom.set("conaffinity", "0")
    own_part = {"mass": "0", "contype": "0", "conaffinity": "1", "group": "3", **contact}
    size = numbers([max(planned.pivot.radius_m, _LEAST_RADIUS_M)])
    for place in touching_centres(model, planned):
        ET.SubElement(own, "geom", {"type": "sphere", "size": size, "pos": numbers(place), **own_part})
    table = {"name": "table", "type": "plane", "size": "2 2 0.1", "contype": "1", "conaffinity": "0"}
    ET.SubElement(world, "geom", {**table, **contact})
    return ET.tostring(root, encoding="unicode"), {} if mesh is None else {mesh.name: mesh.data}


def touching_centres(model: ObjectModel, planned: PlannedStrike) -> Array:
    """Centres (s, 3) [m] of the corners' roundings that may touch the table in a tip, in O.

    A corner's centre lies the radius inside all faces of the hull that meet there. Only corners that come
    near the table count.

    Args:
        model: exterior of the body.
        planned: rest pose and edge, with the radius.
    """
    normals, offsets = model.hull_planes[:, :3], model.hull_planes[:, 3]
    corners = np.unique(np.round(model.hull_vertices / _SAME_POINT_M), axis=0) * _SAME_POINT_M
    gap = np.abs(corners @ normals.T + offsets) < 2 * _SAME_POINT_M
    radius, centres = max(planned.pivot.radius_m, _LEAST_RADIUS_M), np.empty_like(corners)
    for i, corner in enumerate(corners):
        faces = np.unique(np.round(normals[gap[i]], 4), axis=0)
        centres[i] = corner + np.linalg.lstsq(faces, np.full(len(faces), -radius), rcond=1e-3)[0]
    theta, roll = np.meshgrid(_TURNS, _ROLLS)
    turned = Rotation.from_euler("XY", np.stack([roll.ravel(), theta.ravel()], axis=-1)).as_matrix()
    height = centres @ (turned[:, 2] @ np.array(planned.R_world_object)).T
    return centres[np.any(height - height.min(axis=0) < _NEAR_M, axis=1)]
