"""Image layers of the object, its tags and its shadow, for the virtual camera's renderer."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import cv2
import numpy as np

from acquire.virtual.backdrop import FAR_EDGE_M, LIGHT_WORLD
from acquire.virtual.gloss import Gloss
from acquire.virtual.layers import Layer, Outline, compose, filled_layer, masked, overlay
from acquire.virtual.render_mesh import FaceGroup, face_groups
from acquire.virtual.render_parts import PartGroups
from acquire.virtual.render_print import printed_groups
from acquire.virtual.render_tag import Lines, tag_lines

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from acquire.virtual.lens import Lens
    from acquire.virtual.objects import VirtualObject
    from acquire.virtual.render_print import PrintLines

_ALBEDO = 150.0
"""grey level of a face whose normal points along W's -y, towards the camera"""
_AMBIENT = 0.5
"""fraction of the light that comes from all sides"""
_SHADES = 5.0
"""step between the grey levels of faces, about twice the noise: neighbours of equal shade need no boundary,
so that a round wall has few"""
_ON_FACE_M = 0.002
"""distance of a card's middle from a part's face up to which the card may lie on it [m]"""
_OVER_CARD = 0.1
"""height over a card's plane, as a fraction of the tag's edge, from which on a part can hide the card: on a
round wall the card's rim stands off the surface"""


@dataclass(frozen=True)
class _Card:
    """Tag on its white card, which is stuck to one group of the object's faces: pose and boundary lines."""

    group: int
    """index of the group of faces that the card is on"""
    T_object_marker: NDArray[np.float64]
    """(4, 4) pose of the tag in O, the object's frame [m]; z points out of the card"""
    points: NDArray[np.float64]
    """(n, 3) points of the tag's lines [m, in O]"""
    lines: Lines
    """boundary lines of the tag, as indices of `points`"""
    size_m: float
    """edge of the black square [m]"""


