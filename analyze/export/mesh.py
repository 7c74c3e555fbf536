"""The exterior as a mesh file beside the body's own: OBJ, which keeps every digit and which all simulators read."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass

import numpy as np

from analyze.export.body import Body


@dataclass(frozen=True)
class MeshFile:
    """A mesh file and its name."""

    name: str
    """letters, digits, underscore, hyphen: valid in a URI as it stands, the same bytes have the same name"""
    data: bytes


def mesh_file(body: Body) -> MeshFile | None:
    """The mesh that goes beside the body's file; None for a primitive, which every format can say exactly.

    Its name ends in a hash of its content, so that two exports into one folder never take each other's mesh.
    """
    if body.model.primitive is not None:
        return None
    vertices = "\n".join("v " + numbers(vertex) for vertex in body.model.vertices)
    faces = "\n".join(f"f {a} {b} {c}" for a, b, c in (body.model.faces + 1).tolist())
    data = f"# metres, frame O\no {body.identifier}\n{vertices}\n{faces}\n".encode()
    return MeshFile(f"{body.identifier}-{hashlib.sha256(data).hexdigest()[:8]}.obj", data)


def numbers(values: np.ndarray | list[float] | tuple[float, ...]) -> str:
    """Numbers with blanks between, each with as many digits as it takes to be read as the same number."""
    # 0.0 is added, for -0 is 0 to every reader and only puzzles people.
    return " ".join(repr(float(value) + 0.0) for value in values)
