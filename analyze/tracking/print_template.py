"""Template of an object's own print: points of its surface with the grey values that they have at rest.

The mean of the images at rest, free of lens distortion, is projected back to the known shape. Kept are the
points where the print has strong gradients, spread over the faces, and some others, by which the light on
each face is distinguished from the print.

Frames: O (object), W (world), C (camera).
"""

# scipy and cv2 are only partly typed.
# pyright: reportMissingTypeStubs=false, reportUnknownMemberType=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import cv2
import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from analyze.tracking.camera_model import distort, project_ideal, project_jacobian, world_to_camera
from analyze.tracking.print_equations import light_waves
from analyze.types import CameraModel

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from analyze.types import Array, IntArray, LensModel

Box = tuple[slice, slice]
"""rows and columns of a part of an image"""

BLURS_PX = (3.0, 0.8)
"""1 sigma of the blur of the two levels [px]: coarse to catch, fine to measure"""
POINTS = 1500
"""number of points of a template"""
CELL_PX = 12
"""edge of the cells over which the points are spread [px]"""
_MOST_PER_CELL = 24
"""largest number of strong points in one cell"""
BORDER_M, _LEAST_BORDER_PX = 4e-3, 4
"""distance from the outline and from edges between faces within which no point is taken [m, px]: as far as a
hand puts the object off its planned place, so that no point lies on the background"""
_SAME_FACE_RAD = math.radians(15.0)
"""largest angle between neighbouring triangles of one face"""
_PLAIN_SHARE = 0.15
"""share of the points taken anywhere, for the light on each face"""
_ROUND = 0.05
"""rms of the normals' components about their faces' means from which on faces are round"""
_GOLDEN = 0.5 * (math.sqrt(5.0) - 1.0)
"""golden ratio, whose multiples spread most evenly"""
_LEAST_POINTS = 40
"""points below which a face is not used"""
_COMPARED = 8
"""largest number of images at rest from which their noise is measured"""
_STEEPEST = 0.2
"""least cosine of the angle between a triangle's normal and the line of sight: grazing faces smear"""


@dataclass(frozen=True)
class PrintTemplate:
    """Points of the surface and their grey values at rest, for all levels of blur."""

    points: Array
    """(m, 3) points at rest in W [m]"""
    normals: Array
    """(m, 3) outward normals of the surface there, in W"""
    face: IntArray
    """(m,) number of each point's face, from 0"""
    grey: Array
    """(levels, m) grey values at rest"""
    slope: Array
    """(halves, levels, m, 3) gradient along the surface at rest, in W [grey/m], by each half of the images"""
    strength: Array
    """(m,) gradient that both halves of the images show, of the finer level [grey/px]; 0 within two borders
    of the outline, where the background may be seen"""
    noise: Array
    """(levels,) robust scale of one image's grey values about those at rest [grey]"""
    grain: float
    """noise from pixel to pixel that all images at rest share, as coding freezes it [grey]"""
    waves: Array
    """(m, w) waves of the light over the faces"""

    @property
    def faces(self) -> int:
        """Number of faces with points."""
        return int(self.face.max(initial=-1)) + 1

    @property
    def is_round(self) -> bool:
        """True if the faces with points are curved."""
        of_face = [self.normals[self.face == name] for name in range(self.faces)]
        off = np.concatenate([normals - normals.mean(axis=0) for normals in of_face])
        return bool(np.sqrt(np.mean(off**2)) > _ROUND)


class IdealImages:
    """Images of one camera free of lens distortion.

    Args:
        camera: camera that takes the images; its pose does not matter.
    """

    def __init__(self, camera: CameraModel) -> None:
        """Prepare the map from ideal to raw pixels."""
        self.camera = camera
        self._map = _raw_pixels(
            camera.width, camera.height, camera.K.tobytes(), camera.distortion.tobytes(), camera.model
        )
        self._plain = not np.any(camera.distortion)

    def ideal(self, image: NDArray[np.uint8], box: Box | None = None) -> NDArray[np.float32]:
        """Image (h, w) free of lens distortion, whole or only in a box of pixels."""
        rows, columns = box or (slice(None), slice(None))
        if self._plain:
            return image[rows, columns].astype(np.float32)
        coarse, fine = self._map
        taken = cv2.remap(image, coarse[rows, columns], fine[rows, columns], cv2.INTER_LINEAR)
        return taken.astype(np.float32)


