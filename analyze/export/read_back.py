"""Read the ten inertial parameters back from an exported file, to check it.

The libraries are yourdfpy (URDF), rod (SDF, Gazebo), mujoco (MJCF), usd-core (USD) and rosbags (ROS). No code
is shared with the writers.
"""

# These libraries are only partly typed.
# pyright: reportUnknownVariableType=false, reportUnknownArgumentType=false
# pyright: reportUnknownMemberType=false, reportAttributeAccessIssue=false

from __future__ import annotations

import importlib.util
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar
from xml.etree import ElementTree as ET

import numpy as np
from scipy.spatial.transform import Rotation

from analyze.errors import ExportError
from analyze.export.body import Inertial
from analyze.export.formats import Format
from analyze.types import Array
from schemas.software import extra_command

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

Part = TypeVar("Part")

READERS = {
    Format.URDF: ("yourdfpy", "yourdfpy"),
    Format.SDF: ("rod", "rod"),
    Format.MJCF: ("mujoco", "mujoco"),
    Format.USD: ("pxr", "usd-core"),
    Format.ROS: ("rosbags", "rosbags"),
    Format.GAZEBO: ("rod", "rod"),
}
"""module and package that read each format"""


def refuse_without_reader(wanted: Format) -> None:
    """Raise ExportError if the library that reads the format `wanted` back is not installed.

    It is called before any work.

    Raises:
        ExportError: the library is missing.
    """
    module, package = READERS[wanted]
    if importlib.util.find_spec(module) is None:
        raise ExportError(
            f"every {wanted.value.upper()} file is read back after writing, but the package that reads it is "
            f"missing: {package}: {extra_command('export')}"
        )


def read_back(path: Path, written: Format) -> Inertial:
    """Read the inertial parameters of the first body in a file.

    Args:
        path: the file, with its mesh beside it; or the folder of a Gazebo model.
        written: format of the file.

    Returns:
        Mass, centre of mass and inertia tensor about it, in the frame of the body, which is a link in URDF
        and SDF and a prim in USD.

    Raises:
        ExportError: the library is missing, cannot read the file, or finds in it no body, no inertial
            parameters or (USD) other units than kg and m; or a mesh that the file names is missing.
    """
    try:
        readers = {
            Format.URDF: _urdf,
            Format.SDF: _sdf,
            Format.MJCF: _mjcf,
            Format.USD: _usd,
            Format.ROS: _ros,
            Format.GAZEBO: _gazebo,
        }
        return readers[written](path)
    except Exception as error:  # each library raises its own kinds
        package = READERS[written][1]
        raise ExportError(
            f"{path.name}: {package} does not read what was written: {' '.join(str(error).split())}"
        ) from error


def _urdf(path: Path) -> Inertial:
    import yourdfpy

    # The scene and its meshes are for display: the parameters need neither.
    link = yourdfpy.URDF.load(str(path), build_scene_graph=False, load_meshes=False).robot.links[0]
    shapes = [_required(part.geometry, "geometry") for part in (*link.visuals, *link.collisions)]
    _refuse_missing(path, [shape.mesh.filename for shape in shapes if shape.mesh is not None])
    own = _required(link.inertial, "inertial")
    pose = _required(own.origin, "origin")
    return _in_frame(
        _required(own.mass, "mass"), pose[:3, 3], _required(own.inertia, "inertia"), pose[:3, :3]
    )


def _sdf(path: Path) -> Inertial:
    # Otherwise rod runs an installed Gazebo, and cannot be imported if that is older than 2022.
    os.environ.setdefault("ROD_SKIP_SDFORMAT_CHECK", "1")
    import rod

    link = rod.Sdf.load(path, is_urdf=False).models()[0].links()[0]
    _refuse_missing(
        path,
        [
            part.geometry.mesh.uri
            for part in (*link.visuals(), *link.collisions())
            if part.geometry.mesh is not None
        ],
    )
    own = _required(link.inertial, "inertial")
    pose = _required(own.pose, "pose").transform()
    return _in_frame(own.mass, pose[:3, 3], own.inertia.matrix(), pose[:3, :3])


def _mjcf(path: Path) -> Inertial:
    import mujoco

    body = mujoco.MjModel.from_xml_path(str(path)).body(1)  # 0 is the world
    axes = Rotation.from_quat(body.iquat, scalar_first=True).as_matrix()
    return _in_frame(float(body.mass[0]), body.ipos, np.diag(body.inertia), axes)


