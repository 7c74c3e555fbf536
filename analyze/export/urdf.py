"""Write URDF: one link whose frame is O, that of the object's shape file.

`<cylinder>` is along z, as in object files.
"""

from __future__ import annotations

from xml.etree import ElementTree as ET

from analyze.export.body import ExportBody
from analyze.export.mesh import MeshFile
from analyze.export.xml_text import child, document
from analyze.result.urdf_inertial import inertial_element, numbers
from schemas.object_spec import Box, Cylinder


def urdf_text(body: ExportBody, mesh: MeshFile | None) -> str:
    """Text of the URDF file of a body.

    Args:
        body: exported body.
        mesh: mesh in the same folder, to which the text refers; None for a box or cylinder.
    """
    robot = ET.Element("robot", name=body.identifier)
    link = child(robot, "link", name=body.identifier)
    own = body.inertial
    link.append(inertial_element(own.mass, own.com, own.inertia))
    for role in ("visual", "collision"):
        element = child(link, role, name=f"{body.identifier}_{role}")
        child(element, "origin", xyz="0 0 0", rpy="0 0 0")
        _geometry(child(element, "geometry"), body, mesh)
    return document(robot, body)


def _geometry(parent: ET.Element, body: ExportBody, mesh: MeshFile | None) -> None:
    match body.model.primitive:
        case Box(size_m=size):
            child(parent, "box", size=numbers(size))
        case Cylinder(radius_m=radius, height_m=height):
            child(parent, "cylinder", radius=numbers([radius]), length=numbers([height]))
        case None:
            child(parent, "mesh", filename="" if mesh is None else mesh.name)
