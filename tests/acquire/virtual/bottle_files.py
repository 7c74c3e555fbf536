"""Makes the STL files of the two bottles in acquire/virtual/object_data from their rings.

`python -m tests.acquire.virtual.bottle_files DIRECTORY` writes `spray.stl` and `juice.stl` (binary, mm,
closed, outward normals).
"""

from __future__ import annotations

import struct
import sys
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from acquire.virtual.bottle_shapes import BOTTLES, Ring


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


def main(directory: Path) -> None:
    """Write `spray.stl` and `juice.stl` into a directory."""
    for name, rings in BOTTLES.items():
        (directory / f"{name}.stl").write_bytes(
            stl_bytes(*bottle_mesh(rings), title=f"percuss {name} bottle, mm")
        )


if __name__ == "__main__":
    main(Path(sys.argv[1]))