@lru_cache(maxsize=2)
def _raw_pixels(
    width: int, height: int, K: bytes, distortion: bytes, model: LensModel
) -> tuple[NDArray[np.int16], NDArray[np.uint16]]:
    """Map for `cv2.remap` from the ideal pixels of a camera to its raw ones; cached, as it takes 0.3 s."""
    camera = CameraModel(
        width, height, np.frombuffer(K).reshape(3, 3), np.frombuffer(distortion), np.eye(4), model
    )
    columns, rows = np.meshgrid(np.arange(width, dtype=float), np.arange(height, dtype=float))
    raw = distort(camera, np.stack([columns, rows], axis=-1)).astype(np.float32)
    coarse, fine = cv2.convertMaps(raw[..., 0], raw[..., 1], cv2.CV_16SC2)
    return coarse.astype(np.int16, copy=False), fine.astype(np.uint16, copy=False)


def blurred(image: NDArray[np.float32], blur_px: float) -> NDArray[np.float32]:
    """Image (h, w) with a Gaussian blur of `blur_px` (1 sigma)."""
    return np.asarray(cv2.GaussianBlur(image, (0, 0), blur_px), dtype=np.float32)


class BlurredPart:
    """Part of one image free of distortion, blurred level by level as it is needed.

    Args:
        images: removal of the camera's distortion.
        image: (h, w) the camera's image.
        box: rows and columns of the part.
        blurs: 1 sigma of the blur of the levels [px].
    """

    def __init__(
        self, images: IdealImages, image: NDArray[np.uint8], box: Box, blurs: Sequence[float] = BLURS_PX
    ) -> None:
        """Take the part."""
        self.blurs = blurs
        self._ideal = images.ideal(image, box)
        self._origin = np.array([box[1].start, box[0].start])
        self._levels: dict[int, NDArray[np.float32]] = {}

    def at(self, pixels: Array, level: int) -> Array:
        """Grey values (n,) at (n, 2) [px] of the whole image; pixels outside take the nearest value."""
        if level not in self._levels:
            self._levels[level] = blurred(self._ideal, self.blurs[level])
        inner = (pixels - self._origin).astype(np.float32)
        found = cv2.remap(
            self._levels[level], inner[:, :1], inner[:, 1:], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
        )
        return found[:, 0].astype(np.float64)


def print_template(
    rest: Sequence[NDArray[np.float32]],
    camera: CameraModel,
    vertices: Array,
    triangles: IntArray,
    pose: tuple[Array, Array],
    points: int = POINTS,
    blurs: Sequence[float] = BLURS_PX,
) -> PrintTemplate:
    """Template of an object at rest, from the images there.

    The points are chosen by the gradients of one half of the images. Those of the other half show which of
    them are print and which are noise.

    Args:
        rest: (h, w) images at rest, two or more, free of lens distortion.
        camera: camera with its pose in W.
        vertices: (v, 3) vertices of the shape in O [m].
        triangles: (t, 3) indices of its triangles, counter-clockwise from outside.
        pose: rotation (3, 3) and place (3,) [m] of O in W.
        points: number of points to take.
        blurs: 1 sigma of the blur of the levels [px], from coarse to fine.
    """
    placed = vertices @ pose[0].T + pose[1]
    seen, faces = visible_triangles(camera, placed, triangles)
    box = _around(seen, blurs[0])
    seen = seen[box]
    top, left = box[0].start, box[1].start
    part = [image[box] for image in rest]
    halves = [np.mean(part[::2], axis=0), np.mean(part[1::2], axis=0)]
    distance = float(np.linalg.norm(placed.mean(axis=0) - camera.T_world_camera[:3, 3]))
    border = max(_LEAST_BORDER_PX, round(BORDER_M * camera.K[0, 0] / distance))
    steep = np.hypot(*_gradients(blurred(halves[0], blurs[-1])))
    rows, columns = _spread(steep, _inner(seen, faces, border), points)
    surely_on = _inner(seen, faces, 2 * border)[rows, columns]
    corner = placed[triangles[seen[rows, columns]]]
    normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    pixels = np.column_stack([columns + left, rows + top])
    at = points_on_planes(camera, pixels, corner[:, 0], normal)
    R, t = world_to_camera(camera)
    by_point = project_jacobian(camera, at @ R.T + t) @ R
    levels = [[blurred(half, blur) for blur in blurs] for half in halves]
    grey = 0.5 * np.array(
        [one[rows, columns] + other[rows, columns] for one, other in zip(*levels, strict=True)]
    )
    slope, by_pixel = np.empty((2, len(blurs), len(rows), 3)), []
    for half, level in np.ndindex(2, len(blurs)):
        by_x, by_y = _gradients(levels[half][level])
        by_pixel.append(np.column_stack([by_x[rows, columns], by_y[rows, columns]]))
        along = np.einsum("ni,nij->nj", by_pixel[-1], by_point)
        slope[half, level] = along - np.sum(along * normal, axis=1, keepdims=True) * normal
    common = np.sum(by_pixel[len(blurs) - 1] * by_pixel[-1], axis=1)
    strength = surely_on * np.sqrt(np.maximum(common, 0.0))
    noise = np.array([_scatter(part, blur, rows, columns) for blur in blurs])
    grain = float(np.median(np.abs(_grain(np.mean(halves, axis=0))[rows, columns])) * 1.4826)
    face = faces[seen[rows, columns]]
    names, counts = np.unique(face, return_counts=True)
    kept = np.isin(face, names[counts >= _LEAST_POINTS])
    _, number = np.unique(face[kept], return_inverse=True)
    places = pixels[kept]
    return PrintTemplate(
        at[kept],
        normal[kept],
        number.astype(np.int64),
        grey[:, kept],
        slope[:, :, kept],
        strength[kept],
        noise,
        grain,
        light_waves(places, number),
    )


