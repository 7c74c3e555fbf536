"""Write URDF: one link whose frame is O, that of the object's shape file.

`<cylinder>` is along z, as in object files. URDF has no friction; Gazebo reads it from its own `<gazebo>`
element, which other readers skip.
"""

from __future__ import annotations

from dataclasses import replace
from xml.etree import ElementTree as ET

from analyze.export.body import ExportBody
from analyze.export.mesh import MeshFile
from analyze.export.sdf import add_surface
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
    if body.friction_measured or body.restitution is not None:
        _gazebo(child(robot, "gazebo", reference=body.identifier), body)
    return document(robot, body)


def _gazebo(extension: ET.Element, body: ExportBody) -> None:
    """Add measured friction and restitution for Gazebo."""
    if body.friction_measured and body.friction is not None:
        for name in ("mu1", "mu2"):
            child(extension, name, numbers([body.friction]))
    if body.restitution is not None:
        add_surface(child(extension, "collision"), replace(body, friction=None))


def _geometry(parent: ET.Element, body: ExportBody, mesh: MeshFile | None) -> None:
    match body.model.primitive:
        case Box(size_m=size):
            child(parent, "box", size=numbers(size))
        case Cylinder(radius_m=radius, height_m=height):
            child(parent, "cylinder", radius=numbers([radius]), length=numbers([height]))
        case None:
            child(parent, "mesh", filename="" if mesh is None else mesh.name)
