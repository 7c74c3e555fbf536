"""Object files of world shapes with a clean CAD mesh, a scan or convex pieces, as users have them."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Literal

import numpy as np
import trimesh
from manifold3d import Manifold
from numpy.typing import NDArray
from PIL import Image

from tests.world.pieces import convex_pieces
from tests.world.scans import NOISE_MM, scan
from tests.world.shapes import WorldShape

Kind = Literal["cad", "scan", "pieces"]
KINDS: tuple[Kind, ...] = ("cad", "scan", "pieces")
_SCALE = {"mm": 1.0, "m": 1e-3}


def write_object(
    shape: WorldShape, kind: Kind, folder: Path, tags_placed: bool = False, states_noise: bool | None = None
) -> Path:
    """Write a shape's object file and its shape file, and return the object file's path.

    The formats change from shape to shape: STL, OBJ and PLY in millimetres or metres for CAD; textured OBJ
    and GLB with seams, PLY and STL for scans; one OBJ in metres with a group per convex piece.

    Args:
        shape: the shape.
        kind: what the shape file is.
        folder: existing folder for both files.
        tags_placed: True to state the tags' places; otherwise six tags are listed without.
        states_noise: whether `surface_sd_m` is stated; None for every second scan and for no CAD mesh.
    """
    rng = np.random.default_rng([shape.seed, 5, *shape.name.encode()])
    if kind == "pieces":
        file, unit = _write_pieces(convex_pieces(shape), folder / f"{shape.name}.obj"), "m"
    elif kind == "cad":
        suffix, unit = [("stl", "mm"), ("stl", "m"), ("obj", "mm"), ("ply", "mm")][rng.integers(4)]
        file = folder / f"{shape.name}.{suffix}"
        mesh = trimesh.Trimesh(shape.vertices * _SCALE[unit], shape.faces, process=False)
        mesh.export(file)
    else:
        found = scan(shape)
        suffix, unit = [("obj", "mm"), ("obj", "m"), ("glb", "m"), ("ply", "mm"), ("stl", "mm")][
            rng.integers(5)
        ]
        file = folder / f"{shape.name}.{suffix}"
        _write_scan(found.vertices * _SCALE[unit], found.faces, file)
    stated = kind == "scan" and rng.random() < 0.5 if states_noise is None else states_noise
    path = folder / f"{shape.name}.toml"
    path.write_text(_toml(shape, file.name, unit, tags_placed, stated), encoding="utf-8")
    return path


def _toml(shape: WorldShape, file: str, unit: str, tags_placed: bool, states_noise: bool) -> str:
    lines = [
        f'name = "{shape.name}"',
        f"mass_kg = {shape.mass_kg:.5f}",
        f"mass_sd_kg = {max(1e-4, 1e-3 * shape.mass_kg):.5f}",
        "mass_includes_markers = true",
        "",
        "[shape]",
        f'file = "{file}"',
        f'unit = "{unit}"',
    ]
    if states_noise:
        lines.append(f"surface_sd_m = {1e-3 * NOISE_MM}")
    places = shape.tag_places() if tags_placed else [None] * 6
    for number, place in enumerate(places):
        lines += ["", "[[marker]]", f"id = {number}", f"size_m = {shape.tag_mm / 1000:g}"]
        if place is not None:
            rows = [[round(float(value), 6) for value in row] for row in place]
            lines.append(f"T_object_marker = {rows}")
    return "\n".join([*lines, ""])


def _write_pieces(pieces: list[Manifold], path: Path) -> Path:
    lines, base = list[str](), 1
    for number, piece in enumerate(pieces):
        mesh = piece.to_mesh()
        vertices = np.asarray(mesh.vert_properties[:, :3], float) / 1000
        lines.append(f"o convex_{number}")
        lines += [f"v {x:.7f} {y:.7f} {z:.7f}" for x, y, z in vertices]
        lines += [f"f {a} {b} {c}" for a, b, c in np.asarray(mesh.tri_verts, np.int64) + base]
        base += len(vertices)
    path.write_text("\n".join([*lines, ""]), encoding="utf-8")
    return path


def _write_scan(vertices: NDArray[np.float64], faces: NDArray[np.int64], path: Path) -> None:
    """Write a scan; in OBJ and GLB with a texture, whose charts divide the vertices along their seams."""
    if path.suffix not in {".obj", ".glb"}:
        trimesh.Trimesh(vertices, faces, process=False).export(path)
        return
    corners = vertices[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    axis = np.abs(normals).argmax(axis=1)
    chart = 2 * axis + (np.take_along_axis(normals, axis[:, None], 1)[:, 0] > 0)
    keys, index = np.unique(faces * 6 + chart[:, None], return_inverse=True)
    split = vertices[keys // 6]
    span = np.ptp(vertices, axis=0).max()
    flat = np.stack([np.delete(split, k, axis=1) for k in range(3)])[(keys % 6) // 2, np.arange(len(keys))]
    image = Image.fromarray(np.random.default_rng(1).integers(0, 255, (64, 64, 3), dtype=np.uint8), "RGB")
    visual = trimesh.visual.TextureVisuals(
        uv=(flat - flat.min(axis=0)) / span,
        material=trimesh.visual.material.PBRMaterial(baseColorTexture=image)
        if path.suffix == ".glb"
        else trimesh.visual.material.SimpleMaterial(image=image),
    )
    mesh = trimesh.Trimesh(split, index.reshape(-1, 3), visual=visual, process=False)
    if path.suffix == ".glb":
        path.write_bytes(bytes(trimesh.Scene(mesh).export(file_type="glb")))
        return
    text, files = trimesh.exchange.obj.export_obj(
        mesh, return_texture=True, mtl_name=f"{path.stem}.mtl", digits=7
    )
    path.write_text(text, encoding="utf-8")
    for name, content in files.items():
        (path.parent / name).write_bytes(
            content if isinstance(content, bytes) else io.BytesIO(content).getvalue()
        )
