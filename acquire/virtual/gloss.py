"""Soft highlights on glossy faces: mirror images of a lamp, which stay with camera and lamp in the image.

On each plane the highlight lies where the camera sees the lamp mirrored, whatever is printed there. Not
modelled: mirror images of anything else, roughness that differs over a face.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from acquire.virtual.layers import Outline, filled_layer

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from acquire.virtual.layers import Layer
    from acquire.virtual.lens import Lens
    from acquire.virtual.render_mesh import FaceGroup

_LAMP_WORLD = np.array([-0.05, -0.9, 0.15])
"""place of the lamp in W [m]: beside the camera, behind it and above"""
_STRENGTH = 60.0
"""grey levels in the middle of a highlight"""
_SPREAD_M = 0.022
"""1 sigma of a highlight on a face at the usual distance [m]"""
_REACH = 3.0
"""distance from a highlight's middle, over its sigma, up to which it is drawn"""


@dataclass(frozen=True)
class _Planes:
    """Planes of a group's faces: each with its triangles and a ball that holds them."""

    point: NDArray[np.float64]
    """(n, 3) a point of each [m, in O]"""
    normal: NDArray[np.float64]
    """(n, 3) outward unit normals"""
    face: NDArray[np.int64]
    """(n,) index of one of its faces"""
    corners: list[NDArray[np.float64]]
    """(t, 3, 3) corners of the triangles of each [m]"""
    middle: NDArray[np.float64]
    """(n, 3) centres of the balls [m]"""
    radius: NDArray[np.float64]
    """(n,) their radii [m]"""


class Gloss:
    """Painter of highlights on an object's faces.

    Args:
        lens: projection to pixels.
        width: image width [px].
        height: image height [px].
        groups: groups of the object's faces.
    """

    def __init__(self, lens: Lens, width: int, height: int, groups: tuple[FaceGroup, ...]) -> None:
        self._lens, self._width, self._height = lens, width, height
        self._planes = [_planes(group) for group in groups]

    def add(
        self,
        layer: Layer,
        number: int,
        seen: NDArray[np.bool_],
        pose: tuple[NDArray[np.float64], NDArray[np.float64]],
    ) -> None:
        """Add the highlights on a group's faces to its image layer, in place.

        Args:
            layer: image layer of the group; its box contains the faces.
            number: index of the group.
            seen: (f,) True for faces that the camera sees.
            pose: positions (k, 3) [m] and rotations (k, 3, 3) of the poses of an exposure; the highlights are
                those of the middle one.
        """
        middle = len(pose[0]) // 2
        p, R = pose[0][middle], pose[1][middle]
        planes = self._planes[number]
        spots = self._mirrored(planes.point @ R.T + p, planes.normal @ R.T)
        gaps = np.linalg.norm(spots - planes.middle @ R.T - p, axis=1) - planes.radius
        for n in np.flatnonzero(seen[planes.face] & (gaps < _REACH * _SPREAD_M)):
            self._add_spot(layer, planes.corners[n], spots[n], pose)

    def _mirrored(self, point: NDArray[np.float64], normal: NDArray[np.float64]) -> NDArray[np.float64]:
        """Points (n, 3) in W of planes at which the camera sees the lamp mirrored; infinite if from behind.

        Args:
            point: (n, 3) point of each plane in W [m].
            normal: (n, 3) unit normals.
        """
        eye = self._lens.p_world_camera
        height = np.sum((eye - point) * normal, axis=1)[:, None]
        lamp = np.sum((_LAMP_WORLD - point) * normal, axis=1)[:, None]
        behind = eye - 2 * height * normal
        before = (height > 0) & (lamp > 0)
        share = np.where(before, height, np.inf) / np.where(before, height + lamp, 1.0)
        return behind + (_LAMP_WORLD - behind) * share

    def _add_spot(
        self,
        layer: Layer,
        corners: NDArray[np.float64],
        spot: NDArray[np.float64],
        pose: tuple[NDArray[np.float64], NDArray[np.float64]],
    ) -> None:
        p, R = pose
        centre = self._lens.pixels(spot)
        near = self._lens.pixels(spot + _SPREAD_M * self._lens.R_camera_world[0])
        sigma = float(np.linalg.norm(near - centre))
        pixels = self._lens.pixels(corners.reshape(-1, 3) @ np.swapaxes(R, 1, 2) + p[:, None, :])
        # Counter-clockwise from outside has the inside on the left: the lines run the other way.
        edges = pixels.reshape(len(p), -1, 3, 2)
        end = edges.reshape(len(p), -1, 2)
        start = np.roll(edges, -1, axis=2).reshape(len(p), -1, 2)
        one = np.ones(end.shape[1])
        face = filled_layer(Outline(start, end, one, one), self._width, self._height)
        if face is None:
            return
        box = face.box
        x = (np.arange(box.left, box.right) - centre[0]) / sigma
        y = (np.arange(box.top, box.bottom) - centre[1]) / sigma
        light = _STRENGTH * np.exp(-0.5 * y[:, None] ** 2) * np.exp(-0.5 * x[None, :] ** 2)
        layer.light[box.within(layer.box)] += (light * face.cover).astype(np.float32)


def _planes(group: FaceGroup) -> _Planes:
    both = np.round(np.column_stack([group.face_point, group.face_normal]), 9)
    _, face, plane = np.unique(both, axis=0, return_index=True, return_inverse=True)
    corners = [group.corners[plane.reshape(-1) == number] for number in range(len(face))]
    flat = [each.reshape(-1, 3) for each in corners]
    middle = np.array([0.5 * (each.min(axis=0) + each.max(axis=0)) for each in flat])
    far = [np.linalg.norm(each - at, axis=1).max() for each, at in zip(flat, middle, strict=True)]
    return _Planes(group.face_point[face], group.face_normal[face], face, corners, middle, np.array(far))
