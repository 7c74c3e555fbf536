"""The object and its tags as layers, at k poses."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import cv2
import numpy as np

from acquire.virtual.backdrop import LIGHT_WORLD
from acquire.virtual.layers import Layer, Outline, composed, covered, layer
from acquire.virtual.render_mesh import FaceGroup, face_groups
from acquire.virtual.render_tag import Lines, tag_lines

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from acquire.virtual.lens import Lens
    from acquire.virtual.objects import VirtualObject

_ALBEDO = 150.0
"""grey level of a face that looks along W's -y, where the camera stands"""
_AMBIENT = 0.5
_SHADES = 5.0
"""grey levels between the shades of faces, about twice the noise: neighbours of one shade need no border, so that a round wall has few"""


@dataclass(frozen=True)
class _Card:
    group: int
    T_object_marker: NDArray[np.float64]
    points: NDArray[np.float64]
    """(n, 3) m in O"""
    lines: Lines


class ObjectPainter:
    """Draws one object through one lens.

    Not modelled: the rounding of edges, what is printed on the faces, gloss, light from one face on another.
    """

    def __init__(self, virtual_object: VirtualObject, lens: Lens, width: int, height: int) -> None:
        self._lens, self._width, self._height = lens, width, height
        self._groups = face_groups(virtual_object.mesh_vertices, virtual_object.mesh_faces)
        self._cards: list[_Card] = []
        for marker in virtual_object.spec.marker:
            if marker.T_object_marker is None:
                continue
            T = np.array(marker.T_object_marker)
            lines = tag_lines(marker.family, marker.id)
            points = lines.points * (marker.size_m / lines.tag_cells) @ T[:3, :2].T + T[:3, 3]
            self._cards.append(_Card(self._nearest_group(T[:3, 3]), T, points, lines))
        self._vertices = virtual_object.mesh_vertices

    def layer(self, p_world_object: NDArray[np.float64], R_world_object: NDArray[np.float64]) -> Layer | None:
        """Everything of the object, None where it is out of view. (k, 3) m, (k, 3, 3); what is visible is decided at the middle pose."""
        middle = len(p_world_object) // 2
        R = R_world_object[middle]
        camera_object = (self._lens.p_world_camera - p_world_object[middle]) @ R
        pose = (p_world_object, R_world_object)
        order = sorted(range(len(self._groups)), key=lambda g: float(np.linalg.norm(self._groups[g].vertices.mean(axis=0) - camera_object)))
        drawn: list[Layer] = []
        for g in order:
            facing = [c for c in self._cards if c.group == g and (camera_object - c.T_object_marker[:3, 3]) @ c.T_object_marker[:3, 2] > 0]
            cards = [item for item in (self._card(card, R, pose) for card in facing) if item is not None]
            surface = self._group(self._groups[g], camera_object, R, pose)
            if surface is not None:
                drawn.append(covered(surface, cards))
            else:
                drawn += cards
        return composed(drawn) if drawn else None

    def shadow(self, p_world_object: NDArray[np.float64], R_world_object: NDArray[np.float64]) -> Layer | None:
        """What the object shades of the table, one pose (3,), (3, 3); softened by 9 px."""
        points = self._vertices @ R_world_object.T + p_world_object
        points = points - np.maximum(points[:, 2:], 0.0) / LIGHT_WORLD[2] * LIGHT_WORLD
        # cv2.convexHull runs clockwise in an image whose y points down
        hull = cv2.convexHull(self._lens.pixels(points).astype(np.float32), clockwise=False)[:, 0].astype(np.float64)
        one = np.ones(len(hull))
        found = layer(Outline(hull[None], np.roll(hull, -1, axis=0)[None], one, one), self._width, self._height)
        if found is None:
            return None
        box = found.box.grown(6, self._width, self._height)
        cover = np.zeros((box.bottom - box.top, box.right - box.left), np.float32)
        cover[found.box.within(box)] = found.cover
        cover = np.asarray(cv2.blur(cover, (9, 5)), np.float32)
        return Layer(box, cover, cover)

    def _nearest_group(self, point: NDArray[np.float64]) -> int:
        gaps = [np.linalg.norm(np.maximum(0.0, np.maximum(g.vertices.min(0) - point, point - g.vertices.max(0)))) for g in self._groups]
        return int(np.argmin(gaps))

    def _pixels(self, points: NDArray[np.float64], pose: tuple[NDArray[np.float64], NDArray[np.float64]]) -> NDArray[np.float64]:
        p, R = pose
        return self._lens.pixels(points @ np.swapaxes(R, 1, 2) + p[:, None, :])

    def _card(
        self, card: _Card, R_world_object: NDArray[np.float64], pose: tuple[NDArray[np.float64], NDArray[np.float64]]
    ) -> Layer | None:
        brightness = _shade(R_world_object @ card.T_object_marker[:3, 2])
        pixels = self._pixels(card.points, pose)
        lines = card.lines
        outline = Outline(pixels[:, lines.start], pixels[:, lines.end], lines.value * brightness, lines.cover)
        return layer(outline, self._width, self._height)

    def _group(
        self,
        group: FaceGroup,
        camera_object: NDArray[np.float64],
        R_world_object: NDArray[np.float64],
        pose: tuple[NDArray[np.float64], NDArray[np.float64]],
    ) -> Layer | None:
        visible = np.append(np.sum((camera_object - group.face_point) * group.face_normal, axis=1) > 0, False)
        shade = np.round(_ALBEDO * _shade(group.face_normal @ R_world_object.T) / _SHADES) * _SHADES
        value = np.append(shade, 0.0) * visible
        # counter-clockwise on the surface is counter-clockwise in the image: the inside lies on the left
        step = value[group.right_face] - value[group.left_face]
        cover = visible[group.right_face].astype(np.float64) - visible[group.left_face]
        used = (step != 0) | (cover != 0)
        pixels = self._pixels(group.points, pose)
        outline = Outline(pixels[:, group.start[used]], pixels[:, group.end[used]], step[used], cover[used])
        return layer(outline, self._width, self._height)


def _shade(normal_world: NDArray[np.float64]) -> NDArray[np.float64]:
    """Lambert plus ambient, (..., 3) unit normals to (...) factors; 1 for a face that looks along -y."""
    lit = np.maximum(normal_world @ LIGHT_WORLD, 0.0)
    return (_AMBIENT + (1.0 - _AMBIENT) * lit) / (_AMBIENT + (1.0 - _AMBIENT) * -LIGHT_WORLD[1])