def _usd(path: Path) -> Inertial:
    from pxr import Usd, UsdGeom, UsdPhysics

    stage = Usd.Stage.Open(str(path))
    prim = next(each for each in stage.Traverse() if each.HasAPI(UsdPhysics.RigidBodyAPI))
    own = UsdPhysics.MassAPI(prim)
    if (UsdPhysics.GetStageKilogramsPerUnit(stage), UsdGeom.GetStageMetersPerUnit(stage)) != (1.0, 1.0):
        raise ValueError("it finds other units than kilograms and metres")
    quaternion = own.GetPrincipalAxesAttr().Get()
    wxyz = [quaternion.GetReal(), *quaternion.GetImaginary()]
    axes = Rotation.from_quat(wxyz, scalar_first=True).as_matrix()
    return _in_frame(
        own.GetMassAttr().Get(),
        own.GetCenterOfMassAttr().Get(),
        np.diag(own.GetDiagonalInertiaAttr().Get()),
        axes,
    )


def _gazebo(path: Path) -> Inertial:
    config = ET.parse(path / "model.config")  # noqa: S314 - our own file
    return _sdf(path / _required(config.findtext("sdf"), "sdf"))


def _ros(path: Path) -> Inertial:
    """Inertial parameters of a ROS message in a YAML or JSON file, serialised and read back by rosbags."""
    from rosbags.typesys import Stores, get_typestore
    from ruamel.yaml import YAML

    # JSON is a part of YAML.
    content = YAML(typ="safe", pure=True).load(path.read_text(encoding="utf-8"))
    store = get_typestore(Stores.ROS2_HUMBLE)
    name = "geometry_msgs/msg/InertiaStamped"
    message = store.deserialize_cdr(store.serialize_cdr(_message(store, name, content), name), name)
    if not message.header.frame_id:
        raise ValueError("it finds no frame")
    own, com = message.inertia, message.inertia.com
    rows = [[own.ixx, own.ixy, own.ixz], [own.ixy, own.iyy, own.iyz], [own.ixz, own.iyz, own.izz]]
    return _in_frame(own.m, np.array([com.x, com.y, com.z]), np.array(rows), np.eye(3))


def _message(store: Typestore, name: str, content: Mapping[str, object]) -> object:
    """Message of a type, with all fields of its definition and no others.

    Raises:
        ValueError: a field is missing or unknown.
    """
    fields = dict(store.fielddefs[name][1])
    if set(fields) != set(content):
        raise ValueError(f"{name} has the fields {', '.join(fields)}, not {', '.join(content)}")
    values = {}
    for field, value in content.items():
        kind = fields[field][1]
        values[field] = _message(store, str(kind), value) if isinstance(value, Mapping) else value
    return store.types[name](**values)


def _required(part: Part | None, name: str) -> Part:
    """Return `part` of an exported file; raise ValueError with its `name` if it is None."""
    if part is None:
        raise ValueError(f"it finds no {name}")
    return part


def _refuse_missing(path: Path, meshes: Sequence[str]) -> None:
    """Raise FileNotFoundError if a mesh that a URDF or SDF file names is missing.

    The libraries that read these formats do not open meshes here.

    Args:
        path: the file.
        meshes: names of its meshes, relative to its folder.
    """
    for name in meshes:
        # model://FOLDER is the folder of that name, beside other models.
        place = path.parent.parent if name.startswith("model://") else path.parent
        if not (place / name.removeprefix("model://")).is_file():
            raise FileNotFoundError(f"{name} is not beside it")


def _in_frame(mass: float, com: Array, tensor: Array, axes: Array) -> Inertial:
    """Inertial parameters in the frame of a body, with the inertia tensor turned into it from other axes.

    The frame is that of a link (URDF, SDF), body (MJCF) or prim (USD).

    Args:
        mass: mass [kg].
        com: (3,) centre of mass in that frame [m].
        tensor: (3, 3) inertia tensor about the centre of mass, along `axes` [kg m²].
        axes: (3, 3) unit axes in that frame, as columns.
    """
    return Inertial(
        float(mass), np.array(com, dtype=np.float64), axes @ np.asarray(tensor, dtype=np.float64) @ axes.T
    )
