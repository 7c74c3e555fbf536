"""Write URDF: one link whose frame is O, that of the object's shape file.

`<origin>` of `<inertial>` is the centre of mass in the link's frame; the tensor is about it, along the link's
axes for rpy = 0 (wiki.ros.org/urdf/XML/link). `<cylinder>` is along z, as in object files.
"""

from __future__ import annotations

from xml.etree import ElementTree as ET

from analyze.export.body import ExportBody, Inertial
from analyze.export.mesh import MeshFile, numbers
from analyze.export.xml_text import child, document, tensor_entries
from schemas.object_spec import Box, Cylinder


def urdf_text(body: ExportBody, mesh: MeshFile | None) -> str:
    """Text of the URDF file of a body.

    Args:
        body: exported body.
        mesh: mesh in the same folder, to which the text refers; None for a box or cylinder.
    """
    robot = ET.Element("robot", name=body.identifier)
    link = child(robot, "link", name=body.identifier)
    link.append(inertial_element(body.inertial))
    for role in ("visual", "collision"):
        element = child(link, role, name=f"{body.identifier}_{role}")
        child(element, "origin", xyz="0 0 0", rpy="0 0 0")
        _geometry(child(element, "geometry"), body, mesh)
    return document(robot, body)


def inertial_element(inertial: Inertial) -> ET.Element:
    """XML element `<inertial>` of a URDF link: centre of mass, mass and inertia tensor.

    The link's frame is O, that of the object's shape file.
    """
    own = ET.Element("inertial")
    child(own, "origin", xyz=numbers(inertial.com), rpy="0 0 0")
    child(own, "mass", value=numbers([inertial.mass]))
    child(own, "inertia", **tensor_entries(inertial.inertia))
    return own


def _geometry(parent: ET.Element, body: ExportBody, mesh: MeshFile | None) -> None:
    match body.model.primitive:
        case Box(size_m=size):
            child(parent, "box", size=numbers(size))
        case Cylinder(radius_m=radius, height_m=height):
            child(parent, "cylinder", radius=numbers([radius]), length=numbers([height]))
        case None:
            child(parent, "mesh", filename="" if mesh is None else mesh.name)
