"""Exterior of a body as an OBJ file beside the exported file.

OBJ keeps every digit, and all simulators read it.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass

from analyze.export.body import ExportBody
from analyze.result.urdf_inertial import numbers


@dataclass(frozen=True)
class MeshFile:
    """Mesh file in memory: its name and content."""

    name: str
    """file name valid in a URI (letters, digits, underscore, hyphen); the same bytes have the same name"""
    data: bytes
    """content of the OBJ file: vertices in frame O [m], and triangles"""


def mesh_file(body: ExportBody) -> MeshFile | None:
    """OBJ mesh of a body, to be put beside the exported file; None for a box or cylinder.

    Every format represents a box or cylinder itself. The mesh's name ends in a hash of its content, so that
    two exports into one folder never share a mesh by mistake.
    """
    if body.model.primitive is not None:
        return None
    vertices = "\n".join("v " + numbers(vertex) for vertex in body.model.vertices)
    faces = "\n".join(f"f {a} {b} {c}" for a, b, c in (body.model.faces + 1).tolist())
    data = f"# metres, frame O\no {body.identifier}\n{vertices}\n{faces}\n".encode()
    return MeshFile(f"{body.identifier}-{hashlib.sha256(data).hexdigest()[:8]}.obj", data)