def points_on_planes(camera: CameraModel, pixels: Array, corners: Array, normals: Array) -> Array:
    """Points (n, 3) in W [m] seen at ideal pixels (n, 2), each on its plane.

    Args:
        camera: camera with its pose in W.
        pixels: (n, 2) ideal pixels.
        corners: (n, 3) a point of each plane in W [m].
        normals: (n, 3) normals of the planes, of any length.
    """
    ray = np.column_stack([pixels, np.ones(len(pixels))]) @ np.linalg.inv(camera.K).T
    ray = ray @ camera.T_world_camera[:3, :3].T
    eye = camera.T_world_camera[:3, 3]
    depth = np.sum((corners - eye) * normals, axis=1) / np.sum(ray * normals, axis=1)
    return eye + depth[:, None] * ray


def by_rest_pose(template: PrintTemplate, camera: CameraModel, pivot: Array) -> Array:
    """Derivative (m, 3, 3) of the points by the pose at rest, over that of the body's own turn and shift.

    The pose at rest is a turn about W's z at the pivot point, and shifts along x and y. A point stays on its
    line of sight; its depth follows the face.

    Args:
        template: points at rest.
        camera: camera with its pose in W.
        pivot: (3,) point of the pivot's centre line at rest, in W [m].
    """
    ray = template.points - camera.T_world_camera[:3, 3]
    moved = _moved(template.points - pivot)
    depth = np.einsum("ni,nij->nj", template.normals, moved) / np.sum(template.normals * ray, axis=1)[:, None]
    return ray[:, :, None] * depth[:, None, :] - moved


def _moved(arms: Array) -> Array:
    """Derivative (m, 3, 3) of points, at arms (m, 3) from the pivot, by a turn about z and shifts in x, y."""
    moved = np.zeros((len(arms), 3, 3))
    moved[:, :, 0] = np.cross([0.0, 0.0, 1.0], arms)
    moved[:, 0, 1] = moved[:, 1, 2] = 1.0
    return moved


