"""Soft highlights on glossy faces: mirror images of a lamp, which stay with camera and lamp in the image.

On each plane the highlight lies where the camera sees the lamp mirrored, whatever is printed there. Not
modelled: mirror images of anything else, roughness that differs over a face.
"""

from __future__ import annotations

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


class Gloss:
    """Painter of highlights on an object's faces.

    Args:
        lens: projection to pixels.
        width: image width [px].
        height: image height [px].
    """

    def __init__(self, lens: Lens, width: int, height: int) -> None:
        self._lens, self._width, self._height = lens, width, height

    def add(
        self,
        layer: Layer,
        group: FaceGroup,
        seen: NDArray[np.bool_],
        pose: tuple[NDArray[np.float64], NDArray[np.float64]],
    ) -> None:
        """Add the highlights on a group's faces to its image layer, in place.

        Args:
            layer: image layer of the group; its box contains the faces.
            group: the faces.
            seen: (f,) True for faces that the camera sees.
            pose: positions (k, 3) [m] and rotations (k, 3, 3) of the poses of an exposure; the highlights are
                those of the middle one.
        """
        middle = len(pose[0]) // 2
        p, R = pose[0][middle], pose[1][middle]
        point, normal = group.face_point[seen] @ R.T + p, group.face_normal[seen] @ R.T
        corners = group.corners[seen]
        _, plane = np.unique(np.round(np.column_stack([point, normal]), 9), axis=0, return_inverse=True)
        plane = plane.reshape(-1)
        for number in np.unique(plane):
            members = np.flatnonzero(plane == number)
            spot = self._mirrored(point[members[0]], normal[members[0]])
            if spot is not None:
                self._add_spot(layer, corners[members], spot, pose)

    def _mirrored(self, point: NDArray[np.float64], normal: NDArray[np.float64]) -> NDArray[np.float64] | None:
        """Point (3,) in W of a plane at which the camera sees the lamp mirrored; None if behind the plane.

        Args:
            point: (3,) point of the plane in W [m].
            normal: (3,) its unit normal, towards the camera.
        """
        eye = self._lens.p_world_camera
        height, lamp = (eye - point) @ normal, (_LAMP_WORLD - point) @ normal
        if height <= 0 or lamp <= 0:
            return None
        behind = eye - 2 * height * normal
        return behind + (_LAMP_WORLD - behind) * (height / (height + lamp))

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
        low, high = pixels.reshape(-1, 2).min(axis=0), pixels.reshape(-1, 2).max(axis=0)
        if np.any(centre < low - _REACH * sigma) or np.any(centre > high + _REACH * sigma):
            return
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
