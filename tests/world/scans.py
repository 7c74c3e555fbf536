"""Scans of world shapes as depth fusion gives them: even triangles, rounded edges, noise, holes."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from tests.world.shapes import WorldShape

Array = NDArray[np.float64]
Faces = NDArray[np.int64]
NOISE_MM = 0.5
"""standard deviation of the distance of a scan's points from the true surface [mm]"""
_MAX_VOXELS = 1.2e7
_SUB = 8
"""subdivisions of a voxel along x and y for its filled share, two along z"""


@dataclass(frozen=True)
class Scan:
    """Triangle mesh of a simulated scan, with the sizes of its noise, its holes and its base."""

    vertices: Array
    """(n, 3) [mm, in O, the object's frame]"""
    faces: Faces
    """(m, 3) triangles, normals outward"""
    independent_mm: float
    """standard deviation of each vertex's own noise [mm]"""
    correlated_mm: float
    """standard deviation of the noise that neighbours share [mm]"""
    holes: int
    has_bottom: bool


def scan(shape: WorldShape, seed: int = 0) -> Scan:
    """Simulated scan of a shape: some 16 000, 50 000 or 150 000 triangles, 0.5 mm of noise, 0 to 4 holes.

    Three scans in ten have no base.

    Args:
        shape: the shape.
        seed: seed of resolution, noise, holes, and of whether the base is missing.
    """
    rng = np.random.default_rng([seed, shape.seed, 71, *shape.name.encode()])
    count = rng.choice([16_000, 50_000, 150_000], p=[0.6, 0.25, 0.15])
    pitch = float(np.clip(np.sqrt(3 * shape.solid.surface_area() / count), 0.5, 2.5))
    pitch = max(pitch, float((np.prod(shape.size_mm + 8) / _MAX_VOXELS) ** (1 / 3)))
    vertices, faces = fused(shape, pitch)
    if len(faces) > 300_000:
        raise ValueError(f"{shape.name}: {len(faces)} faces of a scan")
    share = rng.choice([0.1, 0.3, 0.7]) if pitch > 1 else 0.1
    independent, correlated = NOISE_MM * np.sqrt(share), NOISE_MM * np.sqrt(1 - share)
    normals = _vertex_normals(vertices, faces)
    shift = independent * rng.normal(size=len(vertices)) + correlated * _waves(vertices, rng)
    noisy = vertices + shift[:, None] * normals
    kept = np.ones(len(faces), bool)
    middles = vertices[faces].mean(axis=1)
    has_bottom = bool(rng.random() > 0.3)
    if not has_bottom:
        heights = middles @ shape.up
        down = _face_normals(vertices, faces) @ shape.up < -0.7
        kept &= ~(down & (heights < heights.min() + 2 * pitch))
    holes = int(rng.integers(0, 5))
    for start in rng.integers(0, len(faces), holes):
        radius = min(rng.uniform(1.5, 5) * max(pitch, 1), 0.06 * float(shape.size_mm.max()))
        kept &= np.linalg.norm(middles - middles[start], axis=1) > radius
    return _compact(Scan(noisy, faces[kept], float(independent), float(correlated), holes, has_bottom))


def fused(shape: WorldShape, pitch: float) -> tuple[Array, Faces]:
    """Closed surface of nearly square quads, split into triangles, around the filled voxels of a shape.

    Args:
        shape: the shape.
        pitch: edge of the voxels [mm].

    Returns:
        Vertices (n, 3) [mm, in O] and triangles (m, 3), normals outward.
    """
    box = shape.solid.bounding_box()
    low = np.array(box[:3]) - 3 * pitch
    counts = np.ceil((np.array(box[3:]) + 3 * pitch - low) / pitch).astype(int)
    filled = np.zeros((counts[2], counts[1], counts[0]), np.float32)
    steps = 2
    for k in range(counts[2]):
        for j in range(steps):
            section = shape.solid.slice(low[2] + (k + (j + 0.5) / steps) * pitch)
            filled[k] += _raster(section.to_polygons(), low[:2], pitch, counts[:2]) / steps
    return surface_net(gaussian_filter(filled, 0.6) - 0.5, low + pitch / 2, pitch)