def _gradients(image: NDArray[np.float32]) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Derivatives (h, w) of an image along x and y [grey/px]."""
    return (
        np.asarray(cv2.Sobel(image, cv2.CV_32F, 1, 0, scale=0.125), dtype=np.float32),
        np.asarray(cv2.Sobel(image, cv2.CV_32F, 0, 1, scale=0.125), dtype=np.float32),
    )


def _scatter(rest: Sequence[NDArray[np.float32]], blur_px: float, rows: IntArray, columns: IntArray) -> float:
    """Robust scale of the grey values of one blurred image at the points [grey], by neighbouring images."""
    if not len(rows):
        return 0.0
    values = [blurred(image, blur_px)[rows, columns] for image in rest[:_COMPARED]]
    return 1.4826 * float(np.median(np.abs(np.diff(values, axis=0)))) / math.sqrt(2.0)


def _grain(image: NDArray[np.float32]) -> NDArray[np.float32]:
    """White noise (h, w) of an image, from which smooth shades and lines are taken (Immerkaer 1996)."""
    second = np.array([[1.0, -2.0, 1.0]])
    return np.asarray(cv2.filter2D(image, cv2.CV_32F, second.T @ second), dtype=np.float32) / 6.0


def visible_triangles(camera: CameraModel, placed: Array, triangles: IntArray) -> tuple[IntArray, IntArray]:
    """Number of the triangle in each pixel (h, w), -1 for none, and the face of each triangle (t,).

    Triangles are drawn from the farthest to the nearest; grazing ones hide others, but are not seen.
    """
    corner = placed[triangles]
    normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-15)
    sight = camera.T_world_camera[:3, 3] - corner.mean(axis=1)
    distance = np.linalg.norm(sight, axis=1)
    facing = np.sum(normal * sight, axis=1) / distance
    R, t = world_to_camera(camera)
    pixels = np.rint(project_ideal(camera, placed @ R.T + t) * 16).astype(np.int32)
    drawn = np.full((camera.height, camera.width), -1, dtype=np.int32)
    for number in np.argsort(-distance):
        if facing[number] > 0:
            value = int(number) if facing[number] > _STEEPEST else -1
            cv2.fillConvexPoly(drawn, pixels[triangles[number]], value, shift=4)
    return drawn.astype(np.int64), smooth_faces(placed, triangles)


def _around(seen: IntArray, blur_px: float) -> Box:
    """Box of pixels around those (h, w) that show a triangle, wider by the reach of the coarse blur."""
    margin = math.ceil(4 * blur_px)
    spans = [np.flatnonzero((seen >= 0).any(axis=axis)) for axis in (1, 0)]
    if not len(spans[0]):
        return slice(0, margin), slice(0, margin)
    low, high = (np.array([span[end] for span in spans]) for end in (0, -1))
    return slice(max(int(low[0]) - margin, 0), int(high[0]) + margin), slice(
        max(int(low[1]) - margin, 0), int(high[1]) + margin
    )


def smooth_faces(vertices: Array, triangles: IntArray) -> IntArray:
    """Face (t,) of each triangle: neighbours within `_SAME_FACE_RAD` of each other are of one face.

    Args:
        vertices: (v, 3) vertices [m].
        triangles: (t, 3) their indices.
    """
    corner = vertices[triangles]
    normals = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-15)
    _, merged = np.unique(np.round(vertices, 7), axis=0, return_inverse=True)
    corners = np.sort(merged.reshape(-1)[triangles], axis=1)
    edges = np.concatenate([corners[:, [0, 1]], corners[:, [1, 2]], corners[:, [0, 2]]])
    owner = np.tile(np.arange(len(triangles)), 3)
    order = np.lexsort(edges.T)
    edges, owner = edges[order], owner[order]
    shared = np.flatnonzero(np.all(edges[1:] == edges[:-1], axis=1))
    one, other = owner[shared], owner[shared + 1]
    smooth = np.sum(normals[one] * normals[other], axis=1) > math.cos(_SAME_FACE_RAD)
    links = coo_array((np.ones(int(smooth.sum())), (one[smooth], other[smooth])), shape=(len(triangles),) * 2)
    return np.asarray(connected_components(links, directed=False)[1], dtype=np.int64)


def _inner(seen: IntArray, faces: IntArray, border: int) -> NDArray[np.bool_]:
    """True (h, w) for pixels on a face, more than `border` [px] from the outline or another face."""
    face = np.where(seen >= 0, faces[np.maximum(seen, 0)] + 1, 0).astype(np.float32)
    kernel = np.ones((2 * border + 1, 2 * border + 1), np.uint8)
    same = cv2.dilate(face, kernel) == cv2.erode(face, kernel)
    return np.asarray((seen >= 0) & same, dtype=np.bool_)


def _spread(size: NDArray[np.float32], usable: NDArray[np.bool_], points: int) -> tuple[IntArray, IntArray]:
    """Rows and columns of the points: the strongest gradients cell by cell, and some others.

    The others are taken evenly from all usable pixels.
    """
    rows, columns = np.nonzero(usable)
    if not len(rows):
        return rows.astype(np.int64), columns.astype(np.int64)
    strength = size[rows, columns]
    cell = (rows // CELL_PX) * (usable.shape[1] // CELL_PX + 1) + columns // CELL_PX
    order = np.lexsort((-strength, cell))
    first = np.r_[0, np.flatnonzero(np.diff(cell[order])) + 1]
    rank = np.arange(len(order)) - np.repeat(first, np.diff(np.r_[first, len(order)]))
    spread = np.flatnonzero(rank < _MOST_PER_CELL)
    by_strength = order[spread[np.argsort(-strength[order[spread]], kind="stable")]]
    strong = by_strength[: round(points * (1 - _PLAIN_SHARE))]
    # By the golden ratio: equal steps through rows of equal length would lie on a few lines.
    others = (np.arange(round(points * _PLAIN_SHARE)) * _GOLDEN % 1.0 * len(rows)).astype(np.int64)
    chosen = np.unique(np.concatenate([strong, others]))
    return rows[chosen].astype(np.int64), columns[chosen].astype(np.int64)
