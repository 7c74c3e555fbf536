"""Write SDFormat 1.7, which Gazebo reads since version 11: one model with one link in frame O.

O is the frame of the object's shape file.

`<inertial><pose>` is the centre of mass in the link's frame with roll, pitch and yaw of the axes that
`<inertia>` refers to (sdformat.org/spec?elem=link#inertial_pose): 0 here, for the axes of O. `<cylinder>` is
along z.
"""

from __future__ import annotations

from xml.etree import ElementTree as ET

from analyze.export.body import ExportBody
from analyze.export.contact import BOUNCE_SPEED
from analyze.export.mesh import MeshFile
from analyze.export.xml_text import child, document
from analyze.result.urdf_inertial import numbers, tensor_entries
from schemas.object_spec import Box, Cylinder

VERSION = "1.7"


def sdf_text(body: ExportBody, mesh: MeshFile | None, address: str = "") -> str:
    """Text of the SDF file of a body.

    Args:
        body: exported body.
        mesh: mesh to which the text refers; None for a box or cylinder.
        address: URI of the mesh's folder, with a slash at its end; empty for the SDF file's own folder.
    """
    inertial = body.inertial
    root = ET.Element("sdf", version=VERSION)
    link = child(child(root, "model", name=body.identifier), "link", name=body.identifier)
    own = child(link, "inertial")
    child(own, "pose", f"{numbers(inertial.com)} 0 0 0")
    child(own, "mass", numbers([inertial.mass]))
    entries = child(own, "inertia")
    for name, value in tensor_entries(inertial.inertia).items():
        child(entries, name, value)
    for role in ("visual", "collision"):
        element = child(link, role, name=f"{body.identifier}_{role}")
        _geometry(child(element, "geometry"), body, None if mesh is None else address + mesh.name)
        if role == "collision":
            add_surface(element, body)
    return document(root, body)


def add_surface(collision: ET.Element, body: ExportBody) -> None:
    """Add `<surface>` with friction and bounce to a `<collision>`; nothing if neither is known.

    Friction is that of both directions of ODE's friction pyramid.
    """
    if body.friction is None and body.restitution is None:
        return
    surface = child(collision, "surface")
    if body.friction is not None:
        ode = child(child(surface, "friction"), "ode")
        for name in ("mu", "mu2"):
            child(ode, name, numbers([body.friction]))
    if body.restitution is not None:
        bounce = child(surface, "bounce")
        child(bounce, "restitution_coefficient", numbers([body.restitution]))
        child(bounce, "threshold", numbers([BOUNCE_SPEED]))


def _geometry(parent: ET.Element, body: ExportBody, mesh_uri: str | None) -> None:
    match body.model.primitive:
        case Box(size_m=size):
            child(child(parent, "box"), "size", numbers(size))
        case Cylinder(radius_m=radius, height_m=height):
            element = child(parent, "cylinder")
            child(element, "radius", numbers([radius]))
            child(element, "length", numbers([height]))
        case None:
            child(child(parent, "mesh"), "uri", mesh_uri)