class ObjectPainter:
    """Painter of image layers of one object with its tags, and of its shadow.

    A mesh with hollows is drawn as convex parts, which fill small hollows. Not modelled: the rounding of
    edges, relief of the print, light reflected between faces.

    Args:
        virtual_object: the object; tags without a given pose on it are not drawn.
        lens: projection to pixels.
        width: image width [px].
        height: image height [px].
    """

    def __init__(self, virtual_object: VirtualObject, lens: Lens, width: int, height: int) -> None:
        self._lens, self._width, self._height = lens, width, height
        parts = virtual_object.drawn_parts
        self._parts = None if parts is None else PartGroups(parts)
        if self._parts is None:
            self._groups = face_groups(virtual_object.mesh_vertices, virtual_object.mesh_faces)
        else:
            self._groups = self._parts.groups
        self._prints = printed_groups(virtual_object, self._groups)
        glossy = virtual_object.packaging.glossy
        self._gloss = Gloss(lens, width, height, self._groups) if glossy else None
        self._cards: list[_Card] = []
        for marker in virtual_object.spec.marker:
            if marker.T_object_marker is None:
                continue
            T = np.array(marker.T_object_marker)
            lines = tag_lines(marker.family, marker.id)
            points = lines.points * (marker.size_m / lines.tag_cells) @ T[:3, :2].T + T[:3, 3]
            group = (
                self._nearest_group(T[:3, 3])
                if self._parts is None
                else self._part_below(T, self._groups[: self._parts.count])
            )
            self._cards.append(_Card(group, T, points, lines, marker.size_m))
        self._vertices = virtual_object.mesh_vertices
        self._triangles = virtual_object.mesh_vertices[virtual_object.mesh_faces]
        self._edges = self._triangles[:, 1:] - self._triangles[:, :1]

    def layer(self, p_world_object: NDArray[np.float64], R_world_object: NDArray[np.float64]) -> Layer | None:
        """Image layer (grey levels and cover) of object and tags, averaged over the k poses of an exposure.

        None if they are out of view. The cover is the covered fraction of each pixel. The visible faces and
        tags, their order and their shading are those of the middle pose.

        Args:
            p_world_object: (k, 3) positions of the object's origin in W, the world frame [m].
            R_world_object: (k, 3, 3) rotations from O, the object's frame, to W.
        """
        middle = len(p_world_object) // 2
        R = R_world_object[middle]
        camera_object = (self._lens.p_world_camera - p_world_object[middle]) @ R
        pose = (p_world_object, R_world_object)

        def distance(g: int) -> float:
            return float(np.linalg.norm(self._groups[g].vertices.mean(axis=0) - camera_object))

        if self._parts is not None:
            return self._layer_of_parts(self._parts, camera_object, R, pose)

        def faces_camera(card: _Card) -> bool:
            return bool((camera_object - card.T_object_marker[:3, 3]) @ card.T_object_marker[:3, 2] > 0)

        drawn: list[Layer] = []
        for g in sorted(range(len(self._groups)), key=distance):
            facing = [card for card in self._cards if card.group == g and faces_camera(card)]
            cards = [item for item in (self._card(card, R, pose) for card in facing) if item is not None]
            surface = self._group(g, camera_object, R, pose)
            if surface is not None:
                drawn.append(overlay(surface, cards))
            else:
                drawn += cards
        return compose(drawn) if drawn else None

    def _layer_of_parts(
        self,
        parts: PartGroups,
        camera_object: NDArray[np.float64],
        R: NDArray[np.float64],
        pose: tuple[NDArray[np.float64], NDArray[np.float64]],
    ) -> Layer | None:
        """Image layer of an object that is drawn as convex parts, with its tags; None if out of view.

        A tag is hidden by those surfaces before its own that reach over the plane of its card; those beside
        it in the same face do not hide it. A tag in a hollow that its own surface fills is hidden as a whole,
        if the object hides its middle.

        Args:
            parts: surfaces of the parts.
            camera_object: (3,) position of the camera in O, the object's frame, in the middle pose [m].
            R: (3, 3) rotation from O to W of the middle pose.
            pose: positions (k, 3) [m] and rotations (k, 3, 3) of the poses.
        """
        order = parts.front_to_back(camera_object)
        surfaces = {g: self._group(g, camera_object, R, pose) for g in order}
        visible = [layer for g in order if (layer := surfaces[g]) is not None]
        cards: list[Layer] = []
        for card in self._cards:
            T = card.T_object_marker
            drawn = self._card(card, R, pose) if (camera_object - T[:3, 3]) @ T[:3, 2] > 0 else None
            if drawn is None:
                continue
            own = next(n for n, g in enumerate(order) if card.group in parts.members[g])
            fills = _reaches_over(self._groups[order[own]], T, card.size_m)
            if fills and self._hidden(T, camera_object):
                continue
            over = [
                layer
                for g in order[:own]
                if (layer := surfaces[g]) is not None and _reaches_over(self._groups[g], T, card.size_m)
            ]
            cards.append(masked(drawn, over))
        if not visible:
            return None
        return overlay(compose(visible), cards)

    def shadow(
        self, p_world_object: NDArray[np.float64], R_world_object: NDArray[np.float64]
    ) -> Layer | None:
        """Image layer whose cover (share of each pixel) is the object's shadow; None if it is out of view.

        The shadow lies on the table: it is the image of the convex hull of the object's vertices, projected
        along the light onto z = 0, and softened by a mean over 9 px along the rows and 5 px along the
        columns. It ends at the table's far edge. The layer's light equals its cover and has no meaning.

        Args:
            p_world_object: (3,) position of the object's origin in W, the world frame [m].
            R_world_object: (3, 3) rotation from O, the object's frame, to W.
        """
        points = self._vertices @ R_world_object.T + p_world_object
        points = points - np.maximum(points[:, 2:], 0.0) / LIGHT_WORLD[2] * LIGHT_WORLD
        if points[:, 1].max() > FAR_EDGE_M:
            points = _within_table(points[:, :2])
            if not len(points):
                return None
        # With clockwise=False, cv2.convexHull runs clockwise in an image whose y points down.
        hull = cv2.convexHull(self._lens.pixels(points).astype(np.float32), clockwise=False)[:, 0].astype(
            np.float64
        )
        one = np.ones(len(hull))
        found = filled_layer(
            Outline(hull[None], np.roll(hull, -1, axis=0)[None], one, one), self._width, self._height
        )
        if found is None:
            return None
        box = found.box.grown(6, self._width, self._height)
        cover = np.zeros((box.bottom - box.top, box.right - box.left), np.float32)
        cover[found.box.within(box)] = found.cover
        cover = np.asarray(cv2.blur(cover, (9, 5)), np.float32)
        return Layer(box, cover, cover)

    def _nearest_group(self, point: NDArray[np.float64]) -> int:
        boxes = [(group.vertices.min(0), group.vertices.max(0)) for group in self._groups]
        gaps = [np.linalg.norm(np.maximum(0.0, np.maximum(low - point, point - high))) for low, high in boxes]
        return int(np.argmin(gaps))

    @staticmethod
    def _part_below(T_object_marker: NDArray[np.float64], parts: tuple[FaceGroup, ...]) -> int:
        """Number of the convex part on which a tag's card lies.

        Where several parts touch the card's middle, it is the one with a face there whose normal is closest
        to the card's.

        Args:
            T_object_marker: (4, 4) pose of the card in O, the object's frame [m].
            parts: faces of each part.
        """
        best = (-2.0, -np.inf)
        found = 0
        for number, group in enumerate(parts):
            heights = np.sum((T_object_marker[:3, 3] - group.face_point) * group.face_normal, axis=1)
            alike = group.face_normal @ T_object_marker[:3, 2]
            gap = float(heights.max())
            fits = float(alike[heights > gap - _ON_FACE_M].max()) if abs(gap) < _ON_FACE_M else -1.0
            if (fits, -abs(gap)) > best:
                best, found = (fits, -abs(gap)), number
        return found

    def _hidden(self, T_object_marker: NDArray[np.float64], camera_object: NDArray[np.float64]) -> bool:
        """True if the object's surface hides the middle of a card from the camera.

        Args:
            T_object_marker: (4, 4) pose of the card in O, the object's frame [m].
            camera_object: (3,) position of the camera in O [m].
        """
        start = T_object_marker[:3, 3] + _ON_FACE_M * T_object_marker[:3, 2]
        origin, edge, other = self._triangles[:, 0], self._edges[:, 0], self._edges[:, 1]
        ray = camera_object - start
        across = np.cross(ray, other)
        area = np.sum(edge * across, axis=1)
        area = np.where(area == 0, np.inf, area)
        near = start - origin
        turned = np.cross(near, edge)
        u, v = np.sum(near * across, axis=1) / area, turned @ ray / area
        reach = np.sum(other * turned, axis=1) / area
        return bool(((u >= 0) & (v >= 0) & (u + v <= 1) & (reach > 0) & (reach < 1)).any())

    def _pixels(
        self, points: NDArray[np.float64], pose: tuple[NDArray[np.float64], NDArray[np.float64]]
    ) -> NDArray[np.float64]:
        p, R = pose
        return self._lens.pixels(points @ np.swapaxes(R, 1, 2) + p[:, None, :])

    def _card(
        self,
        card: _Card,
        R_world_object: NDArray[np.float64],
        pose: tuple[NDArray[np.float64], NDArray[np.float64]],
    ) -> Layer | None:
        brightness = _shade(R_world_object @ card.T_object_marker[:3, 2])
        pixels = self._pixels(card.points, pose)
        lines = card.lines
        outline = Outline(pixels[:, lines.start], pixels[:, lines.end], lines.value * brightness, lines.cover)
        return filled_layer(outline, self._width, self._height)

    def _group(
        self,
        number: int,
        camera_object: NDArray[np.float64],
        R_world_object: NDArray[np.float64],
        pose: tuple[NDArray[np.float64], NDArray[np.float64]],
    ) -> Layer | None:
        """Image layer of the faces of one group, with their print; None if out of view."""
        group, printed = self._groups[number], self._prints[number]
        visible = np.append(np.sum((camera_object - group.face_point) * group.face_normal, axis=1) > 0, False)
        shade = np.round(_ALBEDO * _shade(group.face_normal @ R_world_object.T) / _SHADES) * _SHADES
        value = np.append(shade, 0.0) * visible
        # Counter-clockwise on the surface is counter-clockwise in the image: the inside lies on the left.
        step = value[group.right_face] - value[group.left_face]
        cover = visible[group.right_face].astype(np.float64) - visible[group.left_face]
        used = (step != 0) | (cover != 0)
        pixels = self._pixels(group.points, pose)
        outline = Outline(pixels[:, group.start[used]], pixels[:, group.end[used]], step[used], cover[used])
        if printed is not None:
            outline = self._with_print(outline, printed, value / _ALBEDO, pose)
        layer = filled_layer(outline, self._width, self._height)
        if layer is not None and self._gloss is not None:
            self._gloss.add(layer, number, visible[:-1].astype(bool), pose)
        return layer

    def _with_print(
        self,
        outline: Outline,
        printed: PrintLines,
        shade: NDArray[np.float64],
        pose: tuple[NDArray[np.float64], NDArray[np.float64]],
    ) -> Outline:
        """Outline of a group of faces with the lines of its print.

        Args:
            outline: boundary lines of the faces.
            printed: print of the group.
            shade: (f + 1,) shading factor of each face, 0 for those that are not seen.
            pose: positions (k, 3) [m] and rotations (k, 3, 3) of the poses.
        """
        step = printed.step * (shade[printed.face] - shade[printed.other_face])
        seen = step != 0
        step = step[seen]
        return Outline(
            np.concatenate([outline.start, self._pixels(printed.start[seen], pose)], axis=1),
            np.concatenate([outline.end, self._pixels(printed.end[seen], pose)], axis=1),
            np.concatenate([outline.value, step]),
            np.concatenate([outline.cover, np.zeros(len(step))]),
        )


