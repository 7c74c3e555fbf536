"""Shapes of the two bottles: stacks of octagonal rings, their STL files, and their convex parts.

`python -m acquire.virtual.bottle_shapes DIRECTORY` writes `spray.stl` and `juice.stl` (binary, mm, closed,
outward normals).
"""

from __future__ import annotations

import struct
import sys
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray


@dataclass(frozen=True)
class Ring:
    """Horizontal rectangle with 45 degree corners, an outline of a bottle; all lengths in mm."""

    z: float
    """height over the base"""
    half_x: float
    """half the rectangle's length along x"""
    half_y: float
    """half the rectangle's length along y"""
    corner: float
    """length that a cut corner takes off both of its sides"""

    def vertices(self) -> NDArray[np.float64]:
        """Corners (8, 3) [mm] of the octagon, counter-clockwise seen from above."""
        x, y, c = self.half_x, self.half_y, self.corner
        outline = [
            (x, c - y),
            (x, y - c),
            (x - c, y),
            (c - x, y),
            (-x, y - c),
            (-x, c - y),
            (c - x, -y),
            (x - c, -y),
        ]
        return np.array([(a, b, self.z) for a, b in outline], dtype=float)


BOTTLES: dict[str, tuple[Ring, ...]] = {
    "spray": (Ring(0, 33, 26, 6.5), Ring(138, 33, 26, 6.5), Ring(158, 21, 20, 3), Ring(200, 21, 20, 3)),
    "juice": (Ring(0, 38, 35, 9.5), Ring(146, 38, 35, 9.5), Ring(166, 23, 23, 4), Ring(190, 23, 23, 4)),
}
"""rings of body, shoulder and head, from the base up; the base is centred in the plane z = 0 of O"""


def bottle_mesh(rings: tuple[Ring, ...]) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Closed surface of a bottle: vertices (n, 3) [mm] and triangles (m, 3), normals outward.

    Args:
        rings: octagonal outlines from the base up.
    """
    vertices = np.concatenate([ring.vertices() for ring in rings])
    faces = []
    for level in range(len(rings) - 1):
        for i in range(8):
            a, b = 8 * level + i, 8 * level + (i + 1) % 8
            faces += [(a, b, b + 8), (a, b + 8, a + 8)]
    top = 8 * (len(rings) - 1)
    for i in range(1, 7):
        faces += [(0, i + 1, i), (top, top + i, top + i + 1)]
    return vertices, np.array(faces)


def convex_parts(rings: tuple[Ring, ...]) -> tuple[NDArray[np.float64], ...]:
    """Convex parts of a bottle, one between each two neighbouring rings, as corners (16, 3) [mm] each.

    Args:
        rings: octagonal outlines from the base up.
    """
    return tuple(np.concatenate([low.vertices(), high.vertices()]) for low, high in pairwise(rings))


def stl_bytes(vertices: NDArray[np.float64], faces: NDArray[np.int64], title: str) -> bytes:
    """Contents of a binary STL file of a mesh.

    Args:
        vertices: (n, 3) vertices, in the file's unit.
        faces: (m, 3) triangles as indices of vertices.
        title: text of the header, cut at 80 bytes.
    """
    corners = vertices[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    blocks = [title.encode().ljust(80, b" ")[:80], struct.pack("<I", len(faces))]
    blocks += [struct.pack("<12fH", *n, *c.ravel(), 0) for n, c in zip(normals, corners, strict=True)]
    return b"".join(blocks)


def read_stl(data: bytes) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Mesh of a binary STL file: vertices (n, 3) without duplicates, and triangles (m, 3) of indices.

    Args:
        data: contents of the file; its unit is kept.
    """
    (count,) = struct.unpack_from("<I", data, 80)
    record = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
    corners = (
        np.frombuffer(data, dtype=record, count=count, offset=84)["corners"].reshape(-1, 3).astype(float)
    )
    vertices, index = np.unique(corners, axis=0, return_inverse=True)
    return vertices, index.reshape(-1, 3)


def main(directory: Path) -> None:
    """Write `spray.stl` and `juice.stl` into a directory."""
    for name, rings in BOTTLES.items():
        (directory / f"{name}.stl").write_bytes(
            stl_bytes(*bottle_mesh(rings), title=f"percuss {name} bottle, mm")
        )


if __name__ == "__main__":
    main(Path(sys.argv[1]))
