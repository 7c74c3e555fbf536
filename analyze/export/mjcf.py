"""Write MJCF (MuJoCo's format): one free body in O, the frame of the object's shape file.

The inertia is written as `diaginertia` with the quaternion of its principal axes, as MuJoCo stores it: no
reader has to diagonalise it (MuJoCo 4.0 would do so for `fullinertia`, to 5e-15). No mass is computed from
the shape; `boundmass`, `boundinertia`, `balanceinertia` and `settotalmass`, with which MuJoCo would alter
what it reads, are off by default. The mesh is a file of its own, since Drake, which reads MJCF too, ignores a
mesh inside the file.
"""

from __future__ import annotations

from xml.etree import ElementTree as ET

from analyze.export.body import ExportBody
from analyze.export.contact import MjcfContact
from analyze.export.mesh import MeshFile
from analyze.export.xml_text import child, document
from analyze.result.urdf_inertial import numbers
from schemas.object_spec import Box, Cylinder

AS_WRITTEN = {"angle": "radian", "inertiafromgeom": "false"}
"""attributes of `<compiler>`: angles in radians, inertia as in the file and not from the shapes"""
ROLES = {"visual": {"contype": "0", "conaffinity": "0", "group": "2"}, "collision": {"group": "3"}}
"""groups as in MuJoCo's own models: the viewer shows 2 and hides 3"""


def mjcf_text(body: ExportBody, mesh: MeshFile | None) -> str:
    """Text of the MJCF file of a body.

    Args:
        body: exported body.
        mesh: mesh in the same folder, to which the text refers; None for a box or cylinder.
    """
    inertial = body.inertial
    moments, wxyz = inertial.principal_quaternion()
    root = ET.Element("mujoco", model=body.identifier)
    child(root, "compiler", **AS_WRITTEN)
    shape = _shape(root, body, mesh)
    own = child(child(root, "worldbody"), "body", name=body.identifier)
    child(own, "freejoint", name=f"{body.identifier}_free")
    child(
        own,
        "inertial",
        pos=numbers(inertial.com),
        quat=numbers(wxyz),
        mass=numbers([inertial.mass]),
        diaginertia=numbers(moments),
    )
    for role, settings in ROLES.items():
        contact = _contact(body) if role == "collision" else {}
        child(own, "geom", name=f"{body.identifier}_{role}", mass="0", **shape, **settings, **contact)
    return document(root, body)


def _contact(body: ExportBody) -> dict[str, str]:
    """Attributes of the collision geom for friction and restitution; torsional and rolling friction stay.

    Measured ones hold against any table's own (`priority`), a stated friction is combined with the table's.
    """
    if body.restitution is not None:
        return MjcfContact(body.friction, body.restitution).attributes()
    if body.friction is None:
        return {}
    own = {"priority": "1"} if body.friction_measured else {}
    return {**own, "friction": numbers([body.friction])}


def _shape(root: ET.Element, body: ExportBody, mesh: MeshFile | None) -> dict[str, str]:
    """Attributes that give a `<geom>` its shape: type, and sizes [m] or the name of the mesh.

    MuJoCo takes half the edges of a box, and radius and half height of a cylinder. For a mesh, an `<asset>`
    that names its file is appended to `root`.
    """
    match body.model.primitive:
        case Box(size_m=size):
            return {"type": "box", "size": numbers([edge / 2 for edge in size])}
        case Cylinder(radius_m=radius, height_m=height):
            return {"type": "cylinder", "size": numbers([radius, height / 2])}
        case None:
            name = f"{body.identifier}_mesh"
            child(child(root, "asset"), "mesh", name=name, file="" if mesh is None else mesh.name)
            return {"type": "mesh", "mesh": name}