def _within_table(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Corners (m, 3) of the hull of points (n, 2) on the table's plane [m], cut off at the far edge."""
    hull = cv2.convexHull(points.astype(np.float32))[:, 0].astype(np.float64)
    after = np.roll(hull, -1, axis=0)
    inside = hull[:, 1] <= FAR_EDGE_M
    crossing = inside != (after[:, 1] <= FAR_EDGE_M)
    share = (FAR_EDGE_M - hull[crossing, 1:]) / (after[crossing, 1:] - hull[crossing, 1:])
    cut = np.concatenate([hull[inside], hull[crossing] + share * (after[crossing] - hull[crossing])])
    return np.column_stack([cut, np.zeros(len(cut))])


def _reaches_over(group: FaceGroup, T_object_marker: NDArray[np.float64], size_m: float) -> bool:
    """True if faces reach over the plane of a card, by more than a card's rim stands off a round wall.

    Args:
        group: the faces.
        T_object_marker: (4, 4) pose of the card in O, the object's frame [m].
        size_m: edge of the tag's black square [m].
    """
    heights = (group.vertices - T_object_marker[:3, 3]) @ T_object_marker[:3, 2]
    return bool(heights.max() > _OVER_CARD * size_m)


def _shade(normal_world: NDArray[np.float64]) -> NDArray[np.float64]:
    """Shading factor (...) of unit normals (..., 3) in W, the world frame: diffuse plus ambient light.

    The diffuse part follows Lambert's law; the factor is 1 for a normal along -y, towards the camera.
    """
    lit = np.maximum(normal_world @ LIGHT_WORLD, 0.0)
    return (_AMBIENT + (1.0 - _AMBIENT) * lit) / (_AMBIENT + (1.0 - _AMBIENT) * -LIGHT_WORLD[1])
