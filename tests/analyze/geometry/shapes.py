"""Object specifications and meshes for tests."""

from __future__ import annotations

import numpy as np
import trimesh

from analyze.geometry.object_model import load_object_model
from schemas.document import validate
from schemas.object_spec import ObjectSpec

SIZE = np.array([60.0, 50.0, 200.0])
"""size of `box_mesh` [mm]"""
IDENTITY = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]


def spec_of(shape: dict, mass: float = 0.05, markers: list | None = None, **more) -> ObjectSpec:
    data = {
        "name": "thing",
        "mass_kg": mass,
        "mass_sd_kg": 0.0001,
        "shape": shape,
        "marker": markers or [{"id": 0, "size_m": 0.03, "T_object_marker": IDENTITY}],
        **more,
    }
    return validate(ObjectSpec, data, "thing.toml")


def box_triangles(size, centre=(0.0, 0.0, 0.0)) -> np.ndarray:
    corners = (
        np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)]) * size + centre
    )
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return corners[np.array([face for a, b, c, d in quads for face in ((a, b, c), (a, c, d))])]


def stl(triangles) -> bytes:
    """Binary STL of triangles (f, 3, 3)."""
    record = np.zeros(len(triangles), dtype=[("n", "<f4", 3), ("v", "<f4", (3, 3)), ("a", "<u2")])
    record["v"] = triangles
    return b"\0" * 80 + np.uint32(len(triangles)).tobytes() + record.tobytes()


def obj(vertices, faces) -> bytes:
    lines = [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in vertices] + [
        f"f {a + 1} {b + 1} {c + 1}" for a, b, c in faces
    ]
    return ("\n".join(lines) + "\n").encode()


def load(data: bytes, name: str, unit="mm", mass=0.05, **shape):
    return load_object_model(spec_of({"file": name, "unit": unit, **shape}, mass), data, name)


def box_mesh(size=SIZE, centre=(0, 0, 0)) -> trimesh.Trimesh:
    return trimesh.creation.box(size, trimesh.transformations.translation_matrix(centre))


def mesh_bytes(kind: str, mesh: trimesh.Trimesh) -> bytes:
    if kind == "gltf":
        files = trimesh.exchange.gltf.export_gltf(trimesh.Scene(mesh), embed_buffers=True)
        return files["model.gltf"]
    data = mesh.export(file_type=kind)
    return data.encode() if isinstance(data, str) else data
