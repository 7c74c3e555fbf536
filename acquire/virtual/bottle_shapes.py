"""Shapes of the two bottles: octagonal rings, their convex parts, and the reader of their STL files."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray


@dataclass(frozen=True)
class Ring:
    """Horizontal outline of a bottle at one height: a rectangle with corners cut off at 45 degrees.

    All lengths are in mm, heights over the bottle's base.
    """

    z: float
    """height over the base"""
    half_x: float
    """half the rectangle's length along x"""
    half_y: float
    """half the rectangle's length along y"""
    corner: float
    """length that a cut corner takes off both of its sides"""

    def vertices(self) -> NDArray[np.float64]:
        """Corners (8, 3) [mm] of the octagonal outline, counter-clockwise seen from above.

        The origin is in the middle of the bottle's base, z upwards.
        """
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


def convex_parts(rings: tuple[Ring, ...]) -> tuple[NDArray[np.float64], ...]:
    """Convex parts of a bottle, one between each two neighbouring rings, from the base up.

    Args:
        rings: octagonal outlines from the base up.

    Returns:
        Corners (16, 3) [mm] of each part, those of the lower ring first.
    """
    return tuple(np.concatenate([low.vertices(), high.vertices()]) for low, high in pairwise(rings))


def read_stl(data: bytes) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Mesh of a binary STL file: vertices (n, 3) without duplicates, triangles (m, 3) as their indices.

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
