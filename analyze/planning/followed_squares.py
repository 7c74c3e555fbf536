"""Squares on an object by which it is followed in flight: its tags, or without any its printed sides."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from analyze.geometry.object_model import ObjectModel
from analyze.geometry.rotations import apply
from analyze.types import Array
from schemas.object_spec import ObjectSpec

_SIDE_SHARE = 0.6
"""edge of the square on a side, over the side's shorter edge"""
_LEAST_SIDE = 0.3
"""shorter edge of a side over that of the largest one, below which the side is not counted on"""


@dataclass(frozen=True)
class FollowedSquare:
    """Square on the object that the camera can follow."""

    name: str
    """name that a person can point at: "tag 3" or "the +x side"."""
    size: float
    """edge [m]"""
    T_object_square: Array
    """(4, 4) pose of the square in O: z out of the object, translation in m"""

    @property
    def corners(self) -> Array:
        """Corners (4, 3) in O [m]."""
        half = 0.5 * self.size
        return apply(self.T_object_square, np.array([[x * half, y * half, 0.0] for x, y in _SIGNS]))


_SIGNS = ((-1, -1), (-1, 1), (1, -1), (1, 1))


def tag_squares(spec: ObjectSpec) -> tuple[FollowedSquare, ...]:
    """Tags of an object whose place on it is known."""
    return tuple(
        FollowedSquare(f"tag {marker.name}", marker.size_m, np.array(marker.T_object_marker))
        for marker in spec.marker
        if marker.T_object_marker is not None
    )


def side_squares(model: ObjectModel) -> tuple[FollowedSquare, ...]:
    """Squares on the sides of an object's bounding box, without the narrow ones."""
    low, high = (np.asarray(bound, dtype=np.float64) for bound in model.bounds)
    extent, middle = high - low, 0.5 * (low + high)
    shorter = np.array([np.delete(extent, axis).min() for axis in range(3)])
    squares: list[FollowedSquare] = []
    for axis in np.flatnonzero(shorter >= _LEAST_SIDE * shorter.max()):
        for sign, name in ((1.0, "+"), (-1.0, "−")):
            normal = sign * np.eye(3)[axis]
            up = np.eye(3)[(axis + 1) % 3]
            pose = np.eye(4)
            pose[:3, :3] = np.column_stack([np.cross(up, normal), up, normal])
            pose[:3, 3] = middle + 0.5 * extent[axis] * normal
            squares.append(
                FollowedSquare(f"the {name}{'xyz'[axis]} side", _SIDE_SHARE * float(shorter[axis]), pose)
            )
    return tuple(squares)