def _raster(
    polygons: list[Array], low: Array, pitch: float, counts: NDArray[np.int64]
) -> NDArray[np.float32]:
    """Share (rows, columns) of each pixel that lies within polygons, by the even-odd rule.

    Args:
        polygons: corners (n, 2) of each polygon [mm].
        low: (2,) x and y of the image's corner [mm].
        pitch: edge of a pixel [mm].
        counts: (2,) number of pixels along x and y.
    """
    image = np.zeros((counts[1] * _SUB, counts[0] * _SUB), np.uint8)
    if polygons:
        lines = [np.round(((each - low) / pitch * _SUB - 0.5) * 256).astype(np.int32) for each in polygons]
        cv2.fillPoly(image, lines, 1, shift=8)
    return image.reshape(counts[1], _SUB, counts[0], _SUB).mean(axis=(1, 3), dtype=np.float32)


def surface_net(field: NDArray[np.float32], origin: Array, pitch: float) -> tuple[Array, Faces]:
    """Surface where a field on a grid [z, y, x] changes sign, one vertex per cell that it crosses.

    Args:
        field: (c, b, a) field, positive inside, negative at the border.
        origin: (3,) place x, y, z of the first grid point.
        pitch: distance of the grid points.

    Returns:
        Vertices (n, 3) in the unit of `origin`, and triangles (m, 3), normals outward.
    """
    field = np.ascontiguousarray(field.transpose(2, 1, 0))  # x, y, z
    inside = field > 0
    cells = tuple(n - 1 for n in field.shape)
    sums, number = np.zeros((*cells, 3), np.float32), np.zeros(cells, np.uint8)
    crossings = []
    for axis in range(3):
        a, b = np.moveaxis(field, axis, 0)[:-1], np.moveaxis(field, axis, 0)[1:]
        at = np.argwhere(np.moveaxis((a > 0) != (b > 0), 0, axis))
        start = field[tuple(at.T)]
        end = field[tuple((at + np.eye(3, dtype=int)[axis]).T)]
        point = at.astype(np.float32)
        point[:, axis] += start / (start - end)
        u, v = (axis + 1) % 3, (axis + 2) % 3
        around = []
        for du, dv in ((0, 0), (-1, 0), (-1, -1), (0, -1)):
            cell = at.copy()
            cell[:, u] += du
            cell[:, v] += dv
            np.add.at(sums, tuple(cell.T), point)
            np.add.at(number, tuple(cell.T), 1)
            around.append(np.ravel_multi_index(tuple(cell.T), cells))
        crossings.append((np.stack(around, axis=1), inside[tuple(at.T)]))
    used = np.flatnonzero(number)
    vertices = sums.reshape(-1, 3)[used] / number.ravel()[used, None]
    index = np.full(number.size, -1, np.int64)
    index[used] = np.arange(len(used))
    quads = np.concatenate([np.where(fore[:, None], quad, quad[:, ::-1]) for quad, fore in crossings])
    quads = index[quads]
    faces = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    return origin + pitch * vertices.astype(float), faces


def _waves(points: Array, rng: np.random.Generator) -> Array:
    """Smooth random field (n,) of variance 1 at points (n, 3) [mm], with waves of 15 to 80 mm."""
    lengths = rng.uniform(15, 80, 40)
    directions = rng.normal(size=(40, 3))
    directions *= (2 * np.pi / lengths / np.linalg.norm(directions, axis=1))[:, None]
    phases = rng.uniform(0, 2 * np.pi, 40)
    field = np.zeros(len(points))
    for direction, phase in zip(directions, phases, strict=True):
        field += np.cos(points @ direction + phase)
    return field / np.sqrt(20)


def _face_normals(vertices: Array, faces: Faces) -> Array:
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    normals = np.cross(b - a, c - a)
    return normals / np.maximum(np.linalg.norm(normals, axis=1), 1e-12)[:, None]


def _vertex_normals(vertices: Array, faces: Faces) -> Array:
    normals, each = np.zeros_like(vertices), _face_normals(vertices, faces)
    for i in range(3):
        np.add.at(normals, faces[:, i], each)
    return normals / np.maximum(np.linalg.norm(normals, axis=1), 1e-12)[:, None]


def _compact(made: Scan) -> Scan:
    used = np.unique(made.faces)
    index = np.full(len(made.vertices), -1, np.int64)
    index[used] = np.arange(len(used))
    return Scan(
        made.vertices[used],
        index[made.faces],
        made.independent_mm,
        made.correlated_mm,
        made.holes,
        made.has_bottom,
    )
